//! The voxel cells that a ray crosses, and where their values are.
//!
//! ```text
//! t_a' = t_a + 1 / |d_a|  for the axis a of the nearest face      cell_a' = cell_a + sign d_a
//! cells of a segment:  1 + sum over axes of ceil((t_end - t_a) |d_a|)       t_a: of the first face
//! index of a cell:     base + x slab + y row + z                  (place.rs)
//! ```
//!
//! Everything is f64 in lanes, whole numbers too: from one cell to the next are a dozen
//! instructions, and none of them a branch that is guessed. What is known of a brick is kept until
//! the ray leaves it. Octants of a brick in which there is nothing are passed over: within the
//! box of a wisp of smoke that is a third of the cells.
//!
//! Segments end at faces rounded to f32. Cells tile a segment to the bit all the same: what is
//! missing of a cell, or too much, goes to its neighbour (`SLIVER`). The field being continuous,
//! that is wrong by the square of the sliver: below 1e-13 voxels times the field's slope, which
//! only the integral of a ray that touches the field and no more would show.

use bytemuck::cast;
use wide::{f64x4, i32x4};

use super::place::Spot;
use super::{BRICK, Grid};
use crate::lanes::{greater, lesser};
use crate::ray::{ExactRay, reciprocal};

/// A ray in f64, its three axes side by side.
#[derive(Clone, Copy)]
pub(super) struct Line {
    origin: f64x4,
    direction: f64x4,
    /// One over the direction; 0 where no face is ever reached.
    inverse: f64x4,
    /// From face to face, and faces for each t; 0 where none is ever reached.
    between: f64x4,
    speed: f64x4,
    /// Set where faces are reached.
    moves: f64x4,
    /// From cell to cell.
    step: f64x4,
    /// From a cell's lowest voxel to the face that the ray leaves by.
    ahead: f64x4,
}

/// A cell on a ray.
#[derive(Clone, Copy)]
pub(super) struct Crossing {
    /// Its lowest voxel.
    pub(super) low: f64x4,
    /// Where the ray enters it.
    pub(super) from: f64,
    /// Where it leaves it.
    pub(super) to: f64,
}

impl Line {
    #[inline]
    pub(super) fn new(ray: &ExactRay) -> Self {
        let four = |v: [f64; 3]| f64x4::new([v[0], v[1], v[2], 0.0]);
        let reached = reciprocal(ray.direction.as_vec3())
            .to_array()
            .map(f32::is_finite);
        let direction = ray.direction.to_array();
        let of_axis = |f: &dyn Fn(usize) -> f64| {
            four(std::array::from_fn(|a| if reached[a] { f(a) } else { 0.0 }))
        };
        let step = of_axis(&|a| direction[a].signum());
        let inverse = of_axis(&|a| 1.0 / direction[a]);
        Self {
            origin: four(ray.origin.to_array()),
            direction: four(direction),
            inverse,
            between: inverse.abs(),
            speed: of_axis(&|a| direction[a].abs()),
            moves: step.simd_ne(f64x4::ZERO),
            step,
            ahead: step.fast_max(f64x4::ZERO),
        }
    }

    #[inline]
    fn at(&self, t: f64) -> f64x4 {
        self.direction.mul_add(f64x4::splat(t), self.origin)
    }

    /// Where in a cell the point at t is, in [0, 1].
    #[inline]
    pub(super) fn inside(&self, low: f64x4, t: f64) -> f64x4 {
        (self.at(t) - low)
            .fast_max(f64x4::ZERO)
            .fast_min(f64x4::ONE)
    }

    /// Where in a cell the middle of its chord is, and how long that is.
    #[inline(always)]
    pub(super) fn middle(&self, cell: &Crossing) -> (f64x4, f64) {
        let place = self.inside(cell.low, 0.5 * (cell.from + cell.to));
        (place, cell.to - cell.from)
    }

    /// t at which the ray meets a face on each axis.
    #[inline]
    fn meets(&self, faces: f64x4) -> f64x4 {
        let t = (faces - self.origin) * self.inverse;
        self.moves.bitselect(t, f64x4::splat(f64::INFINITY))
    }
}

/// The voxel cells that a ray crosses in [t, t_end]; tiles it exactly. All axes are stepped at a
/// time and by masks: which one it is cannot be guessed. How many there are is known beforehand
/// from the faces ahead, so that the end of the loop does not wait for the last step.
pub(super) struct Cells<'a> {
    line: &'a Line,
    /// The cell's lowest voxel.
    low: f64x4,
    /// t at which the ray meets the faces by which it leaves the cell.
    next: f64x4,
    t: f64,
    t_end: f64,
    /// How far a cell goes at least: any but the last, and the last.
    least: [f64; 2],
    /// Cells that are left.
    left: u32,
}

/// What may be missing at either end of a segment, over t: its ends are rounded to f32. What is
/// less is taken as the next cell's: it would be a cell more for each segment, of no length.
const SLIVER: f64 = f32::EPSILON as f64;

impl<'a> Cells<'a> {
    #[inline(always)]
    pub(super) fn new(line: &'a Line, t: f64, t_end: f64, most: f64) -> Self {
        let middle = 0.5 * (t + t_end);
        let sliver = SLIVER * t_end;
        let (first, last) = (lesser(t + sliver, middle), greater(t_end - sliver, middle));
        let low = line.at(first).floor();
        let next = line.meets(low + line.ahead);
        // A start on a face belongs to the cell that the ray goes on into, however slowly.
        let behind = next.simd_le(f64x4::splat(first));
        let low = low + (behind & line.step);
        let next = next + (behind & line.between);
        // One axis at a time; what is stepped along two at once leaves cells of no length.
        let faces = (f64x4::splat(last) - next) * line.speed;
        let faces = (line.moves & faces).ceil().fast_max(f64x4::ZERO);
        let [x, y, z, _] = faces.to_array();
        Self {
            line,
            low,
            next,
            t,
            t_end,
            least: [f64::NEG_INFINITY, t_end],
            left: 1 + lesser(x + y + z, most) as u32,
        }
    }

    /// The next cell.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<Crossing> {
        self.left = self.left.checked_sub(1)?;
        let [x, y, z, _] = self.next.to_array();
        let nearest = lesser(lesser(x, y), z);
        let to = lesser(greater(nearest, self.t), self.t_end);
        let crossing = Crossing {
            low: self.low,
            from: self.t,
            // From a table: a choice would be made a branch, and guessed.
            to: greater(to, self.least[usize::from(self.left == 0)]),
        };
        self.t = to;
        let mask = self.next.simd_le(f64x4::splat(nearest));
        self.next += mask & self.line.between;
        self.low += mask & self.line.step;
        Some(crossing)
    }
}

/// A brick and its stored cells, as a ray sees them.
pub(super) struct Boxed {
    /// Lowest voxels of the first stored cell and of the last.
    low: f64x4,
    high: f64x4,
    /// Voxel in the middle of the brick.
    middle: f64x4,
    /// Octants around it that are not empty, bit by bit.
    octants: u64,
    /// From a value to the next on each axis.
    strides: f64x4,
    /// Index of the value at voxel (0, 0, 0), were it stored.
    base: f64,
    row: u32,
    slab: u32,
}

impl Boxed {
    /// No brick.
    pub(super) const NONE: Self = Self {
        low: f64x4::new([f64::INFINITY, f64::INFINITY, f64::INFINITY, 0.0]),
        high: f64x4::ZERO,
        middle: f64x4::splat(f64::INFINITY),
        octants: 0,
        strides: f64x4::ZERO,
        base: 0.0,
        row: 0,
        slab: 0,
    };

    /// The brick of a cell.
    #[inline(always)]
    pub(super) fn around(grid: &Grid, cell: f64x4) -> Self {
        let voxel = whole(cell);
        let place = grid.places.at(voxel);
        let brick: i32x4 = voxel >> BRICK.ilog2() as i32;
        let edge = f64::from(BRICK);
        let corner = f64x4::from_i32x4(brick) * f64x4::splat(edge);
        let (low, last) = place.cells();
        let low = corner + f64x4::from_i32x4(low);
        let strides = place.strides();
        let [slab, row, ..] = strides.to_array();
        let strides = f64x4::from_i32x4(strides);
        Self {
            low,
            high: low + f64x4::from_i32x4(last),
            middle: corner + f64x4::splat(0.5 * edge),
            octants: place.octants(),
            strides,
            // Whole numbers of such a size are exact.
            base: place.start() as f64 - (strides * low).reduce_add(),
            row: row as u32,
            slab: slab as u32,
        }
    }

    /// True if a cell is one of the brick's.
    #[inline(always)]
    pub(super) fn has(&self, cell: f64x4) -> bool {
        let half = f64x4::splat(0.5 * f64::from(BRICK));
        let (first, beyond) = (self.middle - half, self.middle + half);
        (cell.simd_ge(first) & cell.simd_lt(beyond)).all()
    }

    /// True if a cell is one of the brick's that are stored, and its octant is not empty.
    #[inline(always)]
    pub(super) fn is_filled(&self, cell: f64x4) -> bool {
        let stored = cell.simd_ge(self.low) & cell.simd_le(self.high);
        // No octant has a number beyond 7: outside there is none. The fourth lane is always inside,
        // and below the middle.
        let outside = (!stored).to_bitmask();
        let octant = cell.simd_ge(self.middle).to_bitmask();
        self.octants >> (octant + 8 * outside) & 1 != 0
    }

    /// Where the corners of such a cell are.
    #[inline(always)]
    pub(super) fn spot(&self, cell: f64x4) -> Spot {
        let [x, y, z, _] = (cell * self.strides).to_array();
        // Whole numbers below 2^52 are the fraction's bits.
        let index = (self.base + (x + z) + y + INTEGERS).to_bits() & (INTEGERS_BIT - 1);
        Spot {
            start: index as usize,
            row: self.row,
            slab: self.slab,
        }
    }
}

/// Whole numbers in 32 bits: the lower halves of what they are far up where f64 is whole numbers.
#[inline(always)]
fn whole(v: f64x4) -> i32x4 {
    let bits: [u64; 4] = cast(v + f64x4::splat(1.5 * INTEGERS));
    let [x, y, z, w] = bits.map(|bits| bits as i32);
    i32x4::new([x, y, z, w])
}

/// From here on f64 is whole numbers, one by one.
const INTEGERS: f64 = INTEGERS_BIT as f64;
const INTEGERS_BIT: u64 = 1 << 52;
