//! Kernels cut at the surfaces between which a ray runs.
//!
//! ```text
//! h  = (t_wall - t) |n.d| / sqrt(1 - (n.d)^2)       from the ray to the wall, in the photon's disc [m]
//! K' = K / M(h/r)   on the ray's side of the wall,   0 beyond
//! M(z) = share of the kernel's mass on one side of a line at distance z (in radii) from its middle
//! ```
//!
//! No photons come from beyond a wall, so a disc that reaches over it finds too few, by half at
//! the wall itself. The part of the disc on the ray's side of the plane through the hit is kept and
//! made to count for all. Where the fluence is constant that is exact on flat walls, and outside
//! convex bodies of any size: photons beyond the plane that a small body does not hide are left out
//! on both sides of the account. It also keeps out what leaks through a thin wall. What is left:
//! walls beside the ray that it does not end on (corners, a corridor along the view), and the
//! inside of curved walls, to second order in the radius. With a wall at both ends of a stretch the
//! one nearer to the photon's disc cuts.
//!
//! A line cuts a kernel like its own boundary: Jones 1993, "Simple boundary correction for kernel
//! density estimation", the local constant form.

use glam::Vec3;

use crate::estimate::kernel::Kernel;
use crate::ray::Ray;
use crate::surface::Hit;

/// The plane that a ray starts from or ends on.
#[derive(Debug, Clone, Copy)]
pub struct Wall {
    /// Where the ray meets it. \[m\]
    t: f32,
    /// Distance from the ray, in the plane at right angles to it, for each metre before the wall.
    slope: f32,
    /// On the ray's side.
    normal: Vec3,
    /// Of the plane along its normal. \[m\]
    offset: f32,
}

impl Wall {
    /// No wall, infinitely far.
    pub const NONE: Self = Self {
        t: 0.0,
        slope: f32::INFINITY,
        normal: Vec3::ZERO,
        offset: 0.0,
    };

    /// False for [`Self::NONE`].
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.slope < f32::INFINITY
    }

    /// Of a surface that the ray meets at `t`, or 0 for the one that it leaves.
    #[must_use]
    pub fn new(ray: &Ray, hit: &Hit, t: f32) -> Self {
        let cos = ray.direction.dot(hit.normal);
        // On the side of the ray's middle: against its direction at its end, along it at its start.
        let to_ray = if t > 0.0 { -cos } else { cos };
        let normal = if to_ray < 0.0 {
            -hit.normal
        } else {
            hit.normal
        };
        Self {
            t,
            slope: cos.abs() / (1.0 - cos * cos).max(f32::MIN_POSITIVE).sqrt(),
            normal,
            offset: normal.dot(hit.position),
        }
    }

    /// Distance to the wall in the disc around the ray at `t`. \[m\]
    #[inline]
    fn distance(&self, t: f32) -> f32 {
        (self.t - t).abs() * self.slope
    }

    /// What a photon at `position`, met at `t`, counts for: 1 away from the wall, 0 beyond it.
    #[inline]
    #[must_use]
    pub fn weight(&self, kernel: Kernel, t: f32, radius: f32, position: Vec3) -> f32 {
        let h = self.distance(t);
        // A ray on the wall's own point of an infinite slope is NaN, and away from it, too.
        if h < radius {
            self.cut(kernel, h / radius, position)
        } else {
            1.0
        }
    }

    #[cold]
    fn cut(&self, kernel: Kernel, z: f32, position: Vec3) -> f32 {
        if self.normal.dot(position) < self.offset {
            0.0
        } else {
            1.0 / kernel.mass_within(z)
        }
    }
}

/// The weight by the nearer of the walls at the two ends of a stretch.
#[inline]
#[must_use]
pub fn weight(walls: &[Wall; 2], kernel: Kernel, t: f32, radius: f32, position: Vec3) -> f32 {
    let [start, end] = walls;
    let nearer = if start.distance(t) < end.distance(t) {
        start
    } else {
        end
    };
    nearer.weight(kernel, t, radius, position)
}
