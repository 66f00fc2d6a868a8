//! Makes a world of a scene: places its volumes, fogs, objects, lights and camera.

use glam::DVec3;

use super::{LoadedVolume, World, WorldError};
use crate::blackbody::Blackbody;
use crate::camera::Camera;
use crate::effects::General;
use crate::light::{Glow, Light};
use crate::medium::{EmissionField, Field, GridField, Medium};
use crate::photon::deposit::Part;
use crate::ray::Bounds;
use crate::scene::{Emission, March, Optics, Scene, Volume};
use crate::spectrum::Spectrum;
use crate::surface::{Inside, Surfaces};

/// Share of its size by which a box around surfaces is widened. Smaller: rounding puts points of the
/// inside beyond it, and photons that start on it behind a surface that bounds it; larger: photons
/// aimed at nothing.
const MARGIN: f32 = 1e-3;

/// Compartments that photons tell apart; of more glass objects, the rest share the last.
const MAX_COMPARTMENT: u8 = 63;

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
            media.extend(volume_medium(scene, volume, loaded, origin, general));
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
}

/// The medium of a volume; none of one that is 0 all over.
fn volume_medium<S: Spectrum>(
    scene: &Scene,
    volume: &Volume,
    loaded: LoadedVolume,
    origin: DVec3,
    general: General,
) -> Option<Medium<S>> {
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
        return None;
    }
    // Steps through a plateau would be exact where those through its grid are not.
    let closed = !general.grids && scene.settings.march == March::Exact;
    let plateau = if closed { field.plateau() } else { None };
    Some(Medium {
        sigma_t,
        albedo: S::from_rgb(volume.optics.albedo),
        phase: volume.optics.phase.into(),
        field: plateau.map_or_else(
            || Field::Grid(Box::new(field)),
            |plateau| Field::Plateau(Box::new(plateau)),
        ),
        emission,
    })
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
