//! A ray meets a sphere, or what an affine transform made of it.
//!
//! A point is on the surface where `|M (x - c)| = 1`, c the centre \[m\] and M \[1/m\] the map onto
//! the unit sphere. With `o' = M (o - c)`, `d' = M d`, `b = o'.d' / d'.d'` and `f = o' - b d'` (the
//! foot of the perpendicular), the ray crosses at
//! `t = -b -+ sqrt((1 - f.f) / d'.d')` \[m\].
//! The normal is the gradient, along `M^T M (x - c)`; a uniform point of the unit sphere has, on
//! the surface, the area density `1 / (4 pi |cof(M^-1) p'|)` \[1/m2\].
//!
//! Source: Haines, Guenther, Akenine-Moeller 2019, "Precision improvements for ray/sphere
//! intersection" (Ray Tracing Gems, ch. 7): the foot of the perpendicular, and the smaller root
//! from the product of the roots. Where we depart: f64 throughout, so distant small spheres and
//! near large ones need no further care; one form serves spheres and ellipsoids.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};

/// The image of the unit sphere under an affine map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ellipsoid {
    center: DVec3,
    from_unit: DMat3,
    to_unit: DMat3,
}

impl Ellipsoid {
    /// `from_unit` is invertible; its columns are the half axes. \[m\]
    pub(super) fn new(center: DVec3, from_unit: DMat3) -> Self {
        Self {
            center,
            from_unit,
            to_unit: from_unit.inverse(),
        }
    }

    /// Smallest box around it, rounded outwards.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        // The support function along axis k is the length of row k.
        let half = DVec3::new(
            self.from_unit.row(0).length(),
            self.from_unit.row(1).length(),
            self.from_unit.row(2).length(),
        );
        let outward = |v: DVec3, towards: fn(f32) -> f32| {
            let v = v.as_vec3();
            Vec3::new(towards(v.x), towards(v.y), towards(v.z))
        };
        (
            outward(self.center - half, f32::next_down),
            outward(self.center + half, f32::next_up),
        )
    }

    /// Both crossings of the line, nearer first.
    #[inline]
    pub(super) fn roots(&self, origin: Vec3, direction: Vec3) -> Option<[f64; 2]> {
        let o = self.to_unit * (origin.as_dvec3() - self.center);
        let d = self.to_unit * direction.as_dvec3();
        let a = d.length_squared();
        let b = o.dot(d);
        let foot = o - (b / a) * d;
        let discriminant = a * (1.0 - foot.length_squared());
        if discriminant < 0.0 {
            return None;
        }
        let q = -b - discriminant.sqrt().copysign(b);
        if q == 0.0 {
            return None;
        }
        let (near, far) = (q / a, (o.length_squared() - 1.0) / q);
        Some([near.min(far), near.max(far)])
    }

    /// Where the hit at t is on the unit sphere, pulled back onto it.
    pub(super) fn unit_point(&self, origin: Vec3, direction: Vec3, t: f64) -> DVec3 {
        let x = origin.as_dvec3() + t * direction.as_dvec3();
        (self.to_unit * (x - self.center)).normalize()
    }

    /// World position of a point of the unit sphere. \[m\]
    pub(super) fn position(&self, unit: DVec3) -> DVec3 {
        self.center + self.from_unit * unit
    }

    /// Outward unit normal there.
    pub(super) fn normal(&self, unit: DVec3) -> DVec3 {
        (self.to_unit.transpose() * unit).normalize()
    }

    /// Area density of a uniform point of the unit sphere. \[1/m2\]
    pub(super) fn pdf_area(&self, unit: DVec3) -> f64 {
        let stretch =
            self.from_unit.determinant().abs() * (self.to_unit.transpose() * unit).length();
        1.0 / (4.0 * PI * stretch)
    }

    /// The point of the unit sphere under a surface position.
    pub(super) fn unit_of(&self, position: DVec3) -> DVec3 {
        (self.to_unit * (position - self.center)).normalize()
    }

    /// Surface area, by a fixed quadrature that is exact for spheres. \[m2\]
    pub(super) fn area(&self) -> f64 {
        // Mean of 1 / pdf over a Fibonacci lattice of uniform points.
        const POINTS: u32 = 4096;
        let golden = PI * (3.0 - 5.0_f64.sqrt());
        let sum: f64 = (0..POINTS)
            .map(|i| {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(POINTS);
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (sin, cos) = (golden * f64::from(i)).sin_cos();
                1.0 / self.pdf_area(DVec3::new(r * cos, r * sin, z))
            })
            .sum();
        sum / f64::from(POINTS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_a_sphere_near_and_far() {
        let sphere = Ellipsoid::new(
            DVec3::new(1.0, 0.0, 0.0),
            DMat3::from_diagonal(DVec3::splat(0.5)),
        );
        assert_eq!(
            sphere.roots(Vec3::new(-2.0, 0.0, 0.0), Vec3::X),
            Some([2.5, 3.5])
        );
        assert_eq!(
            sphere.roots(Vec3::new(1.0, 0.0, 0.0), Vec3::X),
            Some([-0.5, 0.5])
        );
        assert!(sphere.roots(Vec3::new(-2.0, 0.6, 0.0), Vec3::X).is_none());
    }

    #[test]
    fn a_grain_seen_from_afar_keeps_its_form() {
        // Radius 1e-3 m at 1e4 m: in f32 the discriminant would be noise.
        let sphere = Ellipsoid::new(
            DVec3::new(1e4, 0.0, 0.0),
            DMat3::from_diagonal(DVec3::splat(1e-3)),
        );
        let roots = sphere.roots(Vec3::ZERO, Vec3::X).expect("it lies ahead");
        assert!((roots[1] - roots[0] - 2e-3).abs() < 1e-10, "{roots:?}");
    }

    #[test]
    fn area_of_sphere_and_spheroid() {
        let sphere = Ellipsoid::new(DVec3::ZERO, DMat3::from_diagonal(DVec3::splat(2.0)));
        assert!((sphere.area() / (16.0 * PI) - 1.0).abs() < 1e-12);
        // Oblate spheroid with half axes 2, 2, 1: closed form with e^2 = 3/4.
        let oblate = Ellipsoid::new(DVec3::ZERO, DMat3::from_diagonal(DVec3::new(2.0, 2.0, 1.0)));
        let e = 0.75_f64.sqrt();
        let exact = 2.0 * PI * 4.0 * (1.0 + (1.0 - e * e) / e * e.atanh());
        assert!((oblate.area() / exact - 1.0).abs() < 1e-6);
    }

    #[test]
    fn bounds_hold_a_rotated_ellipsoid() {
        let m = DMat3::from_rotation_z(0.7) * DMat3::from_diagonal(DVec3::new(3.0, 1.0, 0.5));
        let body = Ellipsoid::new(DVec3::new(1.0, 2.0, 3.0), m);
        let (min, max) = body.bounds();
        for i in 0..1000 {
            let z = f64::from(i) / 500.0 - 1.0;
            let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            let p = body.position(DVec3::new(r * cos, r * sin, z));
            assert!(p.cmpge(min.as_dvec3()).all() && p.cmple(max.as_dvec3()).all());
        }
    }
}
