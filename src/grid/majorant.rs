//! Bounds of the field, and the segments of a ray over which they hold.
//!
//! ```text
//! minorant(C) <= f(p) <= majorant(C)   for every p in cell C, faces included
//! ```
//!
//! The bounds are those of the *interpolated* field: a brick's 9^3 values are all that its cells
//! can interpolate between, so their extremes bound it exactly. Cells are cubes of 8, 16, 32 ...
//! voxels (merge.rs). Every brick's entry names the merged cell it is in, so a step is one fetch
//! and no descent, and empty space is crossed in the largest cubes that fit. A brick by itself
//! is empty outside the box of its values (place.rs): a ray meets its bounds only inside.
//!
//! Segments tile [t0, t1] without gap or overlap: each begins at the very t where the last one
//! ended. The walk keeps the integer coordinates of its brick and moves at least one of them at
//! every step, never back, so it ends after at most as many steps as the grid has bricks along
//! its three axes, whatever rounding does to t.

use glam::{IVec3, UVec3, Vec3};
use wide::{f32x4, i32x4};

use super::place::Place;
use super::{BRICK, Grid, TABLE, TABLE_BRICKS, in_table, top_cell, top_index};
use crate::ray::{Bounds, Ray, reciprocal};

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

/// What a box is widened by at least: twice what a point of a ray can be off by at the farthest
/// corner of the largest grid. Less: a ray that creeps along a face is put outside by rounding;
/// more: it looks up what is 0. \[voxels\]
const MARGIN: f32 = 1.0 / 64.0;
/// The same for each voxel between the corner of the grid and the start of the ray.
const MARGIN_PER_VOXEL: f32 = 4.0 * f32::EPSILON;

impl Cell {
    /// log2 of the cube's edge in bricks.
    #[inline]
    pub(super) fn level(self) -> u32 {
        self.link & LEVEL
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
    fn is_boxed(self) -> bool {
        self.link & BOXED != 0
    }

    /// Lowest and highest corner of a boxed brick's box, from the brick's corner on.
    #[inline]
    fn filled(self) -> (i32x4, i32x4) {
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

/// A piece of a ray and the bounds of the field along it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MajorantSegment {
    /// Begin, the ray's parameter.
    pub t_min: f32,
    /// End.
    pub t_max: f32,
    /// Largest density.
    pub majorant: f32,
    /// Smallest density.
    pub minorant: f32,
}

impl MajorantGrid {
    /// The merged cell that a brick is in; none outside the grid.
    #[inline]
    fn cell(&self, brick: IVec3) -> Option<Cell> {
        let c = (brick >> 4i32).as_uvec3();
        if c.cmpge(self.dims).any() {
            return None;
        }
        let cell = self.top[top_index(self.dims, c)];
        if cell.link & DESCEND == 0 {
            return Some(cell);
        }
        let table = (cell.link & !DESCEND) as usize;
        Some(self.tables[table * TABLE_BRICKS + in_table(brick)])
    }

    /// Smallest and largest density in the merged cell around a local point.
    #[must_use]
    pub fn bounds_at(&self, p: Vec3) -> [f32; 2] {
        self.cell(p.floor().as_ivec3() >> 3)
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

    /// The segments of a local-space ray inside [t0, t1].
    #[inline]
    #[must_use]
    pub fn segments(&self, ray: &Ray, t0: f32, t1: f32) -> Segments<'_> {
        let (t, t_end) = self.support.clip(ray, t0, t1).unwrap_or((t0, t0));
        let four = |v: Vec3| f32x4::new([v.x, v.y, v.z, 0.0]);
        let inverse = reciprocal(ray.direction);
        // 0 for what never reaches a face; the fourth lane is such an axis.
        let inverse = four(inverse.map(|i| if i.is_finite() { i } else { 0.0 }));
        let highest = self.dims.as_ivec3() * TABLE - IVec3::ONE;
        let start = ray.at(t) * (1.0 / BRICK as f32);
        Segments {
            grid: self,
            origin: four(ray.origin),
            direction: four(ray.direction),
            inverse,
            moves: inverse.simd_ne(f32x4::ZERO),
            up: bytemuck::cast(inverse.simd_gt(f32x4::ZERO)),
            margin: MARGIN.max(ray.origin.abs().max_element() * MARGIN_PER_VOXEL),
            t,
            t_end,
            brick: start
                .floor()
                .as_ivec3()
                .clamp(IVec3::ZERO, highest.max(IVec3::ZERO)),
        }
    }
}

/// Iterator over the [`MajorantSegment`]s of a ray; all axes are stepped at a time and by masks,
/// since which one it is cannot be guessed.
#[derive(Debug, Clone)]
pub struct Segments<'a> {
    grid: &'a MajorantGrid,
    origin: f32x4,
    direction: f32x4,
    /// One over the direction; 0 where no face is ever reached.
    inverse: f32x4,
    /// Set where faces are reached.
    moves: f32x4,
    /// Set where the ray goes up.
    up: i32x4,
    /// What boxes are widened by. \[voxels\]
    margin: f32,
    t: f32,
    t_end: f32,
    /// Brick that the walk is in.
    brick: IVec3,
}

impl Segments<'_> {
    /// Where the ray enters and leaves the box of a brick; the other way round if it misses.
    #[inline]
    fn crossing(&self, corner: i32x4, cell: Cell) -> (f32, f32) {
        let (low, high) = cell.filled();
        let low = f32x4::from_i32x4(corner + low) - f32x4::splat(self.margin);
        let high = f32x4::from_i32x4(corner + high) + f32x4::splat(self.margin);
        let a = (low - self.origin) * self.inverse;
        let b = (high - self.origin) * self.inverse;
        let infinity = f32x4::splat(f32::INFINITY);
        // An axis that is not moved along decides all or nothing.
        let outside = self.origin.simd_lt(low) | self.origin.simd_gt(high);
        let never = outside.bitselect(infinity, -infinity);
        let enter = self.moves.bitselect(a.fast_min(b), never).to_array();
        let leave = self.moves.bitselect(a.fast_max(b), -never).to_array();
        (
            enter[0].max(enter[1]).max(enter[2]),
            leave[0].min(leave[1]).min(leave[2]),
        )
    }
}

impl Iterator for Segments<'_> {
    type Item = MajorantSegment;

    #[inline]
    fn next(&mut self) -> Option<MajorantSegment> {
        if self.t >= self.t_end {
            return None;
        }
        let cell = self.grid.cell(self.brick)?;
        let size = i32x4::splat(1 << cell.level());
        let brick = i32x4::new([self.brick.x, self.brick.y, self.brick.z, 0]);
        let low = brick & -size;
        let high = low + size;
        // The face by which the ray leaves the cell.
        let faces = f32x4::from_i32x4(self.up.bitselect(high, low) << 3);
        let infinity = f32x4::splat(f32::INFINITY);
        let meets = (faces - self.origin) * self.inverse;
        let meets = self.moves.bitselect(meets, infinity);
        let [x, y, z, _] = meets.to_array();
        let exit = x.min(y).min(z);
        let mut segment = MajorantSegment {
            t_min: self.t,
            t_max: exit.clamp(self.t, self.t_end),
            majorant: cell.majorant,
            minorant: cell.minorant,
        };
        if cell.is_boxed() {
            let (enter, leave) = self.crossing(low << 3, cell);
            if enter < leave && self.t < enter && enter < segment.t_max {
                segment.t_max = enter;
            }
            if self.t >= enter && self.t < leave {
                segment.t_max = segment.t_max.min(leave);
            } else {
                (segment.minorant, segment.majorant) = (0.0, 0.0);
            }
            if segment.t_max < exit {
                // On in the same brick.
                self.t = segment.t_max;
                return Some(segment);
            }
        }
        self.t = segment.t_max;
        if exit == f32::INFINITY {
            self.t = self.t_end;
            return Some(segment);
        }
        // Inside the cell on the other axes, beyond it on this one.
        let p = self.direction.mul_add(f32x4::splat(self.t), self.origin);
        let p = (p * f32x4::splat(1.0 / BRICK as f32))
            .floor()
            .fast_trunc_int();
        let inside = p.max(low).min(high - i32x4::ONE);
        let beyond = self.up.bitselect(high, low - i32x4::ONE);
        let left: i32x4 = bytemuck::cast(meets.simd_le(f32x4::splat(exit)));
        let [x, y, z, _] = left.bitselect(beyond, inside).to_array();
        self.brick = IVec3::new(x, y, z);
        Some(segment)
    }
}
