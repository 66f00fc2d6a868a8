//! Power and radius as a photon keeps them.
//!
//! ```text
//! grey        the upper halves of both f32, 16 bits each: 8 of exponent, 7 of fraction
//! P           rounded up with the probability of what is cut off:   E(P kept) = P
//! r           rounded down
//! ```
//!
//! A photon's power is a random sample: rounded at random, without a change of its expectation, it
//! has 1e-5 more of relative variance, where the map's own is some 1. A radius is what the estimate
//! says it is: the kernel's height follows the one that is kept, at most 2^-7 smaller. The chance is
//! taken from the photon's place, so nothing is drawn for it. Colours keep f32.
//!
//! Source: stochastic rounding, Forsythe 1959.

use std::fmt::Debug;

use glam::Vec3;

/// What a photon keeps of its power and radius.
pub trait Kept<S>: Copy + Debug + Send + Sync + 'static {
    /// Without a radius. `chance` decides how the power is rounded.
    fn new(power: S, chance: u32) -> Self;
    /// The power.
    fn power(self) -> S;
    /// The radius. \[m\]
    fn radius(self) -> f32;
    /// The same with a radius of that, or up to 2^-7 less. \[m\]
    #[must_use]
    fn with_radius(self, radius: f32) -> Self;
}

/// One channel and the radius.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Short {
    power: u16,
    radius: u16,
}

/// Three channels and the radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Full {
    power: Vec3,
    radius: f32,
}

/// An f32 of which the lower half is 0.
#[inline]
fn widen(upper: u16) -> f32 {
    f32::from_bits(u32::from(upper) << 16)
}

impl Kept<f32> for Short {
    #[inline]
    fn new(power: f32, chance: u32) -> Self {
        // Below infinity, whatever is added.
        let bits = power.to_bits().min(0x7f7e_ffff);
        Self {
            power: ((bits + (chance & 0xffff)) >> 16) as u16,
            radius: 0,
        }
    }

    #[inline]
    fn power(self) -> f32 {
        widen(self.power)
    }

    #[inline]
    fn radius(self) -> f32 {
        widen(self.radius)
    }

    #[inline]
    fn with_radius(self, radius: f32) -> Self {
        Self {
            radius: (radius.to_bits() >> 16) as u16,
            ..self
        }
    }
}

impl Kept<Vec3> for Full {
    #[inline]
    fn new(power: Vec3, _chance: u32) -> Self {
        Self { power, radius: 0.0 }
    }

    #[inline]
    fn power(self) -> Vec3 {
        self.power
    }

    #[inline]
    fn radius(self) -> f32 {
        self.radius
    }

    #[inline]
    fn with_radius(self, radius: f32) -> Self {
        Self { radius, ..self }
    }
}

/// A chance that the place of a photon decides: its bits, scattered.
#[inline]
#[must_use]
pub fn chance_of(place: Vec3) -> u32 {
    let [x, y, z] = place.to_array().map(f32::to_bits);
    scattered((x.wrapping_mul(0x9e37_79b1) ^ y).wrapping_mul(0x85eb_ca77) ^ z)
}

/// Every bit of a number in every other: the finaliser of MurmurHash3.
#[inline]
#[must_use]
pub fn scattered(mut h: u32) -> u32 {
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};
    use crate::stats::Welford;

    /// Powers of many magnitudes, each kept for many places: the mean is the power, and none is
    /// farther from it than the step between two that can be kept.
    #[test]
    fn power_is_kept_without_bias() {
        let mut rng = Rng::stream(1, Stage::Check, 0, 0);
        let mut worst = 0.0f64;
        for exponent in -120..120 {
            let power = (1.0 + rng.uniform()) * 2f32.powi(exponent);
            let mean: Welford = (0..2000)
                .map(|_| {
                    let place = Vec3::new(rng.uniform(), rng.uniform(), rng.uniform());
                    let kept = Short::new(power, chance_of(place)).power();
                    let off = f64::from(kept) / f64::from(power) - 1.0;
                    assert!(off.abs() <= 1.0 / 128.0, "{power:e} kept as {kept:e}");
                    off
                })
                .collect();
            worst = worst.max(mean.z(0.0, 1e-9).abs());
        }
        // 240 powers at 1e-3 together (Sidak).
        assert!(worst < 4.6, "|z| {worst}");
        assert_eq!(Short::new(0.0, u32::MAX).power(), 0.0);
        assert!(Short::new(f32::MAX, u32::MAX).power().is_finite());
    }

    #[test]
    fn radii_are_kept_from_below() {
        let mut rng = Rng::stream(2, Stage::Check, 0, 0);
        for exponent in -120..120 {
            let radius = (1.0 + rng.uniform()) * 2f32.powi(exponent);
            let kept = Short::new(1.0, 0).with_radius(radius).radius();
            assert!(
                kept <= radius && kept >= radius * (127.0 / 128.0),
                "{radius:e}: {kept:e}"
            );
        }
    }
}
