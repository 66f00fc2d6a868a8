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
mod emission;
mod flight;
mod heading;
pub(crate) mod kdtree;
pub mod kept;
mod lattice;
pub mod map;
mod part;
pub mod radius;
pub mod rim;
pub mod surface;

use glam::Vec3;
use rayon::prelude::*;

use crate::rng::{Rng, Stage};
use crate::scene::Direct;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;
use crate::world::World;

pub use heading::{Heading, Packed};

use deposit::DepositRate;
use emission::{Emission, Shares, chunk_of};
use kept::{Kept, chance_of};
use surface::SurfacePhoton;

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
    let emission = Emission {
        world,
        settings,
        shares,
        shift: std::array::from_fn(|_| shift.bits()),
    };
    let chunk = chunk_of(settings.emit);
    let chunks: Vec<Photons<S, H>> = (0..settings.emit.div_ceil(chunk))
        .into_par_iter()
        .map(|number| {
            let first = number * chunk;
            emission.trace(first..(first + chunk).min(settings.emit))
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
