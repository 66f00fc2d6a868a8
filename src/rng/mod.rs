//! Random streams: (seed, stage, pass, index) -> generator; nobody else makes one.
//!
//! Every photon and every pixel of every pass has a stream of its own, so the result cannot
//! depend on which thread drew what. The key is hashed by SplitMix64's finaliser (Steele, Lea,
//! Flood 2014) into the 64-bit seed of Xoshiro256++ (Blackman & Vigna 2021), which the `rand` crate
//! holds too: this one is open, as its state has to lie in lanes where eight streams are drawn from at
//! a time (octet.rs).
//!
//! Lengths of flights:
//!
//! ```text
//! -ln U = h ln 2 - ln(1 - w)            U = 2^-h (1 - w), uniform in (0, 1)
//! h       zeros before the first bit that is set, P(h) = 2^-(h + 1)
//! w       uniform in [0, 1/2)
//! ```
//! Halvings are counted and never end, the rest is a polynomial: no guess, no table and no call in
//! the midst of a flight, and the same for eight at a time. The split is Ahrens & Dieter's (1972; Knuth,
//! The Art of Computer Programming 2, 3.4.1, algorithm S); they sample the rest.

mod octet;

pub(crate) use octet::RngOctet;

use std::convert::Infallible;
use std::f32::consts::LN_2;

use rand::TryRng;

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
pub struct Rng {
    state: [u64; 4],
}

/// What is drawn of a collision at once, two numbers of 64 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Draw<T = f32> {
    /// Uniform in [0, 1), 24 bits.
    pub(crate) bar: T,
    /// Three more, of 20 bits and one that is set.
    pub(crate) tap: [T; 3],
    /// [`Rng::exponential`].
    pub(crate) tau: T,
}

/// Bits that halvings are counted in, if one of them is set, above those of the rest.
const HALVINGS: u32 = 20;
/// Bits of the rest: as fine as f32 is at 1.
const REST: u32 = 24;

/// `COUNT` bits from bit `SHIFT` on as a fraction of 1.
#[inline(always)]
fn fraction<const SHIFT: u32, const COUNT: u32>(bits: u64) -> f32 {
    let bits = (bits >> SHIFT) as u32 & ((1 << COUNT) - 1);
    bits as i32 as f32 * (1.0 / (1u32 << COUNT) as f32)
}

/// The middle of what has these first bits: no more often below a number than above.
#[inline(always)]
fn middle<const SHIFT: u32, const COUNT: u32>(bits: u64) -> f32 {
    fraction::<SHIFT, COUNT>(bits) + 0.5 / (1u32 << COUNT) as f32
}

/// What SplitMix64 adds from one key to the next.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's finaliser: a bijection that scatters neighbouring keys.
fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(GOLDEN);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// The stream of item `index` in `pass` of `stage`.
    #[must_use]
    pub fn stream(seed: u64, stage: Stage, pass: u64, index: u64) -> Self {
        let key = mix(mix(mix(seed) ^ stage as u64) ^ pass);
        let key = mix(key ^ index);
        let state = [0, 1, 2, 3].map(|i: u64| mix(key.wrapping_add(GOLDEN.wrapping_mul(i))));
        Self { state }
    }

    /// 64 random bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        let [mut a, mut b, mut c, mut d] = self.state;
        let bits = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let t = b << 17;
        c ^= a;
        d ^= b;
        b ^= c;
        a ^= d;
        c ^= t;
        self.state = [a, b, c, d.rotate_left(45)];
        bits
    }

    /// Uniform in [0, 1), 24 bits.
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        fraction::<40, 24>(self.bits())
    }

    /// Uniform in [0, 1), 53 bits.
    #[inline]
    pub fn uniform_f64(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Three uniforms in [0, 1), 21 bits each, for the price of one.
    #[inline]
    pub fn uniform3(&mut self) -> [f32; 3] {
        let bits = self.bits();
        [
            fraction::<43, 21>(bits),
            fraction::<22, 21>(bits),
            fraction::<1, 21>(bits),
        ]
    }

    /// Optical thickness of a free flight, distributed as exp(-tau).
    ///
    /// A 24-bit uniform could produce no step above 24 ln 2 = 16.6; these have no end.
    #[inline]
    pub fn exponential(&mut self) -> f32 {
        let bits = self.bits();
        self.tau(bits)
    }

    /// What is drawn of a collision.
    #[inline]
    pub(crate) fn collision(&mut self) -> Draw {
        let [first, second] = [self.bits(), self.bits()];
        Draw {
            bar: fraction::<40, 24>(first),
            tap: [
                middle::<20, 20>(first),
                middle::<0, 20>(first),
                middle::<44, 20>(second),
            ],
            tau: self.tau(second),
        }
    }

    /// [`exponential`](Self::exponential) by the lower 44 bits.
    #[inline]
    fn tau(&mut self, bits: u64) -> f32 {
        let halvings = match (bits >> REST) as u32 & ((1 << HALVINGS) - 1) {
            0 => self.more_halvings(),
            high => high.leading_zeros() + HALVINGS - u32::BITS,
        };
        (halvings as f32).mul_add(LN_2, minus_ln(bits as i32 & ((1 << REST) - 1)))
    }

    /// Halvings where the bits for them are all 0.
    #[cold]
    fn more_halvings(&mut self) -> u32 {
        halvings_after(HALVINGS, || self.bits())
    }

    /// Uniform in 0..n.
    #[inline]
    pub fn below(&mut self, n: u32) -> u32 {
        ((u64::from((self.bits() >> 32) as u32) * u64::from(n)) >> 32) as u32
    }
}

impl TryRng for Rng {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.bits() >> 32) as u32)
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.bits())
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        for bytes in bytes.chunks_mut(8) {
            bytes.copy_from_slice(&self.bits().to_le_bytes()[..bytes.len()]);
        }
        Ok(())
    }
}

/// Zeros before the first bit that is set, `zeros` of them known.
fn halvings_after(mut zeros: u32, mut bits: impl FnMut() -> u64) -> u32 {
    loop {
        let more = bits();
        zeros += more.leading_zeros();
        if more != 0 {
            return zeros;
        }
    }
}

/// Coefficients of [`minus_ln`], of the highest power first; fitted (1.5e-8).
const SERIES: [f32; 4] = [0.134_337_77, 0.141_169_78, 0.200_038_35, 0.333_333_2];

/// -ln(1 - w), w the middle of the k-th of 2^24 parts of [0, 1/2]; to 4e-7 of itself.
#[inline]
fn minus_ln(k: i32) -> f32 {
    let w = (k as f32 + 0.5) * (0.5 / (1u32 << REST) as f32);
    // 2 artanh s, s up to 1/3: a series in s^2.
    let s = w / (2.0 - w);
    let q = s * s;
    let [a, b, c, d] = SERIES;
    let series = q.mul_add(a, b);
    let series = q.mul_add(series, c);
    let series = q.mul_add(series, d);
    (2.0 * s) * q.mul_add(series, 1.0)
}

#[cfg(test)]
mod tests {
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{Rng as _, SeedableRng};

    use super::*;

    /// The generator is `rand`'s, and so is its seeding.
    #[test]
    fn bits_are_those_of_xoshiro() {
        let mut ours = Rng::stream(3, Stage::Check, 1, 4);
        let key = mix(mix(mix(3) ^ Stage::Check as u64) ^ 1);
        let mut theirs = Xoshiro256PlusPlus::seed_from_u64(mix(key ^ 4));
        for i in 0..1000 {
            assert_eq!(ours.bits(), theirs.next_u64(), "{i}");
        }
    }

    #[test]
    fn rests_are_logarithms() {
        let mut worst = 0.0f64;
        for k in 0..1 << REST {
            let w = (f64::from(k) + 0.5) * 0.5f64.powi(25);
            let (found, exact) = (f64::from(minus_ln(k)), -(-w).ln_1p());
            worst = worst.max((found / exact - 1.0).abs());
        }
        // Of w, 2 - w, their ratio, two products and two sums.
        assert!(worst < 7.0 * 0.5 * f64::from(f32::EPSILON), "{worst:e}");
    }

    #[test]
    fn halvings_have_no_end() {
        let mut bits = [0, 0, 1 << 60].into_iter();
        assert_eq!(halvings_after(20, || bits.next().expect("bits")), 151);
    }

    #[test]
    fn a_key_is_a_stream_of_its_own() {
        let mut rng = Rng::stream(0, Stage::Photon, 0, 0);
        let first: Vec<u64> = (0..4).map(|_| rng.bits()).collect();
        let mut again = Rng::stream(0, Stage::Photon, 0, 0);
        assert_eq!(
            first,
            (0..4).map(|_| again.bits()).collect::<Vec<_>>(),
            "same key, same stream"
        );
        let mut other = Rng::stream(0, Stage::Photon, 0, 1);
        assert_ne!(first[0], other.bits(), "neighbouring index, other stream");
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
