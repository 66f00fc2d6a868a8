//! The pilot: few photons that set the rate of deposits and the radius at every place.

use std::time::Instant;

use super::job::Job;
use super::passes::Tally;
use crate::photon::deposit::DepositRate;
use crate::photon::radius::{PILOT_NEIGHBOURS, RadiusField};
use crate::photon::surface::SurfaceRadius;
use crate::photon::{Heading, Photons, TraceSettings, trace_photons};
use crate::rng::Stage;
use crate::spectrum::Spectrum;

/// Photons of a pilot estimate that are emitted, at most: twice as many are stored.
const PILOT_EMITTED: u64 = 30_000;
/// Photons that set the rate of deposits.
const FEW: u64 = 2000;

/// Least radius, a share of the scene. Smaller: 1 / r^2 beyond what f32 adds; larger: detail of
/// photons is lost.
const LEAST: f32 = 1e-5;
/// Greatest radius on surfaces, a share of theirs. Smaller: noise where few photons are; larger:
/// light from the next room.
const MOST_ON_SURFACES: f32 = 0.1;

/// Photons of a pilot estimate for a pass of `photons` whose kernels hold `neighbours`: so many that
/// the ball of its neighbours is half as large as such a kernel. More tell what kernels blur again.
fn pilots(photons: u64, neighbours: u32) -> u64 {
    let enough = photons.saturating_mul(2 * PILOT_NEIGHBOURS as u64) / u64::from(neighbours.max(1));
    enough.min(PILOT_EMITTED).clamp(1, photons.max(1))
}

/// Radii from the pilots: of photons in media, and of points on surfaces.
pub(super) struct Radii<S> {
    /// Where photons are deposited.
    pub(super) rate: DepositRate,
    pub(super) media: RadiusField,
    pub(super) surfaces: Option<SurfaceRadius<S>>,
}

/// Radii from a pilot estimate.
pub(super) fn radii<S: Spectrum, H: Heading>(job: &Job<'_, S>, tally: &mut Tally) -> Radii<S> {
    let clock = Instant::now();
    job.exec.progress.stage("pilot", None);
    let settings = &job.scene.settings;
    let rate = DepositRate::new(&job.world.media, &job.world.parts);
    let mut trace = TraceSettings {
        rate: &rate,
        emit: FEW.min(settings.photons),
        seed: settings.seed,
        stage: Stage::Pilot,
        pass: 0,
        direct: settings.direct,
        surface_photons: job.plan.surface_photons,
    };
    let few = trace_photons::<S, H>(job.world, &trace);
    let deposits = few.first.len() + few.higher.len();
    let mut rate = rate.clone();
    let per_path = |count: u64| count as f64 / trace.emit as f64;
    rate.settle(
        per_path(deposits as u64),
        per_path(few.counters.free_flights),
    );
    trace.rate = &rate;
    trace.emit = pilots(settings.photons, settings.neighbours);
    let Photons {
        first,
        higher,
        surface,
        counters,
        ..
    } = trace_photons::<S, H>(job.world, &trace);
    tally.counters += few.counters;
    tally.counters += counters;
    let positions = first.iter().chain(&higher).map(|p| p.position).collect();
    let ratio = settings.photons as f32 / trace.emit as f32;
    let widest = job.world.parts.iter().map(|p| p.reach).fold(0.0, f32::max);
    let limits = [(LEAST * job.world.bounds.radius()).min(widest), widest];
    let field = RadiusField::new(positions, settings.neighbours as f32, ratio, limits);
    let surfaces = job.plan.surface_photons.then(|| {
        let extent = job.world.target.radius();
        let limits = [LEAST * extent, MOST_ON_SURFACES * extent];
        SurfaceRadius::new(surface, settings.neighbours as f32, ratio, limits)
    });
    tally.times.map += clock.elapsed().as_secs_f64();
    Radii {
        rate,
        media: field,
        surfaces,
    }
}
