//! The whole error of a picture while it is rendered: noise and bias, and when both are small.
//!
//! ```text
//! error² = noise² + bias²                          relMSE of the picture, expected     [1]
//! noise² = mean over j > n/2 of mean( w_j u_j² ) / n      u_j = (x_j - x̄_j) √((j-1)/j)
//! bias²  = (q k)² mean( w (D̄² - S_D²/m) )          D = x(r) - x(r/2), m pairs
//! w      = 1 / (x̄² + 0.01 mean(x̄)²),  means over pixels and channels
//! ```
//!
//! Noise is read from the scatter of the n passes, by their recursive residuals (Brown, Durbin &
//! Evans 1975): x̄_j and w_j are the mean of the passes before pass j, which is the j-th, and its
//! weight. They do not know x_j. Where weight and residual share a pass, a pixel that was hit by a
//! rare bright path weighs its own surprise down, and the noise of pictures with few such paths is
//! told too small, by half with twelve passes of light that one path in fifty carries
//! (`tests/all/accuracy/target_error.rs`). Weights of few passes are noisy, hence too large on average (w is
//! convex): only the later half of the passes counts, so that noise² comes out too large by some
//! 4 noise² of itself.
//!
//! Bias is estimated by a pair: photons of a pass are
//! gathered twice, with their radii and with half of them, along the same camera rays, so that the
//! noise of rays and of first-order light cancels in D. A bias that goes like r^p gives
//!
//! ```text
//! E[D] = B(r) - B(r/2) = B(r) (1 - 2^-p)           k = 1 / (1 - 2^-p)
//! ```
//!
//! Inside smooth fluence p = 2 (the kernel's second moment); at edges, shadows and walls it is 1 or
//! less. We take p = 1, k = 2, which is 1.5 times too careful where all is smooth. The square of
//! the mean of D holds its own noise S_D²/m, which is taken off, as in `study::figures`. Which passes
//! are gathered twice: [`Pairs`]. Radii shrink in between, so
//! q = mean(scale over all passes) / mean(scale over pairs), from the schedule, again with p = 1.
//!
//! How sure: the squared norm of a mean of passes scatters around its expectation tr C / n with a
//! relative variance of 2 tr C² / (tr C)² (Satterthwaite 1946), C being the covariance of pixels in
//! a pass, far from diagonal since a photon lights many pixels. tr C² is the expected squared inner
//! product of two passes, tr C the expected squared norm of one. The variances of the noise the
//! picture has, of the estimate of its level, of the estimate of bias and of their cross terms add
//! up, and
//!
//! ```text
//! upper² = error² + 2 √variance                    95 % of pictures lie below
//! ```
//!
//! Satterthwaite takes such a norm for a χ² of some number of degrees of freedom; the 95 % point of
//! χ² lies 1.65 (many) to 2.01 (one) standard deviations above its mean.
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
/// 1 / (1 - 2^-p) for p = 1. Smaller: bias at edges is told too small; `tests/all/accuracy/target_error.rs`.
const BIAS_OVER_D: f64 = 2.0;
/// Passes that are all gathered twice for a target; later ones, one in so many.
const EVERY_PASS: u32 = 8;
const THEN_EACH: u32 = 4;
/// For a time, one in so many: a second gather takes about half as long as a pass.
const FEW_EACH: u32 = 8;
/// Passes before the scatter of passes is worth looking at.
const FEWEST: usize = 4;
/// Standard deviations to the bound, those of a χ² of one degree of freedom at 95 %. Less: fewer
/// pictures keep to it (`tests/all/accuracy/target_error.rs`).
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

/// Which passes are gathered twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pairs {
    /// The first eight, then one in four, and every one for as long as what pairs do not tell of
    /// the bias holds the bound up more than all noise does.
    Sure,
    /// The second and fourth, then one in eight: a picture for a given time, not an error.
    Few,
}

/// Noise of the passes in one figure: its squared norm, and how independent its pixels are.
#[derive(Debug, Clone, Default)]
struct Norms {
    /// Squared norm of each pass.
    norms: Vec<f64>,
    /// The last pass, weighted.
    last: Vec<[f32; 3]>,
    /// Squared inner products of each pass with the one before.
    products: Vec<f64>,
}

/// What of a list was added since it was half as long.
fn later_half(all: &[f64]) -> &[f64] {
    &all[all.len() / 2..]
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
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
        self.norms.push(dot(&noise, &noise) / share);
        if self.last.len() == noise.len() {
            self.products.push(dot(&noise, &self.last).powi(2));
        }
        self.last = noise;
    }

    /// tr C.
    fn trace(&self) -> f64 {
        mean(later_half(&self.norms))
    }

    /// Relative variance of the squared norm of a mean of passes (see above), and of its estimate.
    fn relative_variance(&self) -> [f64; 2] {
        let (norms, products) = (later_half(&self.norms), later_half(&self.products));
        let (trace, n) = (mean(norms), norms.len() as f64);
        if products.is_empty() || trace == 0.0 {
            return [PRIOR, PRIOR];
        }
        let squares: f64 = norms.iter().map(|v| (v / trace - 1.0).powi(2)).sum();
        [
            2.0 * mean(products) / trace.powi(2) + PRIOR,
            squares / (n * (n - 1.0).max(1.0)) + PRIOR,
        ]
    }
}

/// Watches the passes and ends the render once the error is below a target.
#[derive(Debug)]
pub struct ErrorWatch {
    target: Option<f64>,
    wanted: Pairs,
    /// Bias depends on the radius at all.
    kernels: bool,
    /// What the pairs do not tell of the bias holds the bound up more than all noise does.
    blurred: bool,
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
    pub fn new(target: Option<f64>, wanted: Pairs, method: Method) -> Self {
        Self {
            target,
            wanted,
            blurred: false,
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

    /// Takes in the noise of a pass: its recursive residuals.
    fn add_noise(&mut self, film: &Film, samples: &[Sample]) {
        let j = f64::from(film.passes());
        if j < 2.0 {
            return;
        }
        // The picture as it was before the pass.
        let before: Vec<[f64; 3]> = pixels(film)
            .zip(samples)
            .map(|((x, y), sample)| {
                let mean = film.mean(x, y);
                let n = j - f64::from(film.nonfinite_passes(x, y));
                let off = mean - sample.colour().as_dvec3();
                let before = if off.is_finite() && n > 1.0 {
                    mean + off / (n - 1.0)
                } else {
                    mean
                };
                before.to_array()
            })
            .collect();
        let weights =
            Weights::of_mean(before.iter().flatten().sum::<f64>() / (3 * before.len()) as f64);
        let share = ((j - 1.0) / j).sqrt();
        let noise = before
            .iter()
            .zip(samples)
            .map(|(before, sample)| {
                let x = sample.colour().as_dvec3().to_array();
                let w = weights.at(*before);
                let off = [0, 1, 2].map(|c| (w[c].sqrt() * share * (x[c] - before[c])) as f32);
                off.map(|v| if v.is_finite() { v } else { 0.0 })
            })
            .collect();
        self.noise.add(noise, 1.0);
    }

    /// What is known after these passes.
    fn look(&mut self, film: &Film) -> Option<ErrorEstimate> {
        if self.noise.norms.len() + 1 < FEWEST || (self.kernels && self.count < 2) {
            return None;
        }
        let weights = Weights::new(film);
        let m = f64::from(self.count);
        let q = match self.scales {
            [all, pairs] if pairs > 0.0 => (all / f64::from(film.passes())) / (pairs / m),
            _ => 0.0,
        };
        let factor = (q * BIAS_OVER_D).powi(2);
        let (mut squares, mut own) = (0.0, 0.0);
        for ((x, y), pixel) in pixels(film).zip(&self.pairs) {
            let w = weights.of(film, x, y);
            for c in 0..3 {
                let [mean, m2] = pixel[c];
                squares += w[c] * mean * mean;
                own += w[c] * m2 / (m * (m - 1.0)).max(1.0);
            }
        }
        let [x0, y0, x1, y1] = film.crop().map(f64::from);
        let count = 3.0 * (x1 - x0) * (y1 - y0);
        let n = f64::from(film.passes());
        let noise = self.noise.trace() / count / n;
        let own = factor * own / count;
        let bias2 = (factor * squares / count - own).max(0.0);
        let [rn, en] = self.noise.relative_variance();
        let [rd, ed] = self.differences.relative_variance();
        // Cross terms of the largest bias that is likely: its noise must not vouch for itself.
        let likely = bias2 + own * rd.sqrt();
        let of_noise = noise * noise * (rn + en) + 2.0 * likely * noise * rn;
        let of_pairs = if self.count < 2 {
            0.0
        } else {
            own * own * (rd * m / (m - 1.0) + ed) + 2.0 * likely * own * rd
        };
        let variance = of_noise + of_pairs;
        self.blurred = SURE * of_pairs.sqrt() > noise;
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
        let wanted = match self.wanted {
            Pairs::Sure => pass < EVERY_PASS || pass % THEN_EACH == THEN_EACH - 1 || self.blurred,
            Pairs::Few => matches!(pass, 1 | 3) || pass % FEW_EACH == FEW_EACH - 1,
        };
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
        Self::of_mean(film.image_mean().mean.to_array().iter().sum::<f64>() / 3.0)
    }

    /// Of a picture with this mean of all channels.
    fn of_mean(mean: f64) -> Self {
        Self {
            floor: (0.01 * mean * mean).max(f64::MIN_POSITIVE),
        }
    }

    fn of(&self, film: &Film, x: u32, y: u32) -> [f64; 3] {
        self.at(film.mean(x, y).to_array())
    }

    fn at(&self, pixel: [f64; 3]) -> [f64; 3] {
        pixel.map(|v| 1.0 / (v * v + self.floor))
    }
}
