//! The segments of a ray over which bounds hold, and the room around a point in which they do.
//!
//! Segments tile [t0, t1] without gap or overlap: each begins at the very t where the last one
//! ended. The walk keeps the integer coordinates of its brick and moves at least one of them at
//! every step, never back, so it ends after at most as many steps as the grid has bricks along
//! its three axes, whatever rounding does to t.
//!
//! A room is a box: between two points of it a ray does not leave it, so that a flight which ends
//! in it needs no faces, and no walk.

use glam::{IVec3, Vec3};
use wide::{f32x4, i32x4};

use super::majorant::{Cell, MajorantGrid};
use super::{BRICK, TABLE};
use crate::ray::Ray;

/// What a box is widened by at least: twice what a point of a ray can be off by at the farthest
/// corner of the largest grid. Less: a ray that creeps along a face is put outside by rounding;
/// more: it looks up what is 0. \[voxels\]
const MARGIN: f32 = 1.0 / 64.0;
/// The same for each voxel between the corner of the grid and the start of the ray.
const MARGIN_PER_VOXEL: f32 = 4.0 * f32::EPSILON;

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
    /// The room around a point, if the field may differ from 0 there.
    #[inline]
    pub(crate) fn room(&self, p: f32x4) -> Option<Room> {
        let brick = brick_of(p);
        let cell = self.cell(brick)?;
        let corner = (brick & cell.mask()) << 3;
        let (low, high) = if cell.is_tight() {
            let (low, high) = cell.filled();
            (corner + low, corner + high)
        } else {
            (corner, corner + i32x4::splat(BRICK << cell.level()))
        };
        let room = Room {
            low: f32x4::from_i32x4(low).fast_max(four(self.support.min)),
            high: f32x4::from_i32x4(high).fast_min(four(self.support.max)),
            lodging: Lodging { brick, cell },
        };
        room.holds(p).then_some(room)
    }

    /// The segments of a local-space ray inside [t0, t1].
    #[inline]
    #[must_use]
    pub fn segments(&self, ray: &Ray, t0: f32, t1: f32) -> Segments<'_, true> {
        self.set_out(ray, None, [t0, t1])
    }

    /// Those for null collisions: a boxed brick is one segment, whole if its box costs more than it
    /// saves, else what is in the box; between segments there is nothing. `place` is that of the
    /// point at t0, if it is in a room.
    #[inline]
    pub(crate) fn flight(
        &self,
        ray: &Ray,
        place: Option<Lodging>,
        span: [f32; 2],
    ) -> Segments<'_, false> {
        self.set_out(ray, place, span)
    }

    #[inline(always)]
    fn set_out<const TILES: bool>(
        &self,
        ray: &Ray,
        place: Option<Lodging>,
        [t0, t1]: [f32; 2],
    ) -> Segments<'_, TILES> {
        let (origin, direction) = (four(ray.origin), four(ray.direction));
        // 0 for what never reaches a face within any finite t; the fourth lane is such an axis.
        let reaches = direction.abs().simd_ge(f32x4::splat(f32::MIN_POSITIVE));
        let inverse = reaches & (f32x4::ONE / direction);
        let mut this = Segments {
            grid: self,
            origin,
            direction,
            inverse,
            moves: inverse.simd_ne(f32x4::ZERO),
            up: bytemuck::cast(inverse.simd_gt(f32x4::ZERO)),
            margin: MARGIN.max(ray.origin.abs().max_element() * MARGIN_PER_VOXEL),
            t: t0,
            t_end: t0,
            brick: i32x4::ZERO,
            cell: None,
            top: i32x4::splat(-1),
            entry: Cell::NOTHING,
        };
        let (enter, leave) = this.crossing(four(self.support.min), four(self.support.max));
        let leave = least(leave, t1);
        if let Some(Lodging { brick, cell }) = place {
            (this.t_end, this.brick, this.cell) = (leave, brick, Some(cell));
            return this;
        }
        let enter = most(enter, t0);
        if enter < leave {
            (this.t, this.t_end) = (enter, leave);
            let highest = self.dims.as_ivec3() * TABLE - IVec3::ONE;
            let highest = i32x4::new([highest.x, highest.y, highest.z, 0]);
            let brick = brick_of(this.at(enter));
            this.brick = brick.min(highest).max(i32x4::ZERO);
        }
        this
    }
}

/// Three components as lanes; the fourth is 0.
#[inline]
pub(crate) fn four(v: Vec3) -> f32x4 {
    f32x4::new([v.x, v.y, v.z, 0.0])
}

/// The lesser of two; the second if one is not a number. One instruction, unlike `f32::min`.
#[inline]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two; the second if one is not a number.
#[inline]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The brick that a point is in, that towards 0 from it below 0; far outside where there is none.
#[inline]
fn brick_of(p: f32x4) -> i32x4 {
    p.fast_trunc_int() >> 3
}

/// A brick, and the cell that it is in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lodging {
    brick: i32x4,
    cell: Cell,
}

/// A box around a point and the bounds of the field in it, faces included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    low: f32x4,
    high: f32x4,
    pub(crate) lodging: Lodging,
}

impl Room {
    /// Smallest and largest density.
    #[inline]
    pub(crate) fn bounds(&self) -> [f32; 2] {
        [self.lodging.cell.minorant, self.lodging.cell.majorant]
    }

    /// True for a point inside or on a face; false for one that is not a number.
    #[inline]
    pub(crate) fn holds(&self, p: f32x4) -> bool {
        (p.simd_ge(self.low) & p.simd_le(self.high)).all()
    }
}

/// Iterator over the [`MajorantSegment`]s of a ray; all axes are stepped at a time and by masks,
/// since which one it is cannot be guessed. They tile the ray, or leave out what is empty of bricks.
#[derive(Debug, Clone)]
pub struct Segments<'a, const TILES: bool> {
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
    brick: i32x4,
    /// Its cell, if known.
    cell: Option<Cell>,
    /// A top cell, and its entry.
    top: i32x4,
    entry: Cell,
}

impl<const TILES: bool> Segments<'_, TILES> {
    /// The point at t.
    #[inline]
    fn at(&self, t: f32) -> f32x4 {
        self.direction.mul_add(f32x4::splat(t), self.origin)
    }

    /// The cell of the brick that the walk is in; mostly one of the table that the last one was in.
    #[inline]
    fn fetch(&mut self) -> Option<Cell> {
        let top: i32x4 = self.brick >> 4;
        if top != self.top {
            self.entry = self.grid.entry(top)?;
            self.top = top;
        }
        self.grid.cell_in(self.entry, self.brick)
    }

    /// Where the ray enters and leaves a box; the other way round if it misses.
    #[inline]
    fn crossing(&self, low: f32x4, high: f32x4) -> (f32, f32) {
        let a = (low - self.origin) * self.inverse;
        let b = (high - self.origin) * self.inverse;
        let infinity = f32x4::splat(f32::INFINITY);
        // An axis that is not moved along decides all or nothing.
        let outside = self.origin.simd_lt(low) | self.origin.simd_gt(high);
        let never = outside.bitselect(infinity, -infinity);
        let enter = self.moves.bitselect(a.fast_min(b), never).to_array();
        let leave = self.moves.bitselect(a.fast_max(b), -never).to_array();
        (
            most(most(enter[0], enter[1]), enter[2]),
            least(least(leave[0], leave[1]), leave[2]),
        )
    }

    /// The same of the box of the brick at a corner, widened by the margin.
    #[inline]
    fn crossing_filled(&self, corner: i32x4, cell: Cell) -> (f32, f32) {
        let (low, high) = cell.filled();
        let margin = f32x4::splat(self.margin);
        self.crossing(
            f32x4::from_i32x4(corner + low) - margin,
            f32x4::from_i32x4(corner + high) + margin,
        )
    }
}

impl<const TILES: bool> Iterator for Segments<'_, TILES> {
    type Item = MajorantSegment;

    #[inline(always)]
    fn next(&mut self) -> Option<MajorantSegment> {
        if self.t >= self.t_end {
            return None;
        }
        let cell = match self.cell.take() {
            Some(cell) => cell,
            None => self.fetch()?,
        };
        let mask = cell.mask();
        let low = self.brick & mask;
        // The face by which the ray leaves the cell: the high one of an axis on which it goes up.
        let face = low - (mask & self.up);
        let meets = (f32x4::from_i32x4(face << 3) - self.origin) * self.inverse;
        let infinity = f32x4::splat(f32::INFINITY);
        let meets = self.moves.bitselect(meets, infinity);
        let [x, y, z, _] = meets.to_array();
        let exit = least(least(x, y), z);
        let end = least(most(exit, self.t), self.t_end);
        let mut segment = MajorantSegment {
            t_min: self.t,
            t_max: end,
            majorant: cell.majorant,
            minorant: cell.minorant,
        };
        if TILES && cell.is_boxed() {
            let (enter, leave) = self.crossing_filled(low << 3, cell);
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
                self.cell = Some(cell);
                return Some(segment);
            }
        } else if !TILES && cell.is_tight() {
            let (enter, leave) = self.crossing_filled(low << 3, cell);
            let (from, to) = (most(enter, self.t), least(leave, end));
            if from <= to {
                (segment.t_min, segment.t_max) = (from, to);
            } else {
                (segment.minorant, segment.majorant) = (0.0, 0.0);
            }
        }
        self.t = end;
        if exit == f32::INFINITY {
            self.t = self.t_end;
            return Some(segment);
        }
        // Inside the cell on the other axes, beyond it on this one.
        let inside = brick_of(self.at(self.t)).max(low).min(low | !mask);
        let beyond = face + !self.up;
        let left: i32x4 = bytemuck::cast(meets.simd_le(f32x4::splat(exit)));
        self.brick = left.bitselect(beyond, inside);
        Some(segment)
    }
}
