//! Random streams: (seed, stage, pass, index) -> generator; nobody else makes one.
//!
//! Every photon and every pixel of every pass has a stream of its own, so the result cannot
//! depend on which thread drew what. The key is hashed by SplitMix64's finaliser (Steele, Lea,
//! Flood 2014) into the 64-bit seed of Xoshiro256++ (Blackman & Vigna 2021), which `rand` keeps
//! portable across platforms and versions. Lengths of flights come from the ziggurat of
//! `rand_distr` (Marsaglia & Tsang 2000): one number in ninety takes more than a product.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng as _, SeedableRng};
use rand_distr::{Distribution, Exp1};

/// What a stream is for; streams of different stages are independent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Stage {
    /// Photons of the pilot estimate that sets the radii.
    Pilot = 1,
    /// Photons.
    Photon = 2,
    /// Camera rays and what is sampled along them.
    Camera = 3,
    /// Path tracing.
    Path = 4,
    /// Checks and calibration.
    Check = 5,
    /// Points on the lens: a stream of their own, so that a pinhole's rays are the same with them.
    Lens = 6,
    /// Photons that stand for others.
    Few = 7,
}

/// One random stream.
#[derive(Debug, Clone)]
pub struct Rng(Xoshiro256PlusPlus);

/// SplitMix64's finaliser: a bijection that scatters neighbouring keys.
fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// The stream of item `index` in `pass` of `stage`.
    #[must_use]
    pub fn stream(seed: u64, stage: Stage, pass: u64, index: u64) -> Self {
        let key = mix(mix(mix(seed) ^ stage as u64) ^ pass);
        Self(Xoshiro256PlusPlus::seed_from_u64(mix(key ^ index)))
    }

    /// 64 random bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1), 24 bits.
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        (self.0.next_u64() >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
    }

    /// Uniform in [0, 1), 53 bits.
    #[inline]
    pub fn uniform_f64(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Three uniforms in [0, 1), 21 bits each, for the price of one.
    #[inline]
    pub fn uniform3(&mut self) -> [f32; 3] {
        let bits = self.0.next_u64();
        [bits >> 43, bits >> 22, bits >> 1]
            .map(|b| (b as u32 & ((1 << 21) - 1)) as f32 * (1.0 / (1u64 << 21) as f32))
    }

    /// Optical thickness of a free flight, distributed as exp(-tau).
    ///
    /// Drawn in f64: a 24-bit uniform could produce neither a step above 24 ln 2 = 16.6 nor one
    /// below 6e-8.
    #[inline]
    pub fn exponential(&mut self) -> f32 {
        let tau: f64 = Exp1.sample(&mut self.0);
        tau as f32
    }

    /// Uniform in 0..n.
    #[inline]
    pub fn below(&mut self, n: u32) -> u32 {
        ((u64::from((self.0.next_u64() >> 32) as u32) * u64::from(n)) >> 32) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_a_stream_of_its_own() {
        let mut rng = Rng::stream(0, Stage::Photon, 0, 0);
        let first: Vec<u64> = (0..4).map(|_| rng.0.next_u64()).collect();
        let mut again = Rng::stream(0, Stage::Photon, 0, 0);
        assert_eq!(
            first,
            (0..4).map(|_| again.0.next_u64()).collect::<Vec<_>>(),
            "same key, same stream"
        );
        let mut other = Rng::stream(0, Stage::Photon, 0, 1);
        assert_ne!(
            first[0],
            other.0.next_u64(),
            "neighbouring index, other stream"
        );
    }

    #[test]
    fn exponential_has_mean_and_tail() {
        let mut rng = Rng::stream(7, Stage::Check, 0, 0);
        let n = 1_000_000;
        let (mut sum, mut tail) = (0.0f64, 0u32);
        for _ in 0..n {
            let x = f64::from(rng.exponential());
            sum += x;
            tail += u32::from(x > 5.0);
        }
        // Standard error of the mean is 1/sqrt(n); of the tail count sqrt(n e^-5).
        assert!(
            (sum / f64::from(n) - 1.0).abs() < 4.0 / f64::from(n).sqrt(),
            "mean {}",
            sum / f64::from(n)
        );
        let expected = f64::from(n) * (-5.0f64).exp();
        assert!(
            (f64::from(tail) - expected).abs() < 4.0 * expected.sqrt(),
            "tail {tail} of {expected}"
        );
    }
}
