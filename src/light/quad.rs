//! A parallelogram that shines on one side.
//!
//! ```text
//! E = L A cos / d^2      of a point uniform on it, on a facing surface     [W/m2]
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
pub struct Quad<S> {
    /// \[m\]
    corner: Vec3,
    /// \[m\]
    edges: [Vec3; 2],
    /// Of the side that emits.
    normal: Vec3,
    /// \[m2\]
    area: f32,
    /// \[W/(m2 sr)\]
    radiance: S,
}

impl<S: Spectrum> Quad<S> {
    pub(super) fn new(corner: Vec3, edge_u: DVec3, edge_v: DVec3, radiance: S) -> Self {
        let cross = edge_u.cross(edge_v);
        Self {
            corner,
            edges: [edge_u.as_vec3(), edge_v.as_vec3()],
            normal: cross.normalize().as_vec3(),
            area: cross.length() as f32,
            radiance,
        }
    }

    fn at(&self, u: [f32; 2]) -> Vec3 {
        self.corner + self.edges[0] * u[0] + self.edges[1] * u[1]
    }

    /// \[m\]
    pub(super) fn middle(&self) -> Vec3 {
        self.at([0.5, 0.5])
    }

    /// The point on the light and the side that emits.
    pub(super) fn plane(&self) -> (Vec3, Vec3) {
        (self.corner, self.normal)
    }

    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<LightSample<S>> {
        let (direction, distance) = toward(p, self.at(u))?;
        let cos = -direction.dot(self.normal);
        (cos > 0.0).then(|| LightSample {
            direction,
            distance,
            value: self.radiance * (self.area * cos / (distance * distance)),
        })
    }

    /// Along the normal. \[W/sr\]
    pub(super) fn intensity(&self) -> f32 {
        self.radiance.mean() * self.area
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        let share = (4.0 * share_of_directions(target, self.middle())).min(1.0);
        self.radiance.mean() * self.area * PI * share
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
    ) -> Option<Emitted<S>> {
        emit_from_surface(
            (self.at(point), self.normal),
            self.area,
            self.radiance,
            target,
            aim,
        )
    }

    pub(super) fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        let cos = ray.direction.dot(self.normal);
        if cos >= 0.0 {
            return None;
        }
        let t = (self.corner - ray.origin).dot(self.normal) / cos;
        let p = ray.at(t) - self.corner;
        // Barycentric in the parallelogram's own, perhaps oblique, axes.
        let cross = self.edges[0].cross(self.edges[1]);
        let scale = 1.0 / cross.length_squared();
        let a = p.cross(self.edges[1]).dot(cross) * scale;
        let b = self.edges[0].cross(p).dot(cross) * scale;
        let inside = (0.0..=1.0).contains(&a) && (0.0..=1.0).contains(&b);
        (inside && t > 0.0 && t < t_max).then_some((t, self.radiance))
    }
}
