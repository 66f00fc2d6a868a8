//! What accuracy costs in time, for one scene: the `study` command.
//!
//! ```text
//! sweep (`plan`) x seeds --render--> runs on disk (`store`)
//! reference in parts (`reference`) --+
//! runs, reference --> relMSE, bias, variance, intervals (`figures`, `table`)
//!                 --> cheapest setting for a target (`pareto`)
//!                 --> study.csv, study.json (`output`), plots (`plot`), index.html (`page`)
//! ```
//!
//! Runs go round by round, one seed of every setting in each, with parts of the reference between
//! them, until all seeds are done or the budget is spent: a study that ends early has fewer seeds,
//! hence wider intervals, and the same command goes on with it. A budget below half an hour also
//! means fewer photons in a pass, from the beginning (`plan::fewer_photons`). Seconds are those of rendering in
//! process: loading and writing are the same for all and left out.

mod bench;
mod clock;
mod encode;
mod error;
pub mod figures;
mod output;
mod page;
mod pareto;
pub mod plan;
mod plot;
pub mod rate;
mod reference;
pub mod store;
mod table;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bench::Bench;
pub use error::StudyError;
pub use figures::{Figures, Interval, Reference, figures, slope};
use plan::Sweep;
use store::{Fingerprint, Plan, Store};
pub use table::{Row, Study};

use crate::grid::load::load_volumes;
use crate::render::Exec;
use crate::scene::Scene;

/// What a study is asked for.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Folder of runs and results.
    pub folder: PathBuf,
    /// The scene as its commands should name it.
    pub scene_file: PathBuf,
    /// Minutes rather than half an hour.
    pub quick: bool,
    /// A reference picture; path tracing without it.
    pub reference: Option<PathBuf>,
    /// Time for everything; 150 s for a quick study, half an hour else. \[s\]
    pub budget: Option<Duration>,
    /// Width and height of the study's pictures. \[px\]
    pub resolution: Option<[u32; 2]>,
    /// Forget what the folder holds.
    pub anew: bool,
}

/// How a study ended.
#[derive(Debug)]
pub struct Outcome {
    /// Its figures.
    pub study: Study,
    /// Runs on disk, of all that were planned (reference parts left out).
    pub runs: [usize; 2],
    /// Ended by Ctrl-C.
    pub interrupted: bool,
    /// Files written.
    pub files: Vec<PathBuf>,
}

/// Default budgets, quick and full. \[s\]
const BUDGET: [u64; 2] = [1800, 150];

/// Runs or continues a study, and writes its results.
///
/// # Errors
/// [`StudyError`].
pub fn run(scene: &Scene, options: &Options, exec: &Exec<'_>) -> Result<Outcome, StudyError> {
    let started = Instant::now();
    let mut scene = scene.clone();
    let (given, resolution) = match &options.reference {
        Some(file) => {
            let own = scene.camera.resolution;
            let (picture, size) = reference::fitting(file, options.resolution, own, exec.warn)?;
            (Some(picture), Some(size))
        }
        None => (None, options.resolution),
    };
    let budget = options
        .budget
        .unwrap_or(Duration::from_secs(BUDGET[usize::from(options.quick)]));
    let fewer = match Plan::read(&options.folder)? {
        Some(plan) if !options.anew => plan.fewer_photons,
        _ if options.quick => plan::MOST_FEWER,
        _ => plan::fewer_photons(budget, Duration::from_secs(BUDGET[0])),
    };
    let sweep = Sweep::new(&scene, options.quick, fewer, resolution);
    let own_resolution = scene.camera.resolution;
    scene.camera.resolution = sweep.resolution;
    scene.settings.crop = None;
    let plan = Plan {
        fewer_photons: fewer,
        made_from: fingerprint(&scene, options, &sweep, exec),
    };
    let store = Store::open(&options.folder, &plan, options.anew)?;
    exec.progress.stage("load", None);
    let volumes = load_volumes(&scene, exec.warn)?;
    let mut bench = Bench::new(&scene, &sweep, &store, volumes, exec);
    bench.given = given.is_some();
    bench.recall()?;
    let interrupted = bench.render_all(started + budget)?;
    exec.progress.finish();

    let reference = match given {
        Some(reference) => reference,
        None => bench.reference()?.ok_or_else(|| StudyError::TooEarly {
            folder: options.folder.clone(),
        })?,
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let study = table::tabulate(&table::Made {
        scene: &scene.name,
        own_resolution,
        sweep: &sweep,
        store: &store,
        seeds: &bench.seeds,
        reference: &reference,
        parts: bench.parts,
        threads: exec.threads.unwrap_or(threads),
    })?;
    if study.rows.is_empty() {
        return Err(StudyError::TooEarly {
            folder: options.folder.clone(),
        });
    }
    let done = bench.seeds.iter().sum::<u64>() as usize;
    let planned = sweep.settings.len() * sweep.seeds as usize;
    let files = output::write(&study, &scene, &sweep, &store, &reference, options)?;
    Ok(Outcome {
        study,
        runs: [done, planned],
        interrupted,
        files,
    })
}

/// Everything that the runs depend on.
fn fingerprint(scene: &Scene, options: &Options, sweep: &Sweep, exec: &Exec<'_>) -> Fingerprint {
    let volumes: Vec<String> = scene
        .volumes
        .iter()
        .map(|v| store::stamp(&v.file))
        .collect();
    let program = std::env::current_exe().map(|exe| store::stamp(&exe));
    let reference = options.reference.as_deref().map(store::stamp);
    Fingerprint::new([
        ("scene", format!("{scene:?}")),
        ("volumes", volumes.join("\n")),
        ("settings of the sweep", format!("{sweep:?}")),
        ("threads", format!("{:?}", exec.threads)),
        ("reference", format!("{reference:?}")),
        ("program", program.unwrap_or_default()),
    ])
}
