//! The segments of a ray over which bounds hold.
//!
//! Segments tile [t0, t1] without gap or overlap: each begins at the very t where the last one
//! ended. The walk keeps the integer coordinates of its brick and moves at least one of them at
//! every step, never back, so it ends after at most as many steps as the grid has bricks along
//! its three axes, whatever rounding does to t.

use glam::IVec3;
use wide::{f32x4, i32x4};

use super::TABLE;
use super::tables::{Entry, Tables};
use crate::lanes::{four, greater, lesser};
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

/// The brick that a point is in, that towards 0 from it below 0; far outside where there is none.
#[inline]
fn brick_of(p: f32x4) -> i32x4 {
    p.fast_trunc_int() >> 3
}

/// Iterator over the [`MajorantSegment`]s of a ray; all axes are stepped at a time and by masks,
/// since which one it is cannot be guessed.
#[derive(Debug, Clone)]
pub(crate) struct Segments<'a, E> {
    tables: &'a Tables<E>,
    pub(super) origin: f32x4,
    pub(super) direction: f32x4,
    /// One over the direction; 0 where no face is ever reached.
    pub(super) inverse: f32x4,
    /// Set where faces are reached.
    moves: f32x4,
    /// Set where the ray goes up.
    up: i32x4,
    /// What boxes are widened by. \[voxels\]
    margin: f32,
    pub(super) t: f32,
    pub(super) t_end: f32,
    /// Brick that the walk comes to next.
    pub(super) brick: i32x4,
    /// Where the ray leaves the cell that the walk is in.
    exit: f32,
    /// Where it leaves the box of its values, and their bounds.
    leave: f32,
    bounds: [f32; 2],
    /// The top cell that the last segment is in, and its entry.
    pub(super) top: i32x4,
    pub(super) entry: E,
}

impl<'a, E: Entry> Segments<'a, E> {
    /// The segments of a local-space ray inside [t0, t1].
    #[inline(always)]
    pub(super) fn new(tables: &'a Tables<E>, ray: &Ray, [t0, t1]: [f32; 2]) -> Self {
        let (origin, direction) = (four(ray.origin), four(ray.direction));
        // 0 for what never reaches a face within any finite t; the fourth lane is such an axis.
        let reaches = direction.abs().simd_ge(f32x4::splat(f32::MIN_POSITIVE));
        let inverse = reaches & (f32x4::ONE / direction);
        let mut this = Segments {
            tables,
            origin,
            direction,
            inverse,
            moves: inverse.simd_ne(f32x4::ZERO),
            up: bytemuck::cast(inverse.simd_gt(f32x4::ZERO)),
            margin: MARGIN.max(ray.origin.abs().max_element() * MARGIN_PER_VOXEL),
            t: t0,
            t_end: t0,
            brick: i32x4::ZERO,
            exit: t0,
            leave: t0,
            bounds: [0.0; 2],
            top: i32x4::splat(-1),
            entry: E::NOTHING,
        };
        let support = &tables.support;
        let (enter, leave) = this.crossing(four(support.min), four(support.max));
        let (enter, leave) = (greater(enter, t0), lesser(leave, t1));
        if enter < leave {
            (this.t, this.t_end, this.exit) = (enter, leave, enter);
            let highest = tables.dims.as_ivec3() * TABLE - IVec3::ONE;
            let highest = i32x4::new([highest.x, highest.y, highest.z, 0]);
            let brick = brick_of(this.at(enter));
            this.brick = brick.min(highest).max(i32x4::ZERO);
        }
        this
    }

    /// The point at t.
    #[inline]
    pub(crate) fn at(&self, t: f32) -> f32x4 {
        self.direction.mul_add(f32x4::splat(t), self.origin)
    }

    /// The cell of the brick that the walk comes to; mostly one of the table that the last one was in.
    #[inline]
    fn fetch(&mut self) -> Option<E> {
        let top: i32x4 = self.brick >> 4;
        if top != self.top {
            self.entry = self.tables.entry(top)?;
            self.top = top;
        }
        self.tables.entry_in(self.entry, self.brick)
    }

    /// True where there is no segment more.
    #[inline]
    pub(crate) fn is_done(&self) -> bool {
        self.t >= self.t_end
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
            greater(greater(enter[0], enter[1]), enter[2]),
            lesser(lesser(leave[0], leave[1]), leave[2]),
        )
    }

    /// The same of a box in the brick at a corner, widened by the margin.
    #[inline]
    fn crossing_filled(&self, corner: i32x4, (low, high): (i32x4, i32x4)) -> (f32, f32) {
        let margin = f32x4::splat(self.margin);
        self.crossing(
            f32x4::from_i32x4(corner + low) - margin,
            f32x4::from_i32x4(corner + high) + margin,
        )
    }
}

impl<E: Entry> Iterator for Segments<'_, E> {
    type Item = MajorantSegment;

    #[inline(always)]
    fn next(&mut self) -> Option<MajorantSegment> {
        (!self.is_done()).then(|| self.advance())
    }
}

impl<E: Entry> Segments<'_, E> {
    /// The next segment, of a walk that is not done.
    #[inline(always)]
    pub(crate) fn advance(&mut self) -> MajorantSegment {
        if self.t < self.exit {
            return self.go_on();
        }
        let Some(cell) = self.fetch() else {
            // Beyond the grid, where rounding has put the last point of the support.
            self.exit = self.t_end;
            return self.segment(self.t_end, [0.0; 2]);
        };
        let mask = cell.mask();
        let low = self.brick & mask;
        // The face by which the ray leaves the cell: the high one of an axis on which it goes up.
        let face = low - (mask & self.up);
        let meets = (f32x4::from_i32x4(face << 3) - self.origin) * self.inverse;
        let infinity = f32x4::splat(f32::INFINITY);
        let meets = self.moves.bitselect(meets, infinity);
        let [x, y, z, _] = meets.to_array();
        let exit = lesser(lesser(x, y), z);
        self.exit = lesser(greater(exit, self.t), self.t_end);
        // Inside the cell on the other axes, beyond it on this one. In a single brick the others stay
        // as they are: a branch, guessed mostly right, which does not wait for the exit.
        let inside = if cell.level() == 0 {
            low
        } else {
            brick_of(self.at(self.exit)).max(low).min(low | !mask)
        };
        let beyond = face + !self.up;
        let left: i32x4 = bytemuck::cast(meets.simd_le(f32x4::splat(exit)));
        self.brick = left.bitselect(beyond, inside);
        let Some(filled) = cell.filled() else {
            return self.segment(self.exit, cell.bounds());
        };
        let (enter, leave) = self.crossing_filled(low << 3, filled);
        if enter >= leave || self.t >= leave || enter >= self.exit {
            return self.segment(self.exit, [0.0; 2]);
        }
        (self.leave, self.bounds) = (leave, cell.bounds());
        if self.t < enter {
            self.segment(enter, [0.0; 2])
        } else {
            self.go_on()
        }
    }

    /// The next segment in the same cell: that in the box of its values, or behind it.
    #[inline(always)]
    fn go_on(&mut self) -> MajorantSegment {
        if self.t < self.leave {
            self.segment(lesser(self.leave, self.exit), self.bounds)
        } else {
            self.segment(self.exit, [0.0; 2])
        }
    }

    /// The segment up to t, from where the last one ended.
    #[inline(always)]
    fn segment(&mut self, t: f32, [minorant, majorant]: [f32; 2]) -> MajorantSegment {
        MajorantSegment {
            t_min: std::mem::replace(&mut self.t, t),
            t_max: t,
            majorant,
            minorant,
        }
    }
}
