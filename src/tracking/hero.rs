//! Colour: one path for all channels.
//!
//! ```text
//! w_c = p_c / mean over channels of p      p_c: density of the path, had it followed channel c
//! ```
//!
//! Coefficients of a medium have one density in common, so channels collide at rates that
//! differ by constant factors. A path follows one channel, its hero, and carries the ratio of
//! every channel's path density to the hero's; the balance heuristic over the channels
//! (single-sample, Miller et al. 2019) then bounds every weight by the number of channels.

use super::Sampler;
use super::dense::Cell;
use crate::rng::Rng;
use crate::spectrum::Spectrum;

/// The channel that a path follows, and how likely each channel's path was beside it.
#[derive(Debug, Clone)]
pub struct Hero<S> {
    pub(super) channel: usize,
    /// Path density of each channel over the hero's, up to the end of the last flight.
    pub(super) ratio: S,
    /// The same up to its start.
    pub(super) start: S,
    /// What the last flight met on its way, in media whose channels differ.
    pub(super) passed: Vec<Passed<S>>,
}

/// What a flight passes without colliding: events that are not equally likely for all channels.
#[derive(Debug, Clone, Copy)]
pub(super) enum Passed<S> {
    /// A null collision at t, of this density by channel.
    Null { t: f32, density: S },
    /// A stretch of a homogeneous medium.
    Stretch { t0: f32, t1: f32, sigma_t: S },
    /// A cell whose depth is known all along it, with the coefficients of density 1.
    Cell { cell: Cell, sigma_t: S },
}

impl<S: Spectrum> Hero<S> {
    /// Chooses a channel.
    #[inline]
    #[must_use]
    pub fn choose(rng: &mut Rng) -> Self {
        let channel = if S::CHANNELS == 1 {
            0
        } else {
            rng.below(S::CHANNELS as u32) as usize
        };
        Self {
            channel,
            ratio: S::ONE,
            start: S::ONE,
            passed: Vec::new(),
        }
    }

    /// Weight of each channel by the balance heuristic; 1 of a grey path.
    #[inline]
    #[must_use]
    pub fn weight(&self) -> S {
        Self::balance(self.ratio)
    }

    /// The same of the path that ends at `t` of the last flight, before its collision.
    #[inline]
    #[must_use]
    pub fn weight_at(&self, t: f32) -> S {
        Self::balance(self.ratio_at(t))
    }

    #[inline]
    fn balance(ratio: S) -> S {
        if S::CHANNELS == 1 {
            S::ONE
        } else {
            ratio * (1.0 / ratio.mean())
        }
    }

    /// A flight begins.
    #[inline]
    pub(super) fn set_out(&mut self, sampler: &mut Sampler) {
        sampler.counters.free_flights += 1;
        self.start = self.ratio;
        self.passed.clear();
    }

    /// The flight ends at `end`, in a collision with a medium of this coefficient or in none.
    #[inline]
    pub(super) fn arrive(&mut self, end: f32, collision: Option<S>) {
        if S::CHANNELS > 1 {
            self.ratio = self.ratio_at(end);
            if let Some(sigma_t) = collision.filter(|sigma_t| coloured(*sigma_t)) {
                self.ratio *= self.over_own(sigma_t);
            }
        }
    }

    /// Ratios at `t` of the last flight.
    #[inline]
    pub(super) fn ratio_at(&self, t: f32) -> S {
        let mut ratio = self.start;
        for passed in &self.passed {
            let density = match *passed {
                Passed::Null { t: at, density } if at < t => density,
                Passed::Null { .. } => continue,
                Passed::Stretch { t0, t1, sigma_t } => {
                    S::transmittance(sigma_t * (t.min(t1) - t0).max(0.0))
                }
                Passed::Cell { cell, sigma_t } => S::transmittance(sigma_t * cell.depth(t)),
            };
            ratio *= self.over_own(density);
        }
        ratio
    }

    /// Each channel's density over the hero's.
    #[inline]
    pub(super) fn over_own(&self, density: S) -> S {
        // The hero's own density is 0 where it cannot be, and by rounding alone: no 0/0 then.
        let own = density.channel(self.channel);
        if own > 0.0 {
            density * (1.0 / own)
        } else {
            S::ONE
        }
    }
}

/// True where the channels of a coefficient differ.
#[inline]
pub(super) fn coloured<S: Spectrum>(sigma_t: S) -> bool {
    S::CHANNELS > 1 && sigma_t != S::splat(sigma_t.channel(0))
}
