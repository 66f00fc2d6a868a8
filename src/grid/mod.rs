//! A sparse scalar field: values at integer index coordinates, trilinear between them.
//!
//! ```text
//! f(p) = sum over the 8 corners c of p's cell   v(c) * prod_axis (1 - |p - c|)
//! ```
//!
//! Layout. Bricks of 8^3 cells hold the 9^3 values that their cells touch (an apron on the high
//! side), so that any lookup reads one brick: about 1.4 times the memory of bare 8^3 bricks, and
//! no neighbour is ever looked up. Two index levels lead to a brick: a dense array over cells of
//! 128^3 voxels, each empty, constant, or a table of 16^3 bricks; a brick whose 9^3 values are
//! equal is a constant in its table and takes no storage. Equal bricks are stored once, and so are
//! tables between constants: entries may name the same one. A sparse 2000^3 cloud has 4096
//! entries at the top.
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
mod compact;
pub mod load;
pub mod majorant;
mod values;
pub mod walk;

use glam::{DAffine3, DVec3, IVec3, UVec3, Vec3};

pub use self::values::BrickValues;
use self::values::Values;
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

/// A sparse, read-only scalar field. See the module's page.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Index coordinates of local (0, 0, 0).
    origin: IVec3,
    /// Top cells along each axis.
    dims: UVec3,
    /// Entry of each top cell: a table, or a constant.
    top: Vec<u32>,
    /// Entries of each table's bricks: a brick, or a constant.
    tables: Vec<u32>,
    /// Values of constant cells; the first is 0.
    constants: Vec<f32>,
    /// Values of bricks.
    values: Values,
    /// Smallest and largest value of each brick.
    ranges: Vec<[f32; 2]>,
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

/// Linear index of a brick in its table.
#[inline]
fn in_table(brick: IVec3) -> usize {
    (((brick.x & 15) << 8) | ((brick.y & 15) << 4) | (brick.z & 15)) as usize
}

impl Grid {
    /// The field at a local point.
    #[inline]
    #[must_use]
    pub fn lookup(&self, p: Vec3) -> f32 {
        let floor = p.floor();
        let cell = floor.as_ivec3();
        match self.brick(cell >> 3) {
            Brick::Constant(value) => value,
            Brick::Values(values) => values.corners(cell).at(p - floor),
        }
    }

    /// The value at one corner of p's cell, chosen with the probability of its trilinear weight:
    /// in expectation the field at p, for one fetch instead of eight (Hofmann et al. 2021).
    /// Only for estimators linear in the field. `u` holds three uniforms.
    #[inline]
    #[must_use]
    pub fn lookup_one_tap(&self, p: Vec3, u: Vec3) -> f32 {
        let floor = p.floor();
        let cell = floor.as_ivec3();
        match self.brick(cell >> 3) {
            Brick::Constant(value) => value,
            Brick::Values(values) => {
                let up = u.cmplt(p - floor);
                let corner = (cell & 7) + IVec3::new(up.x.into(), up.y.into(), up.z.into());
                values.at(corner)
            }
        }
    }

    /// The value at a local voxel.
    #[must_use]
    pub fn voxel(&self, voxel: IVec3) -> f32 {
        match self.brick(voxel >> 3) {
            Brick::Constant(value) => value,
            Brick::Values(values) => values.at(voxel & 7),
        }
    }

    /// The brick at brick coordinates (local voxels / 8); 0 outside the grid.
    #[inline]
    #[must_use]
    pub fn brick(&self, brick: IVec3) -> Brick<'_> {
        let entry = self.entry(brick);
        if entry & CONSTANT != 0 {
            return Brick::Constant(self.constants[(entry & !CONSTANT) as usize]);
        }
        match self.values.brick(entry as usize) {
            Some(values) => Brick::Values(values),
            None => Brick::Constant(0.0),
        }
    }

    /// Smallest and largest value of the interpolated field in a brick's cells, faces included.
    #[must_use]
    pub fn brick_range(&self, brick: IVec3) -> [f32; 2] {
        self.entry_range(self.entry(brick))
    }

    /// Smallest and largest value of an index entry's brick.
    fn entry_range(&self, entry: u32) -> [f32; 2] {
        if entry & CONSTANT != 0 {
            [self.constants[(entry & !CONSTANT) as usize]; 2]
        } else {
            self.ranges[entry as usize]
        }
    }

    /// Index entry of a brick.
    #[inline]
    fn entry(&self, brick: IVec3) -> u32 {
        let cell = (brick >> 4i32).as_uvec3();
        if cell.cmpge(self.dims).any() {
            return CONSTANT;
        }
        let entry = self.top[self.top_index(cell)];
        if entry & CONSTANT != 0 {
            return entry;
        }
        self.tables[entry as usize * TABLE_BRICKS + in_table(brick)]
    }

    /// Linear index of a top cell.
    #[inline]
    fn top_index(&self, cell: UVec3) -> usize {
        (cell.x as usize * self.dims.y as usize + cell.y as usize) * self.dims.z as usize
            + cell.z as usize
    }

    /// Coordinates of the top cell at a linear index.
    fn top_cell(&self, at: usize) -> IVec3 {
        let (y, z) = (self.dims.y as usize, self.dims.z as usize);
        UVec3::new((at / z / y) as u32, (at / z % y) as u32, (at % z) as u32).as_ivec3()
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
        self.dims
    }

    /// Bricks with storage.
    #[must_use]
    pub fn bricks(&self) -> usize {
        self.ranges.len()
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

    /// Bytes that the field takes in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let entries = self.top.capacity() + self.tables.capacity();
        entries * size_of::<u32>()
            + self.constants.capacity() * size_of::<f32>()
            + self.values.memory_bytes()
            + self.ranges.capacity() * size_of::<[f32; 2]>()
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

/// Linear index of a corner in a brick.
#[inline]
#[must_use]
pub fn corner_index(corner: IVec3) -> usize {
    (corner.x * 81 + corner.y * 9 + corner.z) as usize
}

/// The eight values around a cell; x-y rows of (z, z + 1).
#[derive(Debug, Clone, Copy)]
pub struct Corners([[f32; 2]; 4]);

impl Corners {
    /// Trilinear at `f` in \[0, 1\]^3.
    #[inline]
    #[must_use]
    pub fn at(&self, f: Vec3) -> f32 {
        let row = |r: [f32; 2]| (r[1] - r[0]).mul_add(f.z, r[0]);
        let [a, b, c, d] = self.0.map(row);
        let low = (b - a).mul_add(f.y, a);
        let high = (d - c).mul_add(f.y, c);
        (high - low).mul_add(f.x, low)
    }
}
