//! Bounds of 2^3 voxels: most collisions are decided by them, without a look-up.
//!
//! ```text
//! a collision is real if     x < v        x uniform in [0, majorant), v the value at one tap
//! real whatever v is         level(x) <  low        low  = level(least value of the block)
//! null whatever v is         level(x) >= high       high = level(greatest value) + 1, 0 of 0
//! level(x)                   exponent and four bits of the fraction, from 2^-15 of the field's
//!                            greatest value up; 0 below: steps of 6 % or less
//! ```
//! The squeeze of rejection sampling (Marsaglia 1977, The squeeze method for generating gamma
//! variates), with the field for the density that is dear. It changes no decision, so that flights
//! are what they were; but the two bytes of a block are near, where its values are not, and
//! look-ups no longer depend on how far the majorant is above the field.
//!
//! A brick has 64 blocks, in 128 bytes where its values are up to 2916. They bound the values of
//! voxels, not the field between: a tap has chosen its voxel (Hofmann et al. 2021), and 2^3 values
//! are much closer to one another than the 3^3 between which 2^3 cells interpolate.

use bytemuck::cast;
use glam::IVec3;
use rayon::prelude::*;
use wide::{f32x8, i32x4, i32x8, u16x8};

use super::flights::FlightCell;
use super::place::Place;
use super::{Grid, TABLE_BRICKS, TOP_LOG2, corner_index, three};
use crate::lanes::lanes;
use crate::prefetch::prefetch;

/// Blocks of a brick.
const BLOCKS: usize = 64;
/// Bits of a float that a level leaves out.
const LEFT_OUT: u32 = 19;
/// Level of the greatest value: that beyond it is still a byte.
const TOP: i32 = 254;

/// What blocks tell of a collision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Verdict {
    /// Real, whatever the value is.
    Real,
    /// Either.
    Open,
    /// Null, whatever the value is.
    Null,
}

/// Lanes of each [`Verdict`]; of neither, open.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Verdicts {
    pub(crate) real: i32x8,
    pub(crate) null: i32x8,
}

/// Levels that no value of the block is below, and that all are below.
type Block = [u8; 2];

/// The blocks of a grid's bricks.
#[derive(Debug, Clone)]
pub(super) struct Blocks {
    /// Those of a brick one after another; the first are those of one that is 0 all over, the second
    /// decide nothing.
    all: Vec<Block>,
    /// What a level counts from.
    base: i32,
}

impl Blocks {
    /// Number of those that decide nothing.
    pub(super) const OPEN: u32 = 1;

    /// The blocks of some of a grid's tables, by number, and which of their bricks have which: of
    /// all bricks of the first table, then of the second and so on.
    pub(super) fn new(grid: &Grid, tables: &[usize]) -> (Self, Vec<u32>) {
        let base = (grid.range()[1].max(0.0).to_bits() >> LEFT_OUT) as i32 - TOP;
        let mut this = Self {
            all: [[[0, 0]; BLOCKS], [[0, u8::MAX]; BLOCKS]].concat(),
            base,
        };
        let of_tables: Vec<(Vec<Place>, Vec<Block>)> = tables
            .par_iter()
            .map(|&number| {
                let bricks = different(&grid.places.table(number));
                let blocks = |place: &Place| this.of_brick(grid, place);
                let all = bricks.par_iter().flat_map_iter(blocks).collect();
                (bricks, all)
            })
            .collect();
        let mut names = Vec::with_capacity(tables.len() * TABLE_BRICKS);
        for (&number, (bricks, blocks)) in tables.iter().zip(of_tables) {
            let first = this.all.len() / BLOCKS;
            let name = |place: &Place| bricks.binary_search(place).map_or(0, |at| first + at);
            names.extend(
                grid.places
                    .table(number)
                    .iter()
                    .map(|place| name(place) as u32),
            );
            this.all.extend(blocks);
        }
        this.all.shrink_to_fit();
        (this, names)
    }

    /// The level of a number that is not below 0.
    #[inline(always)]
    fn level(&self, x: f32) -> i32 {
        ((x.to_bits() >> LEFT_OUT) as i32 - self.base).max(0)
    }

    /// Where the blocks of local voxels are, by the names of their bricks' blocks; they will be read.
    #[inline(always)]
    pub(super) fn find(&self, names: i32x8, [i, j, k]: [i32x8; 3]) -> i32x8 {
        let block = ((i << 3u32) & i32x8::splat(0x30))
            | ((j << 1u32) & i32x8::splat(0xc))
            | ((k >> 1u32) & i32x8::splat(3));
        let at = names * i32x8::splat(BLOCKS as i32) + block;
        let each = at.to_array();
        lanes(|lane| prefetch(&self.all, each[lane] as u32 as usize));
        at
    }

    /// What blocks tell of collisions that are real if `x`, not below 0, is below the value, by where they
    /// are; of lanes that are `known`.
    #[inline(always)]
    pub(super) fn verdicts(&self, x: f32x8, at: i32x8, known: i32x8) -> Verdicts {
        let at = at.to_array();
        let block = |lane: usize| u16::from_le_bytes(self.all[at[lane] as u32 as usize]);
        let blocks = i32x8::from_u16x8(u16x8::new(lanes(block)));
        let bits: i32x8 = cast(x);
        let level = ((bits >> LEFT_OUT) - i32x8::splat(self.base)).max(i32x8::ZERO);
        let real = level.simd_lt(blocks & i32x8::splat(0xff)) & known;
        let null = !level.simd_lt(blocks >> 8u32) & known;
        Verdicts { real, null }
    }

    /// The blocks of the brick at a place.
    fn of_brick(&self, grid: &Grid, place: &Place) -> [Block; BLOCKS] {
        let mut ranges = [[f32::MAX, 0.0f32]; BLOCKS];
        let values = grid.brick_values(place);
        for (x, y, z) in (0..512).map(|i| (i >> 6, i >> 3 & 7, i & 7)) {
            let value = values[corner_index(IVec3::new(x, y, z))].max(0.0);
            let [low, high] = &mut ranges[block([x, y, z])];
            (*low, *high) = (low.min(value), high.max(value));
        }
        ranges.map(|[low, high]| {
            let beyond = self.level(high) + i32::from(high > 0.0);
            [self.level(low), beyond].map(|level| level as u8)
        })
    }

    /// Bytes, as allocated.
    pub(super) fn memory_bytes(&self) -> usize {
        self.all.capacity() * size_of::<Block>()
    }

    /// The most bytes that those of a grid take.
    pub(super) fn most_bytes(grid: &Grid) -> usize {
        let tables = (0..grid.places.tables()).into_par_iter();
        let bricks: usize =
            (tables.map(|number| different(&grid.places.table(number)).len())).sum();
        (2 + bricks) * BLOCKS * size_of::<Block>()
    }
}

/// The bricks of a table that are not 0 all over, each once.
fn different(table: &[Place]) -> Vec<Place> {
    let filled = |place: &&Place| place.octants() != 0;
    let mut bricks: Vec<Place> = table.iter().filter(filled).copied().collect();
    bricks.sort_unstable();
    bricks.dedup();
    bricks
}

/// Number of the block of a voxel in its brick.
#[inline(always)]
fn block([x, y, z]: [i32; 3]) -> usize {
    ((x << 3 & 0x30) | (y << 1 & 0xc) | (z >> 1 & 3)) as usize
}

/// The blocks of a top cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Squeeze<'a> {
    /// Coordinates of the top cell.
    pub(super) top: i32x4,
    /// Its bricks; none if it has no table.
    pub(super) bricks: &'a [FlightCell],
    pub(super) blocks: &'a Blocks,
}

impl Squeeze<'_> {
    /// Of a collision that is real if `x`, not below 0, is below the value at a local voxel.
    #[inline(always)]
    pub(crate) fn verdict(&self, x: f32, voxel: i32x4) -> Verdict {
        let top: i32x4 = voxel >> TOP_LOG2 as i32;
        if !top.simd_eq(self.top).all() {
            return Verdict::Open;
        }
        let [i, j, k] = three(voxel);
        let slot = (i << 5 & 0xf00) | (j << 1 & 0xf0) | (k >> 3 & 0xf);
        let Some(brick) = self.bricks.get(slot as usize) else {
            return Verdict::Open;
        };
        let at = brick.blocks() * BLOCKS + block([i, j, k]);
        let Some(&[low, high]) = self.blocks.all.get(at) else {
            return Verdict::Open;
        };
        // By sums, not by branches, which cannot be guessed.
        let level = self.blocks.level(x);
        let beyond = usize::from(level >= i32::from(low)) + usize::from(level >= i32::from(high));
        [Verdict::Real, Verdict::Open, Verdict::Null][beyond]
    }
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;
    use crate::grid::flights::FlightGrid;
    use crate::rng::{Rng, Stage};

    /// Waves about 0, holes, a plateau, wisps of 1e-6 of the greatest value, on both sides of a face of
    /// top cells.
    fn waves() -> Grid {
        let value = |c: IVec3| {
            let [x, y, z] = (c.as_vec3() * 0.15).to_array();
            let wave = x.sin() * y.sin() + z.cos();
            match c.x {
                110.. => 0.7,
                100.. => 1e-6 * wave,
                _ => wave,
            }
        };
        let (low, high) = (IVec3::ZERO, IVec3::new(140, 60, 60));
        Grid::from_fn(low, high, DAffine3::IDENTITY, value).expect("a grid of waves")
    }

    /// What blocks tell is so, of any number and voxel, and they leave little open.
    #[test]
    fn blocks_tell_what_values_do_and_mostly_tell() {
        let grid = waves();
        let flights = FlightGrid::new(&grid, 0.3, 1.0);
        let top = grid.range()[1];
        let mut random = Rng::stream(5, Stage::Check, 0, 0);
        let support = grid.support();
        let low = support.min.as_ivec3() - IVec3::splat(2);
        let high = support.max.as_ivec3() + IVec3::splat(2);
        let (mut open, mut count) = (0, 0);
        for x in low.x..high.x {
            for y in low.y..high.y {
                for z in low.z..high.z {
                    let voxel = IVec3::new(x, y, z);
                    let value = grid.voxel(voxel);
                    let drawn = random.uniform() * top;
                    let near = value * (0.99 + 0.02 * random.uniform());
                    for x in [drawn, near, value, value.next_up()].map(|x| x.max(0.0)) {
                        let told = flights.is_below(x, voxel);
                        assert!(
                            told.is_none_or(|below| below == (x < value)),
                            "{voxel} of {value}, below {x}: {told:?}"
                        );
                    }
                    count += u32::from(value > 0.0);
                    open += u32::from(flights.is_below(drawn, voxel).is_none());
                }
            }
        }
        assert!(count > 100_000, "{count} voxels are not empty");
        assert!(open < count / 5, "{open} of {count} left open");
    }
}
