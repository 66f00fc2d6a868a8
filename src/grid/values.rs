//! Values of bricks: 16 bits each where no bit is lost, else 32.
//!
//! ```text
//! 16 bits if   bits(f32(f16(v))) = bits(v)   for every value v of every brick
//! ```
//!
//! Exporters mostly write 16-bit floats, and a decoded one is itself again when rounded: such a
//! grid takes half the memory and cache. One value that is not (too fine, beyond 65504, a NaN
//! with bits of its own) keeps the whole grid in f32, so a field never depends on how it is kept.
//!
//! The eight corners of a cell are widened by one instruction (VCVTPH2PS, eight at a time) after
//! four loads of two neighbours in z.
//!
//! Source: IEEE 754-2008, binary16; NanoVDB (Museth 2021) has Fp16 grids, which round.

use glam::IVec3;
use half::f16;
use half::slice::HalfFloatSliceExt;
use half::vec::HalfBitsVecExt;
use rayon::prelude::*;

use super::{BRICK_VALUES, Corners, corner_index};

/// Parts in which values are narrowed; each gives its space back before the next, so that no more
/// than one is there twice.
const PARTS: usize = 16;

/// Values of all bricks of a grid, 9^3 each, z fastest.
#[derive(Debug, Clone)]
pub(super) enum Values {
    /// 32 bits each.
    Full(Vec<f32>),
    /// 16 bits each, exactly.
    Half(Vec<f16>),
}

/// The 9^3 values of a brick.
#[derive(Debug, Clone, Copy)]
pub enum BrickValues<'a> {
    /// 32 bits each.
    Full(&'a [f32; BRICK_VALUES]),
    /// 16 bits each.
    Half(&'a [f16; BRICK_VALUES]),
}

/// What a value is stored as.
trait Stored: Copy {
    /// The value.
    fn widen(self) -> f32;
    /// The values of the corners of a cell.
    fn widen_corners(corners: [[Self; 2]; 4]) -> [[f32; 2]; 4];
}

impl Stored for f32 {
    #[inline]
    fn widen(self) -> f32 {
        self
    }

    #[inline]
    fn widen_corners(corners: [[Self; 2]; 4]) -> [[f32; 2]; 4] {
        corners
    }
}

impl Stored for f16 {
    #[inline]
    fn widen(self) -> f32 {
        self.to_f32()
    }

    #[inline]
    fn widen_corners(corners: [[Self; 2]; 4]) -> [[f32; 2]; 4] {
        let mut wide = [[0.0; 2]; 4];
        corners
            .as_flattened()
            .convert_to_f32_slice(wide.as_flattened_mut());
        wide
    }
}

/// The corners of the cell with lower corner `cell` (0..8).
#[inline]
fn corners<S: Stored>(values: &[S; BRICK_VALUES], cell: IVec3) -> Corners {
    // One bounds check: the furthest corner is 81 + 9 + 1 beyond the lowest.
    let start = corner_index(cell & 7);
    let v = &values[start..start + 92];
    Corners(S::widen_corners([
        [v[0], v[1]],
        [v[9], v[10]],
        [v[81], v[82]],
        [v[90], v[91]],
    ]))
}

/// The 9^3 values of the brick at `index`.
#[inline]
fn brick<S>(values: &[S], index: usize) -> Option<&[S; BRICK_VALUES]> {
    let start = index * BRICK_VALUES;
    values[start..start + BRICK_VALUES].try_into().ok()
}

impl BrickValues<'_> {
    /// The value at a corner, 0..=8 along each axis.
    #[inline]
    #[must_use]
    pub fn at(&self, corner: IVec3) -> f32 {
        let index = corner_index(corner);
        match self {
            Self::Full(values) => values[index].widen(),
            Self::Half(values) => values[index].widen(),
        }
    }

    /// The corners of the cell with lower corner `cell` (0..8).
    #[inline]
    #[must_use]
    pub fn corners(&self, cell: IVec3) -> Corners {
        match self {
            Self::Full(values) => corners(values, cell),
            Self::Half(values) => corners(values, cell),
        }
    }
}

impl Values {
    /// Keeps values in 16 bits if all of them survive it.
    pub(super) fn new(mut values: Vec<f32>) -> Self {
        if values.is_empty() || !values.par_chunks(BRICK_VALUES).all(are_halves) {
            return Self::Full(values);
        }
        // Zeroes of the system: no page is taken before it is written.
        let mut halves: Vec<f16> = vec![0u16; values.len()].reinterpret_into();
        let part = values.len().div_ceil(PARTS).next_multiple_of(BRICK_VALUES);
        while !values.is_empty() {
            let from = (values.len() - 1) / part * part;
            halves[from..values.len()]
                .par_chunks_mut(BRICK_VALUES)
                .zip(values[from..].par_chunks(BRICK_VALUES))
                .for_each(|(to, from)| to.convert_from_f32_slice(from));
            values.truncate(from);
            values.shrink_to_fit();
        }
        Self::Half(halves)
    }

    /// The brick at `index`.
    #[inline]
    pub(super) fn brick(&self, index: usize) -> Option<BrickValues<'_>> {
        match self {
            Self::Full(values) => brick(values, index).map(BrickValues::Full),
            Self::Half(values) => brick(values, index).map(BrickValues::Half),
        }
    }

    /// The same values in 32 bits each.
    pub(super) fn widened(&self) -> Self {
        Self::Full(match self {
            Self::Full(values) => values.clone(),
            Self::Half(halves) => halves.to_f32_vec(),
        })
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

/// True if all values of a brick are 16-bit floats.
fn are_halves(brick: &[f32]) -> bool {
    const FEW: usize = 32;
    let (mut halves, mut back) = ([f16::ZERO; FEW], [0.0f32; FEW]);
    brick.chunks(FEW).all(|values| {
        let (halves, back) = (&mut halves[..values.len()], &mut back[..values.len()]);
        halves.convert_from_f32_slice(values);
        halves.convert_to_f32_slice(back);
        // All of them, rather than up to the first that differs: eight at a time.
        values
            .iter()
            .zip(back)
            .fold(true, |same, (a, b)| same & (a.to_bits() == b.to_bits()))
    })
}
