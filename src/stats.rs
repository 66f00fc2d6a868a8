//! Significance of comparisons: z, chi-square and Kolmogorov-Smirnov tests.
//!
//! ```text
//! one comparison among n, at level A for all of them       a = 1 - (1 - A)^(1/n)        (Sidak)
//! z                two-sided bound Phi^-1(1 - a / 2)
//! chi-square       p = Q(k / 2, x / 2)
//! KS               p = 2 sum (-1)^(j-1) exp(-2 j^2 l^2),   l = (sqrt n + 0.12 + 0.11 / sqrt n) D
//! ```
//!
//! Every check runs on fixed seeds at level [`ALPHA`]: it either always passes or always fails.
//! Sources: Sidak 1967; Press et al. 2007, Numerical Recipes, sections 6.2 and 14.3.

/// Level of one test, all its comparisons together.
pub const ALPHA: f64 = 1e-3;

/// Mean and variance of a stream (Welford 1962).
#[derive(Debug, Clone, Copy, Default)]
pub struct Welford {
    n: u64,
    mean: f64,
    m2: f64,
}

impl Welford {
    /// Takes in one value.
    pub fn add(&mut self, x: f64) {
        self.n += 1;
        let before = x - self.mean;
        self.mean += before / self.n as f64;
        self.m2 += before * (x - self.mean);
    }

    /// Mean.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Variance of the mean.
    #[must_use]
    pub fn variance_of_mean(&self) -> f64 {
        self.m2 / (self.n as f64 * (self.n - 1) as f64)
    }

    /// Standard error of the mean.
    #[must_use]
    pub fn standard_error(&self) -> f64 {
        self.variance_of_mean().sqrt()
    }

    /// Distance from an exact value in standard errors. A stream that never varied is off by
    /// nothing or by everything, `rounding` being what f32 may do to it.
    #[must_use]
    pub fn z(&self, exact: f64, rounding: f64) -> f64 {
        let off = self.mean - exact;
        if off.abs() <= rounding {
            0.0
        } else {
            off / self.standard_error()
        }
    }
}

impl FromIterator<f64> for Welford {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut this = Self::default();
        values.into_iter().for_each(|x| this.add(x));
        this
    }
}

/// Level of one of `n` comparisons.
#[must_use]
pub fn sidak(n: usize) -> f64 {
    -((-ALPHA).ln_1p() / n as f64).exp_m1()
}

/// Largest |z| that one of `n` comparisons may show.
#[must_use]
pub fn z_bound(n: usize) -> f64 {
    inverse(|z| gamma_q(0.5, 0.5 * z * z), sidak(n))
}

/// Largest |t| for `freedom` degrees of freedom that one of `n` comparisons may show.
#[must_use]
pub fn t_bound(n: usize, freedom: f64) -> f64 {
    t_two_sided(sidak(n), freedom)
}

/// What |t| of Student's distribution exceeds with probability `p`.
#[must_use]
pub fn t_two_sided(p: f64, freedom: f64) -> f64 {
    inverse(
        |t| beta_i(0.5 * freedom, 0.5, freedom / (freedom + t * t)),
        p,
    )
}

/// Where a falling function of x >= 0 reaches p.
fn inverse(f: impl Fn(f64) -> f64, p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 1e4);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if f(middle) > p {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// p of a chi-square sum of `k` squared standard normals.
#[must_use]
pub fn chi_square_p(sum: f64, k: usize) -> f64 {
    gamma_q(0.5 * k as f64, 0.5 * sum)
}

/// p of the samples being uniform on [0, 1]; sorts them.
pub fn ks_p(samples: &mut [f64]) -> f64 {
    ks_q(ks_lambda(samples))
}

/// The Kolmogorov-Smirnov distance of samples from uniform ones on [0, 1], in units of its
/// spread; sorts them.
pub fn ks_lambda(samples: &mut [f64]) -> f64 {
    samples.sort_by(f64::total_cmp);
    let n = samples.len() as f64;
    let d = samples.iter().enumerate().fold(0.0f64, |d, (i, &u)| {
        let i = i as f64;
        d.max(u - i / n).max((i + 1.0) / n - u)
    });
    let root = n.sqrt();
    (root + 0.12 + 0.11 / root) * d
}

/// Largest [`ks_lambda`] that one of `n` comparisons may show.
#[must_use]
pub fn ks_bound(n: usize) -> f64 {
    inverse(ks_q, sidak(n))
}

/// Largest chi-square of `k` degrees of freedom, per degree, that one of `n` may show.
#[must_use]
pub fn chi_square_bound(k: usize, n: usize) -> f64 {
    inverse(|x| chi_square_p(x * k as f64, k), sidak(n))
}

/// p of a Kolmogorov-Smirnov distance of `lambda` or more.
fn ks_q(lambda: f64) -> f64 {
    if lambda < 0.2 {
        return 1.0;
    }
    let sum: f64 = (1..=100)
        .map(|j| {
            let j = f64::from(j);
            let sign = if j % 2.0 == 1.0 { 1.0 } else { -1.0 };
            sign * (-2.0 * j * j * lambda * lambda).exp()
        })
        .sum();
    (2.0 * sum).clamp(0.0, 1.0)
}

/// ln of the gamma function (Lanczos 1964, g = 7).
pub(crate) fn ln_gamma(x: f64) -> f64 {
    const C: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let base = x + 7.5;
    let sum = (1..9).fold(C[0], |sum, i| sum + C[i] / (x + i as f64));
    0.5 * std::f64::consts::TAU.ln() + (x + 0.5) * base.ln() - base + sum.ln()
}

/// Regularised upper incomplete gamma function.
fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > 1e-17 * sum {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut h = d;
    for i in 1..1000 {
        let i = f64::from(i);
        let k = i * (a - i);
        b += 2.0;
        d = 1.0 / (k * d + b);
        c = b + k / c;
        h *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

/// Regularised incomplete beta function, by its continued fraction.
fn beta_i(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 || x >= 1.0 {
        return x.clamp(0.0, 1.0);
    }
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - beta_i(b, a, 1.0 - x);
    }
    let front =
        (ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b) + a * x.ln() + b * (-x).ln_1p()).exp() / a;
    let (mut c, mut d) = (1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0)));
    let mut h = d;
    for m in 1..1000 {
        let m = f64::from(m);
        let even = m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m));
        let odd = -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0));
        for k in [even, odd] {
            d = 1.0 / (1.0 + k * d);
            c = 1.0 + k / c;
            h *= c * d;
        }
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    front * h
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tabulated quantiles, to the digits of the tables.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-4, "{a}, table {b}");
        close(gamma_q(0.5, 0.5 * 3.290_53 * 3.290_53), 1e-3);
        close(chi_square_p(149.449, 100), 1e-3);
        close(chi_square_p(18.307, 10), 0.05);
        close(beta_i(5.0, 0.5, 10.0 / (10.0 + 4.586_9f64.powi(2))), 1e-3);
        close(z_bound(1), 3.290_53);
        close(t_bound(1, 10.0), 4.586_9);
        // D = 1.36 / sqrt n is the 5 % point.
        let n = 10_000;
        let shift = 1.358_1 / (f64::from(n).sqrt() + 0.12 + 0.0011);
        let mut samples: Vec<f64> = (0..n)
            .map(|i| ((f64::from(i) + 1.0) / f64::from(n) - shift).max(0.0))
            .collect();
        assert!((ks_p(&mut samples) - 0.05).abs() < 1e-3, "5 % point of KS");
    }
}
