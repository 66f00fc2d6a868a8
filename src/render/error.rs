//! The whole error of a picture while it is rendered: noise and bias, and when both are small.
//!
//! ```text
//! error² = noise² + bias²                          relMSE of the picture, expected     [1]
//! noise² = mean( w s² )                            s standard error of a pixel's mean
//! bias²  = (q k)² mean( w (D̄² - S_D²/m) )          D = x(r) - x(r/2), m passes
//! w      = 1 / (x̄² + 0.01 mean(x̄)²),  means over pixels and channels
//! ```
//!
//! Noise is read from the scatter of the passes. Bias is estimated by a pair: photons of a pass are
//! gathered twice, with their radii and with half of them, along the same camera rays, so that the
//! noise of rays and of first-order light cancels in D. A bias that goes like r^p gives
//!
//! ```text
//! E[D] = B(r) - B(r/2) = B(r) (1 - 2^-p)           k = 1 / (1 - 2^-p)
//! ```
//!
//! Inside smooth fluence p = 2 (the kernel's second moment); at edges, shadows and walls it is 1 or
//! less. We take p = 1, k = 2, which is 1.5 times too careful where all is smooth. The square of
//! the mean of D holds its own noise S_D²/m, which is taken off, as in `study::figures`. The first
//! `EVERY_PASS` passes are gathered twice and then every `THEN_EACH`-th; radii shrink in between, so
//! q = mean(scale over all passes) / mean(scale over pairs), from the schedule, again with p = 1.
//!
//! How sure: the squared norm of a mean of passes scatters around its expectation tr C / n with a
//! relative variance of 2 tr C² / (tr C)² (Satterthwaite 1946), C being the covariance of pixels in
//! a pass, far from diagonal since a photon lights many pixels. tr C² is the expected squared inner
//! product of two passes, tr C the expected squared norm of one. The variances of the noise the picture has, of the estimate of its level, of the
//! estimate of bias and of their cross terms add up, and
//!
//! ```text
//! upper² = error² + 2 √variance                    95 % of pictures lie below
//! ```
//!
//! Sources: Hachisuka, Jarosz & Jensen 2010, A progressive error estimation framework for photon
//! density estimation (bias from a derivative in the radius, noise from the passes, one bound from
//! both; theirs is per pixel and assumes p = 2, ours is for the picture and does not); Knaus &
//! Zwicker 2011 (schedule). What no radius shows is not in it: fixed march steps, too few
//! scattering orders.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::{PassDone, Watch};
use crate::film::{Film, Sample};
use crate::photon::radius::radius_scale;
use crate::scene::Method;

/// Factor on radii of the second gather. Nearer to 1: smaller noise of D, but p matters more.
const SECOND: f32 = 0.5;
/// 1 / (1 - 2^-p) for p = 1. Smaller: bias at edges is told too small; `tests/all/target_error.rs`.
const BIAS_OVER_D: f64 = 2.0;
/// Passes that are all gathered twice; later ones, one in so many.
const EVERY_PASS: u32 = 8;
const THEN_EACH: u32 = 4;
/// Passes before the scatter of passes is worth looking at.
const FEWEST: f64 = 4.0;
/// Standard deviations to the bound. 1.645 would do for normal noise; squared norms are skewed, and
/// variances are estimates: with less, fewer than 95 % of pictures keep to it
/// (`tests/all/target_error.rs`).
const SURE: f64 = 2.0;
/// Relative variance of a norm that is assumed on top of the measured one, which few passes may
/// show too small.
const PRIOR: f64 = 0.005;

/// What is known of a picture's error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorEstimate {
    /// √relMSE asked for, if any.
    pub target: Option<f64>,
    /// √relMSE expected.
    pub estimate: f64,
    /// It lies below this with `confidence`.
    pub upper: f64,
    /// Confidence of `upper`.
    pub confidence: f64,
    /// Its part from noise.
    pub noise: f64,
    /// Its part from kernels that are not yet small.
    pub bias: f64,
    /// Passes that were gathered twice for it.
    pub pairs: u32,
}

impl ErrorEstimate {
    /// Is the error, as far as can be told, below the target?
    #[must_use]
    pub fn reached(&self) -> bool {
        self.target.is_none_or(|target| self.upper <= target)
    }
}

/// Noise of the passes in one figure: its squared norm, and how independent its pixels are.
#[derive(Debug, Clone, Default)]
struct Norms {
    /// Squared norm of each pass: count, mean, second moment.
    n: f64,
    mean: f64,
    m2: f64,
    /// The last pass, weighted.
    last: Vec<[f32; 3]>,
    /// Squared inner products of passes that follow one another: count, sum.
    products: [f64; 2],
}

impl Norms {
    /// Adds the noise of a pass, each value times the root of its weight. `share` is the part of its
    /// variance that deviations from a mean with itself in it have.
    fn add(&mut self, noise: Vec<[f32; 3]>, share: f64) {
        let dot = |a: &[[f32; 3]], b: &[[f32; 3]]| {
            let pairs = a.iter().flatten().zip(b.iter().flatten());
            pairs
                .map(|(a, b)| f64::from(*a) * f64::from(*b))
                .sum::<f64>()
        };
        let norm = dot(&noise, &noise) / share;
        self.n += 1.0;
        let before = norm - self.mean;
        self.mean += before / self.n;
        self.m2 += before * (norm - self.mean);
        if self.last.len() == noise.len() {
            self.products[0] += 1.0;
            self.products[1] += dot(&noise, &self.last).powi(2);
        }
        self.last = noise;
    }

    /// Relative variance of the squared norm of a mean of passes (see above), and of its estimate.
    fn relative_variance(&self) -> [f64; 2] {
        let (squared, [count, sum]) = (self.mean * self.mean, self.products);
        if count == 0.0 || squared == 0.0 {
            return [PRIOR, PRIOR];
        }
        let scatter = self.m2 / (self.n - 1.0).max(1.0) / squared;
        [
            2.0 * sum / count / squared + PRIOR,
            scatter / self.n + PRIOR,
        ]
    }
}

/// Watches the passes and ends the render once the error is below a target.
#[derive(Debug)]
pub struct ErrorWatch {
    target: Option<f64>,
    /// Bias depends on the radius at all.
    kernels: bool,
    /// Mean and second moment of D for each pixel and channel.
    pairs: Vec<[[f64; 2]; 3]>,
    count: u32,
    /// Passes in the first sum of `scales`.
    scaled: u32,
    /// Sums of the radii's scales: over passes, those before a resumed render began included, and
    /// over pairs.
    scales: [f64; 2],
    noise: Norms,
    differences: Norms,
    /// The last word.
    pub estimate: Option<ErrorEstimate>,
}

impl ErrorWatch {
    /// Watches a method, and ends it at `target`, √relMSE.
    #[must_use]
    pub fn new(target: Option<f64>, method: Method) -> Self {
        Self {
            target,
            kernels: method != Method::Path,
            scaled: 0,
            pairs: Vec::new(),
            count: 0,
            scales: [0.0; 2],
            noise: Norms::default(),
            differences: Norms::default(),
            estimate: None,
        }
    }

    /// Takes in D of a pass.
    fn add_pair(&mut self, film: &Film, samples: &[Sample], second: &[Sample]) {
        self.count += 1;
        let n = f64::from(self.count);
        self.pairs.resize(samples.len(), [[0.0; 2]; 3]);
        let weights = Weights::new(film);
        let mut noise = vec![[0.0; 3]; samples.len()];
        for ((((x, y), pixel), out), (a, b)) in pixels(film)
            .zip(&mut self.pairs)
            .zip(&mut noise)
            .zip(samples.iter().zip(second))
        {
            let d = (a.colour() - b.colour()).as_dvec3().to_array();
            if !d.iter().all(|d| d.is_finite()) {
                continue;
            }
            let w = weights.of(film, x, y);
            for c in 0..3 {
                let [mean, m2] = &mut pixel[c];
                let before = d[c] - *mean;
                *mean += before / n;
                *m2 += before * (d[c] - *mean);
                out[c] = (w[c].sqrt() * (d[c] - *mean)) as f32;
            }
        }
        if self.count >= 2 {
            self.differences.add(noise, (n - 1.0) / n);
        }
    }

    /// Takes in the noise of a pass.
    fn add_noise(&mut self, film: &Film, samples: &[Sample]) {
        let n = f64::from(film.passes());
        if n < 2.0 {
            return;
        }
        let weights = Weights::new(film);
        let noise = pixels(film)
            .zip(samples)
            .map(|((x, y), sample)| {
                let w = weights.of(film, x, y);
                let off = (sample.colour().as_dvec3() - film.mean(x, y)).to_array();
                let off = [0, 1, 2].map(|c| (w[c].sqrt() * off[c]) as f32);
                off.map(|v| if v.is_finite() { v } else { 0.0 })
            })
            .collect();
        self.noise.add(noise, (n - 1.0) / n);
    }

    /// What is known after these passes.
    fn look(&self, film: &Film) -> Option<ErrorEstimate> {
        if self.noise.n + 1.0 < FEWEST {
            return None;
        }
        let weights = Weights::new(film);
        let m = f64::from(self.count);
        let q = match self.scales {
            [all, pairs] if pairs > 0.0 => (all / f64::from(film.passes())) / (pairs / m),
            _ => 0.0,
        };
        let factor = (q * BIAS_OVER_D).powi(2);
        let (mut noise, mut squares, mut own, mut count) = (0.0, 0.0, 0.0, 0.0);
        for (i, (x, y)) in pixels(film).enumerate() {
            let Some(s) = film.standard_error(x, y) else {
                continue;
            };
            let w = weights.of(film, x, y);
            for c in 0..3 {
                noise += w[c] * s[c] * s[c];
                if let (Some(pixel), true) = (self.pairs.get(i), self.count >= 2) {
                    let [mean, m2] = pixel[c];
                    squares += w[c] * mean * mean;
                    own += w[c] * m2 / (m * (m - 1.0));
                }
            }
            count += 3.0;
        }
        if count == 0.0 {
            return None;
        }
        let noise = noise / count;
        let own = factor * own / count;
        let bias2 = (factor * squares / count - own).max(0.0);
        let n = f64::from(film.passes());
        let [rn, en] = self.noise.relative_variance();
        let [rd, ed] = self.differences.relative_variance();
        // Cross terms of the largest bias that is likely: its noise must not vouch for itself.
        let likely = bias2 + own * rd.sqrt();
        let mut variance = noise * noise * (rn * n / (n - 1.0) + en) + 2.0 * likely * noise * rn;
        if self.count >= 2 {
            variance += own * own * (rd * m / (m - 1.0) + ed) + 2.0 * likely * own * rd;
        }
        let error2 = noise + bias2;
        Some(ErrorEstimate {
            target: self.target,
            estimate: error2.sqrt(),
            upper: (error2 + SURE * variance.sqrt()).sqrt(),
            confidence: 0.95,
            noise: noise.sqrt(),
            bias: bias2.sqrt(),
            pairs: self.count,
        })
    }
}

impl Watch for ErrorWatch {
    fn second_radius(&self, pass: u32) -> Option<f32> {
        let wanted = pass < EVERY_PASS || pass % THEN_EACH == THEN_EACH - 1;
        (self.kernels && wanted).then_some(SECOND)
    }

    fn pass_done(&mut self, done: &PassDone<'_>) -> ControlFlow<()> {
        let film = done.film;
        let scale = f64::from(radius_scale(done.pass, done.dimension));
        while self.scaled <= done.pass {
            self.scales[0] += f64::from(radius_scale(self.scaled, done.dimension));
            self.scaled += 1;
        }
        if let Some(second) = done.second {
            self.scales[1] += scale;
            self.add_pair(film, done.samples, second);
        }
        self.add_noise(film, done.samples);
        self.estimate = self.look(film);
        match self.estimate {
            Some(e) if self.target.is_some() && e.reached() => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// Pixels of the film, row-major.
fn pixels(film: &Film) -> impl Iterator<Item = (u32, u32)> + use<> {
    let [x0, y0, x1, y1] = film.crop();
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (x, y)))
}

/// The weights of relMSE.
struct Weights {
    floor: f64,
}

impl Weights {
    fn new(film: &Film) -> Self {
        let mean = film.image_mean().mean.to_array();
        let mean = mean.iter().sum::<f64>() / 3.0;
        Self {
            floor: (0.01 * mean * mean).max(f64::MIN_POSITIVE),
        }
    }

    fn of(&self, film: &Film, x: u32, y: u32) -> [f64; 3] {
        film.mean(x, y)
            .to_array()
            .map(|v| 1.0 / (v * v + self.floor))
    }
}
