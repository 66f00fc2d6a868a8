//! The effect plan: what this scene calls for, why, and in which specialised form.
//!
//! Computed once from the resolved scene and what its grids really hold. Everything that is not
//! active is not simulated: no time, no memory, no branch in a hot loop. Pruning is exact: it
//! leaves out what contributes nothing, never what contributes little.
//!
//! `facts` counts what the scene has, `kept` finds what of it cannot matter, `rules` say for each
//! effect what follows; this page turns the same facts into the choices that the renderer takes.
//! Without pruning every choice is the general one, and the picture is the same.

mod facts;
mod kept;
mod rules;

use crate::report::Effect;
use crate::scene::{Direct, Method, Scene};
use crate::world::LoadedVolume;

use facts::Facts;
pub use kept::{Dropped, Kept};

/// The general forms that a world takes; by default it takes the special ones where they do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct General {
    /// Homogeneous media and constant grids as grids of voxels, not in closed form; deposits in
    /// media that do not scatter too.
    pub grids: bool,
    /// A hierarchy over surfaces, though there are none.
    pub hierarchy: bool,
    /// Straight lines from boundary to boundary, though no object holds a medium.
    pub boundaries: bool,
    /// Points on lights, though they have no area.
    pub points: bool,
}

impl General {
    /// All of them.
    pub const ALL: Self = Self {
        grids: true,
        hierarchy: true,
        boundaries: true,
        points: true,
    };
}

/// What is simulated, and in which form.
#[derive(Debug, Clone)]
pub struct EffectPlan {
    /// Three channels rather than one.
    pub chromatic: bool,
    /// Photons keep their direction and their compartment: where a medium is anisotropic, or glass
    /// parts the world.
    pub headings: bool,
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
    /// Points on a lens; photons are gathered ray by ray.
    pub lens: bool,
    /// Forms of the world.
    pub general: General,
    /// What of the scene is simulated.
    pub kept: Kept,
    /// What is not, and why.
    pub dropped: Vec<Dropped>,
    /// The table for people and reports.
    pub effects: Vec<Effect>,
}

/// What follows from the facts for more than one effect.
#[derive(Debug, Clone, Copy)]
struct Needs {
    /// Something scatters in a medium.
    scattering: bool,
    /// More than once.
    multiple: bool,
    /// Something glows.
    emission: bool,
    chromatic: bool,
    direct: bool,
    surface_photons: bool,
    photons: bool,
}

impl Needs {
    fn new(scene: &Scene, facts: &Facts) -> Self {
        let settings = &scene.settings;
        let emission = facts.heat.as_ref().is_some_and(|h| h.emits);
        let lit = facts.shining() > 0 || emission;
        let scattering = lit && facts.media.scattering > 0 && settings.max_bounces > 0;
        let multiple = scattering && settings.max_bounces > 1;
        let sampled = facts.shining() - facts.lights.skies;
        let traced = lit && settings.method != Method::Path;
        // A photon is kept on a surface if something has scattered it before.
        let scattered_before = scattering || !facts.materials.one_flat();
        let indirect = settings.max_bounces > 1 && scattered_before;
        // Light straight from a medium is kept, too.
        let straight = settings.max_bounces > 0 && emission;
        let surface_photons = traced && facts.materials.diffuse > 0 && (indirect || straight);
        let from_photons =
            multiple || facts.lights.skies > 0 || emission || settings.direct == Direct::Photons;
        Self {
            scattering,
            multiple,
            emission,
            chromatic: facts.coloured() > 0 || emission,
            direct: scattering && sampled > 0 && settings.direct == Direct::Sampled,
            surface_photons,
            photons: traced && scattering && from_photons || surface_photons,
        }
    }
}

impl EffectPlan {
    /// The plan of a scene.
    #[must_use]
    pub fn new(scene: &Scene, volumes: &[LoadedVolume]) -> Self {
        if !scene.settings.pruning {
            return Self::general(scene, volumes);
        }
        let (kept, dropped) = kept::decide(scene, volumes);
        let facts = Facts::new(scene, volumes, &kept);
        let needs = Needs::new(scene, &facts);
        Self {
            chromatic: needs.chromatic,
            headings: needs.scattering
                && (facts.media.anisotropic > 0 || facts.materials.glass > 0),
            photons: needs.photons,
            direct: needs.direct,
            emission: needs.emission,
            surface_photons: needs.surface_photons,
            follow: needs.photons && facts.materials.specular + facts.materials.interfaces > 0,
            lens: scene.camera.lens.is_some(),
            general: General::default(),
            kept,
            dropped,
            effects: rules::effects(scene, &facts, needs),
        }
    }

    /// Everything, in its general form: what `--no-pruning` renders.
    fn general(scene: &Scene, volumes: &[LoadedVolume]) -> Self {
        let kept = Kept::all();
        let facts = Facts::new(scene, volumes, &kept);
        let beams = scene.settings.method != Method::Path;
        let mut effects = rules::effects(scene, &facts, Needs::new(scene, &facts));
        for effect in &mut effects {
            effect.active = true;
            "in its general form, since nothing is pruned".clone_into(&mut effect.form);
        }
        Self {
            chromatic: true,
            headings: true,
            photons: beams,
            direct: beams && scene.settings.direct == Direct::Sampled,
            emission: true,
            surface_photons: beams,
            follow: beams,
            lens: true,
            general: General::ALL,
            kept,
            dropped: Vec::new(),
            effects,
        }
    }
}
