//! The four calls into the renderer, in one place.

use std::io::Write;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::bail;
use vpm_vdb::film::Film;
use vpm_vdb::progress::Progress;
use vpm_vdb::report::{Effect, Report, Stage};
use vpm_vdb::scene::Scene;

/// How to run; none of it changes the picture that a pass adds.
pub(crate) struct Exec<'a> {
    pub(crate) threads: Option<usize>,
    pub(crate) progress: &'a dyn Progress,
    pub(crate) time_limit: Option<Duration>,
    pub(crate) stop: &'a AtomicBool,
}

/// What comes back.
pub(crate) struct Rendered {
    pub(crate) film: Film,
    pub(crate) report: Report,
    pub(crate) stopped_early: bool,
}

/// Renders one frame.
pub(crate) fn run_render(_scene: &Scene, exec: &Exec<'_>) -> anyhow::Result<Rendered> {
    let _ = (exec.threads, exec.progress, exec.time_limit, exec.stop);
    bail!("this build has no renderer yet")
}

/// Which effects the scene calls for, and what the stages should cost.
pub(crate) fn run_plan(_scene: &Scene) -> anyhow::Result<(Vec<Effect>, Vec<Stage>)> {
    bail!("this build has no planner yet")
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
