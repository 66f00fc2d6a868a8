//! The segments and blocks of eight rays at a time.
//!
//! What `segments.rs` and `squeeze.rs` do for one ray, in lanes, the same numbers to the last bit: a
//! single ray waits for each of its fetches and then guesses what comes of it, eight wait together and
//! guess nothing.

use bytemuck::cast;
use wide::{f32x8, i32x8, u32x8, u64x4};

use super::TOP_LOG2;
use super::flights::{FlightCell, FlightGrid};
use super::segments::Segments;
use super::squeeze::Verdicts;
use crate::lanes::{axes, floats, ints, least, most, pick};

/// Bits of a brick's coordinates that tell its slot in a table.
const IN_TABLE: i32 = 15;

/// Eight rays between the cells of a grid's bounds.
#[derive(Debug, Clone)]
pub(crate) struct Octet<'a> {
    flights: &'a FlightGrid,
    origin: [f32x8; 3],
    direction: [f32x8; 3],
    /// One over the direction; 0 where no face is ever reached.
    inverse: [f32x8; 3],
    t: f32x8,
    t_end: f32x8,
    brick: [i32x8; 3],
    /// The top cells that the last segments are in.
    top: [i32x8; 3],
    /// The entry of a top cell's first brick, or the only one there is; bits that tell bricks apart.
    first: i32x8,
    slots: i32x8,
    /// Fetched: majorants and links of the bricks that rays are in; the lanes that are inside the grid.
    majorant: f32x8,
    link: i32x8,
    inside: i32x8,
}

/// Pieces of the rays, and their bounds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EightSegments {
    pub(crate) t_min: f32x8,
    pub(crate) t_max: f32x8,
    pub(crate) majorant: f32x8,
    pub(crate) minorant: f32x8,
}

/// Number of a brick in its table.
#[inline(always)]
fn slot(brick: [i32x8; 3]) -> i32x8 {
    let within = i32x8::splat(IN_TABLE);
    let [x, y, z] = brick;
    ((x & within) << 8u32) | ((y & within) << 4u32) | (z & within)
}

/// Majorants and links of entries at eight places, by words of 64 bits: even lanes and odd ones.
#[inline(always)]
fn fetch(from: &[FlightCell], at: i32x8) -> (f32x8, i32x8) {
    let at = at.to_array();
    let word = |lane: usize| from[at[lane] as u32 as usize].0;
    let even = u64x4::new([word(0), word(2), word(4), word(6)]);
    let odd = u64x4::new([word(1), word(3), word(5), word(7)]);
    let low = u64x4::splat(u64::from(u32::MAX));
    (
        cast((even & low) | (odd << 32u32)),
        cast((even >> 32u32) | (odd & !low)),
    )
}

impl<'a> Octet<'a> {
    /// No rays.
    pub(crate) fn new(flights: &'a FlightGrid) -> Self {
        Self {
            flights,
            origin: [f32x8::ZERO; 3],
            direction: [f32x8::ZERO; 3],
            inverse: [f32x8::ZERO; 3],
            t: f32x8::ZERO,
            t_end: f32x8::ZERO,
            brick: [i32x8::ZERO; 3],
            top: [i32x8::ZERO; 3],
            first: i32x8::ZERO,
            slots: i32x8::ZERO,
            majorant: f32x8::ZERO,
            link: i32x8::ZERO,
            inside: i32x8::ZERO,
        }
    }

    /// Puts a ray into a lane.
    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, ray: &Segments<'_, FlightCell>) {
        let lane = lane % 8;
        for axis in 0..3 {
            self.origin[axis].as_mut_array()[lane] = ray.origin.as_array()[axis];
            self.direction[axis].as_mut_array()[lane] = ray.direction.as_array()[axis];
            self.inverse[axis].as_mut_array()[lane] = ray.inverse.as_array()[axis];
            self.brick[axis].as_mut_array()[lane] = ray.brick.as_array()[axis];
        }
        self.t.as_mut_array()[lane] = ray.t;
        self.t_end.as_mut_array()[lane] = ray.t_end;
    }

    /// Lanes whose rays have no segment more.
    #[inline(always)]
    pub(crate) fn done(&self) -> i32x8 {
        cast(self.t.simd_ge(self.t_end))
    }

    /// The points at t.
    #[inline(always)]
    pub(crate) fn at(&self, t: f32x8) -> [f32x8; 3] {
        axes(|axis| self.direction[axis].mul_add(t, self.origin[axis]))
    }

    /// Fetches the cells that the rays of some lanes are in.
    #[inline(always)]
    pub(crate) fn fetch(&mut self, of: i32x8) {
        let tables = &self.flights.tables;
        let dims = tables.dims.as_ivec3();
        let dims = axes(|axis| i32x8::splat(dims[axis]));
        let top = axes(|axis| self.brick[axis] >> 4u32);
        let within =
            axes(|axis| top[axis].simd_gt(i32x8::splat(-1)) & top[axis].simd_lt(dims[axis]));
        let inside = of & within[0] & within[1] & within[2];
        let number = ((top[0] * dims[1] + top[1]) * dims[2] + top[2]) & inside;
        let (_, links) = fetch(&tables.top, number);
        let (first, slots) = self.flights.first(links, number);
        let at = first + (slot(self.brick) & slots);
        (self.majorant, self.link) = fetch(&tables.bricks, at);
        self.inside = inside;
        self.first = of.select(first, self.first);
        self.slots = of.select(slots, self.slots);
        self.top = axes(|axis| of.select(top[axis], self.top[axis]));
    }

    /// The next segments of some lanes, whose rays are not done, across the cells fetched; of others,
    /// anything.
    #[inline(always)]
    pub(crate) fn advance(&mut self, of: i32x8) -> EightSegments {
        let (link, inside) = (self.link, self.inside);
        let majorant = floats(inside) & self.majorant;
        let minorant = floats(FlightCell::constants(link)) & majorant;
        let mask = i32x8::splat(-1) << cast::<i32x8, u32x8>(FlightCell::levels(link));
        let up = axes(|axis| ints(self.inverse[axis].simd_gt(f32x8::ZERO)));
        let low = axes(|axis| self.brick[axis] & mask);
        let face = axes(|axis| low[axis] - (mask & up[axis]));
        let meets = axes(|axis| {
            let inverse = self.inverse[axis];
            let met = (f32x8::from_i32x8(face[axis] << 3u32) - self.origin[axis]) * inverse;
            let moves = inverse.simd_ne(f32x8::ZERO);
            moves.select(met, f32x8::splat(f32::INFINITY))
        });
        let exit = least(least(meets[0], meets[1]), meets[2]);
        let end = least(most(exit, self.t), self.t_end);
        let end = pick(inside, end, self.t_end);
        let segments = EightSegments {
            t_min: self.t,
            t_max: end,
            majorant,
            minorant,
        };
        self.t = pick(of, end, self.t);
        let points = self.at(end);
        self.brick = axes(|axis| {
            let inside = points[axis].fast_trunc_int() >> 3u32;
            let inside = inside.max(low[axis]).min(low[axis] | !mask);
            let left = ints(meets[axis].simd_le(exit));
            let brick: i32x8 = left.select(face[axis] + !up[axis], inside);
            of.select(brick, self.brick[axis])
        });
        segments
    }

    /// Where the blocks of local voxels in the top cells of the last segments are, which will be read.
    #[inline(always)]
    pub(crate) fn find_blocks(&self, voxel: [i32x8; 3]) -> i32x8 {
        let brick = axes(|axis| voxel[axis] >> 3u32);
        let at = self.first + (slot(brick) & self.slots);
        let (_, links) = fetch(&self.flights.tables.bricks, at);
        let names = FlightCell::names(links);
        self.flights.blocks.find(names, voxel)
    }

    /// What blocks tell of collisions that are real if `x`, not below 0, is below the value at a local
    /// voxel, by where they were found.
    #[inline(always)]
    pub(crate) fn verdicts(&self, x: f32x8, voxel: [i32x8; 3], blocks: i32x8) -> Verdicts {
        let same = axes(|axis| (voxel[axis] >> TOP_LOG2).simd_eq(self.top[axis]));
        let known = same[0] & same[1] & same[2];
        self.flights.blocks.verdicts(x, blocks, known)
    }
}
