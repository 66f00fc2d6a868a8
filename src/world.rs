//! The world that light moves in: media, lights and camera of a scene, ready to be sampled.
//!
//! Positions are f32 metres from an origin in the middle of the scene's volumes; the origin
//! itself is f64, so a scene a million voxels away from 0 is rendered like one at 0. A world is
//! made for one spectrum: grey scenes have one channel.

use glam::DVec3;

use crate::blackbody::Blackbody;
use crate::camera::Camera;
use crate::light::Light;
use crate::medium::{EmissionField, Field, GridField, Medium};
use crate::ray::{Bounds, Ray};
use crate::scene::{Emission, Scene};
use crate::spectrum::Spectrum;

/// Grids of a scene's volumes, in order.
#[derive(Debug)]
pub struct LoadedVolume {
    /// Density.
    pub density: crate::grid::Grid,
    /// Temperature, where the volume emits.
    pub temperature: Option<crate::grid::Grid>,
}

/// See the module's page.
#[derive(Debug)]
pub struct World<S> {
    /// Media; photons name them by index.
    pub media: Vec<Medium<S>>,
    /// Lights.
    pub lights: Vec<Light<S>>,
    /// The camera.
    pub camera: Camera,
    /// World position of the renderer's origin. \[m\]
    pub origin: DVec3,
    /// Box around all media; empty without any.
    pub bounds: Bounds,
    /// Highest scattering order.
    pub max_bounces: u32,
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

impl<S: Spectrum> World<S> {
    /// Places the scene's volumes, fogs, lights and camera.
    #[must_use]
    pub fn new(scene: &Scene, volumes: Vec<LoadedVolume>) -> Self {
        let origin = middle(scene, &volumes);
        let mut media = Vec::new();
        for (volume, loaded) in scene.volumes.iter().zip(volumes) {
            let extinction = volume.optics.extinction.max_element();
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
            let field = GridField::new(loaded.density, &volume.transform, origin, extinction);
            if field.bounds.is_empty() {
                continue;
            }
            media.push(Medium {
                sigma_t: S::from_rgb(volume.optics.extinction),
                albedo: S::from_rgb(volume.optics.albedo),
                phase: volume.optics.phase.into(),
                field: Field::Grid(Box::new(field)),
                emission,
            });
        }
        let mut bounds = media
            .iter()
            .filter_map(Medium::bounds)
            .fold(Bounds::EMPTY, |a, b| a.union(&b));
        let camera = Camera::new(&scene.camera, origin);
        let lights: Vec<Light<S>> = scene
            .lights
            .iter()
            .filter_map(|l| Light::from_scene(l, origin))
            .collect();
        // Fog without a box fills the box around everything that has a place.
        let mut whole = lights
            .iter()
            .filter_map(Light::position)
            .fold(bounds, |b, p| b.including(p));
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
                field: Field::Constant { bounds: Some(fill) },
                emission: None,
            });
        }
        Self {
            media,
            lights,
            camera,
            origin,
            bounds,
            max_bounces: scene.settings.max_bounces,
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
