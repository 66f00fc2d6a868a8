//! An emissive object: a surface of the scene that shines.
//!
//! ```text
//! E = L cos / (pdf d^2)      of a point with density pdf [1/m2] on it     [W/m2]
//! ```
//!
//! The surface itself belongs to [`Surfaces`]; a light knows its index and about where it is.

use glam::Vec3;

use super::target::emit_from_surface;
use super::{Emitted, LightSample};
use crate::ray::Bounds;
use crate::rng::{Rng, Stage};
use crate::spectrum::Spectrum;
use crate::surface::Surfaces;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Emitter<S> {
    /// Index in the surfaces' list of emitters.
    index: usize,
    /// About its middle. \[m\]
    pub(super) center: Vec3,
    /// Of the whole surface. \[W\]
    pub(super) power: S,
}

/// Points on an emitter that are averaged for its middle.
const POINTS: u32 = 64;

impl<S: Spectrum> Emitter<S> {
    pub(super) fn new(surfaces: &Surfaces, index: usize) -> Self {
        let emitter = &surfaces.emitters()[index];
        let mut center = Vec3::ZERO;
        let mut rng = Rng::stream(0, Stage::Check, 0, 0);
        for _ in 0..POINTS {
            let u = [rng.uniform(), rng.uniform(), rng.uniform()];
            if let Some(point) = surfaces.sample_emitter(emitter, u) {
                center += point.position * (1.0 / POINTS as f32);
            }
        }
        Self {
            index,
            center,
            power: S::from_rgb(emitter.power()),
        }
    }

    /// Light at `p` from a point of the surface.
    #[must_use]
    pub fn sample(&self, surfaces: &Surfaces, p: Vec3, u: [f32; 3]) -> Option<LightSample<S>> {
        let point = surfaces.sample_emitter(&surfaces.emitters()[self.index], u)?;
        let to = point.spawn_origin(p - point.position) - p;
        let distance = to.length();
        let direction = to / distance;
        let cos = -direction.dot(point.normal);
        let value = S::from_rgb(point.radiance) * (cos / (distance * distance * point.pdf));
        (cos > 0.0 && distance > 0.0).then_some(LightSample {
            direction,
            distance,
            value,
        })
    }

    /// A photon; see [`Light::emit`](super::Light::emit).
    #[must_use]
    pub fn emit(
        &self,
        surfaces: &Surfaces,
        target: &Bounds,
        u: [f32; 4],
        rng: &mut Rng,
    ) -> Option<Emitted<S>> {
        let emitter = &surfaces.emitters()[self.index];
        let point = surfaces.sample_emitter(emitter, [rng.uniform(), u[0], u[1]])?;
        let mut emitted = emit_from_surface(
            (point.position, point.normal),
            1.0 / point.pdf,
            S::from_rgb(point.radiance),
            target,
            [u[2], u[3]],
        )?;
        emitted.ray.origin = point.spawn_origin(emitted.ray.direction);
        Some(emitted)
    }
}
