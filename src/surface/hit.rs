//! Where a ray met a surface, and how to leave it again.
//!
//! The hit is computed in f64 and rounded once, so the stored position x is within
//! `error = 2^-24 |x| + 2^-40 s` \[m\] of the true surface along each axis, s the largest
//! coordinate of the primitive: half a unit in the last place, and a floor for coordinates near
//! zero. A ray that goes on from there starts at
//! `x + n sum_k |n_k| error_k`, on the side of the normal n to which it goes, every coordinate
//! rounded away from the surface.
//!
//! Within three errors of an edge the position is drawn that far into its triangle (`inset`), so
//! that rounding cannot put it beyond the neighbouring face, where a ray that goes inwards would
//! start outside: at edges of 30 degrees or more nothing leaks.
//!
//! Source: Pharr, Jakob, Humphreys 2023, section 6.8.6 ("Robust spawned ray origins"); the offset is
//! the distance to the nearest plane with normal n that leaves the box of errors on one side.
//! Where we depart: f64 arithmetic makes the box a few units smaller than pbrt's gamma bounds, and
//! makes the next intersection exact enough to need no smallest distance.

use glam::{DVec3, Vec2, Vec3};

/// A point where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Distance along the ray. \[m\]
    pub t: f32,
    /// On the surface, within `error`. \[m\]
    pub position: Vec3,
    /// Bound on the distance to the true surface, per axis. \[m\]
    pub error: Vec3,
    /// Geometric unit normal: outwards, or to the front of an open surface.
    pub normal: Vec3,
    /// Interpolated unit normal, in the hemisphere of `normal`.
    pub shading_normal: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Index in the scene's list of objects.
    pub object: u32,
    /// The ray came from the side to which `normal` points.
    pub front: bool,
    /// Index of the primitive, for the density of light sampling.
    pub primitive: u32,
}

impl Hit {
    /// Geometric unit normal on the side from which the ray came.
    #[must_use]
    pub fn facing(&self) -> Vec3 {
        if self.front {
            self.normal
        } else {
            -self.normal
        }
    }

    /// Where a ray along `direction` (of travel) starts when it leaves this point. \[m\]
    #[must_use]
    pub fn spawn_origin(&self, direction: Vec3) -> Vec3 {
        offset(self.position, self.error, self.normal, direction)
    }
}

/// Moves a point with a known error off a surface with normal `normal`, to the side of `direction`.
#[must_use]
pub(super) fn offset(position: Vec3, error: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    let distance = normal.abs().dot(error);
    let side = if direction.dot(normal) < 0.0 {
        -1.0
    } else {
        1.0
    };
    let step = side * distance * normal;
    let away = |p: f32, step: f32| {
        let moved = p + step;
        if step > 0.0 {
            moved.next_up()
        } else if step < 0.0 {
            moved.next_down()
        } else {
            moved
        }
    };
    Vec3::new(
        away(position.x, step.x),
        away(position.y, step.y),
        away(position.z, step.z),
    )
}

/// Rounds a position to f32 and bounds the error of doing so; `scale` is the largest coordinate
/// that went into it. \[m\]
pub(super) fn round(position: DVec3, scale: f32) -> (Vec3, Vec3) {
    const HALF_ULP: f32 = f32::EPSILON / 2.0;
    const FLOOR: f32 = 1.0 / (1_u64 << 40) as f32;
    let rounded = position.as_vec3();
    let error = rounded.abs() * HALF_ULP + Vec3::splat(scale * FLOOR);
    (rounded, error)
}

/// Weights of a point at least three errors away from every edge, or the middle of a triangle
/// too small for that; the point itself if it is.
pub(super) fn inset(weights: [f64; 3], corners: &[Vec3; 3], error: Vec3) -> [f64; 3] {
    const MARGIN: f64 = 3.0;
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let twice_area = (b - a).cross(c - a).length();
    let altitude = [(c - b), (a - c), (b - a)].map(|edge| twice_area / edge.length());
    let margin = MARGIN * f64::from(error.length());
    if (0..3).all(|i| weights[i] * altitude[i] >= margin) {
        return weights;
    }
    let lowest = altitude.into_iter().fold(f64::INFINITY, f64::min);
    let pull = (3.0 * margin / lowest).min(1.0);
    weights.map(|w| (1.0 - pull) * w.max(0.0) + pull / 3.0)
}
