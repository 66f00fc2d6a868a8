//! Directions: cones, hemispheres, and how spheres are seen.
//!
//! ```text
//! cone of half angle a      solid angle = 2 pi (1 - cos a) = 2 pi spread      [sr]
//! sphere of radius r at d   sin a = r / d,   spread = sin^2 a / (1 + cos a)
//! ```
//!
//! Cones are given by `spread`, 1 - cosine of their half angle: for small cones the cosine itself
//! would have lost their size in f32. Source: Pharr, Jakob & Humphreys 2023, section 6.2.4.

use std::f32::consts::PI;

use glam::Vec3;

/// A direction within 1 - cosine `spread` of `axis`, uniform in solid angle.
pub(super) fn in_cone(axis: Vec3, spread: f32, u: [f32; 2]) -> Vec3 {
    let gap = spread * u[0];
    crate::phase::around(axis, gap, 2.0 - gap, 2.0 * PI * u[1])
}

/// A cosine-distributed direction around a normal.
#[must_use]
pub fn cosine_hemisphere(normal: Vec3, u: [f32; 2]) -> Vec3 {
    let cos = (1.0 - u[0]).sqrt();
    crate::phase::around(normal, 1.0 - cos, 1.0 + cos, 2.0 * PI * u[1])
}

/// 1 - cosine of an angle in degrees, without cancellation.
pub(super) fn spread_of(degrees: f64) -> f64 {
    2.0 * (0.5 * degrees.to_radians()).sin().powi(2)
}

/// Axis, and 1 - cosine of the half angle, under which a sphere is seen; none from inside.
pub(super) fn sphere_cone(from: Vec3, center: Vec3, radius: f32) -> Option<(Vec3, f32)> {
    let to = center - from;
    let distance2 = to.length_squared();
    if distance2 <= radius * radius {
        return None;
    }
    // 1 - cos by sin^2 / (1 + cos): no cancellation for small, far spheres.
    let sin2 = radius * radius / distance2;
    let cos = (1.0 - sin2).sqrt();
    Some((to * distance2.sqrt().recip(), sin2 / (1.0 + cos)))
}

/// Unit direction and distance from `p` to `q`; none where they coincide.
#[inline]
pub(super) fn toward(p: Vec3, q: Vec3) -> Option<(Vec3, f32)> {
    let to = q - p;
    let distance = to.length();
    (distance > 0.0).then(|| (to / distance, distance))
}
