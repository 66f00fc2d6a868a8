//! The field along a ray, voxel cell by voxel cell.
//!
//! Within one cell of a trilinear field the value along a ray is a cubic in t. Along a chord u
//! through the middle m of a cell its even part is
//!
//! ```text
//! f(m) + s^2 (u_x u_y f_xy + u_x u_z f_xz + u_y u_z f_yz)(m)      s in [-1/2, 1/2]
//! ```
//!
//! and the mean of s^2 is 1/12: one evaluation with the field's mixed derivatives integrates a cell
//! exactly. A piece has the value at its end besides (its first is the last of the cell before). A
//! stretch of one value is one piece however long, empty space nothing at all. Pieces tile the ray
//! inside the grid's support in order, but for what is 0.
//!
//! Faces and places inside cells are computed in f64: in f32 a ray that starts a thousand voxels
//! away knows where it is to 1e-4 of a voxel, and the integral to as much of the field's change.
//! A piece therefore carries its integral beside its rounded ends.

use wide::f64x4;

use super::cells::{Boxed, Cells, Crossing, Line};
use super::corners::{Bends, Corners};
use super::majorant::MajorantGrid;
use super::{Grid, TOP_LOG2};
use crate::ray::ExactRay;

/// A piece of a ray on which the field is a cubic in t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Begin, the ray's parameter.
    pub t_min: f32,
    /// End.
    pub t_max: f32,
    /// Values at begin, middle and end.
    pub density: [f32; 3],
    /// Integral of the field over the piece, its ends as they were before they were rounded.
    pub integral: f64,
}

impl Piece {
    /// A piece of one value.
    #[inline]
    #[must_use]
    pub fn constant(t_min: f32, t_max: f32, density: f32) -> Self {
        Self {
            t_min,
            t_max,
            density: [density; 3],
            integral: f64::from(density) * (f64::from(t_max) - f64::from(t_min)),
        }
    }

    /// A piece by its values at begin, middle and end.
    #[inline]
    #[must_use]
    pub fn cubic(from: f64, to: f64, values: [f64; 3]) -> Self {
        Self {
            t_min: from as f32,
            t_max: to as f32,
            density: values.map(|v| v as f32),
            integral: simpson(to - from, values),
        }
    }
}

/// Visits the pieces of a local-space ray inside [t0, t1] where the field is not 0, in order,
/// until `visit` returns false. Counts evaluations of the field.
#[inline]
pub fn walk(
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &ExactRay,
    t0: f32,
    t1: f32,
    visit: impl FnMut(Piece) -> bool,
) -> u64 {
    let mut pieces = Pieces {
        line: Line::new(ray),
        bends: Bends::new(ray.direction),
        visit,
        constant: (0.0, 0.0, 0.0),
        last: (f64::NAN, 0.0),
        sliver: 0.0,
        lookups: 0,
    };
    cross(grid, majorants, ray, [t0, t1], &mut pieces);
    if pieces.constant.2 != 0.0 {
        pieces.stretch();
    }
    pieces.lookups
}

/// Integral of the field along a local-space ray inside [t0, t1], or up to the end of the cell of
/// the bounds in which it reaches `enough`; and evaluations of the field.
#[inline]
pub fn integral(
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &ExactRay,
    [t0, t1]: [f32; 2],
    enough: f64,
) -> (f64, u64) {
    let mut depth = Depth {
        line: Line::new(ray),
        bends: Bends::new(ray.direction),
        integral: 0.0,
        segment: f64x4::ZERO,
        enough,
        lookups: 0,
    };
    cross(grid, majorants, ray, [t0, t1], &mut depth);
    (depth.integral, depth.lookups)
}

/// What is done with the field along a ray; false ends the walk.
trait Crossed {
    /// The ray as it was taken in.
    fn line(&self) -> &Line;
    /// A stretch of one value.
    fn constant(&mut self, from: f64, to: f64, value: f32) -> bool;
    /// A cell by its corners, which may all be one value.
    fn cell(&mut self, cell: &Crossing, corners: &Corners, is_constant: bool) -> bool;
    /// The end of a segment.
    fn pause(&mut self) -> bool;
}

/// Shows the field along a ray to `crossed`.
#[inline(always)]
fn cross(
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &ExactRay,
    [t0, t1]: [f32; 2],
    crossed: &mut impl Crossed,
) {
    let line = *crossed.line();
    // More than any ray crosses.
    let most = 3.0 * f64::from(grid.dims().max_element()) * f64::from(1 << TOP_LOG2);
    let mut brick = Boxed::NONE;
    for segment in majorants.segments(&ray.rounded(), t0, t1) {
        if segment.majorant == 0.0 && segment.minorant == 0.0 || segment.t_max <= segment.t_min {
            continue;
        }
        let [from, to] = [segment.t_min, segment.t_max].map(f64::from);
        if segment.majorant == segment.minorant {
            if !crossed.constant(from, to, segment.majorant) {
                return;
            }
            continue;
        }
        let mut cells = Cells::new(&line, from, to, most);
        while let Some(cell) = cells.next() {
            if !brick.is_filled(cell.low) {
                if brick.has(cell.low) {
                    continue;
                }
                brick = Boxed::around(grid, cell.low);
                if !brick.is_filled(cell.low) {
                    continue;
                }
            }
            let spot = brick.spot(cell.low);
            if !crossed.cell(&cell, &grid.values.corners(spot), spot.is_constant()) {
                return;
            }
        }
        if !crossed.pause() {
            return;
        }
    }
}

/// Makes pieces.
struct Pieces<V> {
    line: Line,
    bends: Bends,
    visit: V,
    /// A stretch of one value, which may go on; of 0, where there is none.
    constant: (f64, f64, f32),
    /// Where the last cell ended, and the value there: the field is continuous, so the next one
    /// begins with it.
    last: (f64, f64),
    /// Integral over cells too short for a piece; the next one has it.
    sliver: f64,
    lookups: u64,
}

impl<V: FnMut(Piece) -> bool> Pieces<V> {
    /// A cell as a piece.
    #[inline(always)]
    fn piece(&mut self, cell: &Crossing, corners: &Corners) -> bool {
        let (from, value) = self.last;
        let begin = if from == cell.from {
            value
        } else {
            self.begin(cell, corners)
        };
        let end = corners.at_exactly(self.line.inside(cell.low, cell.to));
        let (place, length) = self.line.middle(cell);
        let mean = corners.mean_along(place, length * length, &self.bends);
        let mut piece = Piece {
            t_min: cell.from as f32,
            t_max: cell.to as f32,
            density: [begin, corners.at_exactly(place), end].map(|v| v as f32),
            integral: length * sum(mean),
        };
        piece.integral += self.sliver;
        self.last = (cell.to, end);
        self.lookups += 2;
        if piece.t_min >= piece.t_max {
            // Ends that f32 does not tell apart: where a segment begins, mostly.
            self.sliver = piece.integral;
            return true;
        }
        self.sliver = 0.0;
        piece.integral == 0.0 || (self.visit)(piece)
    }

    /// The value at the begin of a cell that follows no other: out of the way of those that do.
    #[inline(never)]
    fn begin(&self, cell: &Crossing, corners: &Corners) -> f64 {
        corners.at_exactly(self.line.inside(cell.low, cell.from))
    }

    /// The stretch of one value as a piece: out of the way as well.
    #[inline(never)]
    fn stretch(&mut self) -> bool {
        let (from, to, value) = std::mem::take(&mut self.constant);
        let piece = Piece {
            t_min: from as f32,
            t_max: to as f32,
            density: [value; 3],
            integral: f64::from(value) * (to - from),
        };
        piece.t_min >= piece.t_max || (self.visit)(piece)
    }
}

impl<V: FnMut(Piece) -> bool> Crossed for Pieces<V> {
    #[inline(always)]
    fn line(&self) -> &Line {
        &self.line
    }

    #[inline(always)]
    fn constant(&mut self, from: f64, to: f64, value: f32) -> bool {
        let (begin, end, before) = self.constant;
        if end == from && before == value {
            self.constant = (begin, to, value);
            return true;
        }
        let go_on = before == 0.0 || self.stretch();
        if go_on {
            self.constant = (from, to, value);
        }
        go_on
    }

    #[inline(always)]
    fn cell(&mut self, cell: &Crossing, corners: &Corners, is_constant: bool) -> bool {
        // Where faces are met together cells of no length follow, and not in their places: the next
        // piece must not begin with a value of theirs.
        if cell.to <= cell.from {
            return true;
        }
        if is_constant {
            return self.constant(cell.from, cell.to, corners.get([0; 3]));
        }
        let (.., before) = self.constant;
        (before == 0.0 || self.stretch()) && self.piece(cell, corners)
    }

    #[inline(always)]
    fn pause(&mut self) -> bool {
        true
    }
}

/// Adds up.
struct Depth {
    line: Line,
    bends: Bends,
    /// Up to the end of the last segment.
    integral: f64,
    /// Since then, in lanes.
    segment: f64x4,
    enough: f64,
    lookups: u64,
}

impl Crossed for Depth {
    #[inline(always)]
    fn line(&self) -> &Line {
        &self.line
    }

    #[inline(always)]
    fn constant(&mut self, from: f64, to: f64, value: f32) -> bool {
        self.integral += f64::from(value) * (to - from);
        self.integral < self.enough
    }

    #[inline(always)]
    fn cell(&mut self, cell: &Crossing, corners: &Corners, is_constant: bool) -> bool {
        let (place, length) = self.line.middle(cell);
        let mean = corners.mean_along(place, length * length, &self.bends);
        self.segment = mean.mul_add(f64x4::splat(length), self.segment);
        self.lookups += u64::from(!is_constant);
        true
    }

    #[inline(always)]
    fn pause(&mut self) -> bool {
        self.integral += sum(std::mem::take(&mut self.segment));
        self.integral < self.enough
    }
}

/// The sum of four lanes.
#[inline(always)]
fn sum(v: f64x4) -> f64 {
    let [a, b, c, d] = v.to_array();
    (a + c) + (b + d)
}

/// Integral of a cubic over a length, by its values at begin, middle and end.
#[inline]
fn simpson(length: f64, [begin, middle, end]: [f64; 3]) -> f64 {
    length * (1.0 / 6.0) * (4.0f64.mul_add(middle, begin) + end)
}
