//! What the passes of a render share: the scene's world, its lights, the pixels to render.

use crate::effects::EffectPlan;
use crate::estimate::bands::TileGrid;
use crate::estimate::direct::DirectLights;
use crate::resolution;
use crate::scene::Scene;
use crate::spectrum::Spectrum;
use crate::surface::Surfaces;
use crate::world::{LoadedVolume, World};

use super::bright::BrightPixels;
use super::edges::EdgePixels;
use super::{Exec, RenderError};

/// What the passes share.
pub(super) struct Job<'a, S> {
    pub(super) scene: &'a Scene,
    pub(super) world: &'a World<S>,
    pub(super) plan: &'a EffectPlan,
    pub(super) exec: &'a Exec<'a>,
    /// Pixels that are rendered.
    pub(super) grid: TileGrid,
    pub(super) lights: &'a DirectLights,
    pub(super) bright: &'a BrightPixels,
    pub(super) edges: &'a EdgePixels,
}

/// Builds the world of a scene, and does something in it.
pub(super) fn in_world<S: Spectrum, T>(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    plan: &EffectPlan,
    exec: &Exec<'_>,
    then: impl FnOnce(&Job<'_, S>) -> T,
) -> Result<T, RenderError> {
    let world = World::with(scene, volumes, plan.general)?;
    for warning in world.surfaces.iter().flat_map(Surfaces::warnings) {
        (exec.warn)(&warning.to_string());
    }
    for warning in resolution::warnings(&world) {
        (exec.warn)(&warning);
    }
    let [width, height] = scene.camera.resolution;
    let settings = &scene.settings;
    // Of the whole picture: a crop shows the same pixels.
    let rays = u64::from(width) * u64::from(height) * u64::from(settings.spp);
    let lights = DirectLights::new(&world, plan.photons.then_some(settings.photons), rays);
    let [x0, y0, x1, y1] = scene.settings.crop.unwrap_or([0, 0, width, height]);
    let bright = BrightPixels::new(&world, plan, settings.method, [width, height]);
    let grid = TileGrid {
        low: [x0, y0],
        high: [x1, y1],
    };
    let edges = EdgePixels::new(&world, settings.method, &grid);
    Ok(then(&Job {
        scene,
        world: &world,
        plan,
        exec,
        grid,
        lights: &lights,
        bright: &bright,
        edges: &edges,
    }))
}
