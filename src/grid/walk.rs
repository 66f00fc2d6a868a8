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
//! A piece therefore carries its length beside its rounded ends.

use glam::{DVec3, IVec3, Vec3};

use super::majorant::MajorantGrid;
use super::{Brick, Grid};
use crate::ray::{Ray, reciprocal};

/// A piece of a ray on which the field is a cubic in t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Begin, the ray's parameter.
    pub t_min: f32,
    /// End.
    pub t_max: f32,
    /// `t_max - t_min` before they were rounded.
    pub length: f32,
    /// Values at begin, middle and end.
    pub density: [f32; 3],
}

impl Piece {
    /// A piece of one value.
    #[inline]
    #[must_use]
    pub fn constant(t_min: f32, t_max: f32, density: f32) -> Self {
        Self {
            t_min,
            t_max,
            length: t_max - t_min,
            density: [density; 3],
        }
    }

    /// Exact integral of the field over the piece.
    #[inline]
    #[must_use]
    pub fn integral(&self) -> f32 {
        let [a, m, b] = self.density;
        self.length * (1.0 / 6.0) * (4.0f32.mul_add(m, a) + b)
    }
}

/// Visits the pieces of a local-space ray inside [t0, t1] where the field is not 0, in order,
/// until `visit` returns false. Counts evaluations of the field.
#[inline]
pub fn walk(
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &Ray,
    t0: f32,
    t1: f32,
    mut visit: impl FnMut(Piece) -> bool,
) -> u64 {
    let line = Line::new(ray);
    let mut lookups = 0;
    for segment in majorants.segments(ray, t0, t1) {
        if segment.majorant == 0.0 && segment.minorant == 0.0 || segment.t_max <= segment.t_min {
            continue;
        }
        if segment.majorant == segment.minorant {
            let (t_min, t_max) = (segment.t_min, segment.t_max);
            if !visit(Piece::constant(t_min, t_max, segment.majorant)) {
                return lookups;
            }
            continue;
        }
        let mut cells = Cells::new(&line, segment.t_min.into(), segment.t_max.into());
        while let Some((cell, from, mut to)) = cells.next() {
            let brick = cell >> 3i32;
            let values = match grid.brick(brick) {
                Brick::Constant(value) => {
                    while let Some((_, _, end)) = cells.next_in(brick) {
                        to = end;
                    }
                    let (t_min, t_max) = (from as f32, to as f32);
                    if value != 0.0 && t_min < t_max && !visit(Piece::constant(t_min, t_max, value))
                    {
                        return lookups;
                    }
                    continue;
                }
                Brick::Values(values) => values,
            };
            let mut next = Some((cell, from, to));
            // The field is continuous: a cell begins with the value that the last one ended with.
            let mut before = None;
            while let Some((cell, from, to)) = next {
                let corners = values.corners(cell);
                let at = |t: f64| corners.at(line.inside(cell, t));
                let first = before.unwrap_or_else(|| at(from));
                let density = [first, at(0.5 * (from + to)), at(to)];
                before = Some(density[2]);
                lookups += 2;
                let piece = Piece {
                    t_min: from as f32,
                    t_max: to as f32,
                    length: (to - from) as f32,
                    density,
                };
                // What f32 cannot tell from nothing is left out: 1e-4 voxels, once in 1e4 cells.
                if density != [0.0; 3] && piece.t_min < piece.t_max && !visit(piece) {
                    return lookups;
                }
                next = cells.next_in(brick);
            }
        }
    }
    lookups
}

/// A ray in f64.
struct Line {
    origin: DVec3,
    direction: DVec3,
    /// One over the direction; infinite where no face is ever reached.
    inverse: DVec3,
}

impl Line {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let direction = ray.direction.as_dvec3();
        let reached = reciprocal(ray.direction);
        let inverse = std::array::from_fn(|a| {
            if reached[a].is_infinite() {
                f64::INFINITY
            } else {
                1.0 / direction[a]
            }
        });
        Self {
            origin: ray.origin.as_dvec3(),
            direction,
            inverse: DVec3::from_array(inverse),
        }
    }

    #[inline]
    fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// Where in a cell the point at t is, in [0, 1].
    #[inline]
    fn inside(&self, cell: IVec3, t: f64) -> Vec3 {
        (self.at(t) - cell.as_dvec3())
            .as_vec3()
            .clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// The voxel cells that a ray crosses in [t, t_end]; tiles it exactly.
struct Cells<'a> {
    line: &'a Line,
    cell: IVec3,
    step: IVec3,
    /// t of the next face on each axis.
    next: DVec3,
    t: f64,
    t_end: f64,
}

impl<'a> Cells<'a> {
    #[inline]
    fn new(line: &'a Line, t: f64, t_end: f64) -> Self {
        let step = IVec3::from_array(std::array::from_fn(|a| {
            if line.inverse[a].is_infinite() {
                0
            } else if line.inverse[a] > 0.0 {
                1
            } else {
                -1
            }
        }));
        let mut this = Self {
            line,
            cell: line.at(t).floor().as_ivec3(),
            step,
            next: DVec3::INFINITY,
            t,
            t_end,
        };
        for a in 0..3 {
            // A start on a face belongs to the cell that the ray goes on into, and rounding may
            // have put it just behind one: skip cells already left.
            this.next[a] = this.face(a);
            while this.step[a] != 0 && this.next[a] <= t {
                this.cell[a] += this.step[a];
                let face = this.face(a);
                if face <= this.next[a] {
                    this.next[a] = f64::INFINITY;
                    break;
                }
                this.next[a] = face;
            }
        }
        this
    }

    /// t at which the ray leaves its cell along an axis.
    #[inline]
    fn face(&self, a: usize) -> f64 {
        if self.step[a] == 0 {
            return f64::INFINITY;
        }
        let side = self.cell[a] + i32::from(self.step[a] > 0);
        (f64::from(side) - self.line.origin[a]) * self.line.inverse[a]
    }

    /// The next cell, and where the ray enters and leaves it.
    #[inline]
    fn next(&mut self) -> Option<(IVec3, f64, f64)> {
        if self.t >= self.t_end {
            return None;
        }
        let axis = if self.next.x <= self.next.y {
            if self.next.x <= self.next.z { 0 } else { 2 }
        } else if self.next.y <= self.next.z {
            1
        } else {
            2
        };
        let (cell, enter) = (self.cell, self.t);
        self.t = self.next[axis].clamp(enter, self.t_end);
        self.cell[axis] += self.step[axis];
        self.next[axis] = self.face(axis);
        Some((cell, enter, self.t))
    }

    /// The same, while it is in a brick.
    #[inline]
    fn next_in(&mut self, brick: IVec3) -> Option<(IVec3, f64, f64)> {
        (self.cell >> 3i32 == brick).then(|| self.next()).flatten()
    }
}
