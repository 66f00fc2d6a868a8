//! A disk that shines on one side.
//!
//! ```text
//! E = L pi r^2 cos / d^2      of a point uniform on it, on a facing surface     [W/m2]
//! ```

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::directions::toward;
use super::target::{emit_from_surface, share_of_directions};
use super::{Emitted, LightSample};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Disk<S> {
    /// \[m\]
    center: Vec3,
    /// Two at right angles, as long as the radius. \[m\]
    axes: [Vec3; 2],
    /// Of the side that emits.
    normal: Vec3,
    /// \[m\]
    radius: f32,
    /// \[W/(m2 sr)\]
    radiance: S,
}

impl<S: Spectrum> Disk<S> {
    pub(super) fn new(center: Vec3, normal: DVec3, radius: f64, radiance: S) -> Self {
        let normal = normal.normalize();
        let (u, v) = normal.any_orthonormal_pair();
        Self {
            center,
            axes: [(u * radius).as_vec3(), (v * radius).as_vec3()],
            normal: normal.as_vec3(),
            radius: radius as f32,
            radiance,
        }
    }

    fn area(&self) -> f32 {
        PI * self.radius * self.radius
    }

    /// Uniform on the disk.
    fn at(&self, u: [f32; 2]) -> Vec3 {
        let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
        self.center + (self.axes[0] * cos + self.axes[1] * sin) * u[0].sqrt()
    }

    /// The middle and the side that emits.
    pub(super) fn plane(&self) -> (Vec3, Vec3) {
        (self.center, self.normal)
    }

    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<LightSample<S>> {
        let (direction, distance) = toward(p, self.at(u))?;
        let cos = -direction.dot(self.normal);
        (cos > 0.0).then(|| LightSample {
            direction,
            distance,
            value: self.radiance * (self.area() * cos / (distance * distance)),
        })
    }

    /// Along the normal. \[W/sr\]
    pub(super) fn intensity(&self) -> f32 {
        self.radiance.mean() * self.area()
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        let share = (4.0 * share_of_directions(target, self.center)).min(1.0);
        self.intensity() * PI * share
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
    ) -> Option<Emitted<S>> {
        let start = (self.at(point), self.normal);
        emit_from_surface(start, self.area(), self.radiance, target, aim)
    }

    pub(super) fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        let cos = ray.direction.dot(self.normal);
        if cos >= 0.0 {
            return None;
        }
        let t = (self.center - ray.origin).dot(self.normal) / cos;
        let inside = ray.at(t).distance_squared(self.center) < self.radius * self.radius;
        (inside && t > 0.0 && t < t_max).then_some((t, self.radiance))
    }
}
