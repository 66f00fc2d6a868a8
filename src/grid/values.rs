//! Values of bricks and constants, 16 bits each where no bit is lost.
//!
//! ```text
//! 16 bits if   v is finite and bits(f32(f16(v))) = bits(v)   for every value v
//! ```
//!
//! Exporters mostly write 16-bit floats, and a decoded one is itself again when rounded: such a
//! grid takes half the memory and cache. One value that is not (too fine, beyond 65504) keeps the whole grid in f32, so a field never depends on how it is kept.
//!
//! Source: IEEE 754-2008, binary16; NanoVDB (Museth 2021) has Fp16 grids, which round.

use half::f16;
use half::slice::HalfFloatSliceExt;
use half::vec::HalfBitsVecExt;
use rayon::prelude::*;
use wide::{f32x4, f32x8, i16x8, i32x4, i32x8};

use super::corners::Corners;
use super::place::Spot;
use crate::lanes::lanes;
use crate::prefetch::prefetch;

/// Parts in which values are narrowed; each gives its space back before the next, so that no more
/// than one is there twice.
const PARTS: usize = 16;
/// Values that one unit of parallel work looks at.
const CHUNK: usize = 1 << 12;

/// Values of a grid, found by their places.
#[derive(Debug, Clone)]
pub(super) enum Values {
    /// 32 bits each.
    Full(Vec<f32>),
    /// 16 bits each, exactly.
    Half(Vec<f16>),
}

/// What a value is stored as.
trait Stored: Copy {
    /// The value.
    fn widen(self) -> f32;
    /// The corners of a cell, from the first of them to the last; from one to the next in y and x.
    fn corners(values: &[Self], row: usize, slab: usize) -> Corners;
}

impl Stored for f32 {
    #[inline]
    fn widen(self) -> f32 {
        self
    }

    #[inline(always)]
    fn corners(v: &[Self], row: usize, slab: usize) -> Corners {
        let four = |a: usize, b: usize| f32x4::new([v[a], v[a + 1], v[b], v[b + 1]]);
        Corners {
            low: four(0, row),
            high: four(slab, slab + row),
        }
    }
}

impl Stored for f16 {
    #[inline]
    fn widen(self) -> f32 {
        self.to_f32()
    }

    #[inline(always)]
    fn corners(values: &[Self], row: usize, slab: usize) -> Corners {
        // Bytes, so that a pair of neighbours is one load of 32 bits.
        let bytes: &[u8] = bytemuck::cast_slice(values.reinterpret_cast());
        let two = |from: usize| bytemuck::pod_read_unaligned::<i32>(&bytes[2 * from..][..4]);
        let pairs = i32x4::new([two(0), two(row), two(slab), two(slab + row)]);
        let [low, high] = bytemuck::cast(widen8(bytemuck::cast(pairs)));
        Corners { low, high }
    }
}

/// Eight finite halves, by their bits, as floats.
///
/// Exponent and fraction move to their new places, and as a float with a bias of 127, where the
/// half's is 15, that is 2^-112 of the value. A half without an implied 1 is a float without one
/// there, and the product is exact. Integers, because they inline, where the conversion of a
/// slice is a call.
#[inline]
fn widen8(halves: i16x8) -> f32x8 {
    /// Sign, exponent and fraction; between them are copies of the sign.
    const KEPT: i32 = 0x8fff_e000_u32 as i32;
    let bits: i32x8 = (i32x8::from(halves) << 13) & i32x8::splat(KEPT);
    bytemuck::cast::<i32x8, f32x8>(bits) * f32x8::splat(f32::from_bits((127 + 112) << 23))
}

/// The corners of the cell at a spot.
#[inline(always)]
fn corners<S: Stored>(values: &[S], spot: Spot) -> Corners {
    let [row, slab] = [spot.row, spot.slab].map(usize::from);
    // One bounds check: no corner is farther than the last.
    S::corners(&values[spot.start..][..slab + row + 2], row, slab)
}

impl Values {
    /// Keeps values in 16 bits if all of them survive it.
    pub(super) fn new(mut values: Vec<f32>) -> Self {
        if values.is_empty() || !values.par_chunks(CHUNK).all(are_halves) {
            return Self::Full(values);
        }
        // Zeroes of the system: no page is taken before it is written.
        let mut halves: Vec<f16> = vec![0u16; values.len()].reinterpret_into();
        let part = values.len().div_ceil(PARTS);
        while !values.is_empty() {
            let from = (values.len() - 1) / part * part;
            halves[from..values.len()]
                .par_chunks_mut(CHUNK)
                .zip(values[from..].par_chunks(CHUNK))
                .for_each(|(to, from)| to.convert_from_f32_slice(from));
            values.truncate(from);
            values.shrink_to_fit();
        }
        Self::Half(halves)
    }

    /// The value at an index.
    #[inline]
    pub(super) fn at(&self, index: usize) -> f32 {
        match self {
            Self::Full(values) => values[index],
            Self::Half(values) => values[index].widen(),
        }
    }

    /// The values at eight indices.
    #[inline(always)]
    pub(super) fn eight(&self, at: [usize; 8]) -> f32x8 {
        match self {
            Self::Full(values) => f32x8::new(lanes(|lane| values[at[lane]])),
            Self::Half(values) => {
                widen8(i16x8::new(lanes(|lane| values[at[lane]].to_bits() as i16)))
            }
        }
    }

    /// The value at an index will be read.
    #[inline(always)]
    pub(super) fn prefetch(&self, index: usize) {
        match self {
            Self::Full(values) => prefetch(values, index),
            Self::Half(values) => prefetch(values, index),
        }
    }

    /// The corners of the cell at a spot. Always inlined: through memory they cost as much again.
    #[inline(always)]
    pub(super) fn corners(&self, spot: Spot) -> Corners {
        match self {
            Self::Full(values) => corners(values, spot),
            Self::Half(values) => corners(values, spot),
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
            Self::Half(halves) => halves.to_f32_vec(),
        };
        values.par_iter_mut().for_each(|v| *v *= factor);
        Self::Full(values)
    }

    /// Bits of a value.
    pub(super) fn bits(&self) -> u32 {
        match self {
            Self::Full(_) => 32,
            Self::Half(_) => 16,
        }
    }

    /// Bytes, as allocated.
    pub(super) fn memory_bytes(&self) -> usize {
        match self {
            Self::Full(values) => values.capacity() * size_of::<f32>(),
            Self::Half(values) => values.capacity() * size_of::<f16>(),
        }
    }
}

/// True if all values are 16-bit floats.
fn are_halves(values: &[f32]) -> bool {
    const FEW: usize = 32;
    let (mut halves, mut back) = ([f16::ZERO; FEW], [0.0f32; FEW]);
    values.chunks(FEW).all(|values| {
        let (halves, back) = (&mut halves[..values.len()], &mut back[..values.len()]);
        halves.convert_from_f32_slice(values);
        halves.convert_to_f32_slice(back);
        // All of them, rather than up to the first that differs: eight at a time.
        values.iter().zip(back).fold(true, |same, (a, b)| {
            same & (a.to_bits() == b.to_bits()) & a.is_finite()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_is_widened() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                let wide = widen8(i16x8::splat(bits as i16)).to_array();
                assert_eq!(wide.map(f32::to_bits), [half.to_f32().to_bits(); 8]);
            }
        }
    }
}
