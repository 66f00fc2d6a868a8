//! A sphere that shines from its whole surface.
//!
//! ```text
//! E = L 2 pi (1 - cos a)      of a direction uniform in the cone a that it fills     [W/m2]
//! ```
//!
//! E is on a surface that faces the sampled direction, not the sphere's middle.

use std::f32::consts::PI;

use glam::Vec3;

use super::directions::{in_cone, sphere_cone};
use super::target::{emit_from_surface, share_of_directions};
use super::{Emitted, LightSample};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Sphere<S> {
    /// \[m\]
    pub(super) center: Vec3,
    /// \[m\]
    pub(super) radius: f32,
    /// \[W/(m2 sr)\]
    pub(super) radiance: S,
}

impl<S: Spectrum> Sphere<S> {
    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<LightSample<S>> {
        let (axis, spread) = sphere_cone(p, self.center, self.radius)?;
        let direction = in_cone(axis, spread, u);
        let to = self.center - p;
        let along = to.dot(direction);
        let off = (to - direction * along).length_squared();
        let distance = along - (self.radius * self.radius - off).max(0.0).sqrt();
        Some(LightSample {
            direction,
            distance,
            value: self.radiance * (2.0 * PI * spread),
        })
    }

    /// \[W/sr\]
    pub(super) fn intensity(&self) -> f32 {
        self.radiance.mean() * PI * self.radius * self.radius
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        4.0 * PI * self.intensity() * share_of_directions(target, self.center)
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
    ) -> Option<Emitted<S>> {
        let normal = in_cone(Vec3::Z, 2.0, point);
        let area = 4.0 * PI * self.radius * self.radius;
        let start = (self.center + normal * self.radius, normal);
        emit_from_surface(start, area, self.radiance, target, aim)
    }

    pub(super) fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        let to = self.center - ray.origin;
        let along = to.dot(ray.direction);
        let half2 = self.radius * self.radius - (to - ray.direction * along).length_squared();
        let t = along - half2.max(0.0).sqrt();
        (half2 > 0.0 && t > 0.0 && t < t_max).then_some((t, self.radiance))
    }
}
