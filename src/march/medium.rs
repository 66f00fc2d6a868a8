//! The density along a ray in one medium: knots, and how they are found and read.
//!
//! ```text
//! D(t)  cubic Hermite between knots (t, D, density)      density = dD/dt      [m], [1]
//! bin   = (t - t_0) * bins / length      names the last knot at or before its start
//! ```
//!
//! See `march` for what the knots hold. Equal bins of t, two for each knot, take a reading to its
//! knots in a step or two, however unevenly they lie.

use wide::f32x8;

use crate::grid::walk::{Piece, walk};
use crate::hermite::{Knot, distance, hermite, slope};
use crate::medium::GridField;
use crate::ray::Ray;
use crate::scene::March;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

/// Density along a ray in one medium.
#[derive(Debug, Clone, Default)]
pub(super) struct MediumProfile<S> {
    /// Index of the medium.
    pub(super) medium: usize,
    /// Extinction where the density is 1. \[1/m\]
    pub(super) sigma_t: S,
    /// In order of t; at least two, or none.
    pub(super) knots: Vec<Knot>,
    /// Depth of the last knot, before rounding: hundreds of cells add up. \[m\]
    total: f64,
    /// Index of the last knot at or before the start of each of equal bins of t.
    bins: Vec<u32>,
    /// Bins per metre.
    bin_scale: f32,
}

/// Bins of a profile for each knot: enough that a reading scans one knot or two.
const BINS_PER_KNOT: f32 = 2.0;

impl<S: Spectrum> MediumProfile<S> {
    /// Empties the profile for another medium.
    pub(super) fn begin(&mut self, medium: usize, sigma_t: S) {
        self.medium = medium;
        self.sigma_t = sigma_t;
        self.knots.clear();
        self.total = 0.0;
    }

    /// Knots of a grid along the ray.
    pub(super) fn march(
        &mut self,
        field: &GridField,
        ray: &Ray,
        t_max: f32,
        march: March,
        spent: f32,
        counters: &mut Counters,
    ) {
        match march {
            March::Exact => {
                let local = field.placement.exact_ray(ray);
                let lookups = walk(&field.grid, &field.majorants, &local, 0.0, t_max, |piece| {
                    self.push(piece);
                    self.knots.last().is_some_and(|last| last.depth < spent)
                });
                counters.density_lookups += lookups;
            }
            March::Step(voxels) => {
                let local = field.placement.local_ray(ray);
                let Some((t0, t1)) = field.grid.support().clip(&local, 0.0, t_max) else {
                    return;
                };
                let step = voxels as f32 / local.direction.length();
                let steps = ((t1 - t0) / step).ceil() as u32;
                let mut cursor = field.grid.cursor();
                for i in 0..steps {
                    let a = step.mul_add(i as f32, t0);
                    let b = (a + step).min(t1);
                    let density = cursor.lookup(local.at(0.5 * (a + b)));
                    counters.density_lookups += 1;
                    self.push(Piece::constant(a, b, density));
                    if self.knots.last().is_some_and(|last| last.depth >= spent) {
                        break;
                    }
                }
            }
        }
    }

    /// Appends a piece; a gap before it has density 0.
    pub(super) fn push(&mut self, piece: Piece) {
        let [first, _, last] = piece.density;
        if let Some(knot) = self.knots.last().copied() {
            if knot.t < piece.t_min {
                self.knots.push(Knot {
                    density: 0.0,
                    ..knot
                });
                self.knots.push(Knot {
                    t: piece.t_min,
                    density: 0.0,
                    ..knot
                });
            }
            if self.knots.last().is_some_and(|k| k.density != first) {
                self.knots.push(Knot {
                    t: piece.t_min,
                    density: first,
                    ..knot
                });
            }
        } else {
            self.knots.push(Knot {
                t: piece.t_min,
                depth: 0.0,
                density: first,
            });
        }
        self.total += piece.integral;
        self.knots.push(Knot {
            t: piece.t_max,
            depth: self.total as f32,
            density: last,
        });
    }

    /// Makes the bins.
    pub(super) fn index(&mut self) {
        self.bins.clear();
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return;
        };
        let count = (self.knots.len() as f32 * BINS_PER_KNOT).ceil();
        let length = last.t - first.t;
        self.bin_scale = if length > 0.0 { count / length } else { 0.0 };
        if !self.bin_scale.is_finite() {
            self.bin_scale = 0.0;
        }
        let mut knot = 0;
        for bin in 0..=count as u32 {
            let t = first.t + bin as f32 / self.bin_scale.max(f32::MIN_POSITIVE);
            while knot + 2 < self.knots.len() && self.knots[knot + 1].t <= t {
                knot += 1;
            }
            // One earlier, lest rounding of the bin's start skip the knot that holds it.
            self.bins.push(knot.saturating_sub(1) as u32);
        }
    }

    /// The two knots around t, and where between them it lies, in [0, 1].
    #[inline]
    pub(super) fn locate(&self, t: f32) -> (Knot, Knot, f32) {
        let knots = &self.knots[..];
        let bin =
            ((t - knots[0].t) * self.bin_scale).clamp(0.0, (self.bins.len() - 1) as f32) as usize;
        let mut i = self.bins[bin] as usize;
        while i + 2 < knots.len() && knots[i + 1].t <= t {
            i += 1;
        }
        let (a, b) = (knots[i], knots[i + 1]);
        let length = b.t - a.t;
        let s = if length > 0.0 {
            ((t - a.t) / length).clamp(0.0, 1.0)
        } else {
            1.0
        };
        (a, b, s)
    }

    /// Integral of the density up to t.
    #[inline]
    pub(super) fn depth(&self, t: f32) -> f32 {
        let (a, b, s) = self.locate(t);
        hermite(a, b, s)
    }

    /// Density at t: the slope of the depth.
    #[inline]
    pub(super) fn density(&self, t: f32) -> f32 {
        let (a, b, s) = self.locate(t);
        if (a.t..=b.t).contains(&t) {
            slope(a, b, s)
        } else {
            0.0
        }
    }

    /// Where the integral of the density reaches `depth`.
    pub(super) fn distance_at(&self, depth: f32) -> f32 {
        let knots = &self.knots[..];
        let i = knots
            .partition_point(|k| k.depth <= depth)
            .clamp(1, knots.len() - 1);
        let (a, b) = (knots[i - 1], knots[i]);
        distance(a, b, depth)
    }
}

/// The profile of a ray with one medium.
pub(crate) struct OnlyMedium<'a, S>(pub(super) &'a MediumProfile<S>);

impl<S: Spectrum> OnlyMedium<'_, S> {
    /// Index of the medium.
    #[inline]
    pub(crate) fn medium(&self) -> usize {
        self.0.medium
    }

    /// Extinction where the density is 1. \[1/m\]
    #[inline]
    pub(crate) fn sigma_t(&self) -> S {
        self.0.sigma_t
    }

    /// Integral of the density, and the density, at eight points: [`hermite`] and [`slope`].
    #[inline]
    pub(crate) fn read(&self, t: [f32; 8]) -> (f32x8, f32x8) {
        let mut at = [[0.0f32; 8]; 6];
        for lane in 0..8 {
            let (a, b, _) = self.0.locate(t[lane]);
            let knots = [a.t, a.depth, a.density, b.t, b.depth, b.density];
            for (row, value) in at.iter_mut().zip(knots) {
                row[lane] = value;
            }
        }
        let [a_t, a_depth, a_density, b_t, b_depth, b_density] = at.map(f32x8::from);
        let (t, zero, one) = (f32x8::from(t), f32x8::ZERO, f32x8::ONE);
        let length = b_t - a_t;
        let rise = b_depth - a_depth;
        let some = length.simd_gt(zero);
        let per_length = some.select(one / length, zero);
        let s = some.select(((t - a_t) * per_length).fast_max(zero).fast_min(one), one);
        let (start, end) = (a_density * length, b_density * length);
        let cubic = start + end - rise - rise;
        let square = rise - start - cubic;
        let depth = s
            .mul_add(s.mul_add(s.mul_add(cubic, square), start), a_depth)
            .fast_max(a_depth)
            .fast_min(b_depth);
        let bump = f32x8::splat(6.0)
            * s
            * (one - s)
            * (rise * per_length - f32x8::HALF * (a_density + b_density));
        let density = ((b_density - a_density).mul_add(s, a_density) + bump).fast_max(zero);
        let inside = some & t.simd_ge(a_t) & t.simd_le(b_t);
        (depth, inside.select(density, zero))
    }
}
