//! Equal bricks share their storage; what is left is measured.
//!
//! A brick of 9^3 equal values becomes a constant; bricks of the same bits become one, found by a
//! hash and proven by comparison; a table of one constant becomes a constant too. The field stays
//! what it is, bit for bit.

use std::collections::HashMap;

use glam::IVec3;
use rayon::prelude::*;

use super::build::Builder;
use super::{BRICK, BRICK_VALUES, CONSTANT, Grid, TABLE, TABLE_BRICKS, corner_index};
use crate::ray::Bounds;

/// What a pass over a brick's values finds.
struct Summary {
    range: [f32; 2],
    hash: u64,
}

/// Range and hash of a brick's values.
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
    Summary { range, hash }
}

/// True if two bricks have the same bits.
fn same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl Builder {
    /// Constants and equal bricks give their storage back; ranges, support.
    pub(super) fn compact(&mut self) {
        let summaries: Vec<Summary> = self.values.par_chunks(BRICK_VALUES).map(summary).collect();
        let mut renamed = Vec::with_capacity(summaries.len());
        // Two different bricks of one hash are kept apart: the second is just not shared.
        let mut known: HashMap<u64, u32> = HashMap::with_capacity(summaries.len());
        let mut kept = 0;
        for (index, Summary { range, hash }) in summaries.into_iter().enumerate() {
            let [lo, hi] = range;
            if lo == hi {
                renamed.push(self.constant(lo));
                continue;
            }
            let from = index * BRICK_VALUES;
            let values = &mut self.values;
            let first = *known.entry(hash).or_insert(kept);
            if first < kept {
                let at = first as usize * BRICK_VALUES;
                if same(
                    &values[at..at + BRICK_VALUES],
                    &values[from..from + BRICK_VALUES],
                ) {
                    renamed.push(first);
                    continue;
                }
            }
            values.copy_within(from..from + BRICK_VALUES, kept as usize * BRICK_VALUES);
            self.grid.ranges.push(range);
            renamed.push(kept);
            kept += 1;
        }
        self.values.truncate(kept as usize * BRICK_VALUES);
        self.values.shrink_to_fit();
        self.grid.ranges.shrink_to_fit();
        self.grid.constants.shrink_to_fit();
        self.grid
            .tables
            .par_iter_mut()
            .filter(|entry| **entry & CONSTANT == 0)
            .for_each(|entry| {
                *entry = renamed[*entry as usize];
            });
        self.dissolve_tables();
        self.measure();
    }

    /// Tables of one constant become that constant.
    fn dissolve_tables(&mut self) {
        let grid = &mut self.grid;
        let value = |entry: u32| {
            let constant = entry & CONSTANT != 0;
            constant.then(|| grid.constants[(entry & !CONSTANT) as usize].to_bits())
        };
        let mut renamed = Vec::with_capacity(grid.tables.len() / TABLE_BRICKS);
        let mut kept = 0;
        for index in 0..grid.tables.len() / TABLE_BRICKS {
            let from = index * TABLE_BRICKS;
            let table = &grid.tables[from..from + TABLE_BRICKS];
            let first = value(table[0]);
            if first.is_some() && table.iter().all(|entry| value(*entry) == first) {
                renamed.push(table[0]);
                continue;
            }
            grid.tables
                .copy_within(from..from + TABLE_BRICKS, kept * TABLE_BRICKS);
            renamed.push(kept as u32);
            kept += 1;
        }
        grid.tables.truncate(kept * TABLE_BRICKS);
        grid.tables.shrink_to_fit();
        for entry in grid.top.iter_mut().filter(|e| **e & CONSTANT == 0) {
            *entry = renamed[*entry as usize];
        }
    }

    /// Support and range of the field.
    fn measure(&mut self) {
        let grid = &self.grid;
        let tables: Vec<Extent> = grid
            .tables
            .par_chunks(TABLE_BRICKS)
            .map(|table| table_extent(grid, &self.values, table))
            .collect();
        let whole = Bounds {
            min: IVec3::ZERO.as_vec3(),
            max: IVec3::splat(TABLE * BRICK).as_vec3(),
        };
        let extent = (0..grid.top.len())
            .into_par_iter()
            .map(|at| {
                let entry = grid.top[at];
                let extent = if entry & CONSTANT == 0 {
                    tables[entry as usize]
                } else {
                    let value = grid.constants[(entry & !CONSTANT) as usize];
                    let support = if value == 0.0 { Bounds::EMPTY } else { whole };
                    Extent::new(support, [value; 2])
                };
                let corner = (grid.top_cell(at) * TABLE * BRICK).as_vec3();
                Extent {
                    support: Bounds {
                        min: extent.support.min + corner,
                        max: extent.support.max + corner,
                    },
                    ..extent
                }
            })
            .reduce(|| Extent::NONE, |a, b| a.merge(&b));
        self.grid.support = extent.support;
        self.grid.range = extent.range;
    }
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
fn table_extent(grid: &Grid, values: &[f32], table: &[u32]) -> Extent {
    let mut extent = Extent::NONE;
    for (slot, &entry) in table.iter().enumerate() {
        let [lo, hi] = grid.entry_range(entry);
        if lo == 0.0 && hi == 0.0 {
            continue;
        }
        let slot = slot as i32;
        let corner = IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15) * BRICK;
        let (mut low, mut high) = (IVec3::ZERO, IVec3::splat(BRICK));
        if entry & CONSTANT == 0 {
            let start = entry as usize * BRICK_VALUES;
            let values = &values[start..start + BRICK_VALUES];
            let mut voxels = (IVec3::MAX, IVec3::MIN);
            for x in 0..=BRICK {
                for y in 0..=BRICK {
                    for z in 0..=BRICK {
                        let v = IVec3::new(x, y, z);
                        if values[corner_index(v)] != 0.0 {
                            voxels = (voxels.0.min(v), voxels.1.max(v));
                        }
                    }
                }
            }
            // The interpolant reaches one voxel beyond, and this brick holds the cells from its
            // corner on.
            low = (voxels.0 - IVec3::ONE).max(low);
            high = (voxels.1 + IVec3::ONE).min(high);
        }
        let support = Bounds {
            min: (corner + low).as_vec3(),
            max: (corner + high).as_vec3(),
        };
        extent = extent.merge(&Extent::new(support, [lo, hi]));
    }
    extent
}
