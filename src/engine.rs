//! The four calls into the renderer, in one place.

use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use vpm_vdb::effects::EffectPlan;
use vpm_vdb::info::{self, InfoOptions};
use vpm_vdb::progress::Silent;
use vpm_vdb::render::checkpoint::Checkpoint;
use vpm_vdb::render::{self, Exec, Forecast, Rendered, Watch};
use vpm_vdb::scene::{Scene, bare};

/// Renders one frame, going on from a checkpoint and keeping its state in it; `watch` is told
/// of each pass.
pub(crate) fn run_render(
    scene: &Scene,
    exec: &Exec<'_>,
    keep: &mut Checkpoint,
    watch: &mut dyn Watch,
) -> anyhow::Result<Rendered> {
    Ok(render::render_told(scene, exec, Some(keep), watch)?)
}

/// Which effects the scene calls for, and what the stages should cost.
pub(crate) fn run_plan(
    scene: &Scene,
    warn: &(dyn Fn(&str) + Sync),
) -> anyhow::Result<(EffectPlan, Forecast)> {
    let exec = Exec {
        threads: None,
        progress: &Silent,
        time_limit: None,
        warn,
        stop: &AtomicBool::new(false),
    };
    Ok(render::plan(scene, &exec)?)
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
