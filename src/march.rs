//! The optical-depth profile of a camera ray: marched once, read by everything on the ray.
//!
//! ```text
//! tau(t) = sum over media   sigma_t * D(t),   D(t) = integral of the density from 0 to t  [m]
//! T(t)   = exp(-tau(t))
//! ```
//!
//! Knots (t, D, density) stand at cell crossings, where D is exact (Simpson's rule on the
//! field's cubic, see `grid::walk`). Between knots D is the cubic Hermite interpolant; its slope
//! *is* the density, which the knots hold. A reading costs one table look-up and a short scan:
//! O(L + M) for M photons on a ray of L cells, where a march per photon costs O(M L).
//!
//! The march ends where the transmittance is spent: beyond an optical depth of
//! [`SPENT_OPTICAL_DEPTH`] nothing on the ray is looked at. What that leaves out is at most
//! exp(-18) = 1.5e-8 of the radiance there, below what f32 resolves in a sum with the rest.
//!
//! A fixed step (`march = { step = ... }`) takes the density in the middle of each step as that
//! of the whole: the ray march of Jensen & Christensen 1998, kept to show what steps cost.

use crate::hermite::{Knot, distance, hermite, slope};
use crate::medium::{Field, GridField, Medium};
use crate::ray::Ray;
use crate::scene::March;
use crate::spectrum::Spectrum;
use crate::tracking::{Counters, Sampler};

use crate::grid::walk::{Piece, integral, walk};
use wide::f32x8;

/// Optical depth, in the thinnest channel, beyond which a ray is not followed. Lower: energy is
/// lost visibly (e^-8 = 3e-4); higher: dense clouds are marched for what f32 cannot add.
pub const SPENT_OPTICAL_DEPTH: f32 = 18.0;

/// Density along a ray in one medium.
#[derive(Debug, Clone)]
struct MediumProfile<S> {
    /// Index of the medium.
    medium: usize,
    /// Extinction where the density is 1. \[1/m\]
    sigma_t: S,
    /// In order of t; at least two, or none.
    knots: Vec<Knot>,
    /// Depth of the last knot, before rounding: hundreds of cells add up. \[m\]
    total: f64,
    /// Index of the last knot at or before the start of each of equal bins of t.
    bins: Vec<u32>,
    /// Bins per metre.
    bin_scale: f32,
}

/// Optical depth along a ray in all media. Reused from ray to ray: its buffers stay.
#[derive(Debug, Clone)]
pub struct Profile<S> {
    media: Vec<MediumProfile<S>>,
    /// How many of `media` are in use.
    used: usize,
    /// Where the profile ends: the segment's end, or where the transmittance is spent. \[m\]
    pub t_end: f32,
    /// Transmittance of the whole.
    pub transmittance: S,
}

impl<S: Spectrum> Default for Profile<S> {
    fn default() -> Self {
        Self {
            media: Vec::new(),
            used: 0,
            t_end: 0.0,
            transmittance: S::ONE,
        }
    }
}

/// Bins of a profile for each knot: enough that a reading scans one knot or two.
const BINS_PER_KNOT: f32 = 2.0;

impl<S: Spectrum> Profile<S> {
    /// Marches [0, t_max] of `ray` through media, the first of which has the index that comes
    /// with them.
    pub fn march(
        &mut self,
        (first, media): (usize, &[Medium<S>]),
        ray: &Ray,
        t_max: f32,
        march: March,
        counters: &mut Counters,
    ) {
        self.used = 0;
        self.t_end = t_max;
        for (index, medium) in (first..).zip(media) {
            let (medium_sigma, t_end) = (medium.sigma_t, self.t_end);
            let profile = self.next_profile(index, medium_sigma);
            // The thinnest channel that is not clear decides when the ray is spent.
            let spent = SPENT_OPTICAL_DEPTH / thinnest_channel(medium_sigma);
            match &medium.field {
                Field::Constant { bounds } => {
                    if let Some((t0, t1)) =
                        bounds.map_or(Some((0.0, t_end)), |b| b.clip(ray, 0.0, t_end))
                    {
                        let t1 = t1.min(t0 + spent);
                        if t1.is_finite() {
                            profile.push(Piece::constant(t0, t1, 1.0));
                        }
                    }
                }
                Field::Grid(field) => profile.march(field, ray, t_end, march, spent, counters),
                Field::Plateau(field) => {
                    field
                        .plateau
                        .pieces(&field.placement.exact_ray(ray), 0.0, t_end, |piece| {
                            profile.push(piece);
                            profile.knots.last().is_some_and(|last| last.depth < spent)
                        });
                }
            }
            match profile.knots.last().copied() {
                None => self.used -= 1,
                Some(last) if last.depth >= spent => self.t_end = t_end.min(last.t),
                Some(_) => {}
            }
        }
        for profile in &mut self.media[..self.used] {
            profile.index();
        }
        self.transmittance = self.transmittance(self.t_end);
    }

    /// An emptied profile for the next medium.
    fn next_profile(&mut self, medium: usize, sigma_t: S) -> &mut MediumProfile<S> {
        if self.used == self.media.len() {
            self.media.push(MediumProfile {
                medium,
                sigma_t,
                knots: Vec::new(),
                total: 0.0,
                bins: Vec::new(),
                bin_scale: 0.0,
            });
        }
        let profile = &mut self.media[self.used];
        profile.medium = medium;
        profile.sigma_t = sigma_t;
        profile.knots.clear();
        profile.total = 0.0;
        self.used += 1;
        profile
    }

    /// True where the ray meets no medium.
    #[must_use]
    pub fn is_clear(&self) -> bool {
        self.used == 0
    }

    /// Transmittance from the ray's start to t.
    #[inline]
    #[must_use]
    pub fn transmittance(&self, t: f32) -> S {
        S::transmittance(self.optical_depth(t))
    }

    /// Transmittance from the ray's start to t, and the sum of what `of` makes of each medium there
    /// and its extinction coefficient. \[1/m\]
    #[inline]
    pub fn transmittance_and_sum(&self, t: f32, mut of: impl FnMut(usize, S) -> S) -> (S, S) {
        let (mut tau, mut sum) = (S::ZERO, S::ZERO);
        for profile in &self.media[..self.used] {
            let (a, b, s) = profile.locate(t);
            tau += profile.sigma_t * hermite(a, b, s);
            if (a.t..=b.t).contains(&t) {
                let density = slope(a, b, s);
                if density > 0.0 {
                    sum += of(profile.medium, profile.sigma_t * density);
                }
            }
        }
        (S::transmittance(tau), sum)
    }

    /// The profile of the only medium on the ray, to be read eight points at a time.
    #[inline]
    pub(crate) fn only(&self) -> Option<OnlyMedium<'_, S>> {
        match &self.media[..self.used] {
            [profile] => Some(OnlyMedium(profile)),
            _ => None,
        }
    }

    /// Optical depth from the ray's start to t.
    #[inline]
    #[must_use]
    pub fn optical_depth(&self, t: f32) -> S {
        let mut tau = S::ZERO;
        for profile in &self.media[..self.used] {
            tau += profile.sigma_t * profile.depth(t);
        }
        tau
    }

    /// Indices of the media on the ray.
    pub fn media(&self) -> impl Iterator<Item = usize> {
        self.media[..self.used].iter().map(|profile| profile.medium)
    }

    /// Visits each medium on the ray with its extinction coefficient at t. \[1/m\]
    #[inline]
    pub fn media_at(&self, t: f32, mut visit: impl FnMut(usize, S)) {
        for profile in &self.media[..self.used] {
            let density = profile.density(t);
            if density > 0.0 {
                visit(profile.medium, profile.sigma_t * density);
            }
        }
    }

    /// The distance at which the optical depth of a channel reaches `tau`; the end if it does not.
    #[must_use]
    pub fn distance_at(&self, tau: f32, channel: usize) -> f32 {
        if let [only] = &self.media[..self.used] {
            let sigma = only.sigma_t.channel(channel);
            return if sigma > 0.0 {
                only.distance_at(tau / sigma).min(self.t_end)
            } else {
                self.t_end
            };
        }
        // Several media: bisection, then what is left is below f32's resolution of t.
        // Within the media: the profile's own end may be infinite.
        let (mut low, mut high) = self.extent();
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.optical_depth(middle).channel(channel) < tau {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Distances before which the optical depth, in the thinnest channel, is below each of some
    /// rising values: a knot at or beyond the exact place, or the end.
    pub(crate) fn reaches<const N: usize>(&self, depths: &[f32; N]) -> [f32; N] {
        let mut ends = [self.t_end; N];
        // Of several media the sum is reached before any of them reaches it alone: a bound.
        for profile in &self.media[..self.used] {
            let thinnest = (0..S::CHANNELS)
                .map(|c| profile.sigma_t.channel(c))
                .fold(f32::INFINITY, f32::min);
            let mut next = 0;
            for knot in &profile.knots {
                while next < N && knot.depth * thinnest >= depths[next] {
                    ends[next] = ends[next].min(knot.t);
                    next += 1;
                }
            }
        }
        ends
    }

    /// First and last t at which there is a medium; an empty range on a clear ray.
    #[must_use]
    pub fn extent(&self) -> (f32, f32) {
        self.media[..self.used]
            .iter()
            .fold((f32::INFINITY, 0.0), |(a, b), p| match p.knots[..] {
                [first, .., last] => (a.min(first.t), b.max(last.t.min(self.t_end))),
                _ => (a, b),
            })
    }

    /// Visits the stretches of one medium between knots as (t0, t1), in order.
    pub fn stretches(&self, medium: usize, mut visit: impl FnMut(f32, f32)) {
        for profile in self.media[..self.used]
            .iter()
            .filter(|p| p.medium == medium)
        {
            for pair in profile.knots.windows(2) {
                if pair[1].depth > pair[0].depth && pair[0].t < self.t_end {
                    visit(pair[0].t, pair[1].t);
                }
            }
        }
    }
}

/// Optical depth, in the thinnest channel, at which the roulette of shadow rays begins. Lower:
/// noise where light is seen to fade; higher: marches through what is dark anyway.
const ROULETTE_DEPTH: f32 = 3.0;

/// The transmittance of [0, t_max], exact down to e^-3: for shadow rays whose noise would be seen.
/// Its cost is the voxels crossed, where ratio tracking's is the optical thickness; the path
/// tracer takes the latter.
///
/// What is less plays Russian roulette. A ray goes on to depth tau with probability
/// q = exp(3 - tau) and counts T / q, the same e^-3 however far it comes in the thinnest channel:
/// the expectation is T, and a march is a mean free path longer than depth 3, not all the way.
pub fn transmittance<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    sampler: &mut Sampler,
) -> S {
    sampler.counters.transmittance_rays += 1;
    let mut tau = S::ZERO;
    let mut left_out = 0.0;
    for medium in media {
        let per_depth = thinnest_channel(medium.sigma_t);
        // Drawn from (0, 1].
        let end = ROULETTE_DEPTH - (1.0 - sampler.uniform()).ln();
        let spent = end / per_depth;
        let mut depth = 0.0f64;
        match &medium.field {
            Field::Constant { bounds } => {
                let clipped = bounds.map_or(Some((0.0, t_max)), |b| b.clip(ray, 0.0, t_max));
                depth = clipped.map_or(0.0, |(t0, t1)| f64::from((t1 - t0).min(spent)));
            }
            Field::Plateau(field) => {
                field
                    .plateau
                    .pieces(&field.placement.exact_ray(ray), 0.0, t_max, |piece| {
                        depth += piece.integral;
                        depth < f64::from(spent)
                    });
            }
            Field::Grid(field) => {
                let local = field.placement.exact_ray(ray);
                let (all, lookups) = integral(
                    &field.grid,
                    &field.majorants,
                    &local,
                    [0.0, t_max],
                    spent.into(),
                );
                depth = all;
                sampler.counters.density_lookups += lookups;
            }
        }
        if depth >= f64::from(spent) {
            return S::ZERO;
        }
        left_out += (per_depth * depth as f32 - ROULETTE_DEPTH).max(0.0);
        tau += medium.sigma_t * depth as f32;
    }
    S::transmittance(tau - S::splat(left_out))
}

/// Extinction of the thinnest channel; 0 where one is clear: light goes on for ever in it. \[1/m\]
fn thinnest_channel<S: Spectrum>(sigma_t: S) -> f32 {
    (0..S::CHANNELS).fold(f32::INFINITY, |least, c| least.min(sigma_t.channel(c)))
}

impl<S: Spectrum> MediumProfile<S> {
    /// Knots of a grid along the ray.
    fn march(
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
                for i in 0..steps {
                    let a = step.mul_add(i as f32, t0);
                    let b = (a + step).min(t1);
                    let density = field.grid.lookup(local.at(0.5 * (a + b)));
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
    fn push(&mut self, piece: Piece) {
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
    fn index(&mut self) {
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
    fn locate(&self, t: f32) -> (Knot, Knot, f32) {
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
    fn depth(&self, t: f32) -> f32 {
        let (a, b, s) = self.locate(t);
        hermite(a, b, s)
    }

    /// Density at t: the slope of the depth.
    #[inline]
    fn density(&self, t: f32) -> f32 {
        let (a, b, s) = self.locate(t);
        if (a.t..=b.t).contains(&t) {
            slope(a, b, s)
        } else {
            0.0
        }
    }

    /// Where the integral of the density reaches `depth`.
    fn distance_at(&self, depth: f32) -> f32 {
        let knots = &self.knots[..];
        let i = knots
            .partition_point(|k| k.depth <= depth)
            .clamp(1, knots.len() - 1);
        let (a, b) = (knots[i - 1], knots[i]);
        distance(a, b, depth)
    }
}

/// The profile of a ray with one medium.
pub(crate) struct OnlyMedium<'a, S>(&'a MediumProfile<S>);

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
