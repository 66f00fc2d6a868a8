//! Equal bricks share their storage, and keep of it only what is not 0; the rest is measured.
//!
//! A brick of 9^3 equal values becomes a constant; bricks of the same bits become one, found by a
//! hash and proven by comparison; a brick gives up what lies outside the box of its values that
//! are not 0, one voxel more on either side where the interpolant falls to 0; a table of one
//! constant becomes a constant too. The field stays what it is, bit for bit.

use std::collections::HashMap;

use glam::IVec3;
use rayon::prelude::*;

use super::build::{BuildError, Builder};
use super::index::Index;
use super::place::Place;
use super::places::Places;
use super::values::Values;
use super::{APRON, BRICK, BRICK_VALUES, CONSTANT, Grid, TABLE, TABLE_BRICKS, corner_index};
use crate::ray::Bounds;

/// What a pass over a brick's values finds.
struct Summary {
    range: [f32; 2],
    hash: u64,
    /// Lowest corner and size of the box outside whose cells all values are 0.
    kept: [IVec3; 2],
    octants: u8,
}

/// Range, hash and box of a brick's values.
fn summary(brick: &[f32]) -> Summary {
    let mut range = [f32::MAX, f32::MIN];
    // A multiplicative hash in four lanes, which do not wait for one another.
    const MULTIPLIER: u64 = 0x9e37_79b9_7f4a_7c15;
    let mut lanes = [1u64, 2, 3, 4];
    for four in brick.chunks(4) {
        for (lane, v) in lanes.iter_mut().zip(four) {
            range = [range[0].min(*v), range[1].max(*v)];
            *lane = (lane.rotate_left(23) ^ u64::from(v.to_bits())).wrapping_mul(MULTIPLIER);
        }
    }
    let hash = lanes.into_iter().fold(0u64, |hash, lane| {
        (hash.rotate_left(23) ^ lane).wrapping_mul(MULTIPLIER)
    });
    Summary {
        range,
        hash,
        kept: kept(brick),
        octants: octants(brick),
    }
}

/// Lowest corner and size of the box outside whose cells all values of a brick are 0.
fn kept(brick: &[f32]) -> [IVec3; 2] {
    // Which planes across each axis hold a bit that is not 0 (so that -0 stays).
    let mut planes = [0u32; 3];
    let mut along_z = [0u32; APRON];
    for (row, values) in brick.chunks_exact(APRON).enumerate() {
        let mut any = 0;
        for (all, value) in along_z.iter_mut().zip(values) {
            *all |= value.to_bits();
            any |= value.to_bits();
        }
        if any != 0 {
            planes[0] |= 1 << (row / APRON);
            planes[1] |= 1 << (row % APRON);
        }
    }
    for (z, any) in along_z.into_iter().enumerate() {
        planes[2] |= u32::from(any != 0) << z;
    }
    // Cells on either side of a plane touch it.
    let low = planes.map(|p| (p.trailing_zeros() as i32 - 1).max(0));
    let high = planes.map(|p| (32 - p.leading_zeros() as i32).min(BRICK));
    let low = IVec3::from_array(low);
    [low, IVec3::from_array(high) - low + IVec3::ONE]
}

/// Octants of 4^3 cells whose 5^3 values are not all 0, bit by bit: x + 2 y + 4 z.
fn octants(brick: &[f32]) -> u8 {
    // Low, high or, in the middle, both.
    let sides = |at: usize| u8::from(at <= APRON / 2) | u8::from(at >= APRON / 2) << 1;
    let mut octants = 0;
    for (row, values) in brick.chunks_exact(APRON).enumerate() {
        let (x, y) = (sides(row / APRON), sides(row % APRON));
        let any = |values: &[f32]| values.iter().fold(0, |all, v| all | v.to_bits()) != 0;
        // Both sides in x for each side in y.
        let column = (x * (y & 1)) | ((x * (y >> 1)) << 2);
        octants |= u8::from(any(&values[..=APRON / 2])) * column;
        octants |= (u8::from(any(&values[APRON / 2..])) * column) << 4;
    }
    octants
}

/// True if two bricks have the same bits.
fn same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl Builder {
    /// The finished grid: constants and equal bricks give their storage back.
    pub(super) fn finish(mut self) -> Result<Grid, BuildError> {
        let summaries: Vec<Summary> = self.values.par_chunks(BRICK_VALUES).map(summary).collect();
        let mut renamed = Vec::with_capacity(summaries.len());
        // Two different bricks of one hash are kept apart: the second is just not shared.
        let mut known: HashMap<u64, (usize, u32)> = HashMap::with_capacity(summaries.len());
        let mut own = Vec::new();
        for (index, Summary { range, hash, .. }) in summaries.iter().enumerate() {
            let [lo, hi] = *range;
            if lo == hi {
                renamed.push(self.index.constant(lo));
                continue;
            }
            let next = own.len() as u32;
            let (first, name) = *known.entry(*hash).or_insert((index, next));
            let of = |index: usize| &self.values[index * BRICK_VALUES..][..BRICK_VALUES];
            if first < index && same(of(first), of(index)) {
                renamed.push(name);
                continue;
            }
            renamed.push(next);
            own.push(index);
        }
        let own = self.pack(&own, &summaries)?;
        self.index
            .tables
            .par_iter_mut()
            .filter(|entry| **entry & CONSTANT == 0)
            .for_each(|entry| {
                *entry = renamed[*entry as usize];
            });
        self.index.dissolve_tables();
        let extent = extent(&self.index, &own);

        let constants = self.values.len();
        let each = self.index.constants.iter();
        self.values.reserve_exact(2 * each.len());
        self.values.extend(each.flat_map(|value| [*value; 2]));
        self.values.shrink_to_fit();
        let numbers = 0..self.index.constants.len();
        let constants: Vec<Place> = numbers
            .map(|number| Place::constant(constants + 2 * number, number == 0))
            .collect();
        let places = Places::new(
            self.index.dims,
            self.index.top,
            self.index.tables,
            own.iter().map(|brick| brick.place).collect(),
            constants,
            &extent.support,
        );
        Ok(Grid {
            origin: self.index.origin,
            places,
            values: Values::new(self.values),
            bricks: own.len(),
            support: extent.support,
            range: extent.range,
            index_to_world: self.index_to_world,
        })
    }

    /// Moves the boxes of the bricks that are kept together.
    fn pack(&mut self, own: &[usize], summaries: &[Summary]) -> Result<Vec<Packed>, BuildError> {
        let mut end = 0;
        let mut packed = Vec::with_capacity(own.len());
        for &index in own {
            let Summary {
                range,
                kept: [low, size],
                octants,
                ..
            } = summaries[index];
            packed.push(Packed {
                range,
                place: Place::new(end, low, size, octants),
            });
            for x in low.x..low.x + size.x {
                for y in low.y..low.y + size.y {
                    let from = index * BRICK_VALUES + corner_index(IVec3::new(x, y, low.z));
                    let row = size.z as usize;
                    self.values.copy_within(from..from + row, end);
                    end += row;
                }
            }
        }
        // Constants follow.
        if (end + 2 * self.index.constants.len()) as u64 >= Place::END {
            return Err(BuildError::TooManyBricks { bricks: own.len() });
        }
        self.values.truncate(end);
        Ok(packed)
    }
}

/// A brick whose values have found their place.
struct Packed {
    /// Smallest and largest value.
    range: [f32; 2],
    place: Place,
}

/// Support and range of the field.
fn extent(index: &Index, own: &[Packed]) -> Extent {
    let tables: Vec<Extent> = index
        .tables
        .par_chunks(TABLE_BRICKS)
        .map(|table| table_extent(index, own, table))
        .collect();
    let whole = Bounds {
        min: IVec3::ZERO.as_vec3(),
        max: IVec3::splat(TABLE * BRICK).as_vec3(),
    };
    (0..index.top.len())
        .into_par_iter()
        .map(|at| {
            let entry = index.top[at];
            let extent = match index.constant_value(entry) {
                None => tables[entry as usize],
                Some(0.0) => Extent::NONE,
                Some(value) => Extent::new(whole, [value; 2]),
            };
            let corner = (index.top_cell(at) * TABLE * BRICK).as_vec3();
            Extent {
                support: Bounds {
                    min: extent.support.min + corner,
                    max: extent.support.max + corner,
                },
                ..extent
            }
        })
        .reduce(|| Extent::NONE, |a, b| a.merge(&b))
}

/// Where a field differs from 0, and how much.
#[derive(Debug, Clone, Copy)]
struct Extent {
    support: Bounds,
    /// Smallest and largest value, 0 included.
    range: [f32; 2],
}

impl Extent {
    const NONE: Self = Self {
        support: Bounds::EMPTY,
        range: [0.0; 2],
    };

    fn new(support: Bounds, [lo, hi]: [f32; 2]) -> Self {
        Self {
            support,
            range: [lo.min(0.0), hi.max(0.0)],
        }
    }

    fn merge(&self, other: &Self) -> Self {
        Self {
            support: self.support.union(&other.support),
            range: [
                self.range[0].min(other.range[0]),
                self.range[1].max(other.range[1]),
            ],
        }
    }
}

/// Support and range of the field in one table, from its corner.
fn table_extent(index: &Index, own: &[Packed], table: &[u32]) -> Extent {
    let mut extent = Extent::NONE;
    for (slot, &entry) in (0i32..).zip(table) {
        let (low, high, range) = match index.constant_value(entry) {
            Some(0.0) => continue,
            Some(value) => (IVec3::ZERO, IVec3::splat(BRICK), [value; 2]),
            None => {
                let Packed { range, place } = own[entry as usize];
                let low = place.low();
                (low, low + place.size() - IVec3::ONE, range)
            }
        };
        let corner = IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15) * BRICK;
        let support = Bounds {
            min: (corner + low).as_vec3(),
            max: (corner + high).as_vec3(),
        };
        extent = extent.merge(&Extent::new(support, range));
    }
    extent
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A value belongs to the octants whose cells touch it.
    #[test]
    fn octants_of_single_values() {
        for index in 0..BRICK_VALUES {
            let mut brick = [0.0; BRICK_VALUES];
            brick[index] = 1.0;
            let at = [index / 81, index / 9 % 9, index % 9];
            let touched = (0..8).filter(|octant| {
                let first = [0, 1, 2].map(|axis| 4 * (octant >> axis & 1));
                at.iter()
                    .zip(first)
                    .all(|(at, first)| (first..=first + 4).contains(at))
            });
            let expected: u8 = touched.map(|octant| 1 << octant).sum();
            assert_eq!(octants(&brick), expected, "value {at:?}");
        }
    }
}
