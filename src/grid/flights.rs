//! Bounds of the field for free flights: larger cells than those of marches, and blocks.
//!
//! ```text
//! f(p) <= majorant(C)   for every p in cell C, faces included
//! ```
//!
//! A null collision is cheap, since the blocks of squeeze.rs decide most, and dearer steps from cell to
//! cell are worth saving: larger cells than a march wants, which lives on stretches of one value.
//! Eight bytes a brick, as flights go anywhere.

use glam::{IVec3, Vec3};
use wide::i32x4;

use super::majorant::Cell;
use super::merge::{Bricks, Merging, Price, merged};
use super::segments::Segments;
use super::squeeze::{Blocks, Squeeze};
use super::tables::{DESCEND, Entry, Tables};
use super::{Grid, TOP_LOG2};
use crate::ray::Ray;

/// Time of a collision, null or real, over that of a step (docs/grid.md). Larger: more steps; smaller:
/// more collisions.
const COLLISION: f64 = 0.2;
/// Marks the link of a cell of one value.
const CONSTANT: u32 = 1 << 30;
/// Bits of a link for the level; what follows names the brick's blocks.
const LEVEL_BITS: u32 = 4;
/// One more than the greatest name that fits: of bricks with 97 GB of values.
const NAMES: u32 = CONSTANT >> LEVEL_BITS;

/// The majorant over one cube of bricks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlightCell {
    majorant: f32,
    /// log2 of the cube's edge in bricks and the number of the brick's blocks, or a table.
    link: u32,
}

impl FlightCell {
    /// Number of the brick's blocks.
    #[inline]
    pub(super) fn blocks(self) -> usize {
        (self.link >> LEVEL_BITS & (NAMES - 1)) as usize
    }

    fn new(cell: Cell, name: u32) -> Self {
        let link = match cell.table() {
            Some(table) => DESCEND | table as u32,
            None => {
                let name = if name < NAMES { name } else { Blocks::OPEN };
                let constant = u32::from(cell.minorant == cell.majorant) * CONSTANT;
                constant | name << LEVEL_BITS | cell.level()
            }
        };
        Self {
            majorant: cell.majorant,
            link,
        }
    }
}

impl Entry for FlightCell {
    const NOTHING: Self = Self {
        majorant: 0.0,
        link: 0,
    };

    #[inline]
    fn link(self) -> u32 {
        self.link
    }

    #[inline]
    fn bounds(self) -> [f32; 2] {
        let minorant = if self.link & CONSTANT == 0 {
            0.0
        } else {
            self.majorant
        };
        [minorant, self.majorant]
    }
}

/// Bounds of a [`Grid`] for free flights, merged for a given extinction.
#[derive(Debug, Clone)]
pub struct FlightGrid {
    tables: Tables<FlightCell>,
    blocks: Blocks,
}

impl FlightGrid {
    /// Bounds of `grid`, cells merged for `sigma_t_scale` [1/m where the density is 1] and
    /// `voxel_size` \[m, the longest edge\].
    #[must_use]
    pub fn new(grid: &Grid, sigma_t_scale: f32, voxel_size: f32) -> Self {
        Self::with(grid, sigma_t_scale, voxel_size, Merging::Hierarchy)
    }

    /// Bounds of `grid` in other cells than the renderer's: what those save is measured by this.
    #[must_use]
    pub fn with(grid: &Grid, sigma_t_scale: f32, voxel_size: f32, merging: Merging) -> Self {
        Self::of(&Bricks::new(grid), sigma_t_scale, voxel_size, merging)
    }

    /// The same of bricks whose bounds are known.
    pub(crate) fn of(
        bricks: &Bricks<'_>,
        sigma_t_scale: f32,
        voxel_size: f32,
        merging: Merging,
    ) -> Self {
        let price = Price {
            sigma_t: f64::from(sigma_t_scale) * f64::from(voxel_size),
            collision: COLLISION,
            residual: false,
        };
        let (cells, kept) = merged(bricks, &price, merging);
        let (blocks, names) = Blocks::new(bricks.grid, &kept);
        // Copied: collected in place they would keep the room of larger cells.
        let top = cells.top.iter().copied();
        let bricks = cells.bricks.iter().copied().zip(names);
        let tables = Tables {
            top: top.map(|cell| FlightCell::new(cell, 0)).collect(),
            bricks: bricks
                .map(|(cell, name)| FlightCell::new(cell, name))
                .collect(),
            dims: cells.dims,
            support: cells.support,
        };
        Self { tables, blocks }
    }

    /// The segments of a local-space ray inside [t0, t1].
    #[inline]
    pub(crate) fn segments(&self, ray: &Ray, t0: f32, t1: f32) -> Segments<'_, FlightCell> {
        Segments::new(&self.tables, ray, [t0, t1])
    }

    /// The blocks around the last one of segments.
    #[inline]
    pub(crate) fn squeeze(&self, segments: &Segments<'_, FlightCell>) -> Squeeze<'_> {
        self.blocks_of(segments.top, segments.entry)
    }

    /// The blocks of a top cell and its entry.
    #[inline]
    fn blocks_of(&self, top: i32x4, entry: FlightCell) -> Squeeze<'_> {
        Squeeze {
            top,
            bricks: self.tables.table(entry),
            blocks: &self.blocks,
        }
    }

    /// Smallest and largest density in the merged cell around a local point, as far as is known.
    #[must_use]
    pub fn bounds_at(&self, p: Vec3) -> [f32; 2] {
        self.tables.bounds_at(p)
    }

    /// Whether `x`, not below 0, is below the value at a local voxel, if the voxel's block can tell.
    #[must_use]
    pub fn is_below(&self, x: f32, voxel: IVec3) -> Option<bool> {
        let voxel = i32x4::new([voxel.x, voxel.y, voxel.z, 0]);
        let top: i32x4 = voxel >> TOP_LOG2 as i32;
        let entry = self.tables.entry(top)?;
        self.blocks_of(top, entry).is_below(x, voxel)
    }

    /// Bytes that the bounds take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.tables.memory_bytes() + self.blocks.memory_bytes()
    }

    /// The most that the bounds of `grid` take, whatever its extinction: no cells merged.
    #[must_use]
    pub fn most_memory_bytes(grid: &Grid) -> usize {
        Tables::<FlightCell>::most_bytes(grid) + Blocks::most_bytes(grid)
    }
}
