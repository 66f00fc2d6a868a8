//! Two levels from a brick to what is kept for it: top cells, and tables of their bricks.
//!
//! ```text
//! entry of top cell (brick >> 4)   ->   the merged cell itself, or a table   ->   slot (brick & 15)
//! ```
//!
//! Every brick's entry names the merged cell it is in (merge.rs), so a step is one fetch and no
//! descent, and empty space is crossed in the largest cubes that fit.

use glam::{IVec3, UVec3, Vec3};
use wide::i32x4;

use super::{BRICK, Grid, TABLE, TABLE_BRICKS, in_table, top_cell, top_index};
use crate::ray::Bounds;

/// Marks a link that names a table, not a cell.
pub(super) const DESCEND: u32 = 1 << 31;
/// Bits of any other for the level.
pub(super) const LEVEL: u32 = 0xf;

/// What is kept for a cube of bricks; or, of a top cell, its table.
pub(crate) trait Entry: Copy {
    /// Of an empty brick.
    const NOTHING: Self;

    /// log2 of the cube's edge in bricks in the lowest four bits, or a table.
    fn link(self) -> u32;

    /// Smallest and largest value.
    fn bounds(self) -> [f32; 2];

    /// Lowest and highest corner of the box outside which a brick is empty, from the brick's corner
    /// on, where that is known and not all of it.
    #[inline]
    fn filled(self) -> Option<(i32x4, i32x4)> {
        None
    }

    /// Index of a table.
    #[inline]
    fn table(self) -> Option<usize> {
        let link = self.link();
        (link & DESCEND != 0).then_some((link & !DESCEND) as usize)
    }

    /// log2 of the cube's edge in bricks.
    #[inline]
    fn level(self) -> u32 {
        self.link() & LEVEL
    }

    /// What of a brick's coordinates is that of the lowest brick of the cube: minus its edge.
    #[inline]
    fn mask(self) -> i32x4 {
        i32x4::splat(-1 << self.level())
    }
}

/// Entries of a grid.
#[derive(Debug, Clone)]
pub(super) struct Tables<E> {
    /// Top cells along each axis.
    pub(super) dims: UVec3,
    /// Entries of top cells.
    pub(super) top: Vec<E>,
    /// Entries of the bricks of each table.
    pub(super) bricks: Vec<E>,
    /// Where the field can differ from 0.
    pub(super) support: Bounds,
}

impl<E: Entry> Tables<E> {
    /// The entry of a top cell; none outside the grid.
    #[inline]
    pub(super) fn entry(&self, top: i32x4) -> Option<E> {
        // A negative coordinate is a large one, and outside.
        let [x, y, z, _] = top.to_array().map(|c| c as u32);
        if x >= self.dims.x || y >= self.dims.y || z >= self.dims.z {
            return None;
        }
        self.top
            .get(top_index(self.dims, UVec3::new(x, y, z)))
            .copied()
    }

    /// The entry of the merged cell that a brick of a top cell is in.
    #[inline]
    pub(super) fn entry_in(&self, entry: E, brick: i32x4) -> Option<E> {
        let Some(table) = entry.table() else {
            return Some(entry);
        };
        let [x, y, z, _] = brick.to_array();
        let slot = in_table(IVec3::new(x, y, z));
        self.bricks.get(table * TABLE_BRICKS + slot).copied()
    }

    /// The bricks of a top cell with this entry; none if it has no table.
    #[inline]
    pub(super) fn table(&self, entry: E) -> &[E] {
        entry.table().map_or(&[], |table| {
            self.bricks.get(table * TABLE_BRICKS..).unwrap_or(&[])
        })
    }

    /// Smallest and largest density in the merged cell around a local point.
    pub(super) fn bounds_at(&self, p: Vec3) -> [f32; 2] {
        let [x, y, z] = p.floor().as_ivec3().to_array();
        let brick: i32x4 = i32x4::new([x, y, z, 0]) >> 3;
        self.entry(brick >> 4)
            .and_then(|entry| self.entry_in(entry, brick))
            .map_or([0.0; 2], E::bounds)
    }

    /// Visits the merged cells: corners in local voxels, and the entry.
    pub(super) fn visit(&self, mut visit: impl FnMut(Vec3, Vec3, E)) {
        let corner = |brick: IVec3| (brick * BRICK).as_vec3();
        let mut one = |brick: IVec3, entry: E| {
            let size = 1 << entry.level();
            // A merged cell is named by all of its bricks; its lowest stands for it.
            if brick & IVec3::splat(size - 1) == IVec3::ZERO {
                visit(corner(brick), corner(brick + size), entry);
            }
        };
        for (at, &entry) in self.top.iter().enumerate() {
            let lowest = top_cell(self.dims, at) * TABLE;
            if entry.table().is_none() {
                one(lowest, entry);
            }
            for (slot, &entry) in (0i32..).zip(self.table(entry).iter().take(TABLE_BRICKS)) {
                let brick = lowest + IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15);
                one(brick, entry);
            }
        }
    }

    /// Bytes, as allocated.
    pub(super) fn memory_bytes(&self) -> usize {
        (self.top.capacity() + self.bricks.capacity()) * size_of::<E>()
    }

    /// The most bytes that entries of a grid take: no cells merged.
    pub(super) fn most_bytes(grid: &Grid) -> usize {
        (grid.places.top().len() + grid.places.tables() * TABLE_BRICKS) * size_of::<E>()
    }
}
