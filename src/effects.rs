//! The effect plan: what this scene calls for, why, and in which specialised form.
//!
//! Computed once from the resolved scene and what its grids really hold. Everything that is not
//! active is not simulated: no time, no memory, no branch in a hot loop. Pruning is exact: it
//! leaves out what contributes nothing, never what contributes little.

use crate::report::Effect;
use crate::scene::{Direct, Light, Material, Method, Phase, Scene};
use crate::world::LoadedVolume;

/// What is simulated, and in which form.
#[derive(Debug, Clone)]
pub struct EffectPlan {
    /// Three channels rather than one.
    pub chromatic: bool,
    /// Photons keep their direction and their compartment: where a medium is anisotropic, or glass
    /// parts the world.
    pub headings: bool,
    /// Something scatters.
    pub scattering: bool,
    /// Photons are traced and gathered.
    pub photons: bool,
    /// First order is sampled along camera rays.
    pub direct: bool,
    /// Media emit.
    pub emission: bool,
    /// Photons are kept on diffuse surfaces.
    pub surface_photons: bool,
    /// Camera rays go on beyond some surfaces.
    pub follow: bool,
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
                .chain(scene.objects.iter().filter_map(|o| o.interior))
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
        let materials = Materials::new(scene);
        let chromatic = !(lights_grey && media_grey && materials.grey && !emission);
        let skies = scene
            .lights
            .iter()
            .filter(|l| matches!(l, Light::Sky { .. } | Light::SkyImage { .. }))
            .count();
        let sampled = scene.lights.len() - skies + materials.emissive;
        let lit = scene.lights.len() + materials.emissive > 0;
        let direct = scattering && sampled > 0 && scene.settings.direct == Direct::Sampled;
        let traced = lit && scene.settings.method != Method::Path;
        let surface_photons = traced && materials.diffuse > 0 && scene.settings.max_bounces > 1;
        let photons = traced
            && scattering
            && (multiple || skies > 0 || scene.settings.direct == Direct::Photons)
            || surface_photons;
        let boundaries = materials.interfaces + materials.interiors;
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
                format!(
                    "{volumes_n} volumes from grids, {} homogeneous",
                    fogs_n + materials.interiors
                ),
                "delta tracking with local majorants, exact march",
            ),
            effect(
                "surfaces",
                !scene.objects.is_empty(),
                format!("{} objects", scene.objects.len()),
                "one hierarchy; lights sampled at hits, shadows in the media",
            ),
            effect(
                "specular_surfaces",
                materials.specular > 0,
                format!("{} objects are mirrors, glass or metal", materials.specular),
                "camera rays and photons go on; photons under a hierarchy for rays from anywhere",
            ),
            effect(
                "surface_photons",
                surface_photons,
                if materials.diffuse == 0 {
                    "no diffuse surface".to_owned()
                } else if !lit {
                    "no light".to_owned()
                } else if scene.settings.max_bounces < 2 {
                    format!("max_bounces is {}", scene.settings.max_bounces)
                } else if scene.settings.method == Method::Path {
                    "paths are traced, not photons".to_owned()
                } else {
                    format!(
                        "{} diffuse objects that light can reach indirectly",
                        materials.diffuse
                    )
                },
                "a photon map of their own, gathered at hits",
            ),
            effect(
                "medium_boundaries",
                boundaries > 0,
                format!(
                    "{} interfaces, {} objects with a medium inside",
                    materials.interfaces, materials.interiors
                ),
                "each stretch of a ray meets the media of its place",
            ),
            effect(
                "area_lights",
                area + discs + materials.emissive > 0,
                format!(
                    "{} lights with an area, {discs} suns with a disc",
                    area + materials.emissive
                ),
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
            headings: anisotropic || materials.glass > 0 || !prune,
            scattering,
            photons,
            direct,
            emission,
            surface_photons,
            follow: photons && materials.specular + materials.interfaces > 0,
            effects,
        }
    }
}

/// What the scene's objects are made of, counted.
#[derive(Debug, Default)]
struct Materials {
    /// Diffuse, and not black.
    diffuse: usize,
    /// Mirrors, glass, metal.
    specular: usize,
    emissive: usize,
    interfaces: usize,
    glass: usize,
    /// With a medium inside.
    interiors: usize,
    /// No colour anywhere.
    grey: bool,
}

impl Materials {
    fn new(scene: &Scene) -> Self {
        let mut counts = Self {
            grey: true,
            ..Self::default()
        };
        for object in &scene.objects {
            counts.interiors += usize::from(object.interior.is_some());
            let colourless = match &object.material {
                Material::Diffuse {
                    reflectance,
                    texture,
                } => {
                    counts.diffuse += usize::from(reflectance.max_element() > 0.0);
                    grey(*reflectance) && texture.is_none()
                }
                Material::Mirror { reflectance } => {
                    counts.specular += 1;
                    grey(*reflectance)
                }
                Material::Glass { .. } => {
                    counts.specular += 1;
                    counts.glass += 1;
                    true
                }
                Material::Conductor { eta, k, .. } => {
                    counts.specular += 1;
                    grey(*eta) && grey(*k)
                }
                Material::Emissive { radiance } => {
                    counts.emissive += 1;
                    grey(*radiance)
                }
                Material::Interface => {
                    counts.interfaces += 1;
                    true
                }
            };
            counts.grey &= colourless;
        }
        counts
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
