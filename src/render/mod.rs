//! Passes over the picture: photons, map, camera rays, film.
//!
//! A photon pass (`photons`) traces fresh photons, gives each its radius, sorts them into tiles
//! (or trees) and walks the tiles in parallel; passes are independent and their average is consistent, since
//! radii shrink from pass to pass (`photon::radius`). A path pass (`path`) traces a few paths
//! through every pixel. The streams of random numbers belong to photons and pixels, and every sum
//! has one order: the number of threads changes nothing.

mod bright;
mod camera;
pub mod checkpoint;
mod edges;
pub mod error;
mod forecast;
mod job;
mod passes;
mod path;
mod photons;
mod pilot;

pub(crate) use path::PATHS_PER_PASS;

use std::ops::ControlFlow;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use glam::Vec3;
use thiserror::Error;

use crate::effects::EffectPlan;
use crate::film::{Film, Sample};
use crate::grid::load::load_volumes;
use crate::photon::{Energy, Packed};
use crate::progress::Progress;
use crate::report::{Report, Times};
use crate::scene::Scene;
use crate::tracking::Counters;
use crate::world::LoadedVolume;

use checkpoint::Checkpoint;
use job::in_world;
use passes::run;

pub use forecast::Forecast;

/// How to render; changes nothing in the picture.
#[derive(Clone, Copy)]
pub struct Exec<'a> {
    /// Threads; all without it.
    pub threads: Option<usize>,
    /// Who is told.
    pub progress: &'a dyn Progress,
    /// No pass begins that would probably end later than this.
    pub time_limit: Option<Duration>,
    /// Hears of what was cleaned or chosen while loading.
    pub warn: &'a (dyn Fn(&str) + Sync),
    /// Set to stop after the pass in hand.
    pub stop: &'a AtomicBool,
}

impl std::fmt::Debug for Exec<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Exec")
            .field("threads", &self.threads)
            .field("time_limit", &self.time_limit)
            .finish_non_exhaustive()
    }
}

/// A rendered picture.
#[derive(Debug)]
pub struct Rendered {
    /// Pixels.
    pub film: Film,
    /// What was done.
    pub report: Report,
    /// Where the photons' power went, all passes together.
    pub energy: Energy,
    /// What was done how often.
    pub counters: Counters,
    /// Fewer passes than asked for.
    pub stopped_early: bool,
}

/// Why a scene cannot be rendered.
#[derive(Debug, Error)]
pub enum RenderError {
    /// A volume cannot be loaded.
    #[error(transparent)]
    Volume(#[from] crate::grid::load::LoadError),
    /// An object or a light cannot be loaded.
    #[error(transparent)]
    World(#[from] crate::world::WorldError),
    /// No thread pool.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },
}

/// Renders a scene.
///
/// # Errors
/// [`RenderError`]: a volume, an object or a light that cannot be read.
pub fn render(scene: &Scene, exec: &Exec<'_>) -> Result<Rendered, RenderError> {
    render_kept(scene, exec, None)
}

/// Renders a scene, going on from a checkpoint and keeping its state in it.
///
/// # Errors
/// [`RenderError`]: a volume, an object or a light that cannot be read.
pub fn render_kept(
    scene: &Scene,
    exec: &Exec<'_>,
    keep: Option<&mut Checkpoint>,
) -> Result<Rendered, RenderError> {
    render_told(scene, exec, keep, &mut unwatched)
}

/// [`render_kept`] that tells `watch` of each pass.
///
/// # Errors
/// [`RenderError`]: a volume that cannot be read, or what this version does not render.
pub fn render_told(
    scene: &Scene,
    exec: &Exec<'_>,
    keep: Option<&mut Checkpoint>,
    watch: &mut dyn Watch,
) -> Result<Rendered, RenderError> {
    pool(exec)?.install(|| {
        let start = Instant::now();
        exec.progress.stage("load", None);
        let volumes = load_volumes(scene, exec.warn)?;
        let load = start.elapsed().as_secs_f64();
        let mut rendered = planned(scene, volumes, exec, start, Beside { keep, watch })?;
        rendered.report.time_s.load = load;
        Ok(rendered)
    })
}

/// Renders a scene whose volumes, one for each of the scene's in order, are in memory already;
/// their files are not looked at.
///
/// # Errors
/// [`RenderError`]: an object or a light that cannot be read.
pub fn render_loaded(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
) -> Result<Rendered, RenderError> {
    pool(exec)?.install(|| {
        let beside = Beside {
            keep: None,
            watch: &mut unwatched,
        };
        planned(scene, volumes, exec, Instant::now(), beside)
    })
}

/// A pass that is done, as [`render_watched`] tells of it.
#[derive(Debug)]
pub struct PassDone<'a> {
    /// Its number, from 0.
    pub pass: u32,
    /// Dimension of the kernel whose schedule the radii follow.
    pub dimension: u32,
    /// All passes so far.
    pub film: &'a Film,
    /// Pixels of this pass, row-major.
    pub samples: &'a [Sample],
    /// The same from other radii, where [`Watch::second_radius`] asked for it.
    pub second: Option<&'a [Sample]>,
    /// Since the render began, loading excluded. \[s\]
    pub seconds: f64,
    /// By stage, all passes so far.
    pub times: Times,
}

/// Hears of each pass.
pub trait Watch: Send {
    /// Factor on all radii with which the photons of `pass`, from 0, are to be gathered a second
    /// time along the same camera rays, beside the picture; not at all without it.
    fn second_radius(&self, _pass: u32) -> Option<f32> {
        None
    }

    /// Called after each pass; `Break` ends the render.
    fn pass_done(&mut self, done: &PassDone<'_>) -> ControlFlow<()>;
}

impl<F: FnMut(&PassDone<'_>) -> ControlFlow<()> + Send> Watch for F {
    fn pass_done(&mut self, done: &PassDone<'_>) -> ControlFlow<()> {
        self(done)
    }
}

/// [`render_loaded`] that tells `watch` of each pass.
///
/// # Errors
/// [`RenderError`]: what this version does not render.
pub fn render_watched(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
    watch: &mut dyn Watch,
) -> Result<Rendered, RenderError> {
    pool(exec)?.install(|| {
        let beside = Beside { keep: None, watch };
        planned(scene, volumes, exec, Instant::now(), beside)
    })
}

/// What goes on beside the passes.
struct Beside<'a> {
    /// Keeps the state.
    keep: Option<&'a mut Checkpoint>,
    /// Hears of each pass.
    watch: &'a mut dyn Watch,
}

/// Watches nothing.
fn unwatched(_: &PassDone<'_>) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The threads of a render.
fn pool(exec: &Exec<'_>) -> Result<rayon::ThreadPool, RenderError> {
    let threads = exec.threads.unwrap_or(0);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| RenderError::Threads {
            threads,
            reason: e.to_string(),
        })
}

/// Renders in the form that the effect plan chooses.
fn planned(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
    start: Instant,
    beside: Beside<'_>,
) -> Result<Rendered, RenderError> {
    let plan = EffectPlan::new(scene, &volumes);
    in_form(scene, volumes, plan, exec, (start, beside))
}

/// Renders a scene whose volumes are in memory in the forms of a plan that may be more general than
/// its own: to measure what each of them saves. The whole began at `start`.
///
/// # Errors
/// [`RenderError`]: what this version does not render.
pub fn render_as(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    plan: EffectPlan,
    exec: &Exec<'_>,
    start: Instant,
) -> Result<Rendered, RenderError> {
    let beside = Beside {
        keep: None,
        watch: &mut unwatched,
    };
    in_form(scene, volumes, plan, exec, (start, beside))
}

/// Renders in the forms of a plan.
fn in_form(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    plan: EffectPlan,
    exec: &Exec<'_>,
    (start, beside): (Instant, Beside<'_>),
) -> Result<Rendered, RenderError> {
    let (scene, volumes) = plan.kept.take(scene, volumes, plan.emission);
    let scene = &scene;
    let clock = Instant::now();
    let mut rendered = match (plan.chromatic, plan.headings) {
        (false, false) => in_world(scene, volumes, &plan, exec, |job| {
            run::<f32, ()>(job, clock, start, beside)
        }),
        (false, true) => in_world(scene, volumes, &plan, exec, |job| {
            run::<f32, Packed>(job, clock, start, beside)
        }),
        (true, false) => in_world(scene, volumes, &plan, exec, |job| {
            run::<Vec3, ()>(job, clock, start, beside)
        }),
        (true, true) => in_world(scene, volumes, &plan, exec, |job| {
            run::<Vec3, Packed>(job, clock, start, beside)
        }),
    }?;
    exec.progress.finish();
    rendered.report.threads = rayon::current_num_threads();
    rendered.report.effects = plan.effects;
    rendered.report.dropped = plan.dropped;
    let counts = rendered.counters.by_effect();
    for (effect, count) in rendered.report.effects.iter_mut().zip(counts) {
        effect.count = Some(count);
    }
    rendered.report.time_s.total = start.elapsed().as_secs_f64();
    Ok(rendered)
}

/// The effect plan of a scene and what its stages should cost, without rendering it.
///
/// # Errors
/// [`RenderError`]: a volume, an object or a light that cannot be read.
pub fn plan(scene: &Scene, exec: &Exec<'_>) -> Result<(EffectPlan, Forecast), RenderError> {
    pool(exec)?.install(|| {
        let start = Instant::now();
        let volumes = load_volumes(scene, exec.warn)?;
        let load = start.elapsed().as_secs_f64();
        plan_loaded(scene, volumes, exec).map(|(plan, mut forecast)| {
            forecast.stages[0].seconds_estimate = Some(load);
            (plan, forecast)
        })
    })
}

/// As [`plan`], of volumes that are in memory already.
///
/// # Errors
/// [`RenderError`]: an object or a light that cannot be read.
pub fn plan_loaded(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
) -> Result<(EffectPlan, Forecast), RenderError> {
    let plan = EffectPlan::new(scene, &volumes);
    let (scene, volumes) = plan.kept.take(scene, volumes, plan.emission);
    let scene = &scene;
    let clock = Instant::now();
    let forecast = match (plan.chromatic, plan.headings) {
        (false, false) => in_world(scene, volumes, &plan, exec, |job| {
            forecast::forecast::<f32, ()>(job, clock.elapsed())
        }),
        (false, true) => in_world(scene, volumes, &plan, exec, |job| {
            forecast::forecast::<f32, Packed>(job, clock.elapsed())
        }),
        (true, false) => in_world(scene, volumes, &plan, exec, |job| {
            forecast::forecast::<Vec3, ()>(job, clock.elapsed())
        }),
        (true, true) => in_world(scene, volumes, &plan, exec, |job| {
            forecast::forecast::<Vec3, Packed>(job, clock.elapsed())
        }),
    }?;
    Ok((plan, forecast))
}
