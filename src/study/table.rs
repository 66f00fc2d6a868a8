//! The study's figures: one row for each setting and checkpoint, and what follows from them.

use serde::{Deserialize, Serialize};

use super::StudyError;
use super::figures::{Figures, Reference, figures, median, slope};
use super::pareto::{self, EqualTime, Target};
use super::plan::{Knob, Setting, Sweep, direct_name, kernel_name, march_name};
use super::rate::{self, Convergence};
use super::store::{Pixels, Run, Store};
use crate::photon::radius::radius_scale;
use crate::report::Times;
use crate::scene::Method;

/// One setting at one checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Setting, as in the store.
    pub setting: String,
    /// What differs from the base.
    pub knob: Knob,
    /// `beam`, `point`, `path`.
    pub method: String,
    /// Photons emitted in each pass; 0 for paths.
    pub photons: u64,
    /// Passes so far.
    pub passes: u32,
    /// Camera rays of a pixel so far.
    pub spp: u32,
    /// Photons within a radius.
    pub neighbours: u32,
    /// Kernel.
    pub kernel: String,
    /// `exact`, or the step in voxels.
    pub march: String,
    /// First order.
    pub direct: String,
    /// Highest scattering order.
    pub max_bounces: u32,
    /// Root mean square radius of all passes over that of the base's first; null for paths.
    pub radius: Option<f64>,
    /// Seeds rendered.
    pub seeds: usize,
    /// Median over the seeds; loading and writing excluded. \[s\]
    pub seconds: f64,
    /// The same at the scene's own resolution, estimated: camera rays in proportion to the pixels,
    /// all else as it is. \[s\]
    pub seconds_own_resolution: f64,
    /// Mean over the seeds, by stage.
    pub time_s: Times,
    /// Figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// No other row is both faster and better.
    pub pareto: bool,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Study {
    /// Scene name.
    pub scene: String,
    /// Version of this program.
    pub version: String,
    /// Processor, as the system names it.
    pub machine: String,
    /// Threads.
    pub threads: usize,
    /// Width and height of the study's pictures. \[px\]
    pub resolution: [u32; 2],
    /// Width and height of the scene's own. \[px\]
    pub own_resolution: [u32; 2],
    /// Paths of a pixel in the reference; 0 for a picture from elsewhere.
    pub reference_spp: u64,
    /// relMSE that the reference's own noise adds, subtracted in all figures.
    pub reference_relmse: f64,
    /// Pixels that were not finite, in all runs.
    pub nonfinite_pixels: u64,
    /// Rows.
    pub rows: Vec<Row>,
    /// Rates.
    pub convergence: Vec<Convergence>,
    /// Cheapest settings.
    pub targets: Vec<Target>,
    /// Methods against each other.
    pub equal_time: Vec<EqualTime>,
}

impl Study {
    /// Rows of a knob of one method, with the base at as many passes, in the knob's order.
    #[must_use]
    pub fn turned(&self, knob: Knob, method: &str) -> Vec<&Row> {
        let of_knob = |r: &&Row| r.knob == knob && r.method == method;
        let passes = self.rows.iter().filter(of_knob).map(|r| r.passes).max();
        self.rows
            .iter()
            .filter(|r| r.method == method && Some(r.passes) == passes)
            .filter(|r| r.knob == knob || r.knob == Knob::Base)
            .collect()
    }

    /// Rows of a method's base, by passes.
    #[must_use]
    pub fn base(&self, method: &str) -> Vec<&Row> {
        let of = |r: &&Row| r.knob == Knob::Base && r.method == method;
        self.rows.iter().filter(of).collect()
    }

    /// Methods that have a base row.
    #[must_use]
    pub fn methods(&self) -> Vec<&str> {
        let mut all: Vec<&str> = Vec::new();
        for row in self.rows.iter().filter(|r| r.knob == Knob::Base) {
            if !all.contains(&row.method.as_str()) {
                all.push(&row.method);
            }
        }
        all
    }
}

/// Pictures of the first `seeds` seeds.
fn runs(store: &Store, setting: &Setting, seeds: u64) -> Result<Vec<Run>, StudyError> {
    let all: Result<Vec<Option<Run>>, StudyError> = (0..seeds)
        .map(|seed| store.get(&setting.name, seed))
        .collect();
    Ok(all?.into_iter().flatten().collect())
}

/// Mean by stage.
fn mean_times(runs: &[Run], checkpoint: usize) -> Times {
    let n = runs.len() as f64;
    let mean = |of: fn(&Times) -> f64| {
        runs.iter()
            .map(|r| of(&r.header.checkpoints[checkpoint].times))
            .sum::<f64>()
            / n
    };
    Times {
        total: 0.0,
        load: 0.0,
        build: mean(|t| t.build),
        photons: mean(|t| t.photons),
        map: mean(|t| t.map),
        gather: mean(|t| t.gather),
        output: 0.0,
    }
}

/// Root mean square radius over the passes, in units of the base's first pass.
fn radius(setting: &Setting, base: &Setting, passes: u32) -> Option<f64> {
    let (s, b) = (&setting.settings, &base.settings);
    let dimension = match s.method {
        Method::Path => return None,
        Method::Beam => 2,
        Method::Point => 3,
    };
    let ratio =
        f64::from(s.neighbours) / f64::from(b.neighbours) * b.photons as f64 / s.photons as f64;
    let squares: f64 = (0..passes)
        .map(|j| f64::from(radius_scale(j, dimension)).powi(2))
        .sum();
    Some(ratio.cbrt() * (squares / f64::from(passes)).sqrt())
}

/// Does the knob leave the picture that is aimed at the same?
pub(super) fn same_picture(knob: Knob) -> bool {
    matches!(
        knob,
        Knob::Base | Knob::Photons | Knob::Neighbours | Knob::Rays | Knob::Rate
    )
}

/// What has been rendered.
#[derive(Debug)]
pub(super) struct Made<'a> {
    /// Scene name.
    pub(super) scene: &'a str,
    /// The scene's own width and height. \[px\]
    pub(super) own_resolution: [u32; 2],
    /// What was planned.
    pub(super) sweep: &'a Sweep,
    /// Where it is.
    pub(super) store: &'a Store,
    /// Finished seeds of each setting.
    pub(super) seeds: &'a [u64],
    /// The reference.
    pub(super) reference: &'a Reference,
    /// Its parts; 0 for a picture from elsewhere.
    pub(super) parts: u64,
    /// Threads.
    pub(super) threads: usize,
}

/// All figures from the runs on disk.
pub(super) fn tabulate(made: &Made<'_>) -> Result<Study, StudyError> {
    let (sweep, store, reference) = (made.sweep, made.store, made.reference);
    let pixels = |[w, h]: [u32; 2]| f64::from(w) * f64::from(h);
    let larger = pixels(made.own_resolution) / pixels(sweep.resolution);
    let mut rows = Vec::new();
    let mut convergence = Vec::new();
    let mut nonfinite = 0;
    for (setting, seeds) in sweep.settings.iter().zip(made.seeds) {
        let runs = runs(store, setting, *seeds)?;
        if runs.is_empty() {
            continue;
        }
        nonfinite += runs.iter().map(|r| r.header.nonfinite_pixels).sum::<u64>();
        let base = sweep.base(setting.settings.method);
        let base_runs = match base {
            Some(base) if setting.knob != Knob::Base => self::runs(store, base, runs.len() as u64)?,
            _ => Vec::new(),
        };
        let first = rows.len();
        for (i, passes) in setting.checkpoints.iter().enumerate() {
            let pictures: Vec<Pixels> = runs.iter().map(|r| r.pictures[i].clone()).collect();
            let at = base.and_then(|b| b.checkpoints.iter().position(|p| p == passes));
            let paired: Option<Vec<Pixels>> = at
                .filter(|_| base_runs.len() == runs.len())
                .map(|at| base_runs.iter().map(|r| r.pictures[at].clone()).collect());
            let seconds: Vec<f64> = runs
                .iter()
                .map(|r| r.header.checkpoints[i].seconds)
                .collect();
            let s = &setting.settings;
            let path = s.method == Method::Path;
            let time_s = mean_times(&runs, i);
            let seconds = median(&seconds);
            rows.push(Row {
                setting: setting.name.clone(),
                knob: setting.knob,
                method: s.method.name().to_owned(),
                photons: if path { 0 } else { s.photons },
                passes: *passes,
                spp: if path {
                    passes * super::plan::PATHS_PER_PASS
                } else {
                    passes * s.spp
                },
                neighbours: if path { 0 } else { s.neighbours },
                kernel: kernel_name(s.kernel).to_owned(),
                march: march_name(s.march),
                direct: direct_name(s.direct).to_owned(),
                max_bounces: s.max_bounces,
                radius: base.and_then(|b| radius(setting, b, *passes)),
                seeds: runs.len(),
                seconds,
                seconds_own_resolution: seconds + time_s.gather * (larger - 1.0),
                time_s,
                figures: figures(&pictures, reference, paired.as_deref()),
                pareto: false,
            });
        }
        if matches!(setting.knob, Knob::Base | Knob::Rate)
            && let Some(slopes) = slopes(setting, &runs, reference)
        {
            convergence.extend(rate::convergence(&rows[first..], &slopes));
        }
    }
    pareto::mark(&mut rows, same_picture);
    let mut study = Study {
        scene: made.scene.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        machine: machine(),
        threads: made.threads,
        resolution: sweep.resolution,
        own_resolution: made.own_resolution,
        reference_spp: made.parts * u64::from(super::reference::PART_SPP),
        reference_relmse: reference.own_relmse(),
        nonfinite_pixels: nonfinite,
        rows,
        convergence,
        targets: Vec::new(),
        equal_time: Vec::new(),
    };
    study.targets = pareto::targets(&study, same_picture);
    study.equal_time = pareto::equal_time(&study);
    Ok(study)
}

/// Slope of relMSE over the checkpoints, of each seed.
fn slopes(setting: &Setting, runs: &[Run], reference: &Reference) -> Option<Vec<f64>> {
    let relmse = |picture: &Pixels| {
        let one = std::slice::from_ref(picture);
        figures(one, reference, None).relmse.value
    };
    let of_seed = |run: &Run| {
        let points: Vec<(f64, f64)> = run
            .pictures
            .iter()
            .zip(&setting.checkpoints)
            .map(|(picture, passes)| (f64::from(*passes), relmse(picture)))
            .collect();
        slope(&points)
    };
    runs.iter().map(of_seed).collect()
}

/// The processor, as Linux names it.
fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    text.lines()
        .find_map(|l| l.strip_prefix("model name")?.split_once(':'))
        .map_or_else(
            || std::env::consts::ARCH.to_owned(),
            |(_, name)| name.trim().to_owned(),
        )
}
