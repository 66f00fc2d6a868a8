//! A ray meets a triangle, without leaks.
//!
//! Shear and scale space so that the ray is the z axis; with A, B, C the corners there,
//! `U = Cx By - Cy Bx, V = Ax Cy - Ay Cx, W = Bx Ay - By Ax`
//! are twice the areas of the three triangles that the ray makes with the edges, and
//! `t = (U Az + V Bz + W Cz) / (U + V + W)` \[m\] when all three have one sign.
//!
//! Source: Woop, Benthin, Wald 2013, "Watertight ray/triangle intersection". Two triangles that
//! share an edge compute bitwise opposite values for it, since each product rounds monotonically
//! and zero counts as inside, so no ray passes between them: the guarantee of the test. (Woop et al.
//! also swap two axes for d_z < 0, to keep the winding; the test sees both sides and needs none.)
//! Where we depart: corners are f32, everything from the subtraction on is f64. The fallback to
//! double precision for zero areas goes, and t is good to some 2^-50 of the distance of the
//! corners, far below the f32 offset of spawned rays (`hit`), so that no ray hits the triangle
//! it leaves.

use glam::Vec3;

/// The axis along which a direction is largest, and the shear that turns it into z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shear {
    axis: usize,
    x: f64,
    y: f64,
    z: f64,
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TriangleHit {
    /// \[m\]
    pub(super) t: f64,
    /// Weights of the corners; their sum is 1.
    pub(super) weights: [f64; 3],
}

impl Shear {
    pub(super) fn new(direction: Vec3) -> Self {
        let d = direction.to_array();
        let largest = direction.abs();
        let z = if largest.x > largest.y && largest.x > largest.z {
            0
        } else if largest.y > largest.z {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let dz = f64::from(d[z]);
        Self {
            axis: z,
            x: f64::from(d[x]) / dz,
            y: f64::from(d[y]) / dz,
            z: 1.0 / dz,
        }
    }

    /// The hit of the line, on either side of the origin.
    #[inline]
    pub(super) fn intersect(&self, origin: Vec3, corners: &[Vec3; 3]) -> Option<TriangleHit> {
        // One body per axis: constant indices cost nothing, and the branch is the ray's, not the
        // triangle's.
        match self.axis {
            0 => self.test::<1, 2, 0>(origin, corners),
            1 => self.test::<2, 0, 1>(origin, corners),
            _ => self.test::<0, 1, 2>(origin, corners),
        }
    }

    #[inline]
    fn test<const X: usize, const Y: usize, const Z: usize>(
        &self,
        origin: Vec3,
        corners: &[Vec3; 3],
    ) -> Option<TriangleHit> {
        let corner = |v: Vec3| {
            let (v, o) = (v.to_array(), origin.to_array());
            let z = f64::from(v[Z]) - f64::from(o[Z]);
            let x = f64::from(v[X]) - f64::from(o[X]) - self.x * z;
            let y = f64::from(v[Y]) - f64::from(o[Y]) - self.y * z;
            [x, y, z]
        };
        let a = corner(corners[0]);
        let b = corner(corners[1]);
        let c = corner(corners[2]);
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        if sum == 0.0 {
            return None;
        }
        let inverse = 1.0 / sum;
        let weights = [u * inverse, v * inverse, w * inverse];
        let t = self.z * (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]);
        Some(TriangleHit { t, weights })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_and_weights_are_exact() {
        let corners = [
            Vec3::new(0.0, 0.0, 2.0),
            Vec3::new(4.0, 0.0, 2.0),
            Vec3::new(0.0, 4.0, 2.0),
        ];
        for (origin, direction, t) in [
            (Vec3::new(1.0, 2.0, 0.0), Vec3::Z, 2.0),
            (Vec3::new(1.0, 2.0, 5.0), Vec3::NEG_Z, 3.0),
            (Vec3::new(1.0, 2.0, 5.0), Vec3::Z, -3.0),
        ] {
            let hit = Shear::new(direction).intersect(origin, &corners);
            let hit = hit.expect("the ray passes through the middle");
            assert_eq!((hit.t, hit.weights), (t, [0.25, 0.25, 0.5]));
        }
    }

    #[test]
    fn an_edge_belongs_to_both_sides() {
        // A ray exactly through the diagonal of a square meets both halves, so never neither.
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let shear = Shear::new(Vec3::NEG_Z);
        let origin = Vec3::new(0.3, 0.3, 1.0);
        assert!(shear.intersect(origin, &[a, b, c]).is_some());
        assert!(shear.intersect(origin, &[a, c, d]).is_some());
    }

    #[test]
    fn a_ray_in_the_plane_misses() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let shear = Shear::new(Vec3::X);
        assert!(
            shear
                .intersect(Vec3::new(-1.0, 0.2, 0.0), &corners)
                .is_none()
        );
    }
}
