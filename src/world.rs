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

use std::sync::Arc;

use glam::DVec3;

use crate::blackbody::Blackbody;
use crate::camera::Camera;
use crate::effects::General;
use crate::grid::Grid;
use crate::light::{Glow, Light, LightError, LightSample};
use crate::medium::{EmissionField, Field, GridField, Medium};
use crate::photon::deposit::Part;
use crate::ray::{Bounds, Ray};
use crate::scene::{Emission, March, Optics, Scene};
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

/// Density 1 in a homogeneous medium within `bounds`, in closed form, or as a grid around it.
fn homogeneous(optics: &Optics, around: Bounds, bounds: Option<Bounds>, general: General) -> Field {
    let grid = general
        .grids
        .then(|| GridField::filled(&around, optics.extinction.max_element()));
    match grid {
        Some(Ok(field)) => Field::Grid(Box::new(field)),
        // A box without an inside has no grid.
        Some(Err(_)) | None => Field::Constant { bounds },
    }
}

/// Middle of everything that has a place: where the renderer puts its origin.
fn middle(scene: &Scene, volumes: &[LoadedVolume]) -> DVec3 {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    let mut include = |p: DVec3| {
        low = low.min(p);
        high = high.max(p);
    };
    for (volume, loaded) in scene.volumes.iter().zip(volumes) {
        if !loaded.density.support().is_empty() {
            loaded
                .density
                .world_corners()
                .iter()
                .for_each(|c| include(volume.transform.transform_point3(*c)));
        }
    }
    scene
        .fogs
        .iter()
        .filter_map(|fog| fog.bounds)
        .flatten()
        .for_each(&mut include);
    if low.cmple(high).all() {
        0.5 * (low + high)
    } else {
        scene.camera.position
    }
}

/// Share of its distance by which a shadow ray stops short of a light, lest a surface on which the
/// light lies block it. Larger: blockers that close to a light are missed.
const SHORT: f32 = 1e-4;

/// Share of its size by which a box around surfaces is widened. Smaller: rounding puts points of the
/// inside beyond it, and photons that start on it behind a surface that bounds it; larger: photons
/// aimed at nothing.
const MARGIN: f32 = 1e-3;

/// Compartments that photons tell apart; of more glass objects, the rest share the last.
const MAX_COMPARTMENT: u8 = 63;

/// Boundaries that one straight line may pass: an end to numerical loops.
const MAX_CROSSINGS: u32 = 1024;

impl<S: Spectrum> World<S> {
    /// Places the scene's volumes, fogs, objects, lights and camera.
    ///
    /// # Errors
    /// [`WorldError`]: an object or a light that cannot be loaded.
    pub fn new(scene: &Scene, volumes: Vec<LoadedVolume>) -> Result<Self, WorldError> {
        Self::with(scene, volumes, General::default())
    }

    /// As [`new`](Self::new), with general forms where special ones would do.
    ///
    /// # Errors
    /// [`WorldError`]: an object or a light that cannot be loaded.
    pub fn with(
        scene: &Scene,
        volumes: Vec<LoadedVolume>,
        general: General,
    ) -> Result<Self, WorldError> {
        let origin = middle(scene, &volumes);
        let surfaces = if scene.objects.is_empty() && !general.hierarchy {
            None
        } else {
            Some(Surfaces::build(&scene.objects, origin)?)
        };
        let solid = surfaces
            .as_ref()
            .and_then(Surfaces::bounds)
            .map_or(Bounds::EMPTY, |(min, max)| Bounds { min, max });
        let mut media = Vec::new();
        for (volume, loaded) in scene.volumes.iter().zip(volumes) {
            let emission = match (&volume.emission, loaded.temperature) {
                (
                    Some(Emission::Blackbody {
                        scale, radiance, ..
                    }),
                    Some(grid),
                ) => Some(EmissionField {
                    temperature: GridField::new(grid, &volume.transform, origin, 0.0),
                    scale: *scale as f32,
                    radiance: *radiance as f32,
                    blackbody: Blackbody::new(*scale),
                }),
                _ => None,
            };
            let extinction = S::from_rgb(volume.optics.extinction);
            let (field, sigma_t) =
                GridField::in_units(loaded.density, &volume.transform, origin, extinction);
            if field.bounds.is_empty() {
                continue;
            }
            // Steps through a plateau would be exact where those through its grid are not.
            let closed = !general.grids && scene.settings.march == March::Exact;
            let plateau = if closed { field.plateau() } else { None };
            media.push(Medium {
                sigma_t,
                albedo: S::from_rgb(volume.optics.albedo),
                phase: volume.optics.phase.into(),
                field: plateau.map_or_else(
                    || Field::Grid(Box::new(field)),
                    |plateau| Field::Plateau(Box::new(plateau)),
                ),
                emission,
            });
        }
        let mut bounds = media
            .iter()
            .filter_map(Medium::bounds)
            .fold(Bounds::EMPTY, |a, b| a.union(&b));
        let camera = Camera::new(&scene.camera, origin);
        let mut lights: Vec<Light<S>> = scene
            .lights
            .iter()
            .map(|l| Light::from_scene(l, origin))
            .chain(surfaces.iter().flat_map(Light::from_surfaces).map(Ok))
            .collect::<Result<_, _>>()?;
        // Fog without a box fills the box around everything that has a place.
        let mut whole = lights
            .iter()
            .filter_map(Light::position)
            .fold(bounds.union(&solid), |b, p| b.including(p));
        whole = whole
            .including(camera.position)
            .including((scene.camera.look_at - origin).as_vec3());
        for fog in &scene.fogs {
            let fill = fog.bounds.map_or(whole, |[min, max]| Bounds {
                min: (min - origin).as_vec3(),
                max: (max - origin).as_vec3(),
            });
            bounds = bounds.union(&fill);
            media.push(Medium {
                sigma_t: S::from_rgb(fog.optics.extinction),
                albedo: S::from_rgb(fog.optics.albedo),
                phase: fog.optics.phase.into(),
                field: homogeneous(&fog.optics, fill, Some(fill), general),
                emission: None,
            });
        }
        let open = media.len();
        // What scatters nothing needs no photons around it.
        let useful = |mut part: Part, medium: &Medium<S>| {
            if medium.albedo.is_zero() && !general.grids {
                part.reach = 0.0;
            }
            part
        };
        let mut parts: Vec<Part> = media
            .iter()
            .map(|m| useful(Part::new(m, bounds), m))
            .collect();
        let interiors = (0..scene.objects.len() as u32)
            .map(|object| {
                let surfaces = surfaces.as_ref().filter(|s| s.encloses(object))?;
                let optics = surfaces.interior(object)?;
                let (min, max) = surfaces.object_bounds(object);
                // Rounding may put a point of the inside a little beyond the box.
                let margin = MARGIN * (max - min).max_element();
                let around = Bounds {
                    min: min - margin,
                    max: max + margin,
                };
                media.push(Medium {
                    sigma_t: S::from_rgb(optics.extinction),
                    albedo: S::from_rgb(optics.albedo),
                    phase: optics.phase.into(),
                    field: homogeneous(optics, around, None, general),
                    emission: None,
                });
                let filled = surfaces.filled(object);
                parts.extend(media.last().map(|m| {
                    let part = Part::inside(m, Bounds { min, max }, filled);
                    useful(part, m)
                }));
                Some(media.len() - 1)
            })
            .collect();
        let glows = (0..open).filter_map(|i| Glow::new(&media, i));
        lights.extend(glows.map(Light::Glow));
        let mut next = 0u8;
        let compartments = (0..scene.objects.len() as u32)
            .map(|object| {
                let bends = surfaces.as_ref().is_some_and(|s| s.refracts(object));
                next = next.saturating_add(u8::from(bends));
                if bends { next.min(MAX_COMPARTMENT) } else { 0 }
            })
            .collect();
        let mut target = parts
            .iter()
            .fold(solid, |all, part| all.union(&part.reached()));
        if !solid.is_empty() {
            // A photon that starts on the box must not start on a surface that bounds it.
            let margin = glam::Vec3::splat(MARGIN * target.radius().max(f32::MIN_POSITIVE));
            target.min -= margin;
            target.max += margin;
            if media.len() > open {
                bounds = bounds.union(&solid);
            }
        }
        let inside_at = |p: glam::Vec3| {
            surfaces
                .as_ref()
                .map_or(Inside::NOTHING, |s| s.inside_at(p))
        };
        let light_inside = lights
            .iter()
            .map(|l| l.position().map_or(Inside::NOTHING, inside_at))
            .collect();
        Ok(Self {
            points: general.points || lights.iter().any(Light::is_wide),
            boundaries: general.boundaries || surfaces.as_ref().is_some_and(Surfaces::any_encloses),
            camera_inside: inside_at(camera.position),
            light_inside,
            media,
            open,
            interiors,
            parts,
            compartments,
            surfaces,
            lights,
            camera,
            origin,
            bounds,
            target,
            max_bounces: scene.settings.max_bounces,
        })
    }

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
