//! The field along a ray, voxel cell by voxel cell.
//!
//! Within one cell of a trilinear field the value along a ray is a cubic in t, so Simpson's rule
//!
//! ```text
//! integral over [a, b] = (b - a) / 6 * (f(a) + 4 f((a + b) / 2) + f(b))
//! ```
//!
//! integrates it exactly. A cell costs two evaluations from one fetch of its corners (its first
//! value is the last of the cell before), a constant brick one piece however long the ray is in
//! it, empty space nothing at all. Pieces tile the ray inside the grid's support in order.
//!
//! Faces and places inside cells are computed in f64: in f32 a ray that starts a thousand voxels
//! away knows where it is to 1e-4 of a voxel, and the integral to as much of the field's change.
//! A piece therefore carries its integral beside its rounded ends.

use wide::f64x4;

use super::majorant::MajorantGrid;
use super::place::Spot;
use super::values::Values;
use super::{BRICK, Bends, Corners, Grid, TOP_LOG2};
use crate::ray::{ExactRay, reciprocal};

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
        visit,
        constant: (0.0, 0.0, 0.0),
        last: (f64::NAN, 0.0),
        sliver: 0.0,
        lookups: 0,
    };
    cross(grid, majorants, ray, [t0, t1], &mut pieces);
    pieces.lookups
}

/// Integral of the field along a local-space ray inside [t0, t1], or up to a cell behind where it
/// reaches `enough`; and evaluations of the field.
///
/// The integral alone needs one evaluation a cell, with the field's mixed derivatives there:
/// along a chord u through the middle m of a cell the even part of the cubic is
///
/// ```text
/// f(m) + s^2 (u_x u_y f_xy + u_x u_z f_xz + u_y u_z f_yz)(m)      s in [-1/2, 1/2]
/// ```
///
/// and the mean of s^2 is 1/12.
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
    /// Cells in order.
    fn cells(&mut self, values: &Values, cells: &[Crossing]) -> bool;
    /// The end.
    fn end(&mut self);
}

/// Cells that are found before the first of them is fetched, to begin with and at most: twice as
/// many each time. A ray that ends early has found as many in vain. More at a time: no more
/// fetches overlap, and a short ray pays for the room.
const AHEAD: [usize; 2] = [8, 32];

/// Shows the field along a ray to `crossed`.
///
/// Cells are found ahead of their values. Where a segment ends is guessed wrongly once for each
/// of them, and a wrong guess must not wait for memory: what is fetched in one go overlaps.
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
    let most = 3.0 * f64::from(grid.dims.max_element()) * f64::from(1 << TOP_LOG2);
    let [mut room, highest] = AHEAD;
    let mut ahead = [Crossing::NONE; AHEAD[1]];
    let mut found = 0;
    let mut at = [i32::MIN; 3];
    let mut brick = grid.place(at).open(grid.constants);
    for segment in majorants.segments(&ray.rounded(), t0, t1) {
        if segment.majorant == 0.0 && segment.minorant == 0.0 || segment.t_max <= segment.t_min {
            continue;
        }
        let [from, to] = [segment.t_min, segment.t_max].map(f64::from);
        if segment.majorant == segment.minorant {
            if !crossed.cells(&grid.values, &ahead[..found])
                || !crossed.constant(from, to, segment.majorant)
            {
                return;
            }
            found = 0;
            continue;
        }
        let mut cells = Cells::new(&line, from, to, most);
        while let Some((cell, crossing)) = cells.next() {
            let other = |(a, b): (&i32, &i32)| a ^ b;
            if at.iter().zip(&cell).map(other).fold(0, |all, a| all | a) & -BRICK != 0 {
                at = cell;
                brick = grid.place(cell).open(grid.constants);
            }
            ahead[found] = Crossing {
                spot: brick.spot(cell),
                ..crossing
            };
            found += 1;
            if found == room {
                if !crossed.cells(&grid.values, &ahead[..found]) {
                    return;
                }
                found = 0;
                room = highest.min(2 * room);
            }
        }
    }
    if crossed.cells(&grid.values, &ahead[..found]) {
        crossed.end();
    }
}

/// Makes pieces.
struct Pieces<V> {
    line: Line,
    visit: V,
    /// A stretch of one value, which may go on.
    constant: (f64, f64, f32),
    /// Where the last cell ended, and the value there: the field is continuous, so the next one
    /// begins with it.
    last: (f64, f64),
    /// Integral over cells too short for a piece; the next one has it.
    sliver: f64,
    lookups: u64,
}

impl<V: FnMut(Piece) -> bool> Pieces<V> {
    #[inline(always)]
    fn cell(&mut self, cell: &Crossing, corners: &Corners) -> bool {
        let at = |t: f64| corners.at_exactly(self.line.inside(cell.low, t));
        let (from, value) = self.last;
        let begin = if from == cell.from {
            value
        } else {
            at(cell.from)
        };
        let end = at(cell.to);
        let middle = at(0.5 * (cell.from + cell.to));
        let mut piece = Piece::cubic(cell.from, cell.to, [begin, middle, end]);
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

    /// The stretch of one value as a piece.
    #[inline]
    fn stretch(&mut self) -> bool {
        let (from, to, value) = std::mem::take(&mut self.constant);
        let piece = Piece {
            t_min: from as f32,
            t_max: to as f32,
            density: [value; 3],
            integral: f64::from(value) * (to - from),
        };
        value == 0.0 || piece.t_min >= piece.t_max || (self.visit)(piece)
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
        let go_on = self.stretch();
        self.constant = (from, to, value);
        go_on
    }

    #[inline(always)]
    fn cells(&mut self, values: &Values, cells: &[Crossing]) -> bool {
        for cell in cells {
            let go_on = if cell.spot.is_constant() {
                self.constant(cell.from, cell.to, values.at(cell.spot.start))
            } else {
                self.stretch() && self.cell(cell, &values.corners(cell.spot))
            };
            if !go_on {
                return false;
            }
        }
        true
    }

    #[inline(always)]
    fn end(&mut self) {
        self.stretch();
    }
}

/// Adds up.
struct Depth {
    line: Line,
    bends: Bends,
    integral: f64,
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
    fn cells(&mut self, values: &Values, cells: &[Crossing]) -> bool {
        let mut sum = f64x4::ZERO;
        for cell in cells {
            let length = cell.to - cell.from;
            let middle = self.line.inside(cell.low, 0.5 * (cell.from + cell.to));
            let corners = values.corners(cell.spot);
            let mean = corners.mean_along(middle, length * length, &self.bends);
            sum = mean.mul_add(f64x4::splat(length), sum);
            self.lookups += u64::from(!cell.spot.is_constant());
        }
        let [a, b, c, d] = sum.to_array();
        self.integral += (a + c) + (b + d);
        self.integral < self.enough
    }

    #[inline(always)]
    fn end(&mut self) {}
}

/// Integral of a cubic over a length, by its values at begin, middle and end.
#[inline]
fn simpson(length: f64, [begin, middle, end]: [f64; 3]) -> f64 {
    length * (1.0 / 6.0) * (4.0f64.mul_add(middle, begin) + end)
}

/// A ray in f64, its three axes side by side.
#[derive(Clone, Copy)]
struct Line {
    origin: f64x4,
    direction: f64x4,
    /// One over the direction; 0 where no face is ever reached.
    inverse: f64x4,
    /// From face to face.
    between: f64x4,
    /// Set where faces are reached.
    moves: f64x4,
    /// From cell to cell.
    step: f64x4,
    /// From a cell's lowest voxel to the face that the ray leaves by.
    ahead: f64x4,
    /// The steps along the axes of each mask.
    steps: [[i32; 3]; 8],
}

/// A cell on a ray.
#[derive(Clone, Copy)]
struct Crossing {
    /// Its lowest voxel.
    low: f64x4,
    /// Where the ray enters and leaves it.
    from: f64,
    to: f64,
    /// Where its corners are.
    spot: Spot,
}

impl Crossing {
    const NONE: Self = Self {
        low: f64x4::ZERO,
        from: 0.0,
        to: 0.0,
        spot: Spot::FIRST,
    };
}

impl Line {
    #[inline]
    fn new(ray: &ExactRay) -> Self {
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
        let [x, y, z, _] = step.to_array().map(|s| s as i32);
        let bit = |mask: usize, axis: usize, step: i32| (mask >> axis & 1) as i32 * step;
        Self {
            origin: four(ray.origin.to_array()),
            direction: four(direction),
            inverse,
            between: inverse.abs(),
            moves: step.simd_ne(f64x4::ZERO),
            step,
            ahead: step.fast_max(f64x4::ZERO),
            steps: std::array::from_fn(|m| [bit(m, 0, x), bit(m, 1, y), bit(m, 2, z)]),
        }
    }

    #[inline]
    fn at(&self, t: f64) -> f64x4 {
        self.direction.mul_add(f64x4::splat(t), self.origin)
    }

    /// Where in a cell the point at t is, in [0, 1].
    #[inline]
    fn inside(&self, low: f64x4, t: f64) -> f64x4 {
        (self.at(t) - low)
            .fast_max(f64x4::ZERO)
            .fast_min(f64x4::ONE)
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
/// from the first and the last, so that the end of the loop does not wait for the last step.
struct Cells<'a> {
    line: &'a Line,
    cell: [i32; 3],
    /// The cell's lowest voxel.
    low: f64x4,
    /// t at which the ray meets the faces by which it leaves the cell.
    next: f64x4,
    t: f64,
    t_end: f64,
    /// Cells that are left.
    left: u32,
}

/// What may be missing at either end of a segment, over t: its ends are rounded to f32. What is
/// less is taken as the next cell's: it would be a cell more for each segment, of no length.
const SLIVER: f64 = f32::EPSILON as f64;

impl<'a> Cells<'a> {
    #[inline(always)]
    fn new(line: &'a Line, t: f64, t_end: f64, most: f64) -> Self {
        let middle = 0.5 * (t + t_end);
        let sliver = SLIVER * t_end;
        let low = line.at(lesser(t + sliver, middle)).floor();
        let last = line.at(greater(t_end - sliver, middle)).floor();
        // One axis at a time; what is stepped along two at once leaves cells of no length.
        let [x, y, z, _] = ((last - low) * line.step).to_array();
        let [a, b, c, _] = low.to_array();
        Self {
            line,
            cell: [a as i32, b as i32, c as i32],
            low,
            next: line.meets(low + line.ahead),
            t,
            t_end,
            left: 1 + lesser(x + y + z, most) as u32,
        }
    }

    /// The next cell, and its lowest voxel.
    #[inline(always)]
    fn next(&mut self) -> Option<([i32; 3], Crossing)> {
        self.left = self.left.checked_sub(1)?;
        let [x, y, z, _] = self.next.to_array();
        let nearest = lesser(lesser(x, y), z);
        let to = lesser(greater(nearest, self.t), self.t_end);
        let cell = self.cell;
        let crossing = Crossing {
            low: self.low,
            from: self.t,
            to: if self.left == 0 { self.t_end } else { to },
            spot: Spot::FIRST,
        };
        self.t = to;
        let mask = self.next.simd_le(f64x4::splat(nearest));
        self.next += mask & self.line.between;
        self.low += mask & self.line.step;
        let steps = self.line.steps[(mask.to_bitmask() & 7) as usize];
        for (c, step) in self.cell.iter_mut().zip(steps) {
            *c = c.wrapping_add(step);
        }
        Some((cell, crossing))
    }
}

/// The lesser of two numbers, in one instruction.
#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The greater of two numbers, in one instruction.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
