//! Points spread over the unit cube: the samples of one ray know of each other.
//!
//! ```text
//! u_i = frac(u_0 + i a)       a = (1/p, 1/p^2, 1/g)       p^3 = p + 1, g^2 = g + 1
//! ```
//!
//! A Kronecker sequence (Roberts 2018: the first two coordinates are his R2) from a random start:
//! each point alone is uniform, so a mean over them is unbiased; together they lie farther apart
//! than independent ones, and a shadow's edge or an area light seen through smoke is less noisy.

use crate::tracking::Sampler;

/// Added from point to point.
const STEP: [f32; 3] = [0.754_877_7, 0.569_840_3, 0.618_034];

/// A sequence from its own random start.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    start: [f32; 3],
}

impl Spread {
    /// A sequence whose start the sampler draws.
    #[must_use]
    pub(super) fn new(sampler: &mut Sampler) -> Self {
        Self {
            start: std::array::from_fn(|_| sampler.uniform()),
        }
    }

    /// Point `i`, in [0, 1) along each axis.
    #[must_use]
    pub(super) fn at(&self, i: u32) -> [f32; 3] {
        std::array::from_fn(|axis| STEP[axis].mul_add(i as f32, self.start[axis]).fract())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    /// Each point is uniform, and the mean over eight of them scatters less than of independent ones.
    #[test]
    fn means_are_right_and_steadier() {
        let mut sampler = Sampler::new(Rng::stream(5, Stage::Check, 0, 0));
        // The lit side of a slanting edge, a third of the square.
        let lit = |u: [f32; 3]| f64::from(u8::from(u[0] + 0.5 * u[1] < 0.583_333_3));
        let (n, count) = (20_000, 8);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let spread = Spread::new(&mut sampler);
            let mean = (0..count).map(|i| lit(spread.at(i))).sum::<f64>() / f64::from(count);
            assert!(
                spread.at(7).iter().all(|u| (0.0..1.0).contains(u)),
                "in the cube"
            );
            sum += mean;
            squares += mean * mean;
        }
        let mean = sum / f64::from(n);
        let variance = squares / f64::from(n) - mean * mean;
        // The exact share: 0.58333 - 0.25.
        let error = (variance / f64::from(n)).sqrt();
        assert!((mean - 1.0 / 3.0).abs() < 4.0 * error, "{mean} +- {error}");
        let independent = (1.0 / 3.0) * (2.0 / 3.0) / f64::from(count);
        assert!(
            variance < 0.5 * independent,
            "{variance}, {independent} independent"
        );
    }
}
