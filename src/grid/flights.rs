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
use wide::{i32x4, i32x8};

use super::majorant::Cell;
use super::merge::{Bricks, Merging, Price, merged};
use super::segments::Segments;
use super::squeeze::{Blocks, Squeeze, Verdict};
use super::tables::{DESCEND, Entry, LEVEL, Tables};
use super::{Grid, TABLE_BRICKS, TOP_LOG2};
use crate::ray::Ray;

/// Time of a collision, null or real, over that of a step (docs/grid.md). Larger: more steps; smaller:
/// more collisions.
const COLLISION: f64 = 0.4;
/// Marks the link of a cell of one value.
const CONSTANT: u32 = 1 << 30;
/// Bits of a link for the level; what follows names the brick's blocks.
const LEVEL_BITS: u32 = 4;
/// One more than the greatest name that fits: of bricks with 97 GB of values.
const NAMES: u32 = CONSTANT >> LEVEL_BITS;

/// The majorant over one cube of bricks.
///
/// One word: in the lower half the majorant, in the upper log2 of the cube's edge in bricks and the number of the
/// brick's blocks, or a table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlightCell(pub(super) u64);

impl FlightCell {
    #[inline]
    fn majorant(self) -> f32 {
        f32::from_bits(self.0 as u32)
    }

    /// Lanes with links of cells of one value.
    #[inline(always)]
    pub(super) fn constants(links: i32x8) -> i32x8 {
        (links << CONSTANT.leading_zeros()) >> 31u32
    }

    /// log2 of the cubes' edges in bricks, by their links.
    #[inline(always)]
    pub(super) fn levels(links: i32x8) -> i32x8 {
        links & i32x8::splat(LEVEL as i32)
    }

    /// Numbers of the bricks' blocks, by links.
    #[inline(always)]
    pub(super) fn names(links: i32x8) -> i32x8 {
        (links >> LEVEL_BITS) & i32x8::splat(NAMES as i32 - 1)
    }

    /// Number of the brick's blocks.
    #[inline]
    pub(super) fn blocks(self) -> usize {
        (self.link() >> LEVEL_BITS & (NAMES - 1)) as usize
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
        Self(u64::from(link) << 32 | u64::from(cell.majorant.to_bits()))
    }
}

impl Entry for FlightCell {
    const NOTHING: Self = Self(0);

    #[inline]
    fn link(self) -> u32 {
        (self.0 >> 32) as u32
    }

    #[inline]
    fn bounds(self) -> [f32; 2] {
        let majorant = self.majorant();
        let constant = self.link() & CONSTANT != 0;
        [if constant { majorant } else { 0.0 }, majorant]
    }
}

/// Bounds of a [`Grid`] for free flights, merged for a given extinction.
#[derive(Debug, Clone)]
pub struct FlightGrid {
    pub(super) tables: Tables<FlightCell>,
    pub(super) blocks: Blocks,
    /// How many entries bricks have; those of top cells follow.
    bricks: usize,
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
        let top = cells.top.iter();
        let top: Vec<FlightCell> = top
            .map(|&cell| FlightCell::new(cell, Blocks::OPEN))
            .collect();
        let count = cells.bricks.len();
        let mut bricks = Vec::with_capacity(count + top.len());
        let named = cells.bricks.iter().zip(names);
        bricks.extend(named.map(|(&cell, name)| FlightCell::new(cell, name)));
        bricks.extend(&top);
        let tables = Tables {
            top,
            bricks,
            dims: cells.dims,
            support: cells.support,
        };
        Self {
            tables,
            blocks,
            bricks: count,
        }
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
        match self.blocks_of(top, entry).verdict(x, voxel) {
            Verdict::Real => Some(true),
            Verdict::Open => None,
            Verdict::Null => Some(false),
        }
    }

    /// Where the entries of top cells' bricks begin, given their own links and numbers, or where their
    /// own are; and the bits that tell bricks apart.
    #[inline(always)]
    pub(super) fn first(&self, links: i32x8, numbers: i32x8) -> (i32x8, i32x8) {
        // The sign.
        let descend = links >> DESCEND.trailing_zeros();
        let tables = (links & i32x8::splat(!DESCEND as i32)) << TABLE_BRICKS.trailing_zeros();
        let own = numbers + i32x8::splat(self.bricks as i32);
        let slots = descend & i32x8::splat(TABLE_BRICKS as i32 - 1);
        (descend.select(tables, own), slots)
    }

    /// Bytes that the bounds take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.tables.memory_bytes() + self.blocks.memory_bytes()
    }

    /// The most that the bounds of `grid` take, whatever its extinction: no cells merged.
    #[must_use]
    pub fn most_memory_bytes(grid: &Grid) -> usize {
        let tops = grid.places.top().len() * size_of::<FlightCell>();
        Tables::<FlightCell>::most_bytes(grid) + tops + Blocks::most_bytes(grid)
    }
}
