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

use glam::{IVec3, Vec3};

use super::majorant::MajorantGrid;
use super::{BRICK, Brick, Grid};
use crate::ray::{Ray, reciprocal};

/// A piece of a ray on which the field is a cubic in t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Begin, the ray's parameter.
    pub t_min: f32,
    /// End.
    pub t_max: f32,
    /// Values at begin, middle and end.
    pub density: [f32; 3],
}

impl Piece {
    /// Exact integral of the field over the piece.
    #[inline]
    #[must_use]
    pub fn integral(&self) -> f32 {
        let [a, m, b] = self.density;
        (self.t_max - self.t_min) * (1.0 / 6.0) * (4.0f32.mul_add(m, a) + b)
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
    let inverse = reciprocal(ray.direction);
    let mut lookups = 0;
    for segment in majorants.segments(ray, t0, t1) {
        if segment.majorant == 0.0 && segment.minorant == 0.0 || segment.t_max <= segment.t_min {
            continue;
        }
        if segment.majorant == segment.minorant {
            let piece = Piece {
                t_min: segment.t_min,
                t_max: segment.t_max,
                density: [segment.majorant; 3],
            };
            if !visit(piece) {
                return lookups;
            }
            continue;
        }
        let mut bricks = Cells::new(ray, inverse, segment.t_min, segment.t_max, BRICK as f32);
        while let Some((brick, b0, b1)) = bricks.next() {
            if b1 <= b0 {
                continue;
            }
            match grid.brick(brick) {
                Brick::Constant(0.0) => {}
                Brick::Constant(value) => {
                    if !visit(Piece {
                        t_min: b0,
                        t_max: b1,
                        density: [value; 3],
                    }) {
                        return lookups;
                    }
                }
                Brick::Values(values) => {
                    let first = brick * BRICK;
                    let last = first + IVec3::splat(BRICK - 1);
                    let mut cells = Cells::new(ray, inverse, b0, b1, 1.0);
                    while let Some((cell, c0, c1)) = cells.next() {
                        if c1 <= c0 {
                            continue;
                        }
                        // At a corner rounding may step out of the brick before its end: its last
                        // cell stands in, not the one that wraps around to its other side.
                        let cell = cell.clamp(first, last);
                        let low = cell.as_vec3();
                        let corners = values.corners(cell - first);
                        let at =
                            |t: f32| corners.at((ray.at(t) - low).clamp(Vec3::ZERO, Vec3::ONE));
                        let density = [at(c0), at(0.5 * (c0 + c1)), at(c1)];
                        lookups += 2;
                        if density == [0.0; 3] {
                            continue;
                        }
                        if !visit(Piece {
                            t_min: c0,
                            t_max: c1,
                            density,
                        }) {
                            return lookups;
                        }
                    }
                }
            }
        }
    }
    lookups
}

/// The cubic cells of a given edge that a ray crosses in [t, t_end]; tiles it exactly.
struct Cells {
    origin: Vec3,
    inverse: Vec3,
    edge: f32,
    cell: IVec3,
    step: IVec3,
    /// t of the next face on each axis.
    next: Vec3,
    t: f32,
    t_end: f32,
}

impl Cells {
    #[inline]
    fn new(ray: &Ray, inverse: Vec3, t: f32, t_end: f32, edge: f32) -> Self {
        let at = |t: f32| (ray.at(t) / edge).floor().as_ivec3();
        // A start on a face belongs to the cell that the ray goes on into: the one at the middle
        // of a short way ahead decides, bounded by the end.
        let cell = at(t);
        let step = IVec3::from_array(std::array::from_fn(|a| {
            if inverse[a].is_infinite() {
                0
            } else if inverse[a] > 0.0 {
                1
            } else {
                -1
            }
        }));
        let mut this = Self {
            origin: ray.origin,

            inverse,
            edge,
            cell,
            step,
            next: Vec3::INFINITY,
            t,
            t_end,
        };
        for a in 0..3 {
            // Rounding may have put the start just behind a face: skip cells already left.
            this.next[a] = this.face(a);
            while this.step[a] != 0 && this.next[a] <= t {
                this.cell[a] += this.step[a];
                let face = this.face(a);
                if face <= this.next[a] {
                    this.next[a] = f32::INFINITY;
                    break;
                }
                this.next[a] = face;
            }
        }
        this
    }

    /// t at which the ray leaves its cell along an axis.
    #[inline]
    fn face(&self, a: usize) -> f32 {
        if self.step[a] == 0 {
            return f32::INFINITY;
        }
        let side = self.cell[a] + i32::from(self.step[a] > 0);
        (side as f32 * self.edge - self.origin[a]) * self.inverse[a]
    }

    /// The next cell, and where the ray enters and leaves it.
    #[inline]
    fn next(&mut self) -> Option<(IVec3, f32, f32)> {
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
        self.next[axis] = if self.step[axis] == 0 {
            f32::INFINITY
        } else {
            self.face(axis)
        };
        Some((cell, enter, self.t))
    }
}
