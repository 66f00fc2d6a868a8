//! Bounds of the field, cell by cell.
//!
//! ```text
//! minorant(C) <= f(p) <= majorant(C)   for every p in cell C, faces included
//! ```
//!
//! The bounds are those of the *interpolated* field: a brick's 9^3 values are all that its cells
//! can interpolate between, so their extremes bound it exactly. Cells are cubes of 8, 16, 32 ...
//! voxels (merge.rs). Every brick's entry names the merged cell it is in, so a step is one fetch
//! and no descent, and empty space is crossed in the largest cubes that fit. A brick by itself
//! is empty outside the box of its values (place.rs): a ray meets its bounds only inside. Rays meet
//! cells in segments.rs.

use glam::{IVec3, UVec3, Vec3};
use wide::i32x4;

use super::place::Place;
use super::{BRICK, Grid, TABLE, TABLE_BRICKS, in_table, top_cell, top_index};
use crate::ray::Bounds;

/// Marks an entry that names a table, not a cell.
pub(super) const DESCEND: u32 = 1 << 31;

/// Bounds over one cube of bricks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// Largest value.
    pub(super) majorant: f32,
    /// Smallest value.
    pub(super) minorant: f32,
    /// log2 of the cube's edge in bricks and the box of its values, or a table.
    pub(super) link: u32,
}

/// Bits of a link for the level.
const LEVEL: u32 = 0xf;
/// Marks the link of a brick of which only a box is not empty; the box follows the level.
const BOXED: u32 = 1 << 30;
/// Marks that of a boxed brick whose box costs a flight more than it saves (merge.rs).
const LOOSE: u32 = 1 << 29;

impl Cell {
    /// Empty.
    pub(super) const NOTHING: Self = Self {
        majorant: 0.0,
        minorant: 0.0,
        link: 0,
    };

    /// log2 of the cube's edge in bricks.
    #[inline]
    pub(super) fn level(self) -> u32 {
        self.link & LEVEL
    }

    /// What of a brick's coordinates is that of the lowest brick of the cube: minus its edge.
    #[inline]
    pub(super) fn mask(self) -> i32x4 {
        i32x4::splat(-1 << self.level())
    }

    /// The link of a brick that is empty outside the cells of a place's box.
    pub(super) fn brick_link(place: Place) -> u32 {
        let (low, cells) = (place.low(), place.size() - IVec3::ONE);
        if cells == IVec3::splat(BRICK) {
            return 0;
        }
        let pack = |v: IVec3| (v.x << 8 | v.y << 4 | v.z) as u32;
        BOXED | pack(low) << 4 | pack(cells) << 16
    }

    /// True for a brick of which only a box is not empty.
    #[inline]
    pub(super) fn is_boxed(self) -> bool {
        self.link & BOXED != 0
    }

    /// True for one whose box saves a flight more than it costs.
    #[inline]
    pub(super) fn is_tight(self) -> bool {
        self.link & (BOXED | LOOSE) == BOXED
    }

    /// Cells in a boxed brick's box, or in a brick.
    pub(super) fn filled_cells(self) -> i32 {
        let field = |shift: u32| (self.link >> shift & 0xf) as i32;
        if self.is_boxed() {
            field(16) * field(20) * field(24)
        } else {
            BRICK * BRICK * BRICK
        }
    }

    /// The same cell, its box for marches only.
    pub(super) fn loosened(self) -> Self {
        Self {
            link: self.link | LOOSE,
            ..self
        }
    }

    /// Lowest and highest corner of a boxed brick's box, from the brick's corner on.
    #[inline]
    pub(super) fn filled(self) -> (i32x4, i32x4) {
        let field = |shift: u32| (self.link >> shift & 0xf) as i32;
        let at = |shift| i32x4::new([field(shift + 8), field(shift + 4), field(shift), 0]);
        (at(4), at(4) + at(16))
    }
}

/// Bounds of a [`Grid`], merged for a given extinction.
#[derive(Debug, Clone)]
pub struct MajorantGrid {
    /// Top cells along each axis.
    pub(super) dims: UVec3,
    /// Bounds of top cells.
    pub(super) top: Vec<Cell>,
    /// Bounds of the bricks of each table.
    pub(super) tables: Vec<Cell>,
    /// Where the field can differ from 0.
    pub(super) support: Bounds,
}

impl MajorantGrid {
    /// The merged cell that a brick is in; none outside the grid.
    #[inline]
    pub(super) fn cell(&self, brick: i32x4) -> Option<Cell> {
        self.cell_in(self.entry(brick >> 4)?, brick)
    }

    /// The entry of a top cell; none outside the grid.
    #[inline]
    pub(super) fn entry(&self, top: i32x4) -> Option<Cell> {
        // A negative coordinate is a large one, and outside.
        let [x, y, z, _] = top.to_array().map(|c| c as u32);
        if x >= self.dims.x || y >= self.dims.y || z >= self.dims.z {
            return None;
        }
        self.top
            .get(top_index(self.dims, UVec3::new(x, y, z)))
            .copied()
    }

    /// The merged cell that a brick of a top cell is in.
    #[inline]
    pub(super) fn cell_in(&self, entry: Cell, brick: i32x4) -> Option<Cell> {
        if entry.link & DESCEND == 0 {
            return Some(entry);
        }
        let [x, y, z, _] = brick.to_array();
        let table = (entry.link & !DESCEND) as usize;
        let slot = in_table(IVec3::new(x, y, z));
        self.tables.get(table * TABLE_BRICKS + slot).copied()
    }

    /// Smallest and largest density in the merged cell around a local point.
    #[must_use]
    pub fn bounds_at(&self, p: Vec3) -> [f32; 2] {
        let [x, y, z] = p.floor().as_ivec3().to_array();
        self.cell(i32x4::new([x, y, z, 0]) >> 3)
            .map_or([0.0; 2], |c| [c.minorant, c.majorant])
    }

    /// Largest density of the grid.
    #[must_use]
    pub fn highest(&self) -> f32 {
        let all = self.top.iter().filter(|c| c.link & DESCEND == 0);
        all.chain(&self.tables).fold(0.0, |m, c| m.max(c.majorant))
    }

    /// Visits the merged cells that are not empty: corners in local voxels, and the largest
    /// density.
    pub fn visit_cells(&self, mut visit: impl FnMut(Vec3, Vec3, f32)) {
        let corner = |brick: IVec3| (brick * BRICK).as_vec3();
        let mut one = |brick: IVec3, cell: Cell| {
            let size = 1 << cell.level();
            // A merged cell is named by all of its bricks; its lowest stands for it.
            if cell.majorant > 0.0 && brick & IVec3::splat(size - 1) == IVec3::ZERO {
                visit(corner(brick), corner(brick + size), cell.majorant);
            }
        };
        for (at, cell) in self.top.iter().enumerate() {
            let lowest = top_cell(self.dims, at) * TABLE;
            if cell.link & DESCEND == 0 {
                one(lowest, *cell);
                continue;
            }
            let first = (cell.link & !DESCEND) as usize * TABLE_BRICKS;
            let table = &self.tables[first..first + TABLE_BRICKS];
            for (slot, cell) in (0i32..).zip(table) {
                let brick = lowest + IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15);
                one(brick, *cell);
            }
        }
    }

    /// Bytes that the bounds take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        (self.top.capacity() + self.tables.capacity()) * size_of::<Cell>()
    }

    /// The most that the bounds of `grid` take, whatever its extinction: no cells merged.
    #[must_use]
    pub fn most_memory_bytes(grid: &Grid) -> usize {
        (grid.top.len() + grid.tables.len()) * size_of::<Cell>()
    }
}
