//! What the stages of a render should cost: foretold from well under a second of the real thing.
//!
//! ```text
//! load, build   done, and timed
//! photons       P n / n' t'              P passes of n photons, n' of them traced here in t'
//! map           pilot + P n / n' t'      the pilot is the real one
//! gather        p / p' (t_0 + (t' - t_0) m)    p' of p pixels, with photons t', without them t_0
//! output        p / p' t'                the pixels looked at, encoded to memory
//! ```
//!
//! A ray pierces n pi r^2 photons per unit of volume and length: with radii times sqrt(n / n'), as
//! many of the n' as it will of the n; spheres hold n r^3. m is the mean over the passes of their squared radii over
//! those of the first. Tiles are spread over the picture by the golden ratio. Memory is what the
//! calibration holds, in the same proportions.
//!
//! What it does not foresee: other work on the machine, caches that hold n' photons but not n, and
//! how far `--time` lets the passes go.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::job::Job;
use super::passes::Tally;
use super::photons::{Band, Gather, blur_dimension, trace};
use super::pilot::Radii;
use super::{path, pilot};
use crate::estimate::bands::TILE;
use crate::estimate::tiles::TileRays;
use crate::film::{Film, Sample};
use crate::image;
use crate::photon::radius::radius_scale;
use crate::photon::{Heading, Photons};
use crate::report::{PhotonCounts, Stage};
use crate::rng;
use crate::scene::{Method, Scene};
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

/// Photons traced, at most. Fewer: times below a millisecond, which tell nothing.
const FEW: u64 = 30_000;
/// Time for which tiles are looked at, with photons and again without.
const LOOK: Duration = Duration::from_millis(200);
/// Tiles that are looked at, at least.
const FEWEST: usize = 4;
/// Passes over which the shrinking of radii is averaged; beyond, it hardly changes.
const MOST_PASSES: u32 = 1000;

/// What a render should cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Forecast {
    /// In the order in which they run, named as in the report's `time_s`.
    pub stages: Vec<Stage>,
    /// Photons of all passes together.
    pub photons: PhotonCounts,
}

/// Time and memory of a stage.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    seconds: f64,
    bytes: f64,
}

/// A few photons, and what they are to stand for.
struct Few<'a, S: Spectrum, H> {
    photons: Photons<S, H>,
    radii: &'a Radii<S>,
    /// n / n'.
    ratio: f64,
}

/// Foretells the stages of a job whose world took `build`. Reading is timed by the caller.
pub(super) fn forecast<S: Spectrum, H: Heading>(job: &Job<'_, S>, build: Duration) -> Forecast {
    // More rays through a pixel cost as many times one.
    let mut scene = job.scene.clone();
    scene.settings.spp = 1;
    let one = Job {
        scene: &scene,
        ..*job
    };
    let settings = &job.scene.settings;
    let passes = f64::from(settings.passes);
    let (mut tracing, mut map) = (Cost::default(), Cost::default());
    let mut counts = PhotonCounts::default();
    let mut tally = Tally::default();
    let radii = job
        .plan
        .photons
        .then(|| pilot::radii::<S, H>(job, &mut tally));
    let few = radii.as_ref().map(|radii| {
        let emit = settings.photons.clamp(1, FEW);
        let ratio = settings.photons as f64 / emit as f64;
        let clock = Instant::now();
        let photons = trace::<S, H>(job, radii, emit, rng::Stage::Check, 0);
        tracing.seconds = passes * ratio * clock.elapsed().as_secs_f64();
        tracing.bytes = ratio * photons.memory_bytes() as f64;
        counts.emitted = settings.photons * u64::from(settings.passes);
        counts.stored = (passes * ratio * photons.stored() as f64) as u64;
        let clock = Instant::now();
        let sorted = Gather::new(job, Some((photons.clone(), radii)), [1.0; 2], 0);
        map.seconds = tally.times.map + passes * ratio * clock.elapsed().as_secs_f64();
        map.bytes = ratio * sorted.memory_bytes() as f64;
        Few {
            photons,
            radii,
            ratio,
        }
    });
    let looked = match settings.method {
        Method::Path => paths(&one),
        Method::Beam | Method::Point => beams(&one, few),
    };
    let ([x0, y0], [x1, y1]) = (job.grid.low, job.grid.high);
    let pixels = f64::from(x1 - x0) * f64::from(y1 - y0);
    let [width, height] = job.scene.camera.resolution;
    let rays = match settings.method {
        Method::Path => f64::from(settings.spp),
        Method::Beam | Method::Point => passes * f64::from(settings.spp),
    };
    let gather = Cost {
        seconds: pixels * rays * looked.seconds,
        bytes: Film::new(width, height, settings.crop).memory_bytes() as f64,
    };
    let known = |seconds, bytes: usize| Cost {
        seconds,
        bytes: bytes as f64,
    };
    let stages = [
        ("load", known(0.0, job.world.grid_bytes())),
        (
            "build",
            known(build.as_secs_f64(), job.world.structure_bytes()),
        ),
        ("photons", tracing),
        ("map", map),
        ("gather", gather),
        ("output", output(&looked.samples, pixels, &scene)),
    ];
    Forecast {
        stages: stages.map(Stage::from_cost).to_vec(),
        photons: counts,
    }
}

impl Stage {
    fn from_cost((name, cost): (&str, Cost)) -> Self {
        Self {
            name: name.to_owned(),
            seconds_estimate: Some(cost.seconds),
            memory_bytes: Some(cost.bytes.round() as u64),
        }
    }
}

/// What some pixels tell.
struct Looked {
    /// Of one ray through one pixel, all threads at work. \[s\]
    seconds: f64,
    samples: Vec<Sample>,
}

/// Camera rays with photons and without.
fn beams<S: Spectrum, H: Heading>(job: &Job<'_, S>, few: Option<Few<'_, S, H>>) -> Looked {
    let tiles = |gather: &Gather<'_, S, H>| {
        look(job, TileRays::default, |rays, band, column| {
            let mut counters = Counters::default();
            let sums = Band::new(job, gather, band, 0).tile(column, rays, &mut counters);
            let width = job.grid.high[0] - job.grid.low[0] - column * TILE;
            let rows = job.grid.high[1] - job.grid.low[1] - band * TILE;
            let inside = |i: u32| i % TILE < width && i / TILE < rows;
            (0..)
                .zip(&sums)
                .filter(|(i, _)| inside(*i))
                .map(|(_, s)| s.mean(1))
                .collect()
        })
    };
    let without = tiles(&Gather::new(job, None, [1.0; 2], 0));
    let Some(Few {
        photons,
        radii,
        ratio,
    }) = few
    else {
        return without;
    };
    let dimension = blur_dimension(job.scene.settings.method);
    let scale = ratio.powf(1.0 / f64::from(dimension)) as f32;
    let with = tiles(&Gather::new(job, Some((photons, radii)), [scale, 1.0], 0));
    let passes = job.scene.settings.passes.clamp(1, MOST_PASSES);
    let squares =
        (0..passes).map(|pass| f64::from(radius_scale(pass, dimension)).powi(dimension as i32));
    let mean = squares.sum::<f64>() / f64::from(passes);
    Looked {
        seconds: without.seconds + (with.seconds - without.seconds).max(0.0) * mean,
        samples: with.samples,
    }
}

/// Paths.
fn paths<S: Spectrum>(job: &Job<'_, S>) -> Looked {
    let mut looked = look(
        job,
        || (),
        |(), band, column| {
            let low = [
                job.grid.low[0] + column * TILE,
                job.grid.low[1] + band * TILE,
            ];
            let high = [0, 1].map(|a| (low[a] + TILE).min(job.grid.high[a]));
            let mut counters = Counters::default();
            (low[1]..high[1])
                .flat_map(|y| (low[0]..high[0]).map(move |x| [x, y]))
                .map(|pixel| path::pixel(job, pixel, 0, &mut counters))
                .collect()
        },
    );
    looked.seconds /= f64::from(path::PATHS_PER_PASS);
    looked
}

/// Looks at tiles, a few for each thread at a time, until the time is up.
fn look<S: Spectrum, R>(
    job: &Job<'_, S>,
    scratch: impl Fn() -> R + Sync + Send,
    tile: impl Fn(&mut R, u32, u32) -> Vec<Sample> + Sync + Send,
) -> Looked {
    /// Golden ratio in 2^-64: multiples of it fill the circle evenly, however many there are.
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let columns = u64::from(job.grid.columns());
    let count = columns * u64::from(job.grid.bands());
    let spread = |k: u64| ((u128::from(k.wrapping_mul(GOLDEN)) * u128::from(count)) >> 64) as u64;
    let batch = 2 * rayon::current_num_threads().max(FEWEST);
    let clock = Instant::now();
    let (mut next, mut samples) = (0, Vec::new());
    while next == 0 || (next < count && clock.elapsed() < LOOK) {
        let tiles: Vec<Vec<Sample>> = (next..next + batch as u64)
            .into_par_iter()
            .map_init(&scratch, |scratch, k| {
                let at = spread(k);
                tile(scratch, (at / columns) as u32, (at % columns) as u32)
            })
            .collect();
        samples.extend(tiles.into_iter().flatten());
        next += batch as u64;
    }
    Looked {
        seconds: clock.elapsed().as_secs_f64() / samples.len().max(1) as f64,
        samples,
    }
}

/// Encoding the picture: the pixels that were looked at, side by side.
fn output(samples: &[Sample], pixels: f64, scene: &Scene) -> Cost {
    let width = TILE * TILE;
    let rows = samples.len() as u32 / width;
    if rows == 0 {
        return Cost::default();
    }
    let mut film = Film::new(width, rows, None);
    let used = &samples[..(width * rows) as usize];
    film.add_pass(used);
    film.add_pass(used);
    let clock = Instant::now();
    let bytes = image::encoded_size(&film, scene.settings.exposure);
    let share = pixels / used.len() as f64;
    Cost {
        seconds: share * clock.elapsed().as_secs_f64(),
        bytes: share * bytes as f64,
    }
}
