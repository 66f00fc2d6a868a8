//! How fast the error of a progressive estimate falls, and what theory says of its parts.
//!
//! ```text
//! bias²(N)     = B (Σ s_j² / N)²                       [1]     N passes, j = 0 ... N - 1
//! variance(N)  = P Σ s_j^-d / N²  +  C / N             [1]     s_j scale of the radii of pass j
//!                photons             camera rays               d = 2 beams, 3 points
//! ```
//!
//! A kernel of radius r in smooth fluence is biased like r² and noisy like r^-d; passes are
//! averaged. With s_j^d ~ j^(alpha - 1), alpha = 4/(4 + d), both sums fall like N^-alpha, and so
//! does their sum: the theory's rate (Knaus & Zwicker 2011; Kaplanyan & Dachsbacher 2013). What a
//! camera ray adds by where in its pixel it passes, and by first-order light that it samples, is not
//! photons': it falls like 1/N. Nor do kernels narrower than a pixel get noisier as they shrink, for
//! the pixel averages over them; that too goes into C. While C is most of the variance, the error
//! falls faster than theory says of photons alone.
//!
//! B, P and C are fitted to the measured parts, P and C by least squares of relative deviations,
//! neither below 0; B weighted by the intervals. Across edges in the fluence (shadows, light cut by
//! walls) a kernel's squared bias, averaged over a picture, goes like r, not r^4, and falls slower.

use serde::{Deserialize, Serialize};

use super::figures::{Interval, slope};
use super::table::Row;
use crate::photon::radius::radius_scale;

/// How fast the error of a progressive method falls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// Setting.
    pub setting: String,
    /// Method.
    pub method: String,
    /// Passes of the first and last point of the fit.
    pub passes: [u32; 2],
    /// Slope of ln relMSE against ln photons (paths: ln paths).
    pub slope: Interval,
    /// Theory of photons alone; of paths.
    pub theory: f64,
    /// Slope of ln variance.
    pub variance_slope: Option<f64>,
    /// Slope of ln bias², where it is seen at every point.
    pub bias_slope: Option<f64>,
    /// Laws of the parts; not of paths.
    pub law: Option<Law>,
}

/// The fitted law.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// B. \[1\]
    pub bias2: f64,
    /// P. \[1\]
    pub photons: f64,
    /// C. \[1\]
    pub rays: f64,
    /// Dimension d of the blur.
    pub dimension: u32,
}

/// Σ s_j² / N, squared.
#[must_use]
pub fn bias_factor(passes: u32, dimension: u32) -> f64 {
    (sum(passes, dimension, 2) / f64::from(passes)).powi(2)
}

/// Σ s_j^-d / N².
#[must_use]
pub fn photon_factor(passes: u32, dimension: u32) -> f64 {
    sum(passes, dimension, -(dimension as i32)) / f64::from(passes).powi(2)
}

fn sum(passes: u32, dimension: u32, power: i32) -> f64 {
    let scale = |j| f64::from(radius_scale(j, dimension)).powi(power);
    (0..passes).map(scale).sum()
}

impl Law {
    /// The law of measured parts: passes, bias² and variance of each checkpoint.
    #[must_use]
    pub fn fitted(parts: &[(u32, Interval, f64)], dimension: u32) -> Option<Self> {
        let mut normal = [[0.0; 2]; 2];
        let mut right = [0.0; 2];
        let (mut above, mut below) = (0.0, 0.0);
        for (passes, bias2, variance) in parts {
            if *variance <= 0.0 {
                return None;
            }
            let terms = [photon_factor(*passes, dimension), 1.0 / f64::from(*passes)];
            let terms = terms.map(|t| t / variance);
            for i in 0..2 {
                right[i] += terms[i];
                for k in 0..2 {
                    normal[i][k] += terms[i] * terms[k];
                }
            }
            let f = bias_factor(*passes, dimension);
            let w = match bias2.high.map(|h| h - bias2.value) {
                Some(half) if half > 0.0 => half.powi(-2),
                _ => variance.powi(-2),
            };
            above += w * f * bias2.value;
            below += w * f * f;
        }
        let [[a, b], [_, d]] = normal;
        let determinant = a * d - b * b;
        if parts.len() < 2 || determinant <= 0.0 {
            return None;
        }
        let [mut photons, mut rays] = [
            (d * right[0] - b * right[1]) / determinant,
            (a * right[1] - b * right[0]) / determinant,
        ];
        if photons < 0.0 {
            (photons, rays) = (0.0, right[1] / d);
        } else if rays < 0.0 {
            (photons, rays) = (right[0] / a, 0.0);
        }
        Some(Self {
            bias2: (above / below).max(0.0),
            photons,
            rays,
            dimension,
        })
    }

    /// Bias² and variance after so many passes.
    #[must_use]
    pub fn at(&self, passes: u32) -> [f64; 2] {
        [
            self.bias2 * bias_factor(passes, self.dimension),
            self.photons * photon_factor(passes, self.dimension) + self.rays / f64::from(passes),
        ]
    }

    /// Share of the variance that is not photons'.
    #[must_use]
    pub fn share_of_rays(&self, passes: u32) -> f64 {
        let [_, variance] = self.at(passes);
        self.rays / f64::from(passes) / variance
    }
}

/// The rate over the checkpoints of one setting: its rows, and the slope of each seed.
pub(super) fn convergence(rows: &[Row], slopes: &[f64]) -> Option<Convergence> {
    let (first, last) = (rows.first()?, rows.last()?);
    let dimension = match first.method.as_str() {
        "beam" => Some(2),
        "point" => Some(3),
        _ => None,
    };
    let parts: Option<Vec<(u32, Interval, f64)>> = rows
        .iter()
        .map(|r| Some((r.passes, r.figures.bias2?, r.figures.variance?.value)))
        .collect();
    let parts = parts.unwrap_or_default();
    let of = |figure: &dyn Fn(&(u32, Interval, f64)) -> f64| {
        let points: Vec<(f64, f64)> = parts.iter().map(|p| (f64::from(p.0), figure(p))).collect();
        slope(&points)
    };
    let seen = parts.iter().all(|p| p.1.low.is_some_and(|low| low > 0.0));
    Some(Convergence {
        setting: first.setting.clone(),
        method: first.method.clone(),
        passes: [first.passes, last.passes],
        slope: Interval::of_seeds(slopes),
        theory: dimension.map_or(-1.0, |d| -4.0 / (4.0 + f64::from(d))),
        variance_slope: of(&|p| p.2),
        bias_slope: of(&|p| p.1.value).filter(|_| seen),
        law: dimension.and_then(|d| Law::fitted(&parts, d)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exactly(value: f64) -> Interval {
        Interval {
            value,
            low: Some(0.9 * value),
            high: Some(1.1 * value),
        }
    }

    /// Sums of the schedule follow the theory's exponent, points and beams.
    #[test]
    fn factors_fall_at_the_rate_of_the_theory() {
        for dimension in [2, 3] {
            let alpha = 4.0 / (4.0 + f64::from(dimension));
            for factor in [bias_factor, photon_factor] {
                let rate = (factor(5000, dimension) / factor(500, dimension)).log10();
                assert!((rate + alpha).abs() < 0.01, "dimension {dimension}: {rate}");
            }
        }
    }

    #[test]
    fn laws_are_found_again() {
        let made = |photons, rays| Law {
            bias2: 0.02,
            photons,
            rays,
            dimension: 2,
        };
        for law in [made(0.3, 0.1), made(0.3, 0.0), made(0.0, 0.1)] {
            let parts: Vec<_> = [1, 2, 4, 8, 16]
                .map(|n| {
                    let [bias2, variance] = law.at(n);
                    (n, exactly(bias2), variance)
                })
                .to_vec();
            let found = Law::fitted(&parts, 2).unwrap();
            let off = [
                found.bias2 - law.bias2,
                found.photons - law.photons,
                found.rays - law.rays,
            ];
            assert!(off.iter().all(|v| v.abs() < 1e-9), "{found:?}, not {law:?}");
        }
        let one = [(1, exactly(1.0), 1.0)];
        assert_eq!(Law::fitted(&one, 2), None, "one point has no law");
    }
}
