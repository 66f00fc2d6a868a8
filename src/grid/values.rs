//! Values of bricks and constants, 16 bits each where no bit is lost.
//!
//! ```text
//! code   e 2^10 + f      v = 2^(e - 25) (1 + f / 2^10),   e in 1..64, f in 0..2^10;   0 for v = 0
//! ```
//!
//! Exporters mostly write 16-bit floats, and decoded ones have no more than 11 bits each: such a
//! grid takes half the memory and cache. One value that has no code (negative, too fine, beyond 5e11)
//! keeps the whole grid in f32, so a field never depends on how it is kept (-0 is 0).
//!
//! A half has a sign in place of the sixth bit of the exponent, and so its smallest values, below
//! 6e-5, have no leading 1. Moved to where an f32 has them, these are subnormal there, and many
//! machines multiply one many times more slowly: the rims of smoke are full of them. Here every code
//! but 0 is the leading bits of an ordinary f32.
//!
//! Source: IEEE 754-2008, binary16 and binary32; NanoVDB (Museth 2021) has Fp16 grids, which round.

use rayon::prelude::*;
use wide::{f32x4, f32x8, i32x4, u16x8, u32x8};

use super::corners::Corners;
use super::place::Spot;
use crate::lanes::lanes;
use crate::prefetch::prefetch;

/// Parts in which values are narrowed; each gives its space back before the next, so that no more
/// than one is there twice.
const PARTS: usize = 16;
/// Values that one unit of parallel work looks at.
const CHUNK: usize = 1 << 12;

/// What an exponent of f32 is above that of the code.
const BIAS: u32 = 102;
/// Bits of an f32's fraction that a code has not.
const DROPPED: u32 = 13;

/// Values of a grid, found by their places.
#[derive(Debug, Clone)]
pub(super) enum Values {
    /// 32 bits each.
    Full(Vec<f32>),
    /// Codes of 16 bits each.
    Short(Vec<u16>),
}

/// What a value is stored as.
trait Stored: Copy {
    /// The corners of a cell, from the first of them to the last; from one to the next in y and x.
    fn corners(values: &[Self], row: usize, slab: usize) -> Corners;
}

impl Stored for f32 {
    #[inline(always)]
    fn corners(v: &[Self], row: usize, slab: usize) -> Corners {
        let four = |a: usize, b: usize| f32x4::new([v[a], v[a + 1], v[b], v[b + 1]]);
        Corners {
            low: four(0, row),
            high: four(slab, slab + row),
        }
    }
}

impl Stored for u16 {
    #[inline(always)]
    fn corners(codes: &[Self], row: usize, slab: usize) -> Corners {
        // Bytes, so that a pair of neighbours is one load of 32 bits.
        let bytes: &[u8] = bytemuck::cast_slice(codes);
        let two = |from: usize| bytemuck::pod_read_unaligned::<i32>(&bytes[2 * from..][..4]);
        let pairs = i32x4::new([two(0), two(row), two(slab), two(slab + row)]);
        let [low, high] = bytemuck::cast(widen8(bytemuck::cast(pairs)));
        Corners { low, high }
    }
}

/// The code of a value, and whether it has one. Without branches, so that several are done at a time.
#[inline]
fn encode(value: f32) -> (u16, bool) {
    let bits = value.to_bits();
    let code = (bits >> DROPPED).wrapping_sub(BIAS << 10);
    let exact = bits & ((1 << DROPPED) - 1) == 0;
    let in_range = code.wrapping_sub(1 << 10) < (1 << 16) - (1 << 10);
    let zero = value == 0.0;
    (
        if zero { 0 } else { code as u16 },
        zero | (exact & in_range),
    )
}

/// What the leading bits of an f32 are short of: a power of two.
const SCALE: f32 = f32::from_bits((127 + BIAS) << 23);

/// The value of a code.
#[inline(always)]
fn widen(code: u16) -> f32 {
    f32::from_bits(u32::from(code) << DROPPED) * SCALE
}

/// The values of eight codes.
#[inline(always)]
fn widen8(codes: u16x8) -> f32x8 {
    let bits = u32x8::from(codes) << DROPPED;
    bytemuck::cast::<u32x8, f32x8>(bits) * f32x8::splat(SCALE)
}

/// The corners of the cell at a spot.
#[inline(always)]
fn corners<S: Stored>(values: &[S], spot: Spot) -> Corners {
    let [row, slab] = [spot.row, spot.slab].map(|stride| stride as usize);
    // One bounds check: no corner is farther than the last.
    S::corners(&values[spot.start..][..slab + row + 2], row, slab)
}

impl Values {
    /// Keeps values in 16 bits if all of them survive it.
    pub(super) fn new(mut values: Vec<f32>) -> Self {
        if values.is_empty() || !values.par_chunks(CHUNK).all(have_codes) {
            return Self::Full(values);
        }
        // Zeroes of the system: no page is taken before it is written.
        let mut codes = vec![0; values.len()];
        let part = values.len().div_ceil(PARTS);
        while !values.is_empty() {
            let from = (values.len() - 1) / part * part;
            codes[from..values.len()]
                .par_chunks_mut(CHUNK)
                .zip(values[from..].par_chunks(CHUNK))
                .for_each(|(to, from)| {
                    for (to, from) in to.iter_mut().zip(from) {
                        *to = encode(*from).0;
                    }
                });
            values.truncate(from);
            values.shrink_to_fit();
        }
        Self::Short(codes)
    }

    /// The value at an index.
    #[inline]
    pub(super) fn at(&self, index: usize) -> f32 {
        match self {
            Self::Full(values) => values[index],
            Self::Short(codes) => widen(codes[index]),
        }
    }

    /// The values at eight indices.
    #[inline(always)]
    pub(super) fn eight(&self, at: [usize; 8]) -> f32x8 {
        match self {
            Self::Full(values) => f32x8::new(lanes(|lane| values[at[lane]])),
            Self::Short(codes) => widen8(u16x8::new(lanes(|lane| codes[at[lane]]))),
        }
    }

    /// The value at an index will be read.
    #[inline(always)]
    pub(super) fn prefetch(&self, index: usize) {
        match self {
            Self::Full(values) => prefetch(values, index),
            Self::Short(codes) => prefetch(codes, index),
        }
    }

    /// The corners of the cell at a spot. Always inlined: through memory they cost as much again.
    #[inline(always)]
    pub(super) fn corners(&self, spot: Spot) -> Corners {
        match self {
            Self::Full(values) => corners(values, spot),
            Self::Short(codes) => corners(codes, spot),
        }
    }

    /// The same values in 32 bits each.
    pub(super) fn widened(&self) -> Self {
        self.scaled(1.0)
    }

    /// Every value times a factor, in 32 bits.
    pub(super) fn scaled(&self, factor: f32) -> Self {
        let mut values = match self {
            Self::Full(values) => values.clone(),
            Self::Short(codes) => codes.par_iter().map(|c| widen(*c)).collect(),
        };
        values.par_iter_mut().for_each(|v| *v *= factor);
        Self::Full(values)
    }

    /// Bits of a value.
    pub(super) fn bits(&self) -> u32 {
        match self {
            Self::Full(_) => 32,
            Self::Short(_) => 16,
        }
    }

    /// Bytes, as allocated.
    pub(super) fn memory_bytes(&self) -> usize {
        match self {
            Self::Full(values) => values.capacity() * size_of::<f32>(),
            Self::Short(codes) => codes.capacity() * size_of::<u16>(),
        }
    }
}

/// True if all values have codes.
fn have_codes(values: &[f32]) -> bool {
    // All of a few, rather than up to the first without: several at a time.
    const FEW: usize = 64;
    (values.chunks(FEW)).all(|few| few.iter().fold(true, |all, v| all & encode(*v).1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every code is an ordinary f32 of its own, and that number's only code.
    #[test]
    fn every_code_is_one_value() {
        assert_eq!(encode(-0.0), (0, true));
        for bits in 0..=u16::MAX {
            let value = widen(bits);
            let wide = widen8(u16x8::splat(bits)).to_array();
            assert_eq!(wide.map(f32::to_bits), [value.to_bits(); 8]);
            let [exponent, fraction] = [bits >> 10, bits & 0x3ff].map(i32::from);
            if exponent == 0 {
                // Not made by `encode`, but for 0.
                continue;
            }
            let told = 2f64.powi(exponent - 25) * (1.0 + f64::from(fraction) / 1024.0);
            assert_eq!(f64::from(value), told, "code {bits}");
            assert_eq!(encode(value), (bits, true));
        }
    }

    /// All halves that are not negative have codes.
    #[test]
    fn every_half_has_a_code() {
        let halves = (0..0x7c00).map(|bits| half::f16::from_bits(bits).to_f32());
        for half in halves {
            let (code, exact) = encode(half);
            assert!(exact && widen(code) == half, "{half:e}");
        }
    }
}
