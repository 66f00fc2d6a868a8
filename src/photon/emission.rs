//! Photons from the lights on, many at a time.
//!
//! ```text
//! photon i of N:   light by i / N, four numbers by the i-th point of a Kronecker sequence
//! ```
//!
//! In a grey medium of one grid photons fly side by side (`tracking/many.rs`): a photon that ends leaves its
//! lane to the next. What becomes of each does not depend on the others, and the order in which
//! deposits are kept only on the chunk that they are traced in.

use std::ops::Range;

use super::flight::{Flight, Piece};
use super::{Heading, Photons, TraceSettings};
use crate::light::{Emitted, Light};
use crate::ray::Bounds;
use crate::rng::Rng;
use crate::scene::Direct;
use crate::spectrum::Spectrum;
use crate::tracking::{Collision, Flights, Hero, Sampler, lanes_of, sample_free_flight};
use crate::world::World;

/// Chunks that photons are traced in: parallel work, whatever the number of threads.
const CHUNKS: u64 = 256;
/// Least and most photons of one. More: lanes that run empty at its end matter less.
const CHUNK: Range<u64> = 256..4096;

/// Photons of a chunk.
pub(super) fn chunk_of(photons: u64) -> u64 {
    photons.div_ceil(CHUNKS).clamp(CHUNK.start, CHUNK.end)
}

/// Fractions added per photon: powers of the inverse of the root of x^5 = x + 1, in 2^-64.
const KRONECKER: [u64; 4] = [
    0xdb4f_0b91_75ae_2165,
    0xbbe0_5633_03a4_615f,
    0xa0f2_ec75_a1fe_1575,
    0x89e1_8285_7d9e_d688,
];

/// How the emitted photons are shared out among the lights.
pub(super) struct Shares {
    /// Probability of each light.
    probability: Vec<f32>,
    /// Upper end of each light's share of [0, 1).
    upper: Vec<f32>,
}

impl Shares {
    pub(super) fn new<S: Spectrum>(world: &World<S>, target: &Bounds) -> Option<Self> {
        let powers: Vec<f32> = world
            .lights
            .iter()
            .map(|l| l.power_toward(target))
            .collect();
        let total: f32 = powers.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mut sum = 0.0;
        let upper = powers
            .iter()
            .map(|p| {
                sum += p / total;
                sum
            })
            .collect();
        Some(Self {
            probability: powers.iter().map(|p| p / total).collect(),
            upper,
        })
    }

    fn pick(&self, u: f32) -> usize {
        let last = self.probability.iter().rposition(|p| *p > 0.0).unwrap_or(0);
        self.upper
            .iter()
            .position(|upper| u < *upper)
            .unwrap_or(last)
    }
}

/// What photons begin with.
pub(super) struct Emission<'a, S> {
    pub(super) world: &'a World<S>,
    pub(super) settings: &'a TraceSettings<'a>,
    pub(super) shares: Shares,
    pub(super) shift: [u64; 5],
}

impl<'a, S: Spectrum> Emission<'a, S> {
    /// Emits and follows photons.
    pub(super) fn trace<H: Heading>(&self, indices: Range<u64>) -> Photons<S, H> {
        let mut out = Photons::none(0);
        match self.world.open_media() {
            [medium] if let Some(flights) = Flights::new(medium) => {
                self.trace_many(indices, flights, &mut out);
            }
            _ => {
                for index in indices {
                    if let Some(mut photon) = self.emit(index, &mut out) {
                        photon.follow(self.settings, &mut out);
                        out.counters += photon.sampler.counters;
                    }
                }
            }
        }
        out
    }

    /// The same in lanes.
    fn trace_many<H: Heading>(
        &self,
        mut indices: Range<u64>,
        mut flights: Flights<'_>,
        out: &mut Photons<S, H>,
    ) {
        let mut lanes: [Option<Flight<'a, S>>; Flights::LANES] = std::array::from_fn(|_| None);
        let mut flying = 0;
        for (lane, photon) in lanes.iter_mut().enumerate() {
            flying += usize::from(self.set_out(lane, photon, &mut indices, &mut flights, out));
        }
        while flying > 0 {
            let ended = flights.advance();
            for lane in lanes_of(ended.collided | ended.left) {
                let Some(photon) = &mut lanes[lane] else {
                    continue;
                };
                let t = flights.end(lane, &mut photon.sampler);
                let collided = ended.collided >> lane & 1 == 1;
                let collision = collided.then_some(Collision { t, medium: 0 });
                if !photon.arrive(collision, self.settings, out) {
                    out.counters += photon.sampler.counters;
                    lanes[lane] = None;
                }
                let goes_on = self.set_out(lane, &mut lanes[lane], &mut indices, &mut flights, out);
                flying -= usize::from(!goes_on);
            }
        }
        out.counters.density_lookups += flights.lookups();
    }

    /// Sends the photon of a lane, or the next one, on a flight that takes turns; false if there are no
    /// more.
    fn set_out<H: Heading>(
        &self,
        lane: usize,
        of_lane: &mut Option<Flight<'a, S>>,
        indices: &mut Range<u64>,
        flights: &mut Flights<'_>,
        out: &mut Photons<S, H>,
    ) -> bool {
        loop {
            let photon = match of_lane {
                Some(photon) => photon,
                None => {
                    let Some(index) = indices.next() else {
                        return false;
                    };
                    let Some(photon) = self.emit(index, out) else {
                        continue;
                    };
                    of_lane.insert(photon)
                }
            };
            let collision = match photon.set_out() {
                Piece::Known(collision) => collision,
                Piece::Flight { media, t_max } => {
                    let (ray, hero, sampler) = (&photon.ray, &mut photon.hero, &mut photon.sampler);
                    if !std::ptr::eq(media, self.world.open_media()) {
                        sample_free_flight(media, ray, t_max, hero, sampler)
                    } else if flights.set_out(lane, ray, t_max, hero, sampler) {
                        return true;
                    } else {
                        None
                    }
                }
            };
            if !photon.arrive(collision, self.settings, out) {
                out.counters += photon.sampler.counters;
                *of_lane = None;
            }
        }
    }

    /// Emits one photon; none if there is no light in its direction.
    fn emit<H: Heading>(&self, index: u64, out: &mut Photons<S, H>) -> Option<Flight<'a, S>> {
        let Self {
            world,
            settings,
            shares,
            shift,
        } = self;
        let mut sampler = Sampler::new(Rng::stream(
            settings.seed,
            settings.stage,
            settings.pass,
            index,
        ));
        // Lights take turns in proportion to their power; each photon's four numbers are the next
        // point of the shifted sequence.
        let unit = |bits: u64| (bits >> 40) as f32 * (1.0 / (1u64 << 24) as f32);
        let turn = (index as f64 + f64::from(unit(shift[4]))) / settings.emit as f64;
        let which = shares.pick(turn as f32);
        let u: [f32; 4] = std::array::from_fn(|d| {
            unit(shift[d].wrapping_add(KRONECKER[d].wrapping_mul(index + 1)))
        });
        let light = &world.lights[which];
        let emitted = match (light, &world.surfaces) {
            (Light::Emitter(emitter), Some(surfaces)) => {
                emitter.emit(surfaces, &world.target, u, &mut sampler.rng)
            }
            (Light::Glow(glow), _) => glow.emit(world, u, &mut sampler.rng),
            _ => light.emit(&world.target, u, &mut sampler.rng),
        };
        let Emitted { ray, power } = emitted?;
        let power = power * (1.0 / (shares.probability[which] * settings.emit as f32));
        out.energy.emitted += f64::from(power.mean());
        let counts = &mut sampler.counters.effects;
        counts.sky += u64::from(light.is_sky());
        counts.coloured += u64::from(S::CHANNELS > 1);
        Some(Flight {
            world,
            ray,
            power,
            hero: Hero::choose(&mut sampler.rng),
            inside: world.light_inside[which],
            order: 0,
            keep_first: settings.direct == Direct::Photons || !light.is_sampled(),
            straight: light.is_glow(),
            left: sampler.uniform(),
            sampler,
            pieces: 0,
            hit: None,
        })
    }
}
