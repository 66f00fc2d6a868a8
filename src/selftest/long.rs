//! Long runs: random streams that do not repeat or change, sums that do not drift.
//!
//! ```text
//! film      mean of n samples = the exact mean, standard error = sqrt(variance / n)
//! f32       a running sum of ones stops at 2^24: for comparison, the same samples in f32
//! gather    the sum over a million photons on one ray, against f64
//! ```

use super::fields::rng;
use super::photons::{exact, gather, photon};
use super::{SelftestError, Suite, Worst};
use crate::film::{Film, Sample};
use crate::rng::{Rng, Stage};
use crate::scene::Rgb;
use crate::stats::{chi_square_bound, ks_bound, ks_lambda};

/// First numbers of the stream of photon 5 in pass 3 of seed 7: a change of any changes every
/// picture.
const PINNED: [u64; 4] = [
    0x7b7b_e9f5_3e4b_1165,
    0xf766_0969_909d_17d7,
    0x33f2_5a4e_4f82_a818,
    0x981e_319b_3a5d_96e8,
];

/// Numbers of streams that are not the pinned ones.
fn pinned() -> Worst {
    let mut stream = Rng::stream(7, Stage::Photon, 3, 5);
    let found = PINNED.map(|_| stream.bits());
    let mut faults = Worst::default();
    faults.count(found != PINNED, || format!("{found:#x?}"));
    faults
}

/// Chi-square per degree of freedom of first and second numbers of neighbouring streams, in pairs.
fn pairs(streams: u64) -> f64 {
    let mut cells = vec![0u32; 4096];
    for index in 0..streams {
        let mut stream = Rng::stream(1, Stage::Check, 0, index);
        let (a, b) = (stream.bits() >> 58, stream.bits() >> 58);
        cells[(a * 64 + b) as usize] += 1;
    }
    let expected = streams as f64 / cells.len() as f64;
    let sum: f64 = cells
        .iter()
        .map(|n| (f64::from(*n) - expected).powi(2) / expected)
        .sum();
    sum / (cells.len() - 1) as f64
}

/// Values of a pixel, over and over: some of them no f32 sum takes without rounding.
fn value(i: u32) -> f32 {
    0.1 + 0.7 * (i % 16) as f32
}

/// Relative errors after n samples: of the film's mean, of its standard error, of a mean in f32.
fn drift(n: u32) -> [f64; 3] {
    let values: Vec<f64> = (0..16).map(|i| f64::from(value(i))).collect();
    let mean = values.iter().sum::<f64>() / 16.0;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 16.0;
    let n = n / 16 * 16;
    let samples: Vec<[Sample; 1]> = (0..16)
        .map(|i| {
            [Sample {
                direct: Rgb::splat(value(i)),
                ..Sample::NOTHING
            }]
        })
        .collect();
    let mut film = Film::new(1, 1, None);
    let mut sum = 0.0f32;
    for i in 0..n {
        film.add_pass(&samples[(i % 16) as usize]);
        sum += value(i);
    }
    let n = f64::from(n);
    let error = (variance / (n - 1.0)).sqrt();
    let found = film.standard_error(0, 0).map_or(f64::NAN, |e| e.x);
    [
        (film.mean(0, 0).x / mean - 1.0).abs(),
        (found / error - 1.0).abs(),
        (f64::from(sum) / n / mean - 1.0).abs(),
    ]
}

/// Relative error of the sum over photons that all lie on one ray of a tile.
fn on_one_ray(count: u32) -> Result<Worst, SelftestError> {
    let chosen = 27;
    let mut random = rng(96);
    let (found, photons) = gather(4.0, f32::INFINITY, |rays| {
        (0..count)
            .map(|_| photon(rays[chosen].at(3.5 + random.uniform()), 0.02, 0.1))
            .collect()
    })?;
    let (ray, span) = &found.rays[chosen];
    let sum: f64 = photons.iter().map(|p| exact(p, ray, *span)[0]).sum();
    let mut worst = Worst::default();
    for (road, found) in [("hierarchy", found.by_map), ("tiles", found.by_tile)] {
        let found = f64::from(found[chosen]);
        worst.take((found / sum - 1.0).abs(), || {
            format!("{road}: {found}, exactly {sum}")
        });
    }
    Ok(worst)
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    suite.none("random numbers that are not the pinned ones", pinned());
    let streams = suite.choose([1_000_000, 4_000_000, 100_000_000]);
    let bound = chi_square_bound(4095, 1);
    let what = "neighbouring streams, chi-square per degree of freedom";
    suite.at_most(what, pairs(streams), bound);
    let mut random = rng(95);
    let mut uniform: Vec<f64> = (0..suite.choose([100_000, 1_000_000, 10_000_000]))
        .map(|_| -(-f64::from(random.exponential())).exp_m1())
        .collect();
    suite.at_most(
        "exponential steps, KS distance",
        ks_lambda(&mut uniform),
        ks_bound(1),
    );
    let n = suite.choose([10_000_000, 100_000_000, 1_000_000_000]);
    let [mean, error, single] = drift(n);
    suite.at_most(
        format!("film's mean of {n:e} samples, relative error"),
        mean,
        1e-11,
    );
    suite.at_most(
        format!("its standard error after {n:e}, relative error"),
        error,
        1e-6,
    );
    // The film must be better than what f32 would make of the same samples, by far.
    suite.at_most("film's error over that of an f32 sum", mean / single, 1e-6);
    let photons = suite.choose([200_000, 1_000_000, 1_000_000]);
    let what = "sum over photons on one ray, relative error";
    suite.worst(
        format!("{what}, {photons:e} of them"),
        on_one_ray(photons)?,
        1e-5,
    );
    Ok(())
}
