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
use super::{BRICK, Corners, Grid};
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
    /// A stretch of one value that is not 0.
    fn constant(&mut self, from: f64, to: f64, value: f32) -> bool;
    /// A cell by its corners.
    fn cell(&mut self, cell: &Crossing, corners: &Corners) -> bool;
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
        let mut cells = Cells::new(&line, from, to);
        let mut next = cells.next();
        while let Some(first) = next {
            let place = grid.place(first.cell);
            if place.is_constant() {
                let mut to = first.to;
                next = cells.next();
                while let Some(cell) = next.filter(|cell| cell.shares_brick(&first)) {
                    to = cell.to;
                    next = cells.next();
                }
                let value = grid.values.at(place.start());
                if value != 0.0 && !crossed.constant(first.from, to, value) {
                    return;
                }
                continue;
            }
            while let Some(cell) = next.filter(|cell| cell.shares_brick(&first)) {
                let spot = place.spot(cell.cell, grid.constants);
                let corners = grid.values.corners(spot);
                next = cells.next();
                if !crossed.cell(&cell, &corners) {
                    return;
                }
            }
        }
    }
}

/// Makes pieces.
struct Pieces<V> {
    line: Line,
    visit: V,
    /// Where the last cell ended, and the value there: the field is continuous, so the next one
    /// begins with it.
    last: (f64, f64),
    /// Integral over cells too short for a piece; the next one has it.
    sliver: f64,
    lookups: u64,
}

impl<V: FnMut(Piece) -> bool> Crossed for Pieces<V> {
    #[inline(always)]
    fn line(&self) -> &Line {
        &self.line
    }

    #[inline(always)]
    fn constant(&mut self, from: f64, to: f64, value: f32) -> bool {
        let piece = Piece {
            t_min: from as f32,
            t_max: to as f32,
            density: [value; 3],
            integral: f64::from(value) * (to - from),
        };
        piece.t_min >= piece.t_max || (self.visit)(piece)
    }

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
}

/// Adds up.
struct Depth {
    line: Line,
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
    fn cell(&mut self, cell: &Crossing, corners: &Corners) -> bool {
        let length = cell.to - cell.from;
        let middle = self.line.inside(cell.low, 0.5 * (cell.from + cell.to));
        let chord = self.line.direction * f64x4::splat(length);
        self.integral += length * corners.mean_along(middle, chord);
        self.lookups += 1;
        self.integral < self.enough
    }
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
    /// Set where faces are reached.
    moves: f64x4,
    /// From cell to cell.
    step: f64x4,
    /// From a cell's lowest voxel to the face that the ray leaves by.
    ahead: f64x4,
    /// The same steps as integers.
    steps: [i32; 3],
}

/// A cell on a ray.
#[derive(Clone, Copy)]
struct Crossing {
    /// Its lowest voxel.
    cell: [i32; 3],
    low: f64x4,
    /// Where the ray enters and leaves it.
    from: f64,
    to: f64,
}

impl Crossing {
    /// True if both cells are in one brick.
    #[inline]
    fn shares_brick(&self, other: &Self) -> bool {
        let ([a, b, c], [x, y, z]) = (self.cell, other.cell);
        ((a ^ x) | (b ^ y) | (c ^ z)) & -BRICK == 0
    }
}

impl Line {
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
        Self {
            origin: four(ray.origin.to_array()),
            direction: four(direction),
            inverse: of_axis(&|a| 1.0 / direction[a]),
            moves: step.simd_ne(f64x4::ZERO),
            step,
            ahead: step.fast_max(f64x4::ZERO),
            steps: std::array::from_fn(|a| step.to_array()[a] as i32),
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
/// time and by masks: which one it is cannot be guessed.
struct Cells<'a> {
    line: &'a Line,
    cell: [i32; 3],
    /// The faces by which the ray leaves the cell.
    faces: f64x4,
    /// t at which it meets each.
    next: f64x4,
    t: f64,
    t_end: f64,
}

/// Faces that rounding may put behind a start: one on each axis, and one to spare.
const BEHIND: usize = 4;

impl<'a> Cells<'a> {
    #[inline]
    fn new(line: &'a Line, t: f64, t_end: f64) -> Self {
        let low = line.at(t).floor();
        let [x, y, z, _] = low.to_array();
        let faces = low + line.ahead;
        let mut this = Self {
            line,
            cell: [x as i32, y as i32, z as i32],
            faces,
            next: line.meets(faces),
            t,
            t_end,
        };
        // A start on a face belongs to the cell that the ray goes on into.
        let now = f64x4::splat(t);
        for _ in 0..BEHIND {
            let behind = this.next.simd_le(now);
            if !behind.any() {
                return this;
            }
            this.step(behind);
        }
        // So far away that f64 does not tell the faces apart: they are never met.
        let behind = this.next.simd_le(now);
        this.next = behind.bitselect(f64x4::splat(f64::INFINITY), this.next);
        this
    }

    /// On to the next cell along the axes of a mask.
    #[inline]
    fn step(&mut self, mask: f64x4) {
        self.faces += mask & self.line.step;
        self.next = self.line.meets(self.faces);
        let axes = mask.to_bitmask() as i32;
        for (a, (cell, step)) in self.cell.iter_mut().zip(self.line.steps).enumerate() {
            *cell += step & -(axes >> a & 1);
        }
    }

    /// The next cell.
    #[inline]
    fn next(&mut self) -> Option<Crossing> {
        if self.t >= self.t_end {
            return None;
        }
        let [x, y, z, _] = self.next.to_array();
        let nearest = x.min(y).min(z);
        let crossing = Crossing {
            cell: self.cell,
            low: self.faces - self.line.ahead,
            from: self.t,
            to: nearest.clamp(self.t, self.t_end),
        };
        self.t = crossing.to;
        self.step(self.next.simd_le(f64x4::splat(nearest)));
        Some(crossing)
    }
}
