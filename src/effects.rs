//! The effect plan: what this scene calls for, why, and in which specialised form.
//!
//! Computed once from the resolved scene and what its grids really hold. Everything that is not
//! active is not simulated: no time, no memory, no branch in a hot loop. Pruning is exact: it
//! leaves out what contributes nothing, never what contributes little.

use crate::report::Effect;
use crate::scene::{Direct, Light, Method, Phase, Scene};
use crate::world::LoadedVolume;

/// What is simulated, and in which form.
#[derive(Debug, Clone)]
pub struct EffectPlan {
    /// Three channels rather than one.
    pub chromatic: bool,
    /// Photons keep their direction, and which of several media they collided in.
    pub anisotropic: bool,
    /// Something scatters.
    pub scattering: bool,
    /// Photons are traced and gathered.
    pub photons: bool,
    /// First order is sampled along camera rays.
    pub direct: bool,
    /// Media emit.
    pub emission: bool,
    /// The table for people and reports.
    pub effects: Vec<Effect>,
}

/// True where all channels are equal.
fn grey(rgb: glam::Vec3) -> bool {
    rgb.x == rgb.y && rgb.y == rgb.z
}

impl EffectPlan {
    /// The plan of a scene.
    #[must_use]
    pub fn new(scene: &Scene, volumes: &[LoadedVolume]) -> Self {
        let optics = || {
            scene
                .volumes
                .iter()
                .map(|v| v.optics)
                .chain(scene.fogs.iter().map(|f| f.optics))
        };
        let prune = scene.settings.pruning;
        let media = optics().count();
        let max_albedo = optics().map(|o| o.albedo.max_element()).fold(0.0, f32::max);
        let max_extinction = optics()
            .map(|o| o.extinction.max_element())
            .fold(0.0, f32::max);
        let scattering = max_albedo > 0.0 && max_extinction > 0.0 && scene.settings.max_bounces > 0;
        let multiple = scattering && scene.settings.max_bounces > 1;
        let anisotropic =
            optics().any(|o| !matches!(o.phase, Phase::Isotropic | Phase::HenyeyGreenstein(0.0)));
        let largest_g = optics()
            .map(|o| {
                if let Phase::HenyeyGreenstein(g) = o.phase {
                    g.abs()
                } else {
                    0.0
                }
            })
            .fold(0.0, f32::max);
        let emitting = scene
            .volumes
            .iter()
            .zip(volumes)
            .filter(|(v, _)| v.emission.is_some());
        let hottest = emitting
            .clone()
            .filter_map(|(_, l)| l.temperature.as_ref())
            .map(|g| g.range()[1])
            .fold(0.0, f32::max);
        let emission = emitting.count() > 0 && hottest > 0.0;
        let lights_grey = scene.lights.iter().all(|l| grey(light_colour(l)));
        let media_grey = optics().all(|o| grey(o.extinction) && grey(o.albedo));
        let chromatic = !(lights_grey && media_grey && !emission);
        let skies = scene
            .lights
            .iter()
            .filter(|l| matches!(l, Light::Sky { .. } | Light::SkyImage { .. }))
            .count();
        let sampled = scene.lights.len() - skies;
        let direct = scattering && sampled > 0 && scene.settings.direct == Direct::Sampled;
        let photons = scattering
            && !scene.lights.is_empty()
            && scene.settings.method != Method::Path
            && (multiple || skies > 0 || scene.settings.direct == Direct::Photons);
        let area = scene
            .lights
            .iter()
            .filter(|l| matches!(l, Light::Quad { .. } | Light::Sphere { .. }))
            .count();
        let discs = scene
            .lights
            .iter()
            .filter(|l| matches!(l, Light::Sun { angular_diameter, .. } if *angular_diameter > 0.0))
            .count();
        let (volumes_n, fogs_n) = (scene.volumes.len(), scene.fogs.len());
        let effect = |name: &str, active: bool, reason: String, form: &str| Effect {
            name: name.to_owned(),
            active,
            reason,
            form: if active {
                form.to_owned()
            } else {
                String::new()
            },
        };
        let effects = vec![
            effect(
                "absorption",
                media > 0 && optics().any(|o| o.albedo.min_element() < 1.0) && max_extinction > 0.0,
                format!(
                    "albedo of the {media} media is between {} and {max_albedo}",
                    optics().map(|o| o.albedo.min_element()).fold(1.0, f32::min)
                ),
                "Russian roulette at collisions, attenuation along camera rays",
            ),
            effect(
                "single_scattering",
                scattering,
                if scattering {
                    format!("highest albedo is {max_albedo}")
                } else if scene.settings.max_bounces == 0 {
                    "max_bounces is 0".to_owned()
                } else {
                    "albedo or extinction is 0 in every medium".to_owned()
                },
                if direct {
                    "sampled along camera rays; skies from photons"
                } else {
                    "photons"
                },
            ),
            effect(
                "multiple_scattering",
                multiple,
                format!(
                    "max_bounces is {} and the highest albedo {max_albedo}",
                    scene.settings.max_bounces
                ),
                if scene.settings.method == Method::Path {
                    "paths"
                } else {
                    "photons"
                },
            ),
            effect(
                "anisotropic_phase",
                anisotropic || !prune,
                if anisotropic {
                    format!("largest |g| is {largest_g}")
                } else {
                    "every phase function is isotropic".to_owned()
                },
                "photons keep their direction",
            ),
            effect(
                "emission",
                emission,
                if emission {
                    format!("temperature grid reaches {hottest}")
                } else {
                    "no volume has an emission with a temperature above 0".to_owned()
                },
                "summed along camera rays",
            ),
            effect(
                "chromatic",
                chromatic || !prune,
                if chromatic {
                    "a medium, a light or an emission has colour".to_owned()
                } else {
                    "coefficients and lights are grey".to_owned()
                },
                "three channels",
            ),
            effect(
                "heterogeneous",
                volumes_n > 0,
                format!("{volumes_n} volumes from grids, {fogs_n} homogeneous"),
                "delta tracking with local majorants, exact march",
            ),
            effect(
                "surfaces",
                false,
                format!("{} objects", scene.objects.len()),
                "",
            ),
            effect("specular_surfaces", false, "no surfaces".to_owned(), ""),
            effect("surface_photons", false, "no surfaces".to_owned(), ""),
            effect("medium_boundaries", false, "no surfaces".to_owned(), ""),
            effect(
                "area_lights",
                area + discs > 0,
                format!("{area} lights with an area, {discs} suns with a disc"),
                "points sampled on the light",
            ),
            effect(
                "environment",
                skies > 0,
                format!("{skies} skies"),
                "photons through the media's box, background",
            ),
            effect(
                "depth_of_field",
                scene.camera.lens.is_some(),
                if scene.camera.lens.is_some() {
                    "the camera has a lens"
                } else {
                    "the camera is a pinhole"
                }
                .to_owned(),
                "points sampled on the lens; photons gathered per ray",
            ),
        ];
        Self {
            chromatic: chromatic || !prune,
            anisotropic: anisotropic || media > 1 || !prune,
            scattering,
            photons,
            direct,
            emission,
            effects,
        }
    }
}

/// Colour of a light, whatever its unit.
fn light_colour(light: &Light) -> glam::Vec3 {
    match light {
        Light::Sun { irradiance, .. } => *irradiance,
        Light::Sky { radiance } | Light::Quad { radiance, .. } | Light::Sphere { radiance, .. } => {
            *radiance
        }
        Light::SkyImage { .. } => glam::Vec3::new(1.0, 0.0, 0.0),
        Light::Point { power, .. } | Light::Spot { power, .. } => *power,
    }
}
