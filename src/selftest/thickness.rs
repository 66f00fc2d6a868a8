//! Optical thickness from 1e-8 to 1e8: depth, transmittance, free flight, and their work.
//!
//! ```text
//! T = exp(-tau)            relative error of T = absolute error of tau
//! F(t) = 1 - T(t)          of a free flight's distance: uniform, by Kolmogorov-Smirnov
//! ```
//!
//! Two fields: one voxel cell of eight different values, and a box of ones in closed form. A third
//! one, rough and nowhere 0, has minorants and majorants far from each other and from its values:
//! what null collisions do with either shows there, at depths where roulette plays too.

use glam::{IVec3, Vec3};

use super::exact::Depth;
use super::fields::{grid, medium, noise, ray_through, rng};
use super::{SelftestError, Suite, Worst};
use crate::grid::Grid;
use crate::grid::walk::walk;
use crate::march::{Profile, SPENT_OPTICAL_DEPTH};
use crate::medium::{Field, Medium};
use crate::ray::{Bounds, Ray};
use crate::scene::March;
use crate::stats::{Welford, ks_bound, ks_lambda, z_bound};
use crate::tracking::{Counters, Hero, Sampler, sample_free_flight, transmittance};

/// Decades of the extinction.
const DECADES: std::ops::RangeInclusive<i32> = -8..=8;

/// Relative error of an optical depth along one cell.
const RELATIVE: f64 = 1e-5;

/// Relative error of T down to 1e-30.
const FAINT_RELATIVE: f64 = 1e-5;

/// Field look-ups of a free flight and a transmittance along some 120 voxel cells, two each, and of
/// null collisions between.
const MOST_AMONG_SPIKES: f64 = 600.0;

/// Field look-ups of one transmittance, however thick the medium: roulette ends it some mean free
/// paths of the majorant beyond T = 0.05.
const MOST_LOOKUPS: f64 = 64.0;

const FOG: Bounds = Bounds {
    min: Vec3::ZERO,
    max: Vec3::ONE,
};

/// A ray of a medium's world in the local space of its grid.
fn local(medium: &Medium<f32>, ray: &Ray) -> Ray {
    match &medium.field {
        Field::Grid(field) => field.placement.local_ray(ray),
        Field::Plateau(field) => field.placement.local_ray(ray),
        Field::Constant { .. } => *ray,
    }
}

/// Density integrated by the walk that all marches share. \[m\]
fn walked(medium: &Medium<f32>, ray: &Ray) -> f64 {
    let Field::Grid(field) = &medium.field else {
        return 0.0;
    };
    let mut depth = 0.0f64;
    let local = field.placement.exact_ray(ray);
    walk(
        &field.grid,
        &field.majorants,
        &local,
        0.0,
        f32::INFINITY,
        |piece| {
            depth += piece.integral;
            true
        },
    );
    depth
}

/// Figures of one medium at one extinction.
struct Found {
    depth: f64,
    mean: f64,
    flight: f64,
    lookups: f64,
}

/// One medium whose depth up to t is `tau(t)`.
fn probe(
    medium: Medium<f32>,
    ray: &Ray,
    tau: impl Fn(f64) -> f64,
    samples: u32,
    seed: u64,
) -> Found {
    let media = [medium];
    let total = tau(1e9);
    let mut profile = Profile::default();
    let nowhere = &mut Counters::default();
    profile.march((0, &media), ray, f32::INFINITY, March::Exact, nowhere);
    let read = f64::from(profile.optical_depth(profile.t_end));
    // A ray is followed until it is spent, and no further.
    let spent = f64::from(SPENT_OPTICAL_DEPTH);
    let depth = if total < spent {
        (read / total - 1.0).abs()
    } else {
        (1.0 - read / spent).max(0.0)
    };
    let mut sampler = Sampler::new(rng(seed));
    let mean: Welford = (0..samples)
        .map(|_| f64::from(transmittance(&media, ray, f32::INFINITY, &mut sampler)))
        .collect();
    let lookups = sampler.counters.density_lookups as f64 / f64::from(samples);
    // Below 1 the numbers of f32 are 6e-8 apart, and the product has some four roundings. The
    // variance of T in [0, 1] is at most its mean, and that of 1 - T.
    let variance = total.min((-total).exp()) / f64::from(samples);
    let off = (mean.mean() - (-total).exp()).abs();
    let mut hero = Hero::choose(&mut sampler.rng);
    let mut random = rng(seed + 100);
    let mut uniform: Vec<f64> = (0..2 * samples)
        .map(|_| {
            sample_free_flight(&media, ray, f32::INFINITY, &mut hero, &mut sampler).map_or_else(
                || 1.0 - (-total).exp() * random.uniform_f64(),
                |c| -(-tau(c.t.into())).exp_m1(),
            )
        })
        .collect();
    Found {
        depth,
        mean: (off - 2.4e-7).max(0.0) / variance.sqrt().max(f64::MIN_POSITIVE),
        flight: ks_lambda(&mut uniform),
        lookups,
    }
}

/// Every decade of the extinction, in one voxel cell and in one box of fog.
fn decades(suite: &mut Suite, samples: u32) -> Result<(), SelftestError> {
    let cell = grid(IVec3::ZERO, IVec3::ONE, |v| 0.5 + noise(v, 9))?;
    let ray = Ray {
        origin: Vec3::new(0.1, 0.2, 0.0),
        direction: Vec3::new(0.3, 0.2, 0.9).normalize(),
    };
    let exit = FOG.clip(&ray, 0.0, 1e9).map_or(0.0, |(_, b)| f64::from(b));
    let exact = Depth::new(&cell, &local(&medium(&cell, 1.0), &ray), f64::INFINITY);
    let mut worst: [Worst; 4] = Default::default();
    for exponent in DECADES {
        let sigma = 10f32.powi(exponent);
        let fog = Medium {
            field: Field::Constant { bounds: Some(FOG) },
            ..medium(&cell, sigma)
        };
        let seed = 27 + exponent.unsigned_abs() as u64;
        let sigma = f64::from(sigma);
        let of_cell = |t: f64| sigma * exact.at(t);
        let of_fog = |t: f64| sigma * t.min(exit);
        for (name, found) in [
            (
                "cell",
                probe(medium(&cell, sigma as f32), &ray, of_cell, samples, seed),
            ),
            ("fog", probe(fog, &ray, of_fog, samples, seed)),
        ] {
            let figures = [found.depth, found.mean, found.flight, found.lookups];
            for (worst, figure) in worst.iter_mut().zip(figures) {
                worst.take(figure, || format!("{name}, extinction {sigma:e}"));
            }
        }
    }
    let n = 2 * DECADES.count();
    let [depth, mean, flight, lookups] = worst;
    suite.worst(
        "optical depth at 1e-8 to 1e8, relative error",
        depth,
        RELATIVE,
    );
    suite.worst("mean transmittance at 1e-8 to 1e8, |z|", mean, z_bound(n));
    suite.worst(
        "free flights at 1e-8 to 1e8, KS distance",
        flight,
        ks_bound(n),
    );
    suite.worst(
        "look-ups of a transmittance at 1e-8 to 1e8",
        lookups,
        MOST_LOOKUPS,
    );
    Ok(())
}

/// Relative error of T down to 1e-30, of rays through one cell.
fn faint(suite: &mut Suite) -> Result<(), SelftestError> {
    let cell = grid(IVec3::ZERO, IVec3::ONE, |v| 0.5 + noise(v, 9))?;
    let thin = medium(&cell, 1.0f32);
    let mut random = rng(31);
    let mut worst = Worst::default();
    for _ in 0..suite.choose([20_000, 100_000, 1_000_000]) {
        let mut ray = ray_through(&cell, &mut random);
        ray.origin += cell.origin().as_vec3();
        let exact = Depth::new(&cell, &local(&thin, &ray), f64::INFINITY).total();
        // Not those that cut a corner: what is known of a crossing's ends is relative to its length.
        if exact > 0.3 {
            let tau = 69.0 * random.uniform_f64();
            let off = (-tau * (walked(&thin, &ray) / exact - 1.0)).exp_m1().abs();
            worst.take(off, || format!("optical depth {tau}: {ray:?}"));
        }
    }
    suite.worst(
        "transmittance down to 1e-30, relative error",
        worst,
        FAINT_RELATIVE,
    );
    Ok(())
}

/// A rough field that is nowhere 0 inside: 0.5 to 1, and `spike` in one voxel of a thousand.
fn rough(spike: f32) -> Result<Grid, SelftestError> {
    let edge = IVec3::splat(20);
    let value = |v| {
        if noise(v, 5) < 1e-3 {
            spike
        } else {
            0.5 + 0.5 * noise(v, 17)
        }
    };
    Ok(grid(-edge, edge, value)?)
}

/// Ratio tracking where roulette plays, and free flights, through minorants above 0. The rays'
/// extinction comes from their depth without spikes.
fn rough_field(suite: &mut Suite, name: &str, field: &Grid) -> Result<(), SelftestError> {
    let smooth = rough(0.75)?;
    let mut random = rng(33);
    let rays = 12;
    let samples = suite.choose([40_000, 80_000, 400_000]);
    let (mut mean, mut flight) = (Worst::default(), Worst::default());
    for i in 0..rays {
        let mut ray = ray_through(field, &mut random);
        ray.origin += field.origin().as_vec3();
        let mut media = [medium(field, 1.0f32)];
        let ray_inside = local(&media[0], &ray);
        let exact = Depth::new(field, &ray_inside, f64::INFINITY);
        let length = Depth::new(&smooth, &ray_inside, f64::INFINITY).total();
        if length <= 0.0 {
            continue;
        }
        // 1 to 6.5 deep: T from 0.37 to 0.0015.
        let tau = 1.0 + 0.5 * i as f64;
        let sigma = (tau / length) as f32;
        media[0] = medium(field, sigma);
        let sigma = f64::from(sigma);
        let mut sampler = Sampler::new(rng(200 + i));
        let found: Welford = (0..samples)
            .map(|_| f64::from(transmittance(&media, &ray, f32::INFINITY, &mut sampler)))
            .collect();
        let z = found.z((-sigma * exact.total()).exp(), 4e-6);
        mean.take(z.abs(), || format!("{tau} deep: {ray:?}"));
        let mut hero = Hero::choose(&mut sampler.rng);
        let end = (-sigma * exact.total()).exp();
        let mut uniform: Vec<f64> = (0..samples)
            .map(|_| {
                sample_free_flight(&media, &ray, f32::INFINITY, &mut hero, &mut sampler)
                    .map_or_else(
                        || 1.0 - end * random.uniform_f64(),
                        |c| -(-sigma * exact.at(c.t.into())).exp_m1(),
                    )
            })
            .collect();
        flight.take(ks_lambda(&mut uniform), || format!("{tau} deep: {ray:?}"));
    }
    let n = rays as usize;
    let what = format!("ratio tracking and its roulette, {name}, |z|");
    suite.worst(what, mean, z_bound(n));
    let what = format!("free flights in {name}, KS distance");
    suite.worst(what, flight, ks_bound(n));
    Ok(())
}

/// Look-ups of a flight or a transmittance among spikes as high as f32 goes: null collisions would
/// be without number, steps without length.
fn spikes_without_end(suite: &mut Suite) -> Result<(), SelftestError> {
    let mut random = rng(34);
    let mut worst = Worst::default();
    for spike in [1e10, 1e20, 1e38] {
        let field = rough(spike)?;
        let media = [medium(&field, 0.05f32)];
        for i in 0..suite.choose([200, 1000, 10_000]) {
            let mut ray = ray_through(&field, &mut random);
            ray.origin += field.origin().as_vec3();
            let mut sampler = Sampler::new(rng(300 + i));
            let mut hero = Hero::choose(&mut sampler.rng);
            let tr = transmittance(&media, &ray, f32::INFINITY, &mut sampler);
            let end = sample_free_flight(&media, &ray, f32::INFINITY, &mut hero, &mut sampler);
            let finite = tr.is_finite() && end.is_none_or(|c| c.t.is_finite());
            let lookups = sampler.counters.density_lookups as f64;
            worst.take(if finite { lookups } else { f64::NAN }, || {
                format!("{spike:e}: {ray:?}")
            });
        }
    }
    let what = "look-ups of a flight and a transmittance among spikes of 1e38";
    suite.worst(what, worst, MOST_AMONG_SPIKES);
    Ok(())
}

/// The checks of this family.
///
/// # Errors
/// None in practice: the fields are small.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let samples = suite.choose([10_000, 40_000, 400_000]);
    decades(suite, samples)?;
    faint(suite)?;
    rough_field(suite, "a rough field", &rough(0.75)?)?;
    rough_field(suite, "a field of spikes", &rough(3e4)?)?;
    spikes_without_end(suite)
}
