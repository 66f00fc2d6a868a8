//! The four calls into the renderer, in one place.

use std::io::Write;
use std::path::Path;

use anyhow::bail;
use vpm_vdb::render::{self, Exec, Rendered};
use vpm_vdb::report::{Effect, Stage};
use vpm_vdb::scene::Scene;

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

/// Lists grids or values.
pub(crate) fn run_info(
    _file: &Path,
    _json: bool,
    _grid: Option<String>,
    _at: &[[i32; 3]],
    _out: &mut dyn Write,
) -> anyhow::Result<()> {
    bail!("this build cannot list grids yet")
}

/// A scene around a lone volume.
pub(crate) fn bare_scene(_vdb: &Path) -> anyhow::Result<Scene> {
    bail!("this build cannot frame a lone volume yet")
}
