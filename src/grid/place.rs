//! Where the values of a brick are stored, and which of them a cell's corners are.
//!
//! ```text
//! stored:   v(c), low <= c < low + size, the least box outside whose cells the field is 0
//! index:    start + x slab + y row + z      (x, y, z) = c - low, row = size.z, slab = size.y row
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

use glam::IVec3;

/// Where the values of a brick are: 40 bits of `start`, three fields of 4 bits for the lowest
/// corner and three for the last cell of the box from there, and a bit for a constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place(u64);

/// The corners of a cell among stored values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// Index of the lowest.
    pub(super) start: usize,
    /// From there to the next in y; in z it is the next value.
    pub(super) row: usize,
    /// From there to the next in x.
    pub(super) slab: usize,
}

/// Bits of the index of the first value.
const START_BITS: u32 = 40;
/// Bit of a constant.
const CONSTANT_BIT: u32 = 63;
/// Highest bit of each field.
const HIGH: u32 = 0x888;

impl Place {
    /// One more than the last index that a value can have: 4 TiB of 32-bit ones.
    pub(super) const END: u64 = 1 << START_BITS;

    /// The values of corners `low` to `low + size`, from index `start` on.
    pub(super) fn new(start: usize, low: IVec3, size: IVec3) -> Self {
        let pack = |v: IVec3| u64::from((v.x << 8 | v.y << 4 | v.z) as u32);
        let last = pack(size - IVec3::splat(2));
        Self(start as u64 | pack(low) << START_BITS | last << (START_BITS + 12))
    }

    /// The constant that stands at `start` and beyond it.
    pub(super) fn constant(start: usize) -> Self {
        let Self(all) = Self::new(start, IVec3::ZERO, IVec3::splat(9));
        Self(all | 1 << CONSTANT_BIT)
    }

    /// True if all values are that at [`Self::start`].
    #[inline]
    pub(super) fn is_constant(self) -> bool {
        self.0 >> CONSTANT_BIT != 0
    }

    /// Index of the first value.
    #[inline]
    pub(super) fn start(self) -> usize {
        (self.0 & (Self::END - 1)) as usize
    }

    /// Lowest corner of the box, 0..8 along each axis.
    pub(super) fn low(self) -> IVec3 {
        unpack(self.low_bits())
    }

    /// Values of the box along each axis, 2..=9.
    pub(super) fn size(self) -> IVec3 {
        unpack(self.last_bits()) + IVec3::splat(2)
    }

    #[inline]
    fn low_bits(self) -> u32 {
        (self.0 >> START_BITS) as u32 & 0xfff
    }

    #[inline]
    fn last_bits(self) -> u32 {
        (self.0 >> (START_BITS + 12)) as u32 & 0x777
    }

    /// The corners of a cell, given by its lowest voxel; at `zero`, where 0 stands, outside the box.
    #[inline]
    pub(super) fn spot(self, [x, y, z]: [i32; 3], zero: usize) -> Spot {
        let cell = ((x & 7) << 8 | (y & 7) << 4 | z & 7) as u32;
        // All three axes at a time: the highest bit of a field stays where none is borrowed.
        let from = (cell | HIGH) - self.low_bits();
        let room = (self.last_bits() | HIGH) - (from & 0x777);
        let inside = from & room & HIGH == HIGH;
        let varies = usize::from(inside & !self.is_constant());
        let last = self.last_bits();
        let row = (last & 7) as usize + 2;
        let slab = ((last >> 4 & 7) as usize + 2) * row;
        let [x, y, z] = [from >> 8 & 7, from >> 4 & 7, from & 7].map(|c| c as usize);
        let start = if inside { self.start() } else { zero };
        Spot {
            start: start + varies * (x * slab + y * row + z),
            row: varies * row,
            slab: varies * slab,
        }
    }
}

/// Three components of four bits.
fn unpack(bits: u32) -> IVec3 {
    let bits = bits as i32;
    IVec3::new(bits >> 8 & 15, bits >> 4 & 15, bits & 15)
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
                let place = Place::new(1 << 33, low, size);
                assert_eq!((place.low(), place.size()), (low, size));
                for x in 0..8 {
                    for y in 0..8 {
                        for z in 0..8 {
                            let cell = IVec3::new(x, y, z);
                            let spot = place.spot((cell + 8).to_array(), zero);
                            let c = cell - low;
                            if c.cmpge(IVec3::ZERO).all() && (c + 1).cmplt(size).all() {
                                let index = (c.x * size.y + c.y) * size.z + c.z;
                                assert_eq!(spot.start, (1 << 33) + index as usize);
                                assert_eq!(spot.row, size.z as usize);
                                assert_eq!(spot.slab, (size.z * size.y) as usize);
                            } else {
                                assert_eq!((spot.start, spot.row, spot.slab), (zero, 0, 0));
                            }
                        }
                    }
                }
            }
        }
        let spot = Place::constant(5).spot([7, 0, 3], zero);
        assert_eq!((spot.start, spot.row, spot.slab), (5, 0, 0));
    }
}
