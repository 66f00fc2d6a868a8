//! Photons: tracing them from the lights through the media.
//!
//! ```text
//! emitted        Phi = power / N                                     N = photons emitted
//! deposits       (position, direction, Phi / lambda)                 at rate lambda along the way
//! survival       with probability q = max(albedo Phi) / max(Phi);    Phi <- albedo Phi / q
//! ```
//!
//! A photon flies from collision to collision (`tracking`) and is deposited on its way at a rate
//! of the place alone (`deposit`): deposits estimate the fluence, and the in-scattered radiance
//! toward a camera ray is the sum of sigma_s p P over the estimate's area or volume (DESIGN section
//! 3, whose deposits at collisions are the case lambda = sigma_t). Absorption is played out by
//! Russian roulette (analogue for one channel), so that all photons of a grey scene carry the same
//! power: what density estimation likes best.
//!
//! Sources: Jensen & Christensen 1998; Jensen 2001. Departures: emission is stratified over the
//! lights and follows a Kronecker sequence (Roberts 2018's generalised golden ratio), shifted at
//! random in every pass: unbiased, and the first orders are smoother than independent draws.
//! The first order of lights that are sampled along camera rays is not deposited.
//!
//! Surfaces. Of the nearest surface and the free flight through the media of the place, whichever
//! comes first happens. Boundaries that bend nothing are passed and use up no bounce; reflection
//! and refraction are scattering events like a collision, absorption there is the same Russian
//! roulette. A photon that arrives on a diffuse surface after at least one event is kept in a map
//! of its own: light that comes straight from a light is sampled there. For the same reason a
//! flight after a mirror or a lens is deposited on (a caustic, which no shadow ray finds), one
//! straight from a sampled light is not.

pub mod deposit;
mod flight;
mod heading;
pub(crate) mod kdtree;
pub mod kept;
pub mod map;
mod part;
pub mod radius;
pub mod rim;
pub mod surface;

use glam::Vec3;
use rayon::prelude::*;

use crate::light::{Emitted, Light};
use crate::ray::Bounds;
use crate::rng::{Rng, Stage};
use crate::scene::Direct;
use crate::spectrum::Spectrum;
use crate::tracking::{Counters, Hero, Sampler};
use crate::world::World;

pub use heading::{Heading, Packed};

use deposit::DepositRate;
use flight::Flight;
use kept::{Kept, chance_of};
use surface::SurfacePhoton;

/// Photons of one unit of parallel work.
const CHUNK: u64 = 512;

/// A photon on its way. 16 bytes grey and isotropic, 32 chromatic and anisotropic.
#[derive(Debug, Clone, Copy)]
pub struct Photon<S: Spectrum, H> {
    /// Where it was. \[m\]
    pub position: Vec3,
    /// Power and radius.
    kept: S::Kept,
    /// Direction of travel.
    pub heading: H,
}

impl<S: Spectrum, H> Photon<S, H> {
    /// A photon without a radius, its power being that over the rate of deposits there \[W m\].
    #[inline]
    #[must_use]
    pub fn new(position: Vec3, power: S, heading: H) -> Self {
        Self {
            position,
            kept: S::Kept::new(power, chance_of(position)),
            heading,
        }
    }

    /// Its power over the rate of deposits there. \[W m\]
    #[inline]
    #[must_use]
    pub fn power(&self) -> S {
        self.kept.power()
    }

    /// Radius of its kernel; 0 until the map sets it. \[m\]
    #[inline]
    #[must_use]
    pub fn radius(&self) -> f32 {
        self.kept.radius()
    }

    /// Sets the radius \[m\], as nearly as it is kept.
    #[inline]
    pub fn set_radius(&mut self, radius: f32) {
        self.kept = self.kept.with_radius(radius);
    }
}

/// What became of the emitted power:
/// emitted = absorbed + on surfaces + escaped + cut off. \[W\]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Energy {
    /// Left the lights toward the media.
    pub emitted: f64,
    /// Absorbed in the media.
    pub absorbed: f64,
    /// Absorbed by surfaces.
    pub on_surfaces: f64,
    /// Left the scene.
    pub escaped: f64,
    /// Left over at the highest scattering order.
    pub cut_off: f64,
}

impl std::ops::AddAssign for Energy {
    fn add_assign(&mut self, other: Self) {
        self.emitted += other.emitted;
        self.absorbed += other.absorbed;
        self.on_surfaces += other.on_surfaces;
        self.escaped += other.escaped;
        self.cut_off += other.cut_off;
    }
}

/// What to trace.
#[derive(Debug, Clone, Copy)]
pub struct TraceSettings<'a> {
    /// Photons to emit.
    pub emit: u64,
    /// Random streams.
    pub seed: u64,
    /// Stage of the streams.
    pub stage: Stage,
    /// Pass of the streams.
    pub pass: u64,
    /// First order: deposited for every light, or only for those that are not sampled along
    /// camera rays.
    pub direct: Direct,
    /// Where they are deposited.
    pub rate: &'a DepositRate,
    /// Photons are kept where they meet diffuse surfaces.
    pub surface_photons: bool,
}

/// The photons of a pass.
#[derive(Debug, Clone)]
pub struct Photons<S: Spectrum, H> {
    /// Deposits of the first scattering order.
    pub first: Vec<Photon<S, H>>,
    /// Deposits of all higher orders.
    pub higher: Vec<Photon<S, H>>,
    /// Arrivals on diffuse surfaces after at least one scattering event, or straight from a medium.
    pub surface: Vec<SurfacePhoton<S>>,
    /// Photons emitted: the count that normalises.
    pub emitted: u64,
    /// Where the power went.
    pub energy: Energy,
    /// Work done.
    pub counters: Counters,
}

impl<S: Spectrum, H: Heading> Photons<S, H> {
    /// No deposits of `emitted` photons.
    fn none(emitted: u64) -> Self {
        Self {
            first: Vec::new(),
            higher: Vec::new(),
            surface: Vec::new(),
            emitted,
            energy: Energy::default(),
            counters: Counters::default(),
        }
    }

    /// Bytes that the deposits take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        (self.first.len() + self.higher.len()) * size_of::<Photon<S, H>>()
            + self.surface.len() * size_of::<SurfacePhoton<S>>()
    }

    /// Deposits of all orders, in media and on surfaces.
    #[must_use]
    pub fn stored(&self) -> usize {
        self.first.len() + self.higher.len() + self.surface.len()
    }
}

/// Fractions added per photon: powers of the inverse of the root of x^5 = x + 1, in 2^-64.
const KRONECKER: [u64; 4] = [
    0xdb4f_0b91_75ae_2165,
    0xbbe0_5633_03a4_615f,
    0xa0f2_ec75_a1fe_1575,
    0x89e1_8285_7d9e_d688,
];

/// How the emitted photons are shared out among the lights.
struct Shares {
    /// Probability of each light.
    probability: Vec<f32>,
    /// Upper end of each light's share of [0, 1).
    upper: Vec<f32>,
}

impl Shares {
    fn new<S: Spectrum>(world: &World<S>, target: &Bounds) -> Option<Self> {
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

/// Traces photons; the same whatever the number of threads.
#[must_use]
pub fn trace_photons<S: Spectrum, H: Heading>(
    world: &World<S>,
    settings: &TraceSettings<'_>,
) -> Photons<S, H> {
    let mut all = Photons::none(settings.emit);
    let Some(shares) = Shares::new(world, &world.target) else {
        return all;
    };
    let mut shift = Rng::stream(settings.seed, settings.stage, settings.pass, u64::MAX);
    let shift: [u64; 5] = std::array::from_fn(|_| shift.bits());
    let chunks: Vec<Photons<S, H>> = (0..settings.emit.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut part = Photons::none(0);
            for index in chunk * CHUNK..((chunk + 1) * CHUNK).min(settings.emit) {
                trace_one(world, settings, &shares, &shift, index, &mut part);
            }
            part
        })
        .collect();
    all.first
        .reserve_exact(chunks.iter().map(|c| c.first.len()).sum());
    all.higher
        .reserve_exact(chunks.iter().map(|c| c.higher.len()).sum());
    all.surface
        .reserve_exact(chunks.iter().map(|c| c.surface.len()).sum());
    for chunk in chunks {
        all.surface.extend(chunk.surface);
        all.first.extend(chunk.first);
        all.higher.extend(chunk.higher);
        all.energy += chunk.energy;
        all.counters += chunk.counters;
    }
    let counts = &mut all.counters.effects;
    counts.first_order += all.first.len() as u64;
    counts.higher_orders += all.higher.len() as u64;
    counts.surface_photons += all.surface.len() as u64;
    all
}

/// Emits and follows one photon.
fn trace_one<S: Spectrum, H: Heading>(
    world: &World<S>,
    settings: &TraceSettings<'_>,
    shares: &Shares,
    shift: &[u64; 5],
    index: u64,
    out: &mut Photons<S, H>,
) {
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
    let u: [f32; 4] =
        std::array::from_fn(|d| unit(shift[d].wrapping_add(KRONECKER[d].wrapping_mul(index + 1))));
    let light = &world.lights[which];
    let emitted = match (light, &world.surfaces) {
        (Light::Emitter(emitter), Some(surfaces)) => {
            emitter.emit(surfaces, &world.target, u, &mut sampler.rng)
        }
        (Light::Glow(glow), _) => glow.emit(world, u, &mut sampler.rng),
        _ => light.emit(&world.target, u, &mut sampler.rng),
    };
    let Some(Emitted { ray, power }) = emitted else {
        return;
    };
    let power = power * (1.0 / (shares.probability[which] * settings.emit as f32));
    out.energy.emitted += f64::from(power.mean());
    let counts = &mut sampler.counters.effects;
    counts.sky += u64::from(light.is_sky());
    counts.coloured += u64::from(S::CHANNELS > 1);
    let keep_first = settings.direct == Direct::Photons || !light.is_sampled();
    Flight {
        world,
        ray,
        power,
        hero: Hero::choose(&mut sampler.rng),
        inside: world.light_inside[which],
        order: 0,
        straight: light.is_glow(),
        left: sampler.uniform(),
    }
    .follow(settings, keep_first, &mut sampler, out);
    out.counters += sampler.counters;
}
