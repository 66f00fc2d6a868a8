//! Where the values of a brick are stored, and which of them a cell's corners are.
//!
//! ```text
//! stored:   v(c), low <= c < low + size, the least box outside whose cells the field is 0
//! index:    base + x slab + y row + z      (x, y, z) = c, row = size.z, slab = size.y row
//! a constant:  row = slab = 0, its value twice
//! ```
//!
//! Boxes. A brick's cells touch 9^3 values where a leaf has 8^3: 1.42 times as many, and more
//! bricks than leaves, since the cells before a leaf touch it too. But clouds are mostly surface:
//! kept to its box, a grid of real smoke or cloud takes 1.0 to 1.3 values for each of its leaves'
//! (`vpm-vdb info`), and a look-up in the empty part of a brick fetches nothing.
//!
//! One path. Empty cells and constants are looked up as others are, at a place where the value
//! stands: points fall in and out of boxes at random, and a processor that need not guess which
//! fetches for several look-ups at a time.

use std::hint::select_unpredictable;

use bytemuck::cast;
use glam::IVec3;
use wide::{i16x8, i32x4, u32x4};

/// Where the values of a brick are: fields of a byte for each axis and one more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(C, align(16))]
pub(super) struct Place {
    /// Lowest corner of the box; 0.
    low: [u8; 4],
    /// Its last cell from there; a bit for each octant of 4^3 cells, set unless all its values are 0.
    last: [u8; 4],
    /// From a value to the next, 0 for a constant; bits 32 to 39 of `start`.
    strides: [u8; 4],
    /// Index of the first value.
    start: u32,
}

/// The corners of a cell among stored values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// Index of the lowest.
    pub(super) start: usize,
    /// From there to the next in y; in z it is the next value.
    pub(super) row: u32,
    /// From there to the next in x.
    pub(super) slab: u32,
}

impl Spot {
    /// True if all eight corners are one value.
    #[inline(always)]
    pub(super) fn is_constant(self) -> bool {
        self.row == 0
    }
}

impl Place {
    /// One more than the last index that a value can have: 4 TiB of 32-bit ones.
    pub(super) const END: u64 = 1 << 40;

    /// The values of corners `low` to `low + size`, from index `start` on; which octants are not
    /// empty, bit by bit.
    #[inline]
    pub(super) fn new(start: usize, low: IVec3, size: IVec3, octants: u8) -> Self {
        let strides = IVec3::new(size.y * size.z, size.z, 1);
        Self {
            low: bytes(low, 0),
            last: bytes(size - IVec3::splat(2), octants),
            strides: bytes(strides, (start as u64 >> 32) as u8),
            start: start as u32,
        }
    }

    /// The constant that stands at `start` and beyond it, 0 or not.
    #[inline]
    pub(super) fn constant(start: usize, is_zero: bool) -> Self {
        Self {
            low: [0; 4],
            last: bytes(IVec3::splat(7), if is_zero { 0 } else { u8::MAX }),
            strides: bytes(IVec3::ZERO, (start as u64 >> 32) as u8),
            start: start as u32,
        }
    }

    /// Octants that are not empty, bit by bit.
    #[inline]
    pub(super) fn octants(&self) -> u64 {
        self.last[3].into()
    }

    /// True if all values are that at [`Self::start`].
    #[inline]
    pub(super) fn is_constant(&self) -> bool {
        self.strides[2] == 0
    }

    /// Index of the first value.
    #[inline(always)]
    pub(super) fn start(&self) -> usize {
        (u64::from(self.start) | u64::from(self.strides[3]) << 32) as usize
    }

    /// Lowest corner of the box, 0..8 along each axis.
    pub(super) fn low(&self) -> IVec3 {
        axes(self.low)
    }

    /// Values of the box along each axis, 2..=9.
    pub(super) fn size(&self) -> IVec3 {
        axes(self.last) + IVec3::splat(2)
    }

    /// The first of the cells and, from there, the last: of a constant, all of the brick's. With
    /// anything in the fourth lane.
    #[inline]
    pub(super) fn cells(&self) -> (i32x4, i32x4) {
        (lanes(self.low), lanes(self.last))
    }

    /// From a value to the next in x, y and z, 0 of a constant; and anything.
    #[inline]
    pub(super) fn strides(&self) -> i32x4 {
        lanes(self.strides)
    }

    /// What a look-up in the brick needs of it; 0 stands at `zero`.
    #[inline(always)]
    pub(super) fn open(&self, zero: usize) -> Opened {
        Opened {
            low: lanes(self.low),
            last: cast(lanes(self.last)),
            strides: lanes(self.strides),
            start: self.start(),
            zero,
            row: self.strides[1].into(),
            slab: self.strides[0].into(),
        }
    }
}

/// A brick made ready for look-ups.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opened {
    /// Lowest corner of the box, and 0.
    low: i32x4,
    /// Its last cell from there, and anything.
    last: u32x4,
    /// From a value to the next, and anything.
    strides: i32x4,
    /// Index of the first value.
    start: usize,
    /// Index at which 0 stands.
    zero: usize,
    /// From a value to the next in y.
    row: u32,
    /// From a value to the next in x.
    slab: u32,
}

impl Opened {
    /// The corners of a cell, given by its lowest voxel and 0; at `zero` outside the box.
    #[inline(always)]
    pub(super) fn spot(&self, cell: i32x4) -> Spot {
        let cell: i32x4 = cell & 7;
        // Below the box it is a large number; in the fourth lane 0.
        let from: u32x4 = cast(cell - self.low);
        let inside = from.min(self.last).simd_eq(from).all();
        let pairs: i16x8 = cast(self.strides);
        let [x, y, z, _] = pairs.dot(cast(from)).to_array();
        let index = self.start + (x + y + z) as u32 as usize;
        // What is written as a choice is made a branch, and that would be guessed wrongly.
        Spot {
            start: select_unpredictable(inside, index, self.zero),
            row: select_unpredictable(inside, self.row, 0),
            slab: select_unpredictable(inside, self.slab, 0),
        }
    }
}

/// Three axes and another byte.
fn bytes(v: IVec3, other: u8) -> [u8; 4] {
    let [x, y, z] = v.to_array().map(|c| c as u8);
    [x, y, z, other]
}

/// The axes of a field.
fn axes([x, y, z, _]: [u8; 4]) -> IVec3 {
    IVec3::new(x.into(), y.into(), z.into())
}

/// The bytes of a field.
#[inline(always)]
fn lanes([x, y, z, w]: [u8; 4]) -> i32x4 {
    i32x4::new([x.into(), y.into(), z.into(), w.into()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_of_every_box() {
        let zero = 7;
        for low in 0..8 {
            for size in 2..=9 - low {
                let (low, size) = (IVec3::new(0, low, low), IVec3::new(9, size, size));
                let octants = (low.x + 31 * size.y + 7 * size.z) as u8;
                let place = Place::new(1 << 39, low, size, octants);
                assert_eq!((place.low(), place.size()), (low, size));
                assert_eq!((place.start(), place.octants()), (1 << 39, octants.into()));
                for x in 0..8 {
                    for y in 0..8 {
                        for z in 0..8 {
                            let cell = IVec3::new(x, y, z);
                            let spot = place.open(zero).spot(i32x4::new([x + 8, y - 8, z, 0]));
                            let c = cell - low;
                            if c.cmpge(IVec3::ZERO).all() && (c + 1).cmplt(size).all() {
                                let index = (c.x * size.y + c.y) * size.z + c.z;
                                assert_eq!(spot.start, (1 << 39) + index as usize);
                                assert_eq!(spot.row as i32, size.z);
                                assert_eq!(spot.slab as i32, size.z * size.y);
                            } else {
                                assert_eq!((spot.start, spot.row, spot.slab), (zero, 0, 0));
                            }
                        }
                    }
                }
            }
        }
        for is_zero in [false, true] {
            let place = Place::constant(5, is_zero);
            assert_eq!(place.octants(), if is_zero { 0 } else { 0xff });
            let spot = place.open(zero).spot(i32x4::new([7, 0, 3, 0]));
            assert_eq!((spot.start, spot.row, spot.slab), (5, 0, 0));
        }
    }
}
