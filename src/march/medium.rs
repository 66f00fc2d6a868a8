//! The density along a ray in one medium: knots, and how they are found and read.
//!
//! ```text
//! D(t)  cubic Hermite between knots (t, D, density)      density = dD/dt      [m], [1]
//! bin   = (t - t_0) * bins / length      names the last cubic that begins in a bin before
//! ```
//!
//! See `march` for what the knots hold. Equal bins of t, two for each cubic, take a reading to its
//! own in a step or two, however unevenly they lie. A cubic's begin and a reading are put into bins
//! by the same steps, which never fall as t rises: what begins in a bin before begins before.

use wide::f32x8;

use crate::grid::walk::{Piece, walk};
use crate::hermite::{Cubic, Knot};
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
    /// In order of t, without gaps, and [`Cubic::END`] once it is indexed.
    cubics: Vec<Cubic>,
    /// The last knot; nowhere in an empty profile.
    pub(super) end: Knot,
    /// Depth there, before rounding: hundreds of cells add up. \[m\]
    total: f64,
    /// Index of the last cubic that begins in a bin before, for each of equal bins of t; the last
    /// entry is no bin.
    bins: Vec<u32>,
    /// Bins per metre.
    bin_scale: f32,
}

/// Bins of a profile for each cubic: enough that a reading scans one or two.
const BINS_PER_CUBIC: usize = 2;
/// Cubics that there is room for from the start. Fewer: the first ray's are moved many times.
const ROOM: usize = 128;

impl<S: Spectrum> MediumProfile<S> {
    /// Empties the profile for another medium.
    pub(super) fn begin(&mut self, medium: usize, sigma_t: S) {
        self.medium = medium;
        self.sigma_t = sigma_t;
        self.cubics.clear();
        self.cubics.reserve(ROOM);
        // Before the first piece there is no gap.
        self.end = Knot {
            t: f32::INFINITY,
            depth: 0.0,
            density: 0.0,
        };
        self.total = 0.0;
    }

    /// Cubics of a grid along the ray.
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
                    self.end.depth < spent
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
                    if self.end.depth >= spent {
                        break;
                    }
                }
            }
        }
    }

    /// Appends a piece; a gap before it has density 0. Always inlined: what of a piece is not asked
    /// for is not computed.
    #[inline(always)]
    pub(super) fn push(&mut self, piece: Piece) {
        let [first, _, last] = piece.density;
        let begin = Knot {
            t: piece.t_min,
            density: first,
            ..self.end
        };
        if self.end.t < piece.t_min {
            let [from, to] = [self.end, begin].map(|knot| Knot {
                density: 0.0,
                ..knot
            });
            self.cubics.push(Cubic::between(from, to));
        }
        self.total += piece.integral;
        self.end = Knot {
            t: piece.t_max,
            depth: self.total as f32,
            density: last,
        };
        self.cubics.push(Cubic::between(begin, self.end));
    }

    /// The last knot, if there is any.
    #[inline]
    pub(super) fn end(&self) -> Option<Knot> {
        (!self.cubics.is_empty()).then_some(self.end)
    }

    /// The cubics, once they are indexed.
    pub(super) fn cubics(&self) -> &[Cubic] {
        self.cubics.split_last().map_or(&[], |(_, cubics)| cubics)
    }

    /// Puts the cubics into bins.
    pub(super) fn index(&mut self) {
        self.bins.clear();
        let Some(first) = self.cubics.first() else {
            return;
        };
        let count = BINS_PER_CUBIC * self.cubics.len();
        self.bin_scale = count as f32 / (self.end.t - first.t);
        if !self.bin_scale.is_finite() {
            self.bin_scale = 0.0;
        }
        self.bins.resize(count + 2, 0);
        let start = first.t;
        for (i, cubic) in (0..).zip(&self.cubics) {
            let bin = ((cubic.t - start) * self.bin_scale) as usize;
            self.bins[bin.min(count) + 1] = i;
        }
        let mut last = 0;
        for bin in &mut self.bins {
            last = last.max(*bin);
            *bin = last;
        }
        self.cubics.push(Cubic::END);
    }

    /// The bin of each t.
    #[inline]
    fn bin(&self, t: f32x8) -> [i32; 8] {
        let last = (self.bins.len() - 2) as f32;
        let bin = (t - f32x8::splat(self.cubics[0].t)) * f32x8::splat(self.bin_scale);
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
        let bin = (t - self.cubics[0].t) * self.bin_scale;
        self.cubic((bin as usize).min(self.bins.len() - 2), t)
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
        let cubics = self.cubics();
        let i = cubics.partition_point(|cubic| cubic.end_depth <= depth);
        cubics[i.min(cubics.len() - 1)].distance(depth)
    }
}
