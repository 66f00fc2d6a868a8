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
use wide::{f32x4, i32x4};

use super::Corners;
use super::place::Spot;

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
    /// The corners of a cell from its pairs of neighbours in z.
    fn widen_pairs(pairs: [[Self; 2]; 4]) -> Corners;
}

impl Stored for f32 {
    #[inline]
    fn widen(self) -> f32 {
        self
    }

    #[inline]
    fn widen_pairs(pairs: [[Self; 2]; 4]) -> Corners {
        Corners {
            low: f32x4::new(pairs.map(|[low, _]| low)),
            high: f32x4::new(pairs.map(|[_, high]| high)),
        }
    }
}

impl Stored for f16 {
    #[inline]
    fn widen(self) -> f32 {
        self.to_f32()
    }

    #[inline]
    fn widen_pairs(pairs: [[Self; 2]; 4]) -> Corners {
        // A pair is one load of 32 bits.
        let two = |[low, high]: [Self; 2]| {
            (u32::from(high.to_bits()) << 16 | u32::from(low.to_bits())) as i32
        };
        let pairs = i32x4::new(pairs.map(two));
        Corners {
            low: widen4(pairs),
            high: widen4(pairs >> 16),
        }
    }
}

/// Four finite halves, by their bits, as floats: exponent and fraction move to their new places,
/// and the exponent's bias grows by 112; what has no implied 1 gets one and gives it back.
/// Integer arithmetic, because it inlines, where the conversion of a slice is a call.
#[inline]
fn widen4(halves: i32x4) -> f32x4 {
    const BIAS: i32 = 112 << 23;
    const ONE: i32 = 1 << 23;
    let size: i32x4 = (halves & i32x4::splat(0x7fff)) << 13;
    let small = size.simd_lt(i32x4::splat(ONE));
    let (bias, less) = (i32x4::splat(BIAS), i32x4::splat(BIAS + ONE));
    let wide: f32x4 = bytemuck::cast(size + bias + (small & i32x4::splat(ONE)));
    let size = wide - bytemuck::cast::<i32x4, f32x4>(small & less);
    let sign: i32x4 = (halves & i32x4::splat(0x8000)) << 16;
    bytemuck::cast(bytemuck::cast::<f32x4, i32x4>(size) | sign)
}

/// The corners of the cell at a spot.
#[inline(always)]
fn corners<S: Stored>(values: &[S], spot: Spot) -> Corners {
    let Spot { start, row, slab } = spot;
    // One bounds check: no corner is farther than the last.
    let v = &values[start..][..slab + row + 2];
    let two = |from: usize| [v[from], v[from + 1]];
    S::widen_pairs([two(0), two(row), two(slab), two(slab + row)])
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
                let wide = widen4(i32x4::splat(bits.into())).to_array();
                assert_eq!(wide.map(f32::to_bits), [half.to_f32().to_bits(); 4]);
            }
        }
    }
}
