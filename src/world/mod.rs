//! The world that light moves in: media, lights and camera of a scene, ready to be sampled.
//!
//! Positions are f32 metres from an origin in the middle of the scene's volumes; the origin
//! itself is f64, so a scene a million voxels away from 0 is rendered like one at 0. A world is
//! made for one spectrum: grey scenes have one channel.
//!
//! Media come in two kinds. Those of the open scene (volumes and fogs, which overlap freely) fill
//! every point that no object owns; an object that light can pass into is filled by its interior
//! alone, or by nothing. `media` holds the open scene's first, then the interiors, so that one
//! index names a medium everywhere; [`World::media_for`] gives those of a place.

mod build;

use std::sync::Arc;

use glam::DVec3;

use crate::camera::Camera;
use crate::grid::Grid;
use crate::light::{Light, LightError, LightSample};
use crate::medium::{Field, GridField, Medium};
use crate::photon::deposit::Part;
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;
use crate::surface::{Hit, Inside, SurfaceError, Surfaces};
use crate::tracking::{Counters, Sampler};

/// Grids of a scene's volumes, in order. A clone shares them.
#[derive(Debug, Clone)]
pub struct LoadedVolume {
    /// Density.
    pub density: Arc<Grid>,
    /// Temperature, where the volume emits.
    pub temperature: Option<Arc<Grid>>,
}

/// Something of a scene that cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// An object.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// A light.
    #[error(transparent)]
    Light(#[from] LightError),
}

/// See the module's page.
#[derive(Debug)]
pub struct World<S> {
    /// Media, those of the open scene first; photons name them by index.
    pub media: Vec<Medium<S>>,
    /// Number of media of the open scene.
    pub open: usize,
    /// Index of the medium inside each object.
    interiors: Vec<Option<usize>>,
    /// The part of space that each medium takes.
    pub parts: Vec<Part>,
    /// The compartment that each object makes of its inside; 0 where its boundary bends nothing.
    compartments: Vec<u8>,
    /// Surfaces; none costs nothing.
    pub surfaces: Option<Surfaces>,
    /// The objects around the camera.
    pub camera_inside: Inside,
    /// The objects around each light.
    pub light_inside: Vec<Inside>,
    /// Lights.
    pub lights: Vec<Light<S>>,
    /// The camera.
    pub camera: Camera,
    /// World position of the renderer's origin. \[m\]
    pub origin: DVec3,
    /// Box around all media; empty without any.
    pub bounds: Bounds,
    /// Box that photons are aimed at: media, as far as kernels over them reach, and surfaces. All
    /// surfaces, since light that starts on
    /// the box must not have passed a blocker outside it.
    pub target: Bounds,
    /// Highest scattering order.
    pub max_bounces: u32,
    /// Points are drawn on lights: some have an area.
    points: bool,
    /// Lines are followed from boundary to boundary: light can pass into some object.
    boundaries: bool,
}

/// Share of its distance by which a shadow ray stops short of a light, lest a surface on which the
/// light lies block it. Larger: blockers that close to a light are missed.
const SHORT: f32 = 1e-4;

/// Boundaries that one straight line may pass: an end to numerical loops.
const MAX_CROSSINGS: u32 = 1024;

impl<S: Spectrum> World<S> {
    /// The grids of all media.
    fn fields(&self) -> impl Iterator<Item = &GridField> {
        self.media.iter().flat_map(|medium| {
            let density = match &medium.field {
                Field::Grid(field) => Some(&**field),
                Field::Constant { .. } | Field::Plateau(_) => None,
            };
            let emission = medium.emission.as_ref();
            density.into_iter().chain(emission.map(|e| &e.temperature))
        })
    }

    /// Bytes that the values of grids take in memory.
    #[must_use]
    pub fn grid_bytes(&self) -> usize {
        self.fields().map(|f| f.grid.memory_bytes()).sum()
    }

    /// Bytes that bounds over grids and surfaces take in memory.
    #[must_use]
    pub fn structure_bytes(&self) -> usize {
        let surfaces = self.surfaces.as_ref().map_or(0, Surfaces::memory_bytes);
        surfaces
            + self
                .fields()
                .map(|f| f.majorants.memory_bytes() + f.flights.memory_bytes())
                .sum::<usize>()
    }

    /// The media of the open scene.
    #[inline]
    #[must_use]
    pub fn open_media(&self) -> &[Medium<S>] {
        &self.media[..self.open]
    }

    /// The media of a place, and the index of the first of them.
    #[inline]
    #[must_use]
    pub fn media_for(&self, inside: &Inside) -> (usize, &[Medium<S>]) {
        let Some(owner) = inside.owner() else {
            return (0, self.open_media());
        };
        match self.interiors[owner as usize] {
            Some(index) => (index, &self.media[index..=index]),
            None => (0, &[]),
        }
    }

    /// The compartment of a place: 0 in the open scene and beyond interfaces, else that of the
    /// glass around it. Fluence is continuous within compartments, and jumps between them.
    #[inline]
    #[must_use]
    pub fn compartment(&self, inside: &Inside) -> u8 {
        let of = |object: &u32| self.compartments[*object as usize];
        inside
            .objects()
            .iter()
            .rev()
            .map(of)
            .find(|c| *c > 0)
            .unwrap_or(0)
    }

    /// What is left of light along the straight line [0, t_max] of `ray` that starts `inside`:
    /// zero behind a surface, else the product of `transmittance` over the stretches between the
    /// boundaries that let it pass unbent.
    pub fn reach(
        &self,
        ray: &Ray,
        t_max: f32,
        inside: &Inside,
        sampler: &mut Sampler,
        transmittance: impl Fn(&[Medium<S>], &Ray, f32, &mut Sampler) -> S,
    ) -> S {
        let Some(surfaces) = &self.surfaces else {
            return transmittance(&self.media, ray, t_max, sampler);
        };
        let mut left = if t_max.is_finite() {
            t_max * (1.0 - SHORT)
        } else {
            t_max
        };
        if !self.boundaries {
            sampler.counters.effects.surface_rays += 1;
            return if surfaces.occluded(ray.origin, ray.direction, left) {
                S::ZERO
            } else {
                transmittance(&self.media, ray, t_max, sampler)
            };
        }
        let (mut ray, mut inside, mut tr) = (*ray, *inside, S::ONE);
        let mut whole = t_max;
        for _ in 0..MAX_CROSSINGS {
            sampler.counters.effects.surface_rays += 1;
            sampler.counters.effects.boundaries += 1;
            let hit = surfaces.intersect(ray.origin, ray.direction, left);
            if let Some(hit) = &hit
                && !passes(surfaces, hit, &inside)
            {
                return S::ZERO;
            }
            let end = hit.as_ref().map_or(whole, |hit| hit.t);
            let (_, media) = self.media_for(&inside);
            if !media.is_empty() {
                tr *= transmittance(media, &ray, end, sampler);
            }
            let Some(hit) = hit else {
                return tr;
            };
            if tr.is_zero() {
                return tr;
            }
            surfaces.cross(&hit, ray.direction, &mut inside);
            ray.origin = hit.spawn_origin(ray.direction);
            left -= hit.t;
            whole -= hit.t;
        }
        S::ZERO
    }

    /// The objects around light that leaves a hit along `direction`; `inside` holds those around
    /// the path that arrived.
    #[must_use]
    pub fn inside_beyond(&self, hit: &Hit, direction: glam::Vec3, inside: &Inside) -> Inside {
        let mut inside = *inside;
        let transmitted = (direction.dot(hit.normal) > 0.0) != hit.front;
        if let Some(surfaces) = self.surfaces.as_ref().filter(|_| transmitted) {
            surfaces.cross(hit, direction, &mut inside);
        }
        inside
    }

    /// Light at `p` from a sampled point of a light; see [`Light::sample`].
    #[inline]
    #[must_use]
    pub fn sample_light(
        &self,
        light: &Light<S>,
        p: glam::Vec3,
        sampler: &mut Sampler,
    ) -> Option<LightSample<S>> {
        let u = match light {
            Light::Emitter(_) => std::array::from_fn(|_| sampler.uniform()),
            _ if self.points => [sampler.uniform(), sampler.uniform(), 0.0],
            _ => [0.0; 3],
        };
        self.sample_light_at(light, p, u, &mut sampler.counters)
    }

    /// The same from the point of the light that `u` gives.
    #[inline]
    #[must_use]
    pub fn sample_light_at(
        &self,
        light: &Light<S>,
        p: glam::Vec3,
        u: [f32; 3],
        counters: &mut Counters,
    ) -> Option<LightSample<S>> {
        match (light, &self.surfaces) {
            (Light::Emitter(emitter), Some(surfaces)) => {
                counters.effects.light_points += 1;
                emitter.sample(surfaces, p, u)
            }
            _ if self.points => {
                counters.effects.light_points += 1;
                light.sample(p, [u[0], u[1]])
            }
            // All are points to a point.
            _ => light.sample(p, [0.0; 2]),
        }
    }

    /// What a ray that leaves the scene meets.
    #[must_use]
    pub fn background(&self, view: glam::Vec3) -> S {
        self.lights
            .iter()
            .fold(S::ZERO, |sum, light| sum + light.background(view))
    }

    /// Sky radiance alone: what scattered rays meet, since lights are sampled.
    #[must_use]
    pub fn sky(&self, view: glam::Vec3) -> S {
        self.lights
            .iter()
            .filter(|l| l.is_sky())
            .fold(S::ZERO, |sum, light| sum + light.background(view))
    }

    /// The nearest light's own surface that a camera ray meets.
    #[must_use]
    pub fn seen_light(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        self.lights.iter().fold(None, |nearest, light| {
            let end = nearest.map_or(t_max, |(t, _)| t);
            light.intersect(ray, end).or(nearest)
        })
    }
}

/// True where light passes a boundary unbent: an interface, or the boundary of an object inside
/// another that owns both sides.
#[inline]
#[must_use]
pub fn passes(surfaces: &Surfaces, hit: &Hit, inside: &Inside) -> bool {
    surfaces.bsdf(hit).is_interface() || (surfaces.encloses(hit.object) && inside.hides(hit.object))
}
