//! One pass of the path tracer: a few paths through every pixel.

use std::time::Instant;

use rayon::prelude::*;

use super::camera::Sum;
use super::job::Job;
use super::passes::Tally;
use crate::film::Sample;
use crate::reference::trace_path;
use crate::rng::{Rng, Stage};
use crate::spectrum::Spectrum;
use crate::tracking::{Counters, Sampler};

/// Paths through a pixel in one pass of the path tracer.
pub(crate) const PATHS_PER_PASS: u32 = 4;

/// One pass of the path tracer.
pub(super) fn pass<S: Spectrum>(job: &Job<'_, S>, pass: u32, tally: &mut Tally) -> Vec<Sample> {
    let clock = Instant::now();
    let ([x0, y0], [x1, y1]) = (job.grid.low, job.grid.high);
    job.exec
        .progress
        .stage(&format!("pass {}", pass + 1), Some(u64::from(y1 - y0)));
    let rows: Vec<(Vec<Sample>, Counters)> = (y0..y1)
        .into_par_iter()
        .map(|y| {
            let mut counters = Counters::default();
            let row = (x0..x1)
                .map(|x| pixel(job, [x, y], pass, &mut counters))
                .collect();
            job.exec.progress.advance(1);
            (row, counters)
        })
        .collect();
    let mut samples = Vec::with_capacity(rows.len() * (x1 - x0) as usize);
    for (row, counters) in rows {
        samples.extend(row);
        tally.counters += counters;
    }
    tally.times.gather += clock.elapsed().as_secs_f64();
    samples
}

/// The paths of one pixel in one pass.
pub(super) fn pixel<S: Spectrum>(
    job: &Job<'_, S>,
    [x, y]: [u32; 2],
    pass: u32,
    counters: &mut Counters,
) -> Sample {
    let index = u64::from(y) << 32 | u64::from(x);
    let seed = job.scene.settings.seed;
    let mut sampler = Sampler::new(Rng::stream(seed, Stage::Path, pass.into(), index));
    let mut lens = (job.plan.lens).then(|| Rng::stream(seed, Stage::Lens, pass.into(), index));
    let mut sum = Sum::default();
    for _ in 0..PATHS_PER_PASS {
        let [jx, jy] = sampler.uniform2();
        let counts = &mut sampler.counters.effects;
        counts.coloured += u64::from(S::CHANNELS > 1);
        counts.lens_points += u64::from(job.plan.lens);
        let lens = (lens.as_mut()).map_or([0.0; 2], |rng| [rng.uniform(), rng.uniform()]);
        let ray = job.world.camera.ray([x as f32 + jx, y as f32 + jy], lens);
        let path = trace_path(job.world, ray, &mut sampler);
        sum.sample.direct += path.direct;
        sum.sample.indirect += path.indirect;
        sum.sample.emission += path.emission;
        sum.sample.alpha += path.alpha;
        if path.depth.is_finite() {
            sum.sample.depth += path.depth;
            sum.met += 1;
        }
    }
    *counters += sampler.counters;
    sum.mean(PATHS_PER_PASS)
}
