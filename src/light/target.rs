//! The box that photons are aimed at, as lights see it.
//!
//! ```text
//! projected area of a box along d   = |d_x| s_y s_z + |d_y| s_z s_x + |d_z| s_x s_y     [m2]
//! ```
//!
//! Light along one direction enters by up to three faces, each in proportion to its projected area.

use glam::Vec3;

use super::Emitted;
use super::directions::{cosine_hemisphere, in_cone, sphere_cone};
use crate::ray::{Bounds, Ray};
use crate::rng::Rng;
use crate::spectrum::Spectrum;

use std::f32::consts::PI;

/// Share of all directions from a place that go toward the target's sphere.
pub(super) fn share_of_directions(target: &Bounds, position: Vec3) -> f32 {
    sphere_cone(position, target.center(), target.radius()).map_or(1.0, |(_, s)| 0.5 * s)
}

/// Surface of the box. \[m2\]
pub(super) fn surface(target: &Bounds) -> f32 {
    let size = target.size();
    2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
}

/// Signed projected areas of the box's faces that light along `direction` enters by (one per
/// axis; the sign is the direction's), and their sum.
pub(super) fn projected_faces(target: &Bounds, direction: Vec3) -> ([f32; 3], f32) {
    let size = target.size();
    let faces = [
        direction.x * size.y * size.z,
        direction.y * size.z * size.x,
        direction.z * size.x * size.y,
    ];
    (faces, faces.iter().map(|f| f.abs()).sum())
}

/// A point on the entered faces, uniform in projected area.
pub(super) fn on_faces(
    target: &Bounds,
    faces: &[f32; 3],
    area: f32,
    u: [f32; 2],
    rng: &mut Rng,
) -> Vec3 {
    let mut pick = rng.uniform() * area;
    let mut axis = 2;
    for (a, face) in faces.iter().enumerate() {
        if pick < face.abs() {
            axis = a;
            break;
        }
        pick -= face.abs();
    }
    let mut s = Vec3::ZERO;
    s[(axis + 1) % 3] = u[0];
    s[(axis + 2) % 3] = u[1];
    s[axis] = if faces[axis] > 0.0 { 0.0 } else { 1.0 };
    target.min + target.size() * s
}

/// Inward normal of the face that a point of the upper faces lies on.
pub(super) fn face_normal(target: &Bounds, p: Vec3) -> Vec3 {
    let gap = (target.max - p).abs();
    if gap.x <= gap.y && gap.x <= gap.z {
        Vec3::NEG_X
    } else if gap.y <= gap.z {
        Vec3::NEG_Y
    } else {
        Vec3::NEG_Z
    }
}

/// A photon from a point of a Lambertian surface.
pub(super) fn emit_from_surface<S: Spectrum>(
    (origin, normal): (Vec3, Vec3),
    area: f32,
    radiance: S,
    target: &Bounds,
    aim: [f32; 2],
) -> Option<Emitted<S>> {
    // A cone of a quarter hemisphere or more: cosine sampling wastes less than its weights vary.
    if let Some((axis, spread)) = sphere_cone(origin, target.center(), target.radius())
        && spread < 0.25
    {
        let direction = in_cone(axis, spread, aim);
        let cos = direction.dot(normal);
        let power = radiance * (area * cos * 2.0 * PI * spread);
        return (cos > 0.0).then_some(Emitted {
            ray: Ray { origin, direction },
            power,
        });
    }
    let direction = cosine_hemisphere(normal, aim);
    Some(Emitted {
        ray: Ray { origin, direction },
        power: radiance * (PI * area),
    })
}
