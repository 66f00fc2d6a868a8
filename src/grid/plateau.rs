//! Plateaus: fields with one value all over a box of voxels, and 0 around it.
//!
//! ```text
//! f(p) = value * prod_axis ramp(p_axis)     ramp(x) = min(1, x - (a - 1), (b + 1) - x), 0 outside
//! ```
//!
//! The trilinear interpolant of voxels that are `value` from a to b and 0 elsewhere, exactly. It
//! takes no memory and no look-up. Along a ray it is a cubic between the planes a - 1, a, b and
//! b + 1 of each axis, 13 pieces at most, so Simpson's rule integrates it exactly however large the
//! box is.

use glam::{DVec3, IVec3, Vec3};

use super::walk::Piece;
use super::{BRICK, Brick, CONSTANT, Grid, TABLE, top_index};
use crate::ray::{Bounds, ExactRay};

/// See the module's page. Coordinates are those of the grid that it was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plateau {
    /// The value.
    pub value: f32,
    /// From the first voxel with the value to the last. \[local voxels\]
    pub core: Bounds,
}

/// Bricks that are looked at, at most, lest a tile of 4096^3 voxels take seconds: about 0.05 s. Boxes
/// of more on their faces stay grids, which are nearly as fast where they are that large.
const MOST_BRICKS: u32 = 1 << 22;

/// True if `holds` for each integer point of a box, both corners included; asks until one fails.
fn each(low: IVec3, high: IVec3, mut holds: impl FnMut(IVec3) -> bool) -> bool {
    (low.x..=high.x)
        .all(|x| (low.y..=high.y).all(|y| (low.z..=high.z).all(|z| holds(IVec3::new(x, y, z)))))
}

/// Planes that bound the pieces: four on each axis.
const PLANES: usize = 12;

impl Plateau {
    /// Where the field is not 0: a voxel more on every side.
    #[must_use]
    pub fn support(&self) -> Bounds {
        Bounds {
            min: self.core.min - 1.0,
            max: self.core.max + 1.0,
        }
    }

    /// The field at a local point.
    #[inline]
    #[must_use]
    pub fn at(&self, p: Vec3) -> f32 {
        let ramp = (p - self.core.min).min(self.core.max - p) + 1.0;
        let ramp = ramp.clamp(Vec3::ZERO, Vec3::ONE);
        self.value * ramp.x * ramp.y * ramp.z
    }

    /// The same in f64.
    fn at_exactly(&self, p: DVec3) -> f64 {
        let (low, high) = (self.core.min.as_dvec3(), self.core.max.as_dvec3());
        let ramp = (p - low).min(high - p) + 1.0;
        let ramp = ramp.clamp(DVec3::ZERO, DVec3::ONE);
        f64::from(self.value) * ramp.x * ramp.y * ramp.z
    }

    /// Integral of the field along a local ray inside [0, t_max], or up to a piece behind where it
    /// reaches `enough`.
    #[must_use]
    pub fn integral(&self, ray: &ExactRay, t_max: f32, enough: f64) -> f64 {
        let mut depth = 0.0;
        self.pieces(ray, 0.0, t_max, |piece| {
            depth += piece.integral;
            depth < enough
        });
        depth
    }

    /// Visits the pieces of a local ray inside [t0, t1] in order, until `visit` returns false.
    pub fn pieces(&self, ray: &ExactRay, t0: f32, t1: f32, mut visit: impl FnMut(Piece) -> bool) {
        let (mut enter, mut exit) = (f64::from(t0), f64::from(t1));
        let mut planes = [f64::INFINITY; PLANES];
        for axis in 0..3 {
            let (a, b) = (self.core.min[axis].into(), self.core.max[axis].into());
            let (o, d): (f64, f64) = (ray.origin[axis], ray.direction[axis]);
            let faces = [a - 1.0, a, b, b + 1.0];
            if d == 0.0 {
                if o <= faces[0] || o >= faces[3] {
                    return;
                }
                continue;
            }
            let meets = faces.map(|face| (face - o) / d);
            enter = enter.max(meets[0].min(meets[3]));
            exit = exit.min(meets[0].max(meets[3]));
            planes[4 * axis..][..4].copy_from_slice(&meets);
        }
        if enter >= exit || exit.is_infinite() {
            return;
        }
        planes.sort_unstable_by(f64::total_cmp);
        let within = planes.into_iter().filter(|t| *t > enter && *t < exit);
        let (mut start, mut first) = (enter, self.at_exactly(ray.at(enter)));
        for end in within.chain([exit]) {
            if end <= start {
                continue;
            }
            let [middle, last] = [0.5 * (start + end), end].map(|t| self.at_exactly(ray.at(t)));
            let values = [first, middle, last];
            let piece = Piece::cubic(start, end, values);
            if piece.t_max > piece.t_min && !visit(piece) {
                return;
            }
            (start, first) = (end, values[2]);
        }
    }
}

impl Grid {
    /// The field as a plateau, if it is one.
    #[must_use]
    pub fn plateau(&self) -> Option<Plateau> {
        let support = self.support();
        if support.is_empty() {
            return None;
        }
        let core = [support.min + 1.0, support.max - 1.0];
        let [low, high] = core.map(Vec3::as_ivec3);
        if core != [low, high].map(|v| v.as_vec3()) || low.cmpgt(high).any() {
            return None;
        }
        let value = self.voxel(low);
        // A cube of constant bricks: inside the box, or outside.
        let whole = |first: IVec3, size: i32, found: f32| {
            let last = first + size;
            let inside = first.cmpge(low).all() && last.cmple(high).all();
            let outside = first.cmpgt(high).any() || last.cmplt(low).any();
            found == value && inside || found == 0.0 && outside
        };
        let brick_fits = |brick: IVec3| {
            let first = brick * BRICK;
            match self.brick(brick) {
                Brick::Constant(found) => whole(first, BRICK, found),
                Brick::Values(values) => each(IVec3::ZERO, IVec3::splat(BRICK), |v| {
                    let inside = (first + v).cmpge(low).all() && (first + v).cmple(high).all();
                    values.at(v) == if inside { value } else { 0.0 }
                }),
            }
        };
        let (from, to) = ((low - 1) >> 3i32, (high + 1) >> 3i32);
        let mut left = MOST_BRICKS;
        let all = each(from >> 4i32, to >> 4i32, |cell| {
            let entry = self.places.top()[top_index(self.dims(), cell.as_uvec3())];
            let size = BRICK * TABLE;
            if entry & CONSTANT != 0 && whole(cell * size, size, self.voxel(cell * size)) {
                return true;
            }
            let (first, last) = (cell * TABLE, cell * TABLE + (TABLE - 1));
            each(first.max(from), last.min(to), |brick| {
                left -= 1;
                left > 0 && brick_fits(brick)
            })
        });
        all.then_some(Plateau {
            value,
            core: Bounds {
                min: core[0],
                max: core[1],
            },
        })
    }

    /// The field with 0 outside a box, sharply. \[local voxels\]
    #[must_use]
    pub fn cut(self, to: &Bounds) -> Self {
        let support = Bounds {
            min: self.support.min.max(to.min),
            max: self.support.max.min(to.max),
        };
        Self { support, ..self }
    }
}
