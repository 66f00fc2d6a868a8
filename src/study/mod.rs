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
//! hence wider intervals, and the same command goes on with it. Seconds are those of rendering in
//! process: loading and writing are the same for all and left out.

mod clock;
mod encode;
pub mod figures;
mod output;
mod page;
mod pareto;
pub mod plan;
mod plot;
mod reference;
pub mod store;
mod table;

use std::io;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clock::Clock;
pub use figures::{Figures, Interval, Reference, figures, slope};
use plan::{Setting, Sweep};
use store::{Checkpoint, Fingerprint, Header, Pixels, Run, Store};
pub use table::{Row, Study};

use crate::atomic::OutputError;
use crate::film::Film;
use crate::grid::load::load_volumes;
use crate::image::ImageError;
use crate::progress::Silent;
use crate::render::{Exec, PassDone, RenderError, Rendered, render_watched};
use crate::scene::{Method, Scene};
use crate::world::LoadedVolume;

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

/// Why a study cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// Rendering.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Loading.
    #[error(transparent)]
    Load(#[from] crate::grid::load::LoadError),
    /// Writing.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A picture.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file of the study.
    #[error("cannot use {}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file of the study that is not what it should be.
    #[error("{} is damaged: {reason}; remove it, and the study makes it again", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The folder is taken.
    #[error(
        "{} holds a study that was made differently (changed: {changed}); choose another folder with -o, or begin anew with --anew",
        folder.display()
    )]
    OtherStudy {
        /// The folder.
        folder: PathBuf,
        /// What changed.
        changed: String,
    },
    /// The reference picture does not fit.
    #[error("reference {}: {reason}", file.display())]
    Reference {
        /// The picture.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A plot could not be drawn.
    #[error("cannot draw {name}: {reason}")]
    Plot {
        /// Which.
        name: String,
        /// Why.
        reason: String,
    },
    /// Stopped before there was anything to show.
    #[error(
        "stopped before the first setting was done; what is finished is kept in {}, and the same command goes on",
        folder.display()
    )]
    TooEarly {
        /// The folder.
        folder: PathBuf,
    },
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
    let mut resolution = options.resolution;
    let given = match &options.reference {
        Some(file) => {
            let (picture, size) = reference::read(file, exec.warn)?;
            if resolution.is_some_and(|r| r != size) {
                return Err(StudyError::Reference {
                    file: file.clone(),
                    reason: format!(
                        "it has {}x{} pixels; leave out --resolution, or give that",
                        size[0], size[1]
                    ),
                });
            }
            let aspect = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h);
            let own = scene.camera.resolution;
            if (aspect(size) / aspect(own) - 1.0).abs() > 0.02 && options.resolution.is_none() {
                return Err(StudyError::Reference {
                    file: file.clone(),
                    reason: format!(
                        "its shape, {}x{}, is not that of the scene, {}x{}",
                        size[0], size[1], own[0], own[1]
                    ),
                });
            }
            resolution = Some(size);
            Some(picture)
        }
        None => None,
    };
    let sweep = Sweep::new(&scene, options.quick, resolution);
    let own_resolution = scene.camera.resolution;
    scene.camera.resolution = sweep.resolution;
    scene.settings.crop = None;
    let store = Store::open(
        &options.folder,
        &fingerprint(&scene, options, &sweep, exec),
        options.anew,
    )?;
    exec.progress.stage("load", None);
    let volumes = load_volumes(&scene, exec.warn)?;
    let budget = options
        .budget
        .unwrap_or(Duration::from_secs(BUDGET[usize::from(options.quick)]));
    let mut bench = Bench {
        scene: &scene,
        sweep: &sweep,
        store: &store,
        volumes,
        exec,
        clock: Clock::default(),
        deadline: started + budget,
        seeds: vec![0; sweep.settings.len()],
        parts: 0,
        spent: [0.0; 2],
    };
    bench.recall(given.is_some())?;
    let interrupted = bench.render_all(given.is_some())?;
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

/// Where runs are made.
struct Bench<'a> {
    scene: &'a Scene,
    sweep: &'a Sweep,
    store: &'a Store,
    volumes: Vec<LoadedVolume>,
    exec: &'a Exec<'a>,
    clock: Clock,
    deadline: Instant,
    /// Finished seeds of each setting: 0, 1, ... in order.
    seeds: Vec<u64>,
    /// Finished parts of the reference.
    parts: u64,
    /// Seconds of the sweep and of the reference.
    spent: [f64; 2],
}

/// What is rendered next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    Part(u64),
    Seed(usize, u64),
}

impl Bench<'_> {
    /// The setting of a part of the reference.
    fn part(&self) -> Setting {
        let mut settings = self.scene.settings.clone();
        settings.method = Method::Path;
        settings.spp = reference::PART_SPP;
        Setting {
            name: reference::NAME.to_owned(),
            knob: plan::Knob::Base,
            settings,
            checkpoints: vec![reference::PART_SPP / plan::PATHS_PER_PASS],
        }
    }

    /// Counts what is on disk.
    fn recall(&mut self, given: bool) -> Result<(), StudyError> {
        let part = self.part();
        while !given
            && let Some(run) = self
                .store
                .get(reference::NAME, reference::FIRST_SEED + self.parts)?
        {
            self.parts += 1;
            self.learn(&part, &run.header, 1);
        }
        for i in 0..self.sweep.settings.len() {
            let setting = &self.sweep.settings[i];
            while self.seeds[i] < self.sweep.seeds
                && let Some(run) = self.store.get(&setting.name, self.seeds[i])?
            {
                self.seeds[i] += 1;
                self.learn(setting, &run.header, 0);
            }
        }
        Ok(())
    }

    fn learn(&mut self, setting: &Setting, header: &Header, kind: usize) {
        let seconds = header.checkpoints.last().map_or(0.0, |c| c.seconds);
        self.spent[kind] += seconds;
        self.clock.learn(
            &setting.name,
            &setting.settings,
            self.sweep.resolution,
            seconds,
        );
    }

    fn expect(&self, setting: &Setting) -> f64 {
        self.clock
            .expect(&setting.name, &setting.settings, self.sweep.resolution)
    }

    fn most_parts(&self) -> u64 {
        u64::from(self.sweep.reference_spp / reference::PART_SPP)
    }

    /// The next run: two parts of the reference and two seeds of the bases come whatever the
    /// budget, for without them there is nothing to show.
    fn next(&self, given: bool, left: f64) -> Option<Next> {
        let part = self.part();
        let must_part = !given && self.parts < 2;
        if must_part {
            return Some(Next::Part(self.parts));
        }
        let bases = self.sweep.settings.iter().enumerate();
        let must = bases
            .filter(|(_, s)| s.knob == plan::Knob::Base)
            .find(|(i, _)| self.seeds[*i] < 2);
        if let Some((i, _)) = must {
            return Some(Next::Seed(i, self.seeds[i]));
        }
        let share = self.sweep.reference_share;
        let behind = self.spent[1] < share / (1.0 - share) * self.spent[0];
        if !given && behind && self.parts < self.most_parts() && self.expect(&part) < left {
            return Some(Next::Part(self.parts));
        }
        let round = self.seeds.iter().copied().min().unwrap_or(0);
        (round..self.sweep.seeds).find_map(|seed| {
            let fits = |(i, s): (usize, &Setting)| {
                (self.seeds[i] == seed && self.expect(s) < left).then_some(Next::Seed(i, seed))
            };
            self.sweep.settings.iter().enumerate().find_map(fits)
        })
    }

    /// Seconds of what is still planned.
    fn ahead(&self, given: bool) -> f64 {
        let sweep: f64 = self
            .sweep
            .settings
            .iter()
            .zip(&self.seeds)
            .map(|(s, done)| (self.sweep.seeds - done) as f64 * self.expect(s))
            .sum();
        let share = self.sweep.reference_share;
        let whole = share / (1.0 - share) * (sweep + self.spent[0]);
        let parts = (self.most_parts() - self.parts.min(self.most_parts())) as f64;
        let most = parts * self.expect(&self.part());
        sweep
            + if given {
                0.0
            } else {
                (whole - self.spent[1]).clamp(0.0, most)
            }
    }

    /// Renders until all is done or the time is up; true if it was interrupted.
    fn render_all(&mut self, given: bool) -> Result<bool, StudyError> {
        let began = Instant::now();
        loop {
            if self.exec.stop.load(Ordering::Relaxed) {
                return Ok(true);
            }
            let left = self
                .deadline
                .saturating_duration_since(Instant::now())
                .as_secs_f64();
            let Some(next) = self.next(given, left) else {
                return Ok(false);
            };
            let (setting, seed) = match next {
                Next::Part(k) => (self.part(), reference::FIRST_SEED + k),
                Next::Seed(i, seed) => (self.sweep.settings[i].clone(), seed),
            };
            let ahead = self.ahead(given).min(left.max(self.expect(&setting)));
            let gone = began.elapsed().as_secs_f64();
            let text = format!(
                "{} seed {}, {} to go",
                setting.name,
                seed % reference::FIRST_SEED,
                clock::words(ahead)
            );
            self.exec
                .progress
                .whole("study", gone / (gone + ahead).max(1e-9), &text);
            // A run may be there after one that is missing.
            let run = match self.store.get(&setting.name, seed)? {
                Some(run) => run,
                None => {
                    let Some(run) = self.render(&setting, seed)? else {
                        return Ok(true);
                    };
                    self.store.put(&run)?;
                    run
                }
            };
            match next {
                Next::Part(_) => self.parts += 1,
                Next::Seed(i, _) => self.seeds[i] += 1,
            }
            self.learn(
                &setting,
                &run.header,
                usize::from(matches!(next, Next::Part(_))),
            );
        }
    }

    /// One run; none if it was interrupted.
    fn render(&mut self, setting: &Setting, seed: u64) -> Result<Option<Run>, StudyError> {
        let mut scene = self.scene.clone();
        scene.settings = setting.settings.clone();
        scene.settings.seed = seed;
        let exec = Exec {
            progress: &Silent,
            time_limit: None,
            // What there is to warn of has been said while loading.
            warn: &|_| {},
            ..*self.exec
        };
        let mut checkpoints = Vec::new();
        let mut pictures = Vec::new();
        let mut keep = |done: &PassDone<'_>| {
            if setting.checkpoints.contains(&done.film.passes()) {
                checkpoints.push(Checkpoint {
                    passes: done.film.passes(),
                    seconds: done.seconds,
                    times: done.times,
                });
                pictures.push(pixels(done.film));
            }
            ControlFlow::Continue(())
        };
        let Rendered { film, report, .. } =
            render_watched(&scene, self.volumes.clone(), &exec, &mut keep)?;
        let whole = checkpoints.len() == setting.checkpoints.len();
        Ok(whole.then(|| Run {
            header: Header {
                name: setting.name.clone(),
                seed,
                resolution: self.sweep.resolution,
                checkpoints,
                nonfinite_pixels: film.nonfinite_pixels(),
                photons: report.photons,
                counters: report.counters,
            },
            pictures,
        }))
    }

    /// The reference from the parts on disk.
    fn reference(&self) -> Result<Option<Reference>, StudyError> {
        let mut parts = reference::Parts::default();
        for k in 0..self.parts {
            if let Some(run) = self.store.get(reference::NAME, reference::FIRST_SEED + k)?
                && let Some(picture) = run.pictures.first()
            {
                parts.add(picture);
            }
        }
        Ok(parts.reference())
    }
}

/// The film's colours.
fn pixels(film: &Film) -> Pixels {
    let [x0, y0, x1, y1] = film.crop();
    (y0..y1)
        .flat_map(|y| (x0..x1).map(move |x| film.mean(x, y).as_vec3().to_array()))
        .collect()
}

/// A file of the study's folder.
fn inside(folder: &Path, name: &str) -> PathBuf {
    folder.join(name)
}
