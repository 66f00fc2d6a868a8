//! Rays and boxes: p(t) = origin + t direction.

use glam::{DVec3, Vec3};

/// A ray; in world space its direction has unit length and t is in metres.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start. \[m\]
    pub origin: Vec3,
    /// Direction of travel.
    pub direction: Vec3,
}

impl Ray {
    /// The point at parameter t.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// A ray in f64: integrals along it keep what f32 would round off its place.
#[derive(Debug, Clone, Copy)]
pub struct ExactRay {
    /// Start.
    pub origin: DVec3,
    /// Direction of travel.
    pub direction: DVec3,
}

impl ExactRay {
    /// The point at parameter t.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// The nearest ray in f32.
    #[inline]
    #[must_use]
    pub fn rounded(&self) -> Ray {
        Ray {
            origin: self.origin.as_vec3(),
            direction: self.direction.as_vec3(),
        }
    }
}

impl From<&Ray> for ExactRay {
    #[inline]
    fn from(ray: &Ray) -> Self {
        Self {
            origin: ray.origin.as_dvec3(),
            direction: ray.direction.as_dvec3(),
        }
    }
}

/// 1/d for slab and cell tests. Zero and denormal components, which never reach a face within
/// any finite t, get the signed infinity; callers treat it as "no crossing".
#[inline]
#[must_use]
pub fn reciprocal(d: Vec3) -> Vec3 {
    let one = |x: f32| {
        if x.abs() < f32::MIN_POSITIVE {
            f32::INFINITY.copysign(x)
        } else {
            1.0 / x
        }
    };
    Vec3::new(one(d.x), one(d.y), one(d.z))
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box around nothing; the union's neutral element.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// True where there is nothing inside.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// The smallest box around this and a point.
    #[must_use]
    pub fn including(&self, p: Vec3) -> Self {
        Self {
            min: self.min.min(p),
            max: self.max.max(p),
        }
    }

    /// Middle.
    #[must_use]
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Edge lengths.
    #[must_use]
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }

    /// Half the diagonal: the radius of the sphere through the corners.
    #[must_use]
    pub fn radius(&self) -> f32 {
        0.5 * self.size().length()
    }

    /// True where the point is inside or on the boundary.
    #[must_use]
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// The part of [0, t_max] that the ray spends inside, if any; all of it where there is no box.
    #[inline]
    #[must_use]
    pub fn clip_if(bounds: Option<&Self>, ray: &Ray, t_max: f32) -> Option<(f32, f32)> {
        bounds.map_or(Some((0.0, t_max)), |b| b.clip(ray, 0.0, t_max))
    }

    /// The part of [t0, t1] that the ray spends inside, if any.
    #[inline]
    #[must_use]
    pub fn clip(&self, ray: &Ray, t0: f32, t1: f32) -> Option<(f32, f32)> {
        let (enter, exit) = self.crossing(ray.origin, reciprocal(ray.direction));
        let (enter, exit) = (enter.max(t0), exit.min(t1));
        (enter < exit).then_some((enter, exit))
    }

    /// Where a line enters and leaves, given one over its direction; the other way round if it
    /// misses.
    #[inline]
    fn crossing(&self, origin: Vec3, inverse: Vec3) -> (f32, f32) {
        let (mut enter, mut exit) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in 0..3 {
            let o = origin[axis];
            if inverse[axis].is_infinite() {
                if o < self.min[axis] || o > self.max[axis] {
                    return (f32::INFINITY, f32::NEG_INFINITY);
                }
                continue;
            }
            let a = (self.min[axis] - o) * inverse[axis];
            let b = (self.max[axis] - o) * inverse[axis];
            enter = enter.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        (enter, exit)
    }
}
