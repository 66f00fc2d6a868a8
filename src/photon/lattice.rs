//! The cells of a box, and those that a straight way crosses.
//!
//! ```text
//! n = (p - low) / edge                 cell floor(n), 0 <= floor(n) < dims      edge [m]
//! s_a' = s_a + edge / |d_a|            for the axis a of the nearest face
//! ```
//!
//! Source: Amanatides & Woo 1987, all axes side by side: which one is next cannot be guessed, and so it is
//! found by masks. Cells stand in a list with one more on every side, so that a way which rounding
//! takes over an edge is in a cell that nothing is in.

use glam::{UVec3, Vec3};
use wide::{f32x4, i32x4};

use crate::lanes::{four, greater, lesser};
use crate::ray::{Bounds, Ray};

/// Cells of a box.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    pub(super) bounds: Bounds,
    low: f32x4,
    per_edge: f32x4,
    /// Cells on each axis; one on the fourth.
    dims: f32x4,
    /// From a cell to the next on each axis.
    strides: [isize; 3],
}

/// The least over three axes.
#[inline(always)]
fn least(v: f32x4) -> f32 {
    let [x, y, z, _] = v.to_array();
    lesser(lesser(x, y), z)
}

impl Lattice {
    /// Cells that fill a box. \[m\]
    pub(super) fn new(bounds: Bounds, edge: f32) -> Self {
        let dims = (bounds.size() / edge).ceil().max(Vec3::ONE);
        let [_, y, z] = dims.to_array().map(|n| n as isize + 2);
        Self {
            bounds,
            low: four(bounds.min),
            per_edge: f32x4::splat(1.0 / edge),
            dims: f32x4::new([dims.x, dims.y, dims.z, 1.0]),
            strides: [y * z, z, 1],
        }
    }

    /// Cells in the list, those around the box included.
    pub(super) fn len(&self) -> usize {
        (self.dims.to_array()[0] as usize + 2) * self.strides[0] as usize
    }

    /// The cell of a point; the nearest of one outside.
    pub(super) fn cell_of(&self, p: Vec3) -> UVec3 {
        let [x, y, z, _] = self.nearest(self.place(p)).to_array();
        Vec3::new(x, y, z).as_uvec3()
    }

    /// Where a cell is in the list.
    #[inline]
    pub(super) fn index(&self, cell: UVec3) -> usize {
        let along = |axis: usize| (cell[axis] as usize + 1) * self.strides[axis] as usize;
        along(0) + along(1) + along(2)
    }

    /// A point in cells from the lowest corner.
    #[inline(always)]
    fn place(&self, p: Vec3) -> f32x4 {
        (four(p) - self.low) * self.per_edge
    }

    /// The cell of a place; the nearest of one outside.
    #[inline(always)]
    fn nearest(&self, place: f32x4) -> f32x4 {
        place
            .floor()
            .fast_min(self.dims - f32x4::ONE)
            .fast_max(f32x4::ZERO)
    }

    /// True of a place in the box.
    #[inline(always)]
    fn holds(&self, place: f32x4) -> bool {
        (place.simd_ge(f32x4::ZERO) & place.simd_lt(self.dims)).all()
    }

    /// Visits the cells on [0, t_max] of a ray, in turn: where in the list, the end of the piece in it, and
    /// its length. Nothing of the ray that is outside.
    #[inline(always)]
    pub(super) fn along(&self, ray: &Ray, t_max: f32, mut visit: impl FnMut(usize, f32, f32)) {
        let list = |cell: f32x4| {
            let cell: i32x4 = cell.fast_trunc_int();
            let [x, y, z, _] = cell.to_array();
            self.index(UVec3::new(x as u32, y as u32, z as u32))
        };
        let (mut t0, mut t1) = (0.0, t_max);
        let mut from = self.place(ray.origin);
        let to = self.place(ray.at(t_max));
        let inside = self.holds(from) && self.holds(to);
        if inside {
            let (first, last) = (from.floor(), to.floor());
            if first == last {
                return visit(list(first), t_max, t_max);
            }
        } else {
            let Some(span) = self.bounds.clip(ray, 0.0, t_max) else {
                return;
            };
            (t0, t1) = span;
            from = self.place(ray.at(t0));
        }
        let direction = four(ray.direction) * self.per_edge;
        let moves = direction.abs().simd_ge(f32x4::splat(f32::MIN_POSITIVE));
        let inverse = moves & (f32x4::ONE / direction);
        let up = direction.simd_gt(f32x4::ZERO);
        let meets = |face: f32x4| {
            let s = (face - from) * inverse;
            moves.select(s, f32x4::splat(f32::INFINITY))
        };
        let cell = self.nearest(from);
        let between = inverse.abs();
        let mut next = meets(cell + (up & f32x4::ONE));
        // From t0 on, lest steps be lost in a t that is large.
        let whole = if inside {
            t1
        } else {
            lesser(t1 - t0, least(meets(up & self.dims)))
        };
        let signs = up.to_bitmask();
        let step = |axis: usize| {
            let stride = self.strides[axis];
            if signs >> axis & 1 == 1 {
                stride
            } else {
                -stride
            }
        };
        let [x, y, z] = [step(0), step(1), step(2)];
        let steps = [0, x, y, x + y, z, x + z, y + z, x + y + z];
        let mut at = list(cell);
        let mut s = 0.0;
        loop {
            let nearest = least(next);
            let end = lesser(greater(nearest, s), whole);
            visit(at, lesser(t0 + end, t1), end - s);
            if end >= whole || end.is_nan() {
                return;
            }
            s = end;
            let crossed = next.simd_le(f32x4::splat(nearest));
            next += crossed & between;
            at = at.wrapping_add_signed(steps[crossed.to_bitmask() as usize & 7]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    const LOW: Vec3 = Vec3::new(-1.0, 3.0, 0.5);
    const EDGE: f32 = 0.37;

    fn lattice() -> Lattice {
        let size = EDGE * Vec3::new(5.0, 12.0, 1.0);
        Lattice::new(
            Bounds {
                min: LOW,
                max: LOW + size,
            },
            EDGE,
        )
    }

    /// Every piece is in its cell, as far as f32 tells places there apart, and all pieces are what the box
    /// has of the ray.
    fn check(lattice: &Lattice, ray: &Ray, t_max: f32) {
        let farthest = ray.origin.abs().max_element().max(10.0);
        let near = 16.0 * f32::EPSILON * farthest;
        let (mut sum, mut last) = (0.0, 0.0);
        lattice.along(ray, t_max, |at, end, length| {
            assert!(at < lattice.len(), "cell {at} of {ray:?}");
            assert!(length >= 0.0 && end <= t_max && end >= last, "{ray:?}");
            last = end;
            sum += length;
            let middle = ray.at(end - 0.5 * length);
            let place = (middle - LOW) / EDGE;
            let strides = lattice.strides.map(|s| s as usize);
            let cell = Vec3::new(
                (at / strides[0]) as f32,
                (at / strides[1] % (strides[0] / strides[1])) as f32,
                (at % strides[1]) as f32,
            ) - 1.0;
            let off = (cell - place).max(place - cell - 1.0).max_element();
            // Nothing comes of a piece that is shorter than that.
            assert!(
                off * EDGE < near || length < near,
                "{place} is not in {cell}, {ray:?}, off by {off}"
            );
        });
        let told = (lattice.bounds.clip(ray, 0.0, t_max)).map_or(0.0, |(a, b)| b - a);
        assert!((sum - told).abs() < 8.0 * near, "{sum} for {told}, {ray:?}");
    }

    #[test]
    fn cells_of_a_way_tile_it() {
        let lattice = lattice();
        let mut random = Rng::stream(5, Stage::Check, 0, 0);
        let size = lattice.bounds.size();
        for i in 0..20_000 {
            let mut point = |reach: f32| {
                let u = Vec3::new(random.uniform(), random.uniform(), random.uniform());
                LOW + size * (0.5 + reach * (u - 0.5))
            };
            // Corners of cells among the points, and rays along faces, short and far away.
            let corner = |p: Vec3| LOW + ((p - LOW) / EDGE).round() * EDGE;
            let (mut a, mut b) = (point(2.0), point(1.0));
            if i % 5 == 1 {
                (a, b) = (corner(a), corner(b));
            }
            if i % 5 == 2 {
                a = b + 1e-3 * (a - b);
            }
            if i % 7 == 3 {
                b[i % 3] = a[i % 3];
            }
            if i % 11 == 4 {
                a[i % 3] = b[i % 3];
                a[(i + 1) % 3] = b[(i + 1) % 3];
            }
            let direction = (b - a).normalize_or(Vec3::X);
            let back = if i % 13 == 5 { 1e5 } else { 0.0 };
            let ray = Ray {
                origin: a - back * direction,
                direction,
            };
            check(&lattice, &ray, back + (b - a).length());
            check(&lattice, &ray, f32::INFINITY);
        }
    }

    #[test]
    fn what_is_not_a_number_is_nowhere() {
        let lattice = lattice();
        for direction in [Vec3::NAN, Vec3::ZERO, Vec3::splat(f32::INFINITY)] {
            for origin in [LOW + 0.1, Vec3::NAN, Vec3::splat(f32::MAX)] {
                let mut count = 0;
                let ray = Ray { origin, direction };
                for t_max in [1.0, f32::INFINITY, f32::NAN] {
                    lattice.along(&ray, t_max, |at, _, _| {
                        assert!(at < lattice.len(), "cell {at} of {ray:?}");
                        count += 1;
                    });
                }
                assert!(count < 10, "{count} pieces of {ray:?}");
            }
        }
    }
}
