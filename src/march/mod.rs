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

mod medium;
mod shadow;

pub use shadow::transmittance;

use wide::f32x8;

use crate::grid::walk::Piece;
use crate::medium::{Field, Medium};
use crate::ray::{Bounds, Ray};
use crate::scene::March;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

use medium::MediumProfile;

/// Optical depth, in the thinnest channel, beyond which a ray is not followed. Lower: energy is
/// lost visibly (e^-8 = 3e-4); higher: dense clouds are marched for what f32 cannot add.
pub const SPENT_OPTICAL_DEPTH: f32 = 18.0;

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
                    if let Some((t0, t1)) = Bounds::clip_if(bounds.as_ref(), ray, t_end) {
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
                            profile.end.depth < spent
                        });
                }
            }
            match profile.end() {
                None => self.used -= 1,
                Some(end) if end.depth >= spent => self.t_end = t_end.min(end.t),
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
            self.media.push(MediumProfile::default());
        }
        let profile = &mut self.media[self.used];
        profile.begin(medium, sigma_t);
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
            let cubic = profile.at(t);
            tau += profile.sigma_t * cubic.depth(t);
            let density = cubic.density(t);
            if density > 0.0 {
                sum += of(profile.medium, profile.sigma_t * density);
            }
        }
        (S::transmittance(tau), sum)
    }

    /// Visits each medium on the ray with its extinction where the density is 1 \[1/m\], and, at
    /// eight points, the integral of its density \[m\] and the density.
    #[inline]
    pub(crate) fn visit_eight(&self, t: f32x8, mut visit: impl FnMut(usize, S, [f32x8; 2])) {
        for profile in &self.media[..self.used] {
            visit(profile.medium, profile.sigma_t, profile.read(t));
        }
    }

    /// True where the channels of no medium on the ray differ.
    pub(crate) fn is_grey(&self) -> bool {
        let mut media = self.media[..self.used].iter();
        media.all(|p| p.sigma_t == S::splat(p.sigma_t.channel(0)))
    }

    /// Optical depth from the ray's start to t.
    #[inline]
    #[must_use]
    pub fn optical_depth(&self, t: f32) -> S {
        let mut tau = S::ZERO;
        for profile in &self.media[..self.used] {
            tau += profile.sigma_t * profile.at(t).depth(t);
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
            let density = profile.at(t).density(t);
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
            for cubic in profile.cubics() {
                while next < N && cubic.end_depth * thinnest >= depths[next] {
                    ends[next] = ends[next].min(cubic.end);
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
            .fold((f32::INFINITY, 0.0), |(a, b), p| match p.cubics() {
                [first, ..] => (a.min(first.t), b.max(p.end.t.min(self.t_end))),
                [] => (a, b),
            })
    }

    /// Visits the stretches of one medium between knots as (t0, t1), in order.
    pub fn stretches(&self, medium: usize, mut visit: impl FnMut(f32, f32)) {
        for profile in self.media[..self.used]
            .iter()
            .filter(|p| p.medium == medium)
        {
            for cubic in profile.cubics() {
                if cubic.rises() && cubic.t < self.t_end {
                    visit(cubic.t, cubic.end);
                }
            }
        }
    }
}

/// Extinction of the thinnest channel; 0 where one is clear: light goes on for ever in it. \[1/m\]
fn thinnest_channel<S: Spectrum>(sigma_t: S) -> f32 {
    (0..S::CHANNELS).fold(f32::INFINITY, |least, c| least.min(sigma_t.channel(c)))
}
