//! Many free flights at a time.
//!
//! Octets of them take turns (octet.rs), so that what one has to fetch comes while the others go on. Whoever
//! follows photons sends a new one into a lane whose flight has ended.
//!
//! Each lane draws the numbers that its photon would draw alone, in the same order, and is the same
//! flight to the last bit as that of [`sample_free_flight`](super::sample_free_flight). Grey media of
//! one grid only, and none so dense that they are crossed cell by cell (`dense.rs`).

use super::Sampler;
use super::dense::DENSE;
use super::hero::{Hero, coloured};
use super::octet::FlightOctet;
use crate::medium::{Field, Medium};
use crate::ray::Ray;
use crate::spectrum::Spectrum;

/// Octets. More: more is on its way at a time, and less of it in the first-level cache.
const OCTETS: usize = 4;

/// Free flights side by side, under way or not.
#[derive(Debug, Clone)]
pub struct Flights<'a> {
    octets: [FlightOctet<'a>; OCTETS],
    lookups: u64,
}

/// Lanes whose flights ended, a bit each.
#[derive(Debug, Clone, Copy)]
pub struct Ended {
    /// In a collision.
    pub collided: u32,
    /// In none.
    pub left: u32,
}

/// The lanes of bits that are set.
pub fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < Flights::LANES).then_some(lane)
    })
}

impl<'a> Flights<'a> {
    /// Flights at a time.
    pub const LANES: usize = 8 * OCTETS;

    /// Flights through a medium; none if they cannot be in lanes.
    #[must_use]
    pub fn new<S: Spectrum>(medium: &'a Medium<S>) -> Option<Self> {
        let Field::Grid(field) = &medium.field else {
            return None;
        };
        let sigma_t = medium.sigma_t.max_channel();
        // No direction is shorter in voxels than one along their longest edge, but for rounding.
        let densest = 0.99 * DENSE / field.voxel_size;
        // Not so of what is not a number.
        let thin = sigma_t * field.grid.range()[1] < densest;
        let fit = thin && !coloured(medium.sigma_t) && !field.grid.support().is_empty();
        fit.then(|| Self {
            octets: std::array::from_fn(|_| FlightOctet::new(field, sigma_t)),
            lookups: 0,
        })
    }

    /// Begins a flight as far as `t_max` in a lane; false if the ray misses the medium. The sampler's
    /// stream is the lane's until the flight has [ended](Self::end).
    #[inline]
    pub fn set_out<S: Spectrum>(
        &mut self,
        lane: usize,
        ray: &Ray,
        t_max: f32,
        hero: &mut Hero<S>,
        sampler: &mut Sampler,
    ) -> bool {
        // The medium is grey: no colour is more likely after the flight than before.
        hero.set_out(sampler);
        self.octets[lane / 8 % OCTETS].set_out(lane, ray, t_max, sampler)
    }

    /// Where the flight of a lane ended that has, if in a collision.
    #[inline]
    pub fn end(&self, lane: usize, sampler: &mut Sampler) -> f32 {
        self.octets[lane / 8 % OCTETS].end(lane, sampler)
    }

    /// Look-ups of all flights.
    #[must_use]
    pub fn lookups(&self) -> u64 {
        self.lookups
    }

    /// A turn of all flights.
    #[inline(never)]
    pub fn advance(&mut self) -> Ended {
        let mut ended = Ended {
            collided: 0,
            left: 0,
        };
        let mut looking = 0;
        // Part by part: while one octet waits for what it fetched the next one fetches.
        self.octets.iter_mut().for_each(FlightOctet::fetch);
        self.octets.iter_mut().for_each(FlightOctet::step);
        self.octets.iter_mut().for_each(FlightOctet::draw);
        self.octets.iter_mut().for_each(FlightOctet::find_blocks);
        for (number, octet) in self.octets.iter_mut().enumerate() {
            let turn = octet.collide();
            ended.collided |= turn.collided << (8 * number);
            ended.left |= turn.left << (8 * number);
            looking |= turn.looking << (8 * number);
        }
        self.lookups += u64::from(looking.count_ones());
        for lane in lanes_of(looking) {
            self.octets[lane / 8].look_up(lane);
        }
        ended
    }
}
