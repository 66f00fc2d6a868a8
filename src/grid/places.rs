//! From a brick to the place of its values.
//!
//! ```text
//! flat         places[(brick - first) . strides]       of the box of all bricks that are not empty
//! two levels   top cell (brick >> 4)   ->   a constant, or a table   ->   slot (brick & 15)   ->   place
//! ```
//!
//! Flat where the box has no more bricks than tables have slots: nearly everywhere but in large, sparse
//! fields. It is one fetch in place of three (docs/grid.md has what that is worth). A sparse 2000^3 field
//! has two levels, with 4096 entries at the top and 16 kB for each 128^3 voxels that hold any.
//!
//! Top cells are OpenVDB's lower internal nodes: constant ones are its tiles. Bounds are kept by
//! table and slot (tables.rs) whatever the places are.

use bytemuck::cast;
use glam::{IVec3, UVec3};
use rayon::prelude::*;
use wide::{i16x8, i32x4, u32x4};

use super::place::Place;
use super::{BRICK, CONSTANT, TABLE, TABLE_BRICKS, TOP_LOG2, in_table, three, top_cell, top_index};
use crate::ray::Bounds;

/// The places of a grid's bricks.
#[derive(Debug, Clone)]
pub(super) struct Places {
    /// Top cells along each axis.
    dims: UVec3,
    /// Entry of each top cell: a table, or a constant.
    top: Vec<u32>,
    /// Tables, counted.
    tables: usize,
    /// Of constants; the first is 0.
    constants: Vec<Place>,
    /// That one.
    zero: Place,
    index: Index,
}

/// Where the place of a brick is.
#[derive(Debug, Clone)]
enum Index {
    Flat(Flat),
    Levels(Levels),
}

/// A box of bricks.
#[derive(Debug, Clone)]
struct Flat {
    /// The lowest, and 0.
    first: i32x4,
    /// The highest from there, and 0.
    last: u32x4,
    /// Places from a brick to the next on each axis, and 0. Below 2^15, as coordinates are.
    strides: i32x4,
    /// Of its bricks.
    places: Vec<Place>,
    /// For each table a top cell that has it.
    cells: Vec<u32>,
}

/// Tables of bricks.
#[derive(Debug, Clone)]
struct Levels {
    /// Numbers of the bricks of each table.
    slots: Vec<u32>,
    /// Of bricks, each once.
    places: Vec<Place>,
}

impl Levels {
    #[inline(always)]
    fn place(&self, slot: usize) -> &Place {
        &self.places[self.slots[slot] as usize]
    }
}

impl Flat {
    /// The box around the bricks that a support touches; none if it would take more than `most` places.
    fn around(support: &Bounds, most: usize) -> Option<Self> {
        if support.min.cmpge(support.max).any() {
            return None;
        }
        let first = support.min.floor().as_ivec3() >> 3i32;
        let dims = ((support.max.ceil().as_ivec3() + (BRICK - 1)) >> 3i32) - first;
        let places = dims.as_u64vec3().element_product();
        let short = |count: i32| count <= i32::from(i16::MAX);
        let strides = IVec3::new(dims.y.saturating_mul(dims.z), dims.z, 1);
        (places <= most as u64 && short(dims.x) && short(strides.x)).then(|| Self {
            first: lanes(first),
            last: cast(lanes(dims - 1)),
            strides: lanes(strides),
            places: Vec::with_capacity(places as usize),
            cells: Vec::new(),
        })
    }

    /// Index of a brick; none outside.
    #[inline(always)]
    fn index(&self, brick: i32x4) -> Option<usize> {
        // Below the first it is a large number, and outside.
        let from: u32x4 = cast(brick - self.first);
        let inside = from.min(self.last).simd_eq(from).all();
        // Coordinates and strides fit the lower halves of their lanes: one instruction, where products of 32
        // bits are slow. Outside it is anything.
        let [from, strides]: [i16x8; 2] = [cast(from), cast(self.strides)];
        let [x, y, z, _] = from.dot(strides).to_array();
        inside.then_some((x + y + z) as u32 as usize)
    }
}

/// Three axes, and 0.
fn lanes(v: IVec3) -> i32x4 {
    i32x4::new([v.x, v.y, v.z, 0])
}

impl Places {
    /// Of the top cells of a grid and the slots of its tables, each a brick's number or a constant's; it is
    /// 0 outside `support`.
    pub(super) fn new(
        dims: UVec3,
        top: Vec<u32>,
        mut slots: Vec<u32>,
        bricks: Vec<Place>,
        constants: Vec<Place>,
        support: &Bounds,
    ) -> Self {
        slots.shrink_to_fit();
        let first = bricks.len() as u32;
        slots
            .par_iter_mut()
            .filter(|slot| **slot & CONSTANT != 0)
            .for_each(|slot| *slot = first + (*slot & !CONSTANT));
        let flat = Flat::around(support, slots.len());
        let mut this = Self {
            dims,
            top,
            tables: slots.len() / TABLE_BRICKS,
            zero: constants[0],
            index: Index::Levels(Levels {
                slots,
                places: [&bricks[..], &constants].concat(),
            }),
            constants,
        };
        if let Some(flat) = flat {
            this.index = Index::Flat(this.flattened(flat));
        }
        this
    }

    /// The places of a box in a row.
    fn flattened(&self, mut flat: Flat) -> Flat {
        let [first, last] = [flat.first, cast(flat.last)].map(|v| IVec3::from_array(three(v)));
        for x in 0..=last.x {
            for y in 0..=last.y {
                for z in 0..=last.z {
                    let brick = first + IVec3::new(x, y, z);
                    flat.places.push(*self.of_brick(brick));
                }
            }
        }
        flat.cells = vec![0; self.tables];
        for (cell, &entry) in (0..).zip(&self.top) {
            if entry & CONSTANT == 0 {
                flat.cells[entry as usize] = cell;
            }
        }
        flat
    }

    /// The same in two levels: to measure against.
    pub(super) fn in_two_levels(&self) -> Self {
        let tables = (0..self.tables).map(|number| self.table(number));
        let all = tables.collect::<Vec<_>>().concat();
        let mut places = all.clone();
        places.sort_unstable();
        places.dedup();
        let number = |place| places.partition_point(|other| other < place) as u32;
        let slots = all.iter().map(number).collect();
        Self {
            index: Index::Levels(Levels { slots, places }),
            ..self.clone()
        }
    }

    /// Top cells along each axis.
    pub(super) fn dims(&self) -> UVec3 {
        self.dims
    }

    /// Entries of top cells: a table's number, or a constant.
    pub(super) fn top(&self) -> &[u32] {
        &self.top
    }

    /// Tables of bricks.
    pub(super) fn tables(&self) -> usize {
        self.tables
    }

    /// Index at which 0 stands.
    #[inline(always)]
    pub(super) fn zero(&self) -> usize {
        self.zero.start()
    }

    /// Place of the value of a top cell that is a constant, by its entry.
    #[inline(always)]
    pub(super) fn constant(&self, entry: u32) -> Option<&Place> {
        (entry & CONSTANT != 0).then(|| &self.constants[(entry & !CONSTANT) as usize])
    }

    /// Places of a table's bricks, by its number.
    pub(super) fn table(&self, number: usize) -> Vec<Place> {
        let each = 0..TABLE_BRICKS;
        match &self.index {
            Index::Levels(levels) => {
                let place = |slot| *levels.place(number * TABLE_BRICKS + slot);
                each.map(place).collect()
            }
            Index::Flat(flat) => {
                let corner = top_cell(self.dims, flat.cells[number] as usize) * TABLE;
                let place = |slot: usize| {
                    let slot = slot as i32;
                    *self.of_brick(corner + IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15))
                };
                each.map(place).collect()
            }
        }
    }

    /// Place of a brick.
    #[inline]
    pub(super) fn of_brick(&self, brick: IVec3) -> &Place {
        self.at(lanes(brick * BRICK))
    }

    /// Place of the brick around a voxel.
    #[inline(always)]
    pub(super) fn at(&self, voxel: i32x4) -> &Place {
        match &self.index {
            Index::Flat(flat) => match flat.index(voxel >> BRICK.ilog2() as i32) {
                Some(index) => &flat.places[index],
                None => &self.zero,
            },
            Index::Levels(levels) => self.in_tables(levels, three(voxel)),
        }
    }

    #[inline(always)]
    fn in_tables<'a>(&'a self, levels: &'a Levels, voxel: [i32; 3]) -> &'a Place {
        // A negative coordinate is a large one, and outside.
        let [x, y, z] = voxel.map(|c| (c >> TOP_LOG2) as u32);
        if x >= self.dims.x || y >= self.dims.y || z >= self.dims.z {
            return &self.zero;
        }
        let entry = self.top[top_index(self.dims, UVec3::new(x, y, z))];
        if let Some(place) = self.constant(entry) {
            return place;
        }
        let brick = IVec3::from_array(voxel) >> BRICK.ilog2() as i32;
        levels.place(entry as usize * TABLE_BRICKS + in_table(brick))
    }

    /// Bytes, as allocated.
    pub(super) fn memory_bytes(&self) -> usize {
        let (numbers, places) = match &self.index {
            Index::Flat(flat) => (flat.cells.capacity(), flat.places.capacity()),
            Index::Levels(levels) => (levels.slots.capacity(), levels.places.capacity()),
        };
        (self.top.capacity() + numbers) * size_of::<u32>()
            + (places + self.constants.capacity()) * size_of::<Place>()
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::grid::Grid;

    /// A grid with a ball of voxels at each of some places, 1 and 0.5 by turns.
    fn balls(centres: &[IVec3]) -> Grid {
        let low = centres.iter().copied().fold(IVec3::MAX, IVec3::min) - 12;
        let high = centres.iter().copied().fold(IVec3::MIN, IVec3::max) + 12;
        let near = |c: IVec3, at: IVec3| (c - at).as_vec3().length() < 9.5;
        let value = |c: IVec3| {
            let at = centres.iter().position(|&at| near(c, at));
            at.map_or(0.0, |at| 1.0 / (1 + at % 2) as f32)
        };
        Grid::from_fn(low, high, DAffine3::IDENTITY, value).expect("a grid of balls")
    }

    /// Each brick in and around a grid is at the same place whatever its index.
    fn indices_agree(grid: &Grid) {
        let places = &grid.places;
        let levels = places.in_two_levels();
        assert!(matches!(levels.index, Index::Levels(_)));
        let bricks = places.dims().as_ivec3() * TABLE;
        for x in -2..bricks.x + 2 {
            for y in -2..bricks.y + 2 {
                for z in -2..bricks.z + 2 {
                    let brick = IVec3::new(x, y, z);
                    assert_eq!(places.of_brick(brick), levels.of_brick(brick), "{brick}");
                }
            }
        }
        for number in 0..places.tables() {
            assert_eq!(places.table(number), levels.table(number));
        }
        for far in [i32::MIN, -1 << 20, 1 << 20, i32::MAX] {
            assert_eq!(places.at(lanes(IVec3::new(9, 9, far))), &places.zero);
        }
    }

    #[test]
    fn flat_where_that_is_small() {
        let grid = balls(&[IVec3::splat(-30), IVec3::new(60, 20, 100)]);
        assert!(matches!(grid.places.index, Index::Flat(_)));
        let levels = grid.places.in_two_levels();
        assert!(grid.places.memory_bytes() < levels.memory_bytes());
        indices_agree(&grid);
    }

    #[test]
    fn two_levels_where_the_box_is_mostly_empty() {
        let grid = balls(&[IVec3::ZERO, IVec3::new(500, 300, 400)]);
        assert!(matches!(grid.places.index, Index::Levels(_)));
        indices_agree(&grid);
    }

    #[test]
    fn nothing_is_nowhere() {
        let grid = Grid::from_fn(IVec3::ZERO, IVec3::ONE, DAffine3::IDENTITY, |_| 0.0);
        let grid = grid.expect("an empty grid");
        indices_agree(&grid);
        assert_eq!(grid.lookup(glam::Vec3::ONE), 0.0);
    }
}
