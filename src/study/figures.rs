//! Figures of a setting: what of its error is bias, what is variance, and how sure that is.
//!
//! With X_s the picture of seed s of m, X̄ their mean, S² their sample variance, R the reference
//! with variance V of its mean, and mean() over pixels and channels:
//!
//! ```text
//! weight     w = 1 / (R² + 0.01 mean(R)²)
//! relMSE     mean( w ((X_s - R)² - V) ), averaged over seeds               [1]
//! variance   mean( w S² )                                                  [1]
//! bias²      mean( w ((X̄ - R)² - S²/m - V) )                               [1]
//! paired     mean( w ((D̄)² - S_D²/m) ),  D_s = X_s - base_s of equal seed   [1]
//! ```
//!
//! relMSE = bias² + variance, exactly. Noise of the mean and of the reference adds to the squared difference on average exactly what
//! is subtracted, so that bias² is unbiased, and may come out below 0 where there is none to see.
//! The weights share the reference's noise. With bias b that adds 4 V / (b R) of itself to bias²,
//! 4 % where both are 1 %; noise with rare bright paths, whose large n² and V meet small weights,
//! moves bias² by up to half of mean(w V), so that much is added to its interval.
//!
//! Confidence intervals, 95 %: over seeds, from jackknife pseudo-values by Student's t with m - 1
//! degrees of freedom; the reference is the same for all seeds, so what its noise does is added in
//! quadrature, pixels being independent in path tracing: var = sum w² (4 (X̄-R)² V + 2 V²) / n².
//! Sources: Rousselle et al. 2012 and pbrt-v4's imgtool (relMSE); Miller 1974 (jackknife).

use serde::{Deserialize, Serialize};

use super::store::Pixels;
use crate::stats::t_two_sided;

/// How often an interval misses.
const LEVEL: f64 = 0.05;

/// A figure and its 95 % confidence interval; unknown ends are null.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Estimate.
    pub value: f64,
    /// Lower end.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
}

impl Interval {
    fn around(value: f64, half: Option<f64>) -> Self {
        Self {
            value,
            low: half.map(|h| value - h),
            high: half.map(|h| value + h),
        }
    }

    /// Of a figure known for each of several independent seeds.
    #[must_use]
    pub fn of_seeds(values: &[f64]) -> Self {
        Self::with(values, 0.0)
    }

    /// The same, with a further source of error of standard deviation `other`.
    fn with(values: &[f64], other: f64) -> Self {
        let m = values.len() as f64;
        let mean = values.iter().sum::<f64>() / m;
        let half = (values.len() >= 2).then(|| {
            let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
            let error = (squares / (m * (m - 1.0))).sqrt();
            (t_two_sided(LEVEL, m - 1.0) * error).hypot(1.96 * other)
        });
        Self::around(mean, half)
    }
}

/// The reference: mean and variance of the mean, of each pixel and channel.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Mean.
    pub mean: Vec<[f64; 3]>,
    /// Variance of the mean.
    pub variance: Vec<[f64; 3]>,
}

impl Reference {
    /// w of each pixel and channel.
    fn weights(&self) -> Vec<[f64; 3]> {
        let n = (3 * self.mean.len()).max(1) as f64;
        let mean = self.mean.iter().flatten().sum::<f64>() / n;
        let floor = (0.01 * mean * mean).max(f64::MIN_POSITIVE);
        let weight = |v: &[f64; 3]| v.map(|v| 1.0 / (v * v + floor));
        self.mean.iter().map(weight).collect()
    }

    /// What its own noise adds to a relMSE measured against it.
    #[must_use]
    pub fn own_relmse(&self) -> f64 {
        let weights = self.weights();
        let terms = weights.iter().flatten().zip(self.variance.iter().flatten());
        terms.map(|(w, v)| w * v).sum::<f64>() / (3 * self.mean.len()).max(1) as f64
    }
}

/// Figures of one setting at one checkpoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// Expected relative mean squared error of one picture.
    pub relmse: Interval,
    /// Its part that no averaging over seeds removes.
    pub bias2: Option<Interval>,
    /// Its part that differs from seed to seed.
    pub variance: Option<Interval>,
    /// Mean of the picture over the reference's, all channels.
    pub mean_ratio: Interval,
    /// Squared mean difference from the base at equal seeds.
    pub paired: Option<Interval>,
}

/// Figures of the pictures of all seeds; `base` holds the base's pictures of the same seeds.
#[must_use]
pub fn figures(pictures: &[Pixels], reference: &Reference, base: Option<&[Pixels]>) -> Figures {
    let weights = reference.weights();
    let m = pictures.len();
    let n = (3 * reference.mean.len()).max(1) as f64;
    let reference_mean = reference.mean.iter().flatten().sum::<f64>() / n;

    let mut per_seed = vec![0.0; m];
    let mut sums = vec![0.0; m];
    let mut variance = Jackknife::new(m);
    let mut bias2 = Jackknife::new(m);
    let mut paired = Jackknife::new(m);
    let mut reference_noise = 0.0;
    let mut values = vec![0.0; m];
    for (i, (w, (r, v))) in weights
        .iter()
        .zip(reference.mean.iter().zip(&reference.variance))
        .enumerate()
    {
        for c in 0..3 {
            for (s, picture) in pictures.iter().enumerate() {
                let x = f64::from(picture[i][c]);
                values[s] = x - r[c];
                per_seed[s] += w[c] * (values[s] * values[s] - v[c]) / n;
                sums[s] += x / n;
            }
            let mean = values.iter().sum::<f64>() / m as f64;
            reference_noise += (w[c] / n).powi(2) * (4.0 * mean * mean * v[c] + 2.0 * v[c] * v[c]);
            bias2.add(&values, |mean, s2, m| {
                w[c] * (mean * mean - s2 / m - v[c]) / n
            });
            variance.add(&values, |_, s2, _| w[c] * s2 / n);
            if let Some(base) = base {
                for (s, picture) in pictures.iter().enumerate() {
                    values[s] = f64::from(picture[i][c]) - f64::from(base[s][i][c]);
                }
                paired.add(&values, |mean, s2, m| w[c] * (mean * mean - s2 / m) / n);
            }
        }
    }
    // Half of what its noise adds: see above.
    let own = reference_noise.sqrt().hypot(0.25 * reference.own_relmse());
    let ratios: Vec<f64> = sums.iter().map(|s| s / reference_mean).collect();
    let mean_noise =
        reference.variance.iter().flatten().sum::<f64>().sqrt() / n / reference_mean.abs();
    Figures {
        relmse: Interval::with(&per_seed, own),
        bias2: bias2.interval(own),
        variance: variance.interval(0.0),
        mean_ratio: Interval::with(&ratios, mean_noise),
        paired: base.and_then(|_| paired.interval(0.0)),
    }
}

/// A statistic of the mean and variance over seeds, of all of them and without each in turn.
struct Jackknife {
    all: f64,
    without: Vec<f64>,
}

impl Jackknife {
    fn new(m: usize) -> Self {
        Self {
            all: 0.0,
            without: vec![0.0; m],
        }
    }

    /// Adds one pixel's term `f(mean, sample variance, count)`; nothing with fewer than two seeds.
    fn add(&mut self, values: &[f64], f: impl Fn(f64, f64, f64) -> f64) {
        let m = values.len() as f64;
        if values.len() < 2 {
            return;
        }
        let mean = values.iter().sum::<f64>() / m;
        let m2: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        self.all += f(mean, m2 / (m - 1.0), m);
        if values.len() < 3 {
            return;
        }
        for (without, v) in self.without.iter_mut().zip(values) {
            let off = v - mean;
            let mean = mean - off / (m - 1.0);
            let m2 = m2 - off * off * m / (m - 1.0);
            *without += f(mean, m2.max(0.0) / (m - 2.0), m - 1.0);
        }
    }

    /// Needs two seeds for a value, three for an interval.
    fn interval(&self, other: f64) -> Option<Interval> {
        let m = self.without.len();
        match m {
            0 | 1 => None,
            2 => Some(Interval::around(self.all, None)),
            _ => {
                let count = m as f64;
                let pseudo: Vec<f64> = self
                    .without
                    .iter()
                    .map(|w| count * self.all - (count - 1.0) * w)
                    .collect();
                let mut interval = Interval::with(&pseudo, other);
                let half = interval.high.map(|h| h - interval.value);
                interval = Interval::around(self.all, half);
                Some(interval)
            }
        }
    }
}

/// Slope of ln y against ln x by least squares.
#[must_use]
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points
        .iter()
        .filter(|(x, y)| *x > 0.0 && *y > 0.0)
        .map(|(x, y)| (x.ln(), y.ln()))
        .collect();
    let n = logs.len() as f64;
    let (mx, my) = (
        logs.iter().map(|p| p.0).sum::<f64>() / n,
        logs.iter().map(|p| p.1).sum::<f64>() / n,
    );
    let sxx: f64 = logs.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let sxy: f64 = logs.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    (logs.len() >= 2 && logs.len() == points.len() && sxx > 0.0).then(|| sxy / sxx)
}

/// Middle value.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}
