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
use crate::hermite::{Cubic, Knot, distance};
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
    /// Between each two of them, and [`Cubic::END`].
    cubics: Vec<Cubic>,
    /// Depth of the last knot, before rounding: hundreds of cells add up. \[m\]
    total: f64,
    /// Index of the last knot at or before each of equal bins of t.
    bins: Vec<u32>,
    /// Bins per metre.
    bin_scale: f32,
}

/// Bins of a profile for each knot: enough that a reading scans one knot or two.
const BINS_PER_KNOT: f32 = 2.0;
/// How far before its begin a bin looks for its knot, and the least of it for each bin before. Less:
/// rounding puts a t into a bin whose knot is beyond it; more: longer scans. \[bins\]
const MARGIN: f32 = 1.0 / 64.0;
const MARGIN_PER_BIN: f32 = 8.0 * f32::EPSILON;

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

    /// Makes cubics and bins.
    pub(super) fn index(&mut self) {
        self.bins.clear();
        self.cubics.clear();
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return;
        };
        let pairs = self.knots.windows(2);
        self.cubics
            .extend(pairs.map(|pair| Cubic::between(pair[0], pair[1])));
        self.cubics.push(Cubic::END);
        let count = (self.knots.len() as f32 * BINS_PER_KNOT).ceil();
        let length = last.t - first.t;
        self.bin_scale = if length > 0.0 { count / length } else { 0.0 };
        if !self.bin_scale.is_finite() {
            self.bin_scale = 0.0;
        }
        let width = 1.0 / self.bin_scale.max(f32::MIN_POSITIVE);
        let mut knot = 0;
        for bin in 0..=count as u32 {
            let before = MARGIN.max(MARGIN_PER_BIN * bin as f32);
            let t = (bin as f32 - before).mul_add(width, first.t);
            while self.cubics[knot + 1].t <= t {
                knot += 1;
            }
            self.bins.push(knot as u32);
        }
    }

    /// The bin of each t.
    #[inline]
    fn bin(&self, t: f32x8) -> [i32; 8] {
        let last = (self.bins.len() - 1) as f32;
        let bin = (t - f32x8::splat(self.knots[0].t)) * f32x8::splat(self.bin_scale);
        let bin = bin.fast_min(f32x8::splat(last)).fast_max(f32x8::ZERO);
        bin.fast_trunc_int().to_array()
    }

    /// The last cubic that begins at or before t, given its bin; the first, if none does.
    #[inline]
    fn cubic(&self, bin: usize, t: f32) -> &Cubic {
        let mut i = self.bins[bin] as usize;
        // One step or two are what a bin takes; which, cannot be guessed.
        i += usize::from(self.cubics[i + 1].t <= t);
        i += usize::from(self.cubics[i + 1].t <= t);
        while self.cubics[i + 1].t <= t {
            i += 1;
        }
        &self.cubics[i]
    }

    /// The cubic around t, or at the nearer end.
    #[inline]
    pub(super) fn at(&self, t: f32) -> &Cubic {
        let bin = (t - self.knots[0].t) * self.bin_scale;
        self.cubic((bin as usize).min(self.bins.len() - 1), t)
    }

    /// Integral of the density, and the density, at eight points.
    #[inline]
    pub(super) fn read(&self, t: f32x8) -> [f32x8; 2] {
        let (bins, each) = (self.bin(t), t.to_array());
        let cubic = |lane: usize| self.cubic(bins[lane] as usize, each[lane]);
        Cubic::read(std::array::from_fn(cubic), t)
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
