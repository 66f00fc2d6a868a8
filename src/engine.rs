//! The four calls into the renderer, in one place.

use std::io::Write;
use std::path::Path;

use vpm_vdb::info::{self, InfoOptions};
use vpm_vdb::render::{self, Exec, Rendered};
use vpm_vdb::report::{Effect, Stage};
use vpm_vdb::scene::{Scene, bare};

/// Renders one frame.
pub(crate) fn run_render(scene: &Scene, exec: &Exec<'_>) -> anyhow::Result<Rendered> {
    Ok(render::render(scene, exec)?)
}

/// Which effects the scene calls for, and what the stages should cost.
pub(crate) fn run_plan(
    scene: &Scene,
    warn: &dyn Fn(&str),
) -> anyhow::Result<(Vec<Effect>, Vec<Stage>)> {
    let plan = render::plan(scene, warn)?;
    Ok((plan.effects, Vec::new()))
}

/// Lists grids or values; returns remarks for the user.
pub(crate) fn run_info(
    file: &Path,
    json: bool,
    grid: Option<String>,
    at: &[[i32; 3]],
    out: &mut dyn Write,
) -> anyhow::Result<Vec<String>> {
    let options = InfoOptions {
        json,
        grid,
        at: at.to_vec(),
    };
    Ok(info::run(file, &options, out)?)
}

/// A scene around a lone volume.
pub(crate) fn bare_scene(vdb: &Path) -> anyhow::Result<Scene> {
    Ok(bare::scene_for(vdb)?)
}
