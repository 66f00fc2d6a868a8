//! A sparse scalar field: values at integer index coordinates, trilinear between them.
//!
//! ```text
//! f(p) = sum over the 8 corners c of p's cell   v(c) * prod_axis (1 - |p - c|)
//! ```
//!
//! Layout. Bricks of 8^3 cells hold the 9^3 values that their cells touch (an apron on the high
//! side), so that any lookup reads one brick and no neighbour is ever looked up; of these values
//! they store the box that differs from 0 (place.rs). The index of bricks is flat, or of two levels where
//! the field is large and sparse (places.rs): a dense array over cells of 128^3 voxels, each empty,
//! constant, or a table of 16^3 bricks. A brick whose 9^3 values are equal is a constant and takes no
//! storage. Equal bricks are stored once, and so are tables between constants: entries may name the same one.
//!
//! Coordinates. `index` is OpenVDB's index space. `local` is index space moved so that the
//! field's box starts a little above 0: non-negative, small, exact in f32. Outside the box of its
//! values the field is 0: a background other than 0 ends at the active bounding box, one voxel
//! beyond which it has fallen to 0 (an unbounded medium would hide every light).
//!
//! Source: OpenVDB (Museth 2013, VDB: High-Resolution Sparse Volumes with Dynamic Topology);
//! the apron as in brick atlases of GVDB (Hoetzlein 2016).

mod border;
pub mod build;
mod cells;
mod compact;
mod corners;
mod cursor;
pub mod flights;
mod index;
pub mod load;
pub mod majorant;
pub mod merge;
pub(crate) mod octet;
mod place;
mod places;
pub mod plateau;
pub mod segments;
pub(crate) mod squeeze;
mod tables;
mod tap;
mod values;
pub mod walk;

use std::sync::Arc;

use glam::{DAffine3, DVec3, IVec3, UVec3, Vec3};
use wide::{f32x8, i32x4};

pub use self::corners::Corners;
pub use self::cursor::Cursor;
use self::place::{Place, Spot};
use self::places::Places;
pub(crate) use self::tap::{eight_taps, tap};
use self::values::Values;
use crate::lanes::four;
use crate::ray::Bounds;

/// Cells of a brick along an axis.
pub const BRICK: i32 = 8;
/// Values of a brick along an axis: its cells' corners.
pub const APRON: usize = 9;
/// Values of a brick.
pub const BRICK_VALUES: usize = APRON * APRON * APRON;
/// log2 of the voxels that a top cell spans.
pub const TOP_LOG2: u32 = 7;
/// Bricks of a top cell along an axis.
pub const TABLE: i32 = 16;
/// Bricks of a top cell.
pub const TABLE_BRICKS: usize = 4096;

/// Top bit of an index entry: the rest is an index into `constants`, not a brick or table.
const CONSTANT: u32 = 1 << 31;

/// Greatest values with which depths, their squares and their sums stay within f32. Wider: they
/// overflow; narrower: values in 16 bits are widened for nothing.
const ORDINARY: std::ops::Range<f32> = 1e-12..1e12;

/// A sparse, read-only scalar field. See the module's page.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Index coordinates of local (0, 0, 0).
    origin: IVec3,
    places: Places,
    /// Values of bricks, then of constants, each of those twice; the first constant is 0.
    values: Values,
    /// Bricks with values of their own.
    bricks: usize,
    /// Where the field can differ from 0, local coordinates.
    support: Bounds,
    /// Smallest and largest value anywhere.
    range: [f32; 2],
    /// Index to world. \[m\]
    index_to_world: DAffine3,
}

/// A brick as seen by a walk along a ray.
#[derive(Debug, Clone, Copy)]
pub enum Brick<'a> {
    /// All 9^3 values are this.
    Constant(f32),
    /// The 9^3 values.
    Values(BrickValues<'a>),
}

/// The 9^3 values of a brick.
#[derive(Debug, Clone, Copy)]
pub struct BrickValues<'a> {
    grid: &'a Grid,
    place: &'a Place,
}

impl BrickValues<'_> {
    /// The corners of the cell with lower corner `cell` (0..8).
    #[inline]
    #[must_use]
    pub fn corners(&self, cell: IVec3) -> Corners {
        let [x, y, z] = cell.to_array();
        let spot = self
            .place
            .open(self.grid.places.zero())
            .spot(i32x4::new([x, y, z, 0]));
        self.grid.values.corners(spot)
    }

    /// The value at a corner, 0..=8 along each axis.
    #[must_use]
    pub fn at(&self, corner: IVec3) -> f32 {
        let cell = corner.min(IVec3::splat(BRICK - 1));
        self.corners(cell).get((corner - cell).to_array())
    }
}

/// Linear index of a top cell.
#[inline]
fn top_index(dims: UVec3, cell: UVec3) -> usize {
    (cell.x as usize * dims.y as usize + cell.y as usize) * dims.z as usize + cell.z as usize
}

/// Coordinates of the top cell at a linear index.
fn top_cell(dims: UVec3, at: usize) -> IVec3 {
    let (y, z) = (dims.y as usize, dims.z as usize);
    UVec3::new((at / z / y) as u32, (at / z % y) as u32, (at % z) as u32).as_ivec3()
}

/// The voxel below a point on all axes, and where between it and the next the point lies.
#[inline(always)]
fn cell_and_fraction(p: Vec3) -> (i32x4, Vec3) {
    let p = four(p);
    let floor = p.floor();
    let [u, v, w, _] = (p - floor).to_array();
    // Not a number, or too far for an integer: i32::MIN, which is outside.
    (floor.fast_trunc_int(), Vec3::new(u, v, w))
}

/// The three axes of four lanes.
#[inline(always)]
fn three(v: i32x4) -> [i32; 3] {
    let [x, y, z, _] = v.to_array();
    [x, y, z]
}

/// Linear index of a brick in its table.
#[inline]
fn in_table(brick: IVec3) -> usize {
    (((brick.x & 15) << 8) | ((brick.y & 15) << 4) | (brick.z & 15)) as usize
}

impl Grid {
    /// The field at a local point.
    #[inline(always)]
    #[must_use]
    pub fn lookup(&self, p: Vec3) -> f32 {
        let (cell, f) = cell_and_fraction(p);
        self.values.corners(self.spot(cell)).at(f)
    }

    /// The value at one corner of p's cell: see `tap`.
    #[inline(always)]
    #[must_use]
    pub fn lookup_one_tap(&self, p: Vec3, u: Vec3) -> f32 {
        self.value(tap(four(p), four(u)))
    }

    /// The value at a local voxel.
    #[inline(always)]
    pub(crate) fn value(&self, voxel: i32x4) -> f32 {
        self.values.at(self.spot(voxel).start)
    }

    /// Where the value at a local voxel is, which will be read.
    #[inline(always)]
    pub(crate) fn find(&self, [x, y, z]: [i32; 3]) -> usize {
        let at = self.spot(i32x4::new([x, y, z, 0])).start;
        self.values.prefetch(at);
        at
    }

    /// The values at eight places that were [found](Self::find), or at 0.
    #[inline(always)]
    pub(crate) fn found(&self, at: [usize; 8]) -> f32x8 {
        self.values.eight(at)
    }

    /// The value at a local voxel.
    #[inline]
    #[must_use]
    pub fn voxel(&self, voxel: IVec3) -> f32 {
        let [x, y, z] = voxel.to_array();
        self.values.at(self.spot(i32x4::new([x, y, z, 0])).start)
    }

    /// The brick at brick coordinates (local voxels / 8); 0 outside the grid.
    #[inline]
    #[must_use]
    pub fn brick(&self, brick: IVec3) -> Brick<'_> {
        let place = self.places.of_brick(brick);
        if place.is_constant() {
            Brick::Constant(self.values.at(place.start()))
        } else {
            Brick::Values(BrickValues { grid: self, place })
        }
    }

    /// Smallest and largest value of the interpolated field in a brick's cells, faces included.
    #[must_use]
    pub fn brick_range(&self, brick: IVec3) -> [f32; 2] {
        self.range_at(self.places.of_brick(brick))
    }

    /// Smallest and largest of the 9^3 values at a place.
    fn range_at(&self, place: &Place) -> [f32; 2] {
        let size = place.size();
        let count = if place.is_constant() {
            1
        } else {
            size.element_product()
        };
        let mut range = [f32::MAX, f32::MIN];
        if count < BRICK_VALUES as i32 && !place.is_constant() {
            range = [0.0; 2];
        }
        for index in place.start()..place.start() + count as usize {
            let value = self.values.at(index);
            range = [range[0].min(value), range[1].max(value)];
        }
        range
    }

    /// All 9^3 values of the brick at a place.
    fn brick_values(&self, place: &Place) -> [f32; BRICK_VALUES] {
        if place.is_constant() {
            return [self.values.at(place.start()); BRICK_VALUES];
        }
        let (low, size) = (place.low(), place.size());
        let mut values = [0.0; BRICK_VALUES];
        let mut from = place.start();
        for x in low.x..low.x + size.x {
            for y in low.y..low.y + size.y {
                let to = corner_index(IVec3::new(x, y, low.z));
                for to in &mut values[to..to + size.z as usize] {
                    *to = self.values.at(from);
                    from += 1;
                }
            }
        }
        values
    }

    /// Where the corners of the cell with lowest voxel `cell` are.
    #[inline(always)]
    fn spot(&self, cell: i32x4) -> Spot {
        self.places.at(cell).open(self.places.zero()).spot(cell)
    }

    /// Where the field can differ from 0. \[local voxels\]
    #[must_use]
    pub fn support(&self) -> Bounds {
        self.support
    }

    /// Smallest and largest value of the field, 0 included where it ends.
    #[must_use]
    pub fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Local voxel coordinates to world. \[m\]
    #[must_use]
    pub fn local_to_world(&self) -> DAffine3 {
        self.index_to_world * DAffine3::from_translation(self.origin.as_dvec3())
    }

    /// Index coordinates of local (0, 0, 0).
    #[must_use]
    pub fn origin(&self) -> IVec3 {
        self.origin
    }

    /// Top cells along each axis.
    #[must_use]
    pub fn dims(&self) -> UVec3 {
        self.places.dims()
    }

    /// Bricks with storage.
    #[must_use]
    pub fn bricks(&self) -> usize {
        self.bricks
    }

    /// Bits that a brick's value takes: 16 where that is exact for the whole grid, else 32.
    #[must_use]
    pub fn value_bits(&self) -> u32 {
        self.values.bits()
    }

    /// The same field with 32 bits for every value: to measure against.
    #[must_use]
    pub fn widened(&self) -> Self {
        Self {
            values: self.values.widened(),
            ..self.clone()
        }
    }

    /// The same field with two levels of index, whatever its box: to measure against.
    #[must_use]
    pub fn in_two_levels(&self) -> Self {
        Self {
            places: self.places.in_two_levels(),
            ..self.clone()
        }
    }

    /// The field over a unit, and the unit: 1 where values are ordinary, else a power of two near
    /// the greatest, so that nothing is rounded but what is 1e-38 of it, and sums along a ray of
    /// values near f32's limits are not beyond them.
    #[must_use]
    pub fn in_units(self: Arc<Self>) -> (Arc<Self>, f32) {
        let greatest = self.range[1];
        if greatest <= 0.0 || ORDINARY.contains(&greatest) {
            return (self, 1.0);
        }
        let exponent = (greatest.log2() as i32).clamp(f32::MIN_EXP - 1, f32::MAX_EXP - 2);
        let unit = 2f32.powi(exponent);
        let scaled = Self {
            values: self.values.scaled(1.0 / unit),
            range: self.range.map(|v| v / unit),
            ..Self::clone(&self)
        };
        (Arc::new(scaled), unit)
    }

    /// Bytes that the field takes in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.places.memory_bytes() + self.values.memory_bytes()
    }

    /// Corners of the support in world space. \[m\]
    #[must_use]
    pub fn world_corners(&self) -> [DVec3; 8] {
        let map = self.local_to_world();
        let (lo, hi) = (self.support.min.as_dvec3(), self.support.max.as_dvec3());
        std::array::from_fn(|i| {
            let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
            map.transform_point3(DVec3::new(
                pick(0, lo.x, hi.x),
                pick(1, lo.y, hi.y),
                pick(2, lo.z, hi.z),
            ))
        })
    }
}

/// Linear index of a corner among all 9^3 of a brick.
#[inline]
#[must_use]
pub fn corner_index(corner: IVec3) -> usize {
    (corner.x * 81 + corner.y * 9 + corner.z) as usize
}
