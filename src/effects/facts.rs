//! Facts of a scene that decide which effects it calls for, counted and measured, not judged.

use glam::Vec3;

use crate::blackbody::COOLEST;
use crate::scene::{Emission, Light, Material, Optics, Phase, Scene, Shape, Volume};
use crate::world::LoadedVolume;

/// See the module's page.
#[derive(Debug, Default)]
pub(super) struct Facts {
    pub(super) media: Media,
    pub(super) lights: Lights,
    pub(super) materials: Materials,
    /// Temperatures, of volumes that could emit.
    pub(super) heat: Option<Heat>,
}

/// Media that do something: their extinction is above 0, and their density somewhere.
#[derive(Debug, Default)]
pub(super) struct Media {
    /// From grids that are not one value all over a box.
    pub(super) sparse: usize,
    /// From grids that are.
    pub(super) plateaus: usize,
    /// Without a grid.
    pub(super) homogeneous: usize,
    /// Albedo above 0.
    pub(super) scattering: usize,
    /// Albedo below 1 in some channel.
    pub(super) absorbing: usize,
    /// Scattering, and not the same in all directions.
    pub(super) anisotropic: usize,
    pub(super) rayleigh: usize,
    /// Channels differ.
    pub(super) coloured: usize,
    pub(super) lowest_albedo: f32,
    pub(super) highest_albedo: f32,
    /// Of scattering media.
    pub(super) largest_g: f32,
}

impl Media {
    pub(super) fn count(&self) -> usize {
        self.sparse + self.plateaus + self.homogeneous
    }

    fn add(&mut self, optics: &Optics) {
        let albedo = optics.albedo;
        if self.count() == 1 {
            self.lowest_albedo = 1.0;
        }
        self.lowest_albedo = self.lowest_albedo.min(albedo.min_element());
        self.highest_albedo = self.highest_albedo.max(albedo.max_element());
        self.absorbing += usize::from(albedo.min_element() < 1.0);
        self.coloured += usize::from(!(grey(optics.extinction) && grey(albedo)));
        if albedo.max_element() > 0.0 {
            self.scattering += 1;
            match optics.phase {
                Phase::Isotropic | Phase::HenyeyGreenstein(0.0) => {}
                Phase::HenyeyGreenstein(g) => {
                    self.anisotropic += 1;
                    self.largest_g = self.largest_g.max(g.abs());
                }
                Phase::Rayleigh => {
                    self.anisotropic += 1;
                    self.rayleigh += 1;
                }
            }
        }
    }
}

/// Lights that shine, emissive objects left out.
#[derive(Debug, Default)]
pub(super) struct Lights {
    pub(super) count: usize,
    pub(super) skies: usize,
    /// Pictures of the sky.
    pub(super) pictures: usize,
    /// With an area: quads and spheres.
    pub(super) areas: usize,
    /// Suns with a disc.
    pub(super) discs: usize,
    pub(super) coloured: usize,
}

/// What the scene's objects are made of.
#[derive(Debug, Default)]
pub(super) struct Materials {
    pub(super) objects: usize,
    /// Diffuse, and not black.
    pub(super) diffuse: usize,
    /// Mirrors, glass, metal.
    pub(super) specular: usize,
    /// Objects that shine.
    pub(super) emissive: usize,
    pub(super) interfaces: usize,
    pub(super) glass: usize,
    pub(super) coloured: usize,
    /// Those that send light on and are no flat quads.
    pub(super) curved: usize,
    /// The first diffuse one.
    pub(super) first_diffuse: String,
}

impl Materials {
    /// Objects that send light on.
    fn reflecting(&self) -> usize {
        self.diffuse + self.specular
    }

    /// True where light cannot go from one surface to another, nor back to the same.
    pub(super) fn one_flat(&self) -> bool {
        self.reflecting() == 1 && self.curved == 0
    }
}

/// The hottest place of all volumes with an emission.
#[derive(Debug)]
pub(super) struct Heat {
    pub(super) grid: String,
    /// \[K\]
    pub(super) hottest: f32,
    /// Where it absorbs, hence can emit, and is bright enough to be seen.
    pub(super) emits: bool,
}

/// True where all channels are equal.
pub(super) fn grey(rgb: Vec3) -> bool {
    rgb.x == rgb.y && rgb.y == rgb.z
}

/// Colour of a light, whatever its unit.
pub(super) fn light_colour(light: &Light) -> Vec3 {
    match light {
        Light::Sun { irradiance, .. } => *irradiance,
        Light::Sky { radiance }
        | Light::Quad { radiance, .. }
        | Light::Disk { radiance, .. }
        | Light::Sphere { radiance, .. } => *radiance,
        // Pictures are taken for coloured.
        Light::SkyImage { .. } | Light::Spot { image: Some(_), .. } => Vec3::X,
        Light::Point { power, .. } | Light::Spot { power, .. } => *power,
    }
}

/// Does a volume do anything to light?
pub(super) fn acts(volume: &Volume, loaded: &LoadedVolume) -> bool {
    volume.optics.extinction.max_element() > 0.0
        && loaded.density.range()[1] > 0.0
        && !loaded.density.support().is_empty()
}

/// Temperatures of a volume, and whether any light of them can be seen.
pub(super) fn heat(volume: &Volume, loaded: &LoadedVolume) -> Option<Heat> {
    let (
        Some(Emission::Blackbody {
            temperature,
            scale,
            radiance,
        }),
        Some(grid),
    ) = (&volume.emission, &loaded.temperature)
    else {
        return None;
    };
    let hottest = grid.range()[1] * *scale as f32;
    Some(Heat {
        grid: temperature.clone(),
        hottest,
        emits: hottest >= COOLEST as f32
            && *radiance > 0.0
            && volume.optics.albedo.min_element() < 1.0
            && acts(volume, loaded),
    })
}

impl Facts {
    /// Facts of what `kept` leaves of a scene.
    pub(super) fn new(scene: &Scene, volumes: &[LoadedVolume], kept: &super::Kept) -> Self {
        let mut facts = Self::default();
        for (volume, loaded) in kept.volumes(scene, volumes) {
            if acts(volume, loaded) {
                match loaded.density.plateau() {
                    Some(_) => facts.media.plateaus += 1,
                    None => facts.media.sparse += 1,
                }
                facts.media.add(&volume.optics);
            }
            if let Some(heat) = heat(volume, loaded) {
                let hotter = |old: &Heat| (old.emits, old.hottest) >= (heat.emits, heat.hottest);
                if !facts.heat.as_ref().is_some_and(hotter) {
                    facts.heat = Some(heat);
                }
            }
        }
        let fogs = kept.fogs(scene).map(|f| f.optics);
        let lets_in = |m: &Material| matches!(m, Material::Glass { .. } | Material::Interface);
        let hollow = scene.objects.iter().filter(|o| lets_in(&o.material));
        let interiors = hollow.filter_map(|o| o.interior);
        for optics in fogs.chain(interiors) {
            if optics.extinction.max_element() > 0.0 {
                facts.media.homogeneous += 1;
                facts.media.add(&optics);
            }
        }
        for light in kept.lights(scene) {
            let colour = light_colour(light);
            if colour.max_element() > 0.0 {
                facts.lights.add(light, colour);
            }
        }
        for object in &scene.objects {
            facts
                .materials
                .add(&object.material, &object.shape, &object.name);
        }
        facts
    }

    /// Lights and emissive objects.
    pub(super) fn shining(&self) -> usize {
        self.lights.count + self.materials.emissive
    }

    /// No colour anywhere.
    pub(super) fn coloured(&self) -> usize {
        self.media.coloured + self.lights.coloured + self.materials.coloured
    }
}

impl Lights {
    fn add(&mut self, light: &Light, colour: Vec3) {
        self.count += 1;
        self.coloured += usize::from(!grey(colour));
        match light {
            Light::Sky { .. } => self.skies += 1,
            Light::SkyImage { .. } => self.pictures += 1,
            Light::Sun {
                angular_diameter, ..
            } => self.discs += usize::from(*angular_diameter > 0.0),
            Light::Quad { .. } | Light::Disk { .. } | Light::Sphere { .. } => self.areas += 1,
            Light::Point { .. } | Light::Spot { .. } => {}
        }
    }
}

impl Materials {
    fn add(&mut self, material: &Material, shape: &Shape, name: &str) {
        self.objects += 1;
        let (colourless, reflects) = match material {
            Material::Diffuse {
                reflectance,
                texture,
            } => {
                let reflects = reflectance.max_element() > 0.0;
                if reflects && self.diffuse == 0 {
                    name.clone_into(&mut self.first_diffuse);
                }
                self.diffuse += usize::from(reflects);
                (grey(*reflectance) && texture.is_none(), reflects)
            }
            Material::Mirror { reflectance } => {
                self.specular += 1;
                (grey(*reflectance), true)
            }
            Material::Glass { .. } => {
                self.specular += 1;
                self.glass += 1;
                (true, true)
            }
            Material::Conductor { eta, k, .. } => {
                self.specular += 1;
                (grey(*eta) && grey(*k), true)
            }
            Material::Emissive { radiance } => {
                self.emissive += usize::from(radiance.max_element() > 0.0);
                (grey(*radiance), false)
            }
            Material::Interface => {
                self.interfaces += 1;
                (true, false)
            }
        };
        self.coloured += usize::from(!colourless);
        self.curved += usize::from(reflects && !matches!(shape, Shape::Quad { .. }));
    }
}
