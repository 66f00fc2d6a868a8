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

use glam::IVec3;
use wide::i32x4;

/// Where the values of a brick are: 37 bits of `base`, below 0 in the first bricks; three fields of
/// 4 bits for the lowest corner and three for the last cell of the box from there; a bit for a
/// constant; and one for each octant of 4^3 cells, set unless all its values are 0. The octants'
/// are where the others leave room: three behind `base`, five at the heads of fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place(u64);

/// The corners of a cell among stored values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// Index of the lowest.
    pub(super) start: usize,
    /// From there to the next in y; in z it is the next value.
    pub(super) row: u8,
    /// From there to the next in x.
    pub(super) slab: u8,
}

impl Spot {
    /// True if all eight corners are one value.
    #[inline(always)]
    pub(super) fn is_constant(self) -> bool {
        self.row == 0
    }
}

/// Bits of the index of corner (0, 0, 0), stored or not, with its sign.
const BASE_BITS: u32 = 37;
/// Where the fields begin.
const FIELDS: u32 = 40;
/// Bit of a constant: the head of the last field.
const CONSTANT_BIT: u32 = 63;
/// Highest bit of each of three fields.
const HIGH: u32 = 0x888;
/// Bits of a place for each octant, in the order of their numbers: x + 2 y + 4 z.
const OCTANTS: [u32; 8] = [37, 38, 39, 43, 47, 51, 55, 59];
/// All of them.
const ALL_OCTANTS: u64 = 7 << 37 | 0x11111 << 43;

impl Place {
    /// One more than the last index that a value can have: 256 GiB of 32-bit ones.
    pub(super) const END: u64 = 1 << (BASE_BITS - 1);

    /// The values of corners `low` to `low + size`, from index `start` on; which octants are not
    /// empty, bit by bit.
    #[inline]
    pub(super) fn new(start: usize, low: IVec3, size: IVec3, octants: u8) -> Self {
        let pack = |v: IVec3| u64::from((v.x << 8 | v.y << 4 | v.z) as u32);
        let last = pack(size - IVec3::splat(2));
        let base = start as i64 - i64::from((low.x * size.y + low.y) * size.z + low.z);
        let base = base as u64 & ((1 << BASE_BITS) - 1);
        let bit = |(i, at): (usize, &u32)| u64::from(octants >> i & 1) << at;
        let octants: u64 = OCTANTS.iter().enumerate().map(bit).sum();
        Self(base | pack(low) << FIELDS | last << (FIELDS + 12) | octants)
    }

    /// The constant that stands at `start` and beyond it, 0 or not.
    #[inline]
    pub(super) fn constant(start: usize, is_zero: bool) -> Self {
        let last = 0x777 << (FIELDS + 12);
        let octants = if is_zero { 0 } else { ALL_OCTANTS };
        Self(start as u64 | last | octants | 1 << CONSTANT_BIT)
    }

    /// Octants that are not empty, bit by bit.
    #[inline]
    pub(super) fn octants(self) -> u64 {
        let bit = |(i, at): (usize, &u32)| (self.0 >> at & 1) << i;
        OCTANTS.iter().enumerate().map(bit).sum()
    }

    /// True if all values are that at [`Self::start`].
    #[inline]
    pub(super) fn is_constant(self) -> bool {
        self.0 >> CONSTANT_BIT != 0
    }

    /// Index of corner (0, 0, 0), were it stored.
    #[inline(always)]
    pub(super) fn base(self) -> i64 {
        (self.0 << (64 - BASE_BITS)) as i64 >> (64 - BASE_BITS)
    }

    /// Index of the first value.
    #[inline]
    pub(super) fn start(self) -> usize {
        let (low, size) = (self.low(), self.size());
        (self.base() + i64::from((low.x * size.y + low.y) * size.z + low.z)) as usize
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
        (self.0 >> FIELDS) as u32 & 0x777
    }

    #[inline]
    fn last_bits(self) -> u32 {
        (self.0 >> (FIELDS + 12)) as u32 & 0x777
    }

    /// The first of the cells and, from there, the last: of a constant, all of the brick's.
    #[inline]
    pub(super) fn cells(self) -> (i32x4, i32x4) {
        let unpack = |bits: u32| {
            let bits = bits as i32;
            i32x4::new([bits >> 8, bits >> 4 & 15, bits & 15, 0])
        };
        (unpack(self.low_bits()), unpack(self.last_bits()))
    }

    /// From a value to the next in y, x and z; 0 of a constant.
    #[inline]
    pub(super) fn strides(self) -> [i32; 3] {
        let (last, varies) = (self.last_bits() as i32, i32::from(!self.is_constant()));
        let row = ((last & 15) + 2) * varies;
        [row, ((last >> 4 & 15) + 2) * row, varies]
    }

    /// What a look-up in the brick needs of it; 0 stands at `zero`.
    #[inline(always)]
    pub(super) fn open(self, zero: usize) -> Opened {
        let last = self.last_bits();
        let varies = i64::from(!self.is_constant());
        let row = (i64::from(last & 7) + 2) * varies;
        Opened {
            base: self.base(),
            zero: zero as i64,
            row,
            slab: (i64::from(last >> 4 & 7) + 2) * row,
            along: -varies,
            low: self.low_bits(),
            last: last | HIGH,
        }
    }
}

/// A brick made ready for look-ups.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opened {
    /// Index of corner (0, 0, 0), were it stored.
    base: i64,
    /// Index at which 0 stands.
    zero: i64,
    /// From a value to the next in y.
    row: i64,
    /// From a value to the next in x.
    slab: i64,
    /// All bits set, none for a constant.
    along: i64,
    /// Lowest corner of the box, packed.
    low: u32,
    /// Its last cell from there, packed, each field with its highest bit.
    last: u32,
}

impl Opened {
    /// The corners of a cell, given by its lowest voxel; at `zero` outside the box.
    #[inline(always)]
    pub(super) fn spot(&self, cell: [i32; 3]) -> Spot {
        let [x, y, z] = cell.map(|c| c & 7);
        let packed = (x << 8 | y << 4 | z) as u32;
        // All three axes at a time: the highest bit of a field stays where none is borrowed.
        let from = (packed | HIGH).wrapping_sub(self.low);
        let room = self.last - (from & 0x777);
        let inside = from & room & HIGH == HIGH;
        let [x, y, z] = [x, y, z].map(i64::from);
        let index = self.base + x * self.slab + y * self.row + (z & self.along);
        // What is written as a choice is made a branch, and that would be guessed wrongly.
        Spot {
            start: select_unpredictable(inside, index, self.zero) as usize,
            row: select_unpredictable(inside, self.row, 0) as u8,
            slab: select_unpredictable(inside, self.slab, 0) as u8,
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
                let octants = (low.x + 31 * size.y + 7 * size.z) as u8;
                let place = Place::new(1 << 33, low, size, octants);
                assert_eq!((place.low(), place.size()), (low, size));
                assert_eq!((place.start(), place.octants()), (1 << 33, octants.into()));
                for x in 0..8 {
                    for y in 0..8 {
                        for z in 0..8 {
                            let cell = IVec3::new(x, y, z);
                            let spot = place.open(zero).spot((cell + 8).to_array());
                            let c = cell - low;
                            if c.cmpge(IVec3::ZERO).all() && (c + 1).cmplt(size).all() {
                                let index = (c.x * size.y + c.y) * size.z + c.z;
                                assert_eq!(spot.start, (1 << 33) + index as usize);
                                assert_eq!(i32::from(spot.row), size.z);
                                assert_eq!(i32::from(spot.slab), size.z * size.y);
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
            let spot = place.open(zero).spot([7, 0, 3]);
            assert_eq!((spot.start, spot.row, spot.slab), (5, 0, 0));
        }
    }
}
