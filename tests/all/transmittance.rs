//! Optical depth, transmittance and free flight against f64 and against exact distributions.
//!
//! The exact march integrates a cubic exactly; what is left is f32. A point of the ray is known
//! to delta = 2 eps (|o| + t |d|) voxels, so the density to its slope times delta, plus a few
//! roundings of its own:
//!
//! ```text
//! |depth - exact| <= integral of |slope| delta dt + 2 delta max + 8 eps depth
//! ```
//!
//! Between the knots of a profile the depth is a quartic, read as the cubic with its ends' values
//! and slopes: with c the density's cubic coefficient on a piece of length L, that is off by
//! c/4 s^2 (1 - s)^2 L^4 <= |c| L^4 / 64, and the density by at most 0.0482 |c| L^3; both errors
//! average to 0 over the piece's two halves or its whole.

use glam::{IVec3, Vec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::march::{Profile, transmittance as march_transmittance};
use vpm_vdb::medium::{Field, Medium, Placement};
use vpm_vdb::phase::PhaseFunction;
use vpm_vdb::ray::{Bounds, Ray};
use vpm_vdb::rng::Rng;
use vpm_vdb::scene::March;
use vpm_vdb::spectrum::Spectrum;
use vpm_vdb::tracking::{Counters, Hero, Sampler, sample_free_flight, transmittance};

use crate::fields::{
    direction, generated, grid, medium, patchy, ray_through, real_density, rng, smoke,
};
use crate::stats::{Welford, ks_p, sidak, z_bound};
use vpm_vdb::selftest::exact::Depth;

const EPS: f64 = f32::EPSILON as f64;

/// The ray in the local space of a medium's grid, as the renderer sees it.
fn local<S>(medium: &Medium<S>, ray: &Ray) -> Ray {
    match &medium.field {
        Field::Grid(field) => field.placement.local_ray(ray),
        Field::Plateau(field) => field.placement.local_ray(ray),
        Field::Constant { .. } => *ray,
    }
}

/// A grid's ray in the world of its medium: index coordinates.
fn world(grid: &Grid, ray: &Ray) -> Ray {
    Ray {
        origin: ray.origin + grid.origin().as_vec3(),
        direction: ray.direction,
    }
}

/// A medium whose world is the local space of its grid, so that rays are the same in both.
fn in_voxels(grid: &Grid, sigma_t: f32) -> Medium<f32> {
    let mut medium = medium(grid, sigma_t);
    if let Field::Grid(field) = &mut medium.field {
        field.placement = Placement::IDENTITY;
    }
    medium
}

fn profile<S: Spectrum>(media: &[Medium<S>], ray: &Ray, march: March) -> Profile<S> {
    let mut profile = Profile::default();
    profile.march(
        (0, media),
        ray,
        f32::INFINITY,
        march,
        &mut Counters::default(),
    );
    profile
}

/// What rounding may do to the integral of the density up to t.
fn rounding(grid: &Grid, ray: &Ray, exact: &Depth<'_>, t: f64) -> f64 {
    let o = f64::from(ray.origin.abs().max_element());
    let d = f64::from(ray.direction.abs().max_element());
    let delta = 2.0 * EPS * (o + exact.extent().1 * d);
    // The ends themselves are off by as much, where the density is the largest at most.
    let ends = 2.0 * delta * f64::from(grid.range()[1]);
    exact.roughness(t) * delta + ends + 8.0 * EPS * exact.at(t)
}

/// Fields of this module: those of `fields`, smoke, and a real one where there is one.
fn fields() -> Vec<(&'static str, Grid)> {
    let mut fields = generated();
    fields.push(("smoke", grid(IVec3::splat(-24), IVec3::splat(24), smoke)));
    if let Some(real) = real_density("openvdb_smoke1_v222.vdb") {
        fields.push(("openvdb_smoke1", real));
    }
    fields
}

#[test]
fn exact_march_is_exact() {
    let mut random = rng(20);
    for (name, grid) in fields() {
        let (mut worst, mut over) = (0.0f64, 0.0f64);
        let mut field = in_voxels(&grid, 1.0);
        for _ in 0..4000 {
            let ray = ray_through(&grid, &mut random);
            let exact = Depth::new(&grid, &ray, f64::INFINITY);
            // Thin enough that no ray is spent, nor shadow rays play roulette.
            let sigma = (2.9 / exact.total().max(1e-6)).min(1.0) as f32;
            field.sigma_t = sigma;
            let found = profile(std::slice::from_ref(&field), &ray, March::Exact);
            let tau = f64::from(sigma) * exact.total();
            let bound = f64::from(sigma) * rounding(&grid, &ray, &exact, f64::INFINITY);
            let off = (f64::from(found.optical_depth(found.t_end)) - tau).abs();
            assert!(
                off <= bound,
                "{name}: optical depth off by {off:e} of {tau}, bound {bound:e}: {ray:?}"
            );
            let shadow: f32 = march_transmittance(
                std::slice::from_ref(&field),
                &ray,
                f32::INFINITY,
                &mut Sampler::new(random.clone()),
            );
            for tr in [found.transmittance, shadow] {
                let off = (f64::from(tr) / (-tau).exp() - 1.0).abs();
                assert!(
                    off <= 1.01 * bound + 3e-7,
                    "{name}: transmittance off by {off:e}, bound {bound:e}"
                );
            }
            if tau > 1e-3 {
                worst = worst.max(off / tau);
                over = over.max(off / bound);
            }
        }
        println!(
            "{name}: worst relative error of the optical depth {worst:.1e}, {over:.2} of its bound"
        );
    }
}

/// Shadow rays that come deeper than the roulette's depth: rarely all the way, and right on average.
#[test]
fn shadow_rays_end_by_roulette_without_bias() {
    let mut random = rng(22);
    let (rays, samples) = (20, 20_000);
    let bound = z_bound(6 * rays);
    for (name, grid) in fields().into_iter().take(2) {
        let mut media = [medium(&grid, Vec3::ONE)];
        for i in 0..rays {
            let ray = ray_through(&grid, &mut random);
            media[0].sigma_t = Vec3::ONE;
            let depth = profile(&media, &ray, March::Exact)
                .optical_depth(f32::INFINITY)
                .x;
            if depth <= 0.0 {
                continue;
            }
            // 3.2 to 7 deep in the thinnest channel.
            let thinnest = (3.2 + 0.2 * i as f32) / depth;
            media[0].sigma_t = Vec3::new(1.5, 1.0, 1.1) * thinnest;
            let exact = profile(&media, &ray, March::Exact).transmittance;
            let mut channels = [Welford::default(); 3];
            let mut sampler = Sampler::new(random.clone());
            random.bits();
            for _ in 0..samples {
                let tr: Vec3 = march_transmittance(&media, &ray, f32::INFINITY, &mut sampler);
                assert!(
                    tr.max_element() <= 0.05,
                    "{name}: weight of a survivor {tr}"
                );
                for (channel, tr) in channels.iter_mut().zip(tr.to_array()) {
                    channel.add(f64::from(tr));
                }
            }
            for (channel, exact) in channels.iter().zip(exact.to_array()) {
                let z = channel.z(f64::from(exact), 0.0);
                assert!(z.abs() < bound, "{name}: depth {depth}, z {z}");
            }
        }
    }
}

/// Readings of a profile at any t: transmittance, density, and the inverse.
#[test]
fn readings_of_a_profile_are_exact() {
    let mut random = rng(21);
    for (name, grid) in fields() {
        let mut media = [in_voxels(&grid, 1.0)];
        let (mut over, mut inverse) = (0.0f64, 0.0f64);
        for _ in 0..500 {
            let ray = ray_through(&grid, &mut random);
            let exact = Depth::new(&grid, &ray, f64::INFINITY);
            let sigma = (8.0 / exact.total().max(1e-6)).min(1.0) as f32;
            media[0].sigma_t = sigma;
            let found = profile(&media, &ray, March::Exact);
            if found.is_clear() {
                assert!(
                    exact.total() <= rounding(&grid, &ray, &exact, 1e9),
                    "{name}"
                );
                continue;
            }
            let (enter, exit) = exact.extent();
            for _ in 0..20 {
                let t = (enter + random.uniform_f64() * (exit - enter)) as f32;
                let bound = f64::from(sigma) * rounding(&grid, &ray, &exact, f64::from(t));
                let tau = f64::from(sigma) * exact.at(f64::from(t));
                let read = f64::from(found.optical_depth(t));
                let (quartic, _) = exact.cubic_reading_error(f64::from(t));
                let allowed = 2.0 * bound + f64::from(sigma) * quartic;
                over = over.max((read - tau).abs() / allowed);
                assert!(
                    (read - tau).abs() <= allowed,
                    "{name}: optical depth {read} at {t}, exactly {tau}, bound {allowed:e}"
                );
                let tr = f64::from(found.transmittance(t));
                assert!(
                    (tr - (-tau).exp()).abs() <= 1.01 * allowed + 3e-7,
                    "{name}: transmittance {tr} at {t}"
                );
                // Where the inverse says that the depth is reached, the profile reads it.
                let reached = found.distance_at(read as f32, 0);
                let again = f64::from(found.optical_depth(reached));
                // The inverse stops at twice eps; t itself resolves a depth no better than this.
                let resolved = f64::from(sigma * grid.range()[1]) * EPS * (exit + 1.0);
                let depth = f64::from(sigma) * exact.total();
                inverse = inverse.max((again - read).abs() / (4.0 * resolved + 8.0 * EPS * depth));
            }
        }
        println!("{name}: readings off by {over:.2} of their bound, the inverse by {inverse:.2}");
        assert!(
            inverse < 1.0,
            "{name}: inverse off by {inverse} of its bound"
        );
    }
}

/// The density that a profile reads is the slope of its cubic: within the bound above, plus what
/// rounding of the depth does to the slope of a piece.
#[test]
fn densities_read_from_a_profile_are_those_of_the_field() {
    let mut random = rng(22);
    for (name, grid) in fields() {
        let media = [in_voxels(&grid, 1e-3)];
        let (mut off, mut sum, mut signed, mut allowed) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..500 {
            let ray = ray_through(&grid, &mut random);
            let exact = Depth::new(&grid, &ray, f64::INFINITY);
            let found = profile(&media, &ray, March::Exact);
            let (enter, exit) = exact.extent();
            for _ in 0..20 {
                let t = (enter + random.uniform_f64() * (exit - enter)) as f32;
                let mut read = 0.0;
                found.media_at(t, |_, sigma| read = f64::from(sigma) / 1e-3);
                let density = exact.density(f64::from(t));
                off += (read - density).abs();
                signed += read - density;
                sum += density;
                allowed += exact.cubic_reading_error(f64::from(t)).1;
            }
        }
        println!(
            "{name}: densities off by {:.1e} of their mean, {:.1e} with sign; the cubic alone by {:.1e} at most",
            off / sum,
            signed / sum,
            allowed / sum
        );
        // Depths of some 50 are known to eps 50 on a piece of a voxel or so.
        assert!(
            off <= allowed + 200.0 * EPS * sum,
            "{name}: off by {}, allowed {}",
            off / sum,
            allowed / sum
        );
    }
}

/// The midpoint rule's error falls with the square of its step where the field is smooth.
#[test]
fn fixed_steps_converge_to_the_exact_march() {
    let grid = grid(IVec3::splat(-32), IVec3::splat(32), crate::fields::blob);
    let media = [medium(&grid, 0.3f32)];
    let mut random = rng(23);
    let rays: Vec<Ray> = (0..400)
        .map(|_| world(&grid, &ray_through(&grid, &mut random)))
        .collect();
    let errors: Vec<f64> = [4.0, 1.0, 0.25]
        .map(|step| {
            let sum: f64 = rays
                .iter()
                .map(|ray| {
                    let a = profile(&media, ray, March::Step(step)).transmittance;
                    let b = profile(&media, ray, March::Exact).transmittance;
                    f64::from(a - b).powi(2)
                })
                .sum();
            (sum / rays.len() as f64).sqrt()
        })
        .to_vec();
    println!("rms error of the transmittance at steps of 4, 1, 1/4 voxels: {errors:?}");
    // 16 for a smooth field; the blob is cut at its box, the field has kinks at faces: at least 8.
    assert!(errors[0] / errors[1] > 8.0, "from 4 to 1: {errors:?}");
    assert!(errors[1] / errors[2] > 8.0, "from 1 to 1/4: {errors:?}");
}

/// Media that overlap: a patchy grid, a blob and a box of fog.
fn overlapping<S: Spectrum>(grids: &[Grid; 2], sigma: [S; 3]) -> Vec<Medium<S>> {
    vec![
        medium(&grids[0], sigma[0]),
        medium(&grids[1], sigma[1]),
        Medium {
            sigma_t: sigma[2],
            albedo: S::ONE,
            phase: PhaseFunction::Isotropic,
            field: Field::Constant { bounds: Some(FOG) },
            emission: None,
        },
    ]
}

const FOG: Bounds = Bounds {
    min: Vec3::new(-25.0, -9.0, -30.0),
    max: Vec3::new(14.0, 22.0, 21.0),
};

fn two_grids() -> [Grid; 2] {
    [
        grid(IVec3::splat(-20), IVec3::splat(20), patchy),
        grid(IVec3::splat(-32), IVec3::splat(32), crate::fields::blob),
    ]
}

/// The exact optical depth of `overlapping` up to t, per medium.
struct Depths<'a> {
    grids: [Depth<'a>; 2],
    fog: (f64, f64),
}

impl<'a> Depths<'a> {
    fn new<S>(grids: &'a [Grid; 2], media: &[Medium<S>], ray: &Ray) -> Self {
        let depth = |i: usize| Depth::new(&grids[i], &local(&media[i], ray), f64::INFINITY);
        let fog = FOG.clip(ray, 0.0, f32::INFINITY).unwrap_or((0.0, 0.0));
        Self {
            grids: [depth(0), depth(1)],
            fog: (fog.0.into(), fog.1.into()),
        }
    }

    fn tau(&self, t: f64, sigma: [f64; 3]) -> f64 {
        let fog = (t.min(self.fog.1) - self.fog.0).max(0.0);
        sigma[0] * self.grids[0].at(t) + sigma[1] * self.grids[1].at(t) + sigma[2] * fog
    }
}

fn random_ray(random: &mut Rng) -> Ray {
    let target = (crate::fields::unit(random) - 0.5) * 40.0;
    let direction = direction(random);
    Ray {
        origin: target - direction * (60.0 * random.uniform()),
        direction,
    }
}

#[test]
fn ratio_tracking_is_unbiased() {
    let grids = two_grids();
    let grey = overlapping(&grids, [0.05f32, 0.03, 0.02]);
    let colours = [
        Vec3::new(0.08, 0.04, 0.01),
        Vec3::new(0.0, 0.03, 0.05),
        Vec3::new(0.02, 0.01, 0.015),
    ];
    let chromatic = overlapping(&grids, colours);
    let mut random = rng(24);
    let (rays, samples) = (150, 2000);
    let bound = z_bound(4 * rays);
    let mut worst = 0.0f64;
    for index in 0..rays {
        let ray = random_ray(&mut random);
        let depths = Depths::new(&grids, &grey, &ray);
        let mut sampler = Sampler::new(rng(1000 + index as u64));
        let mut check = |found: &Welford, sigma: [f64; 3]| {
            let exact = (-depths.tau(1e9, sigma)).exp();
            let z = found.z(exact, 4e-6);
            worst = worst.max(z.abs());
            assert!(
                z.abs() < bound,
                "{} +- {}, exactly {exact}: {ray:?}",
                found.mean(),
                found.standard_error()
            );
        };
        let found: Welford = (0..samples)
            .map(|_| f64::from(transmittance(&grey, &ray, f32::INFINITY, &mut sampler)))
            .collect();
        check(&found, [0.05, 0.03, 0.02]);
        let mut found = [Welford::default(); 3];
        for _ in 0..samples {
            let tr: Vec3 = transmittance(&chromatic, &ray, f32::INFINITY, &mut sampler);
            assert!(
                tr.cmpge(Vec3::ZERO).all() && tr.max_element() < 1.0 + 1e-6,
                "{tr} is no transmittance"
            );
            (0..3).for_each(|c| found[c].add(f64::from(tr[c])));
        }
        for (c, found) in found.iter().enumerate() {
            check(found, colours.map(|sigma| f64::from(sigma[c])));
        }
    }
    println!(
        "ratio tracking: worst |z| {worst:.2} of {}, bound {bound:.2}",
        4 * rays
    );
}

/// A flight's exact distribution maps its distance to a uniform number; flights that leave
/// share out what is left above the last one.
#[test]
fn free_flights_have_the_exact_distribution() {
    let grids = two_grids();
    let sigma = [0.12f32, 0.06, 0.03];
    let media = overlapping(&grids, sigma);
    let mut random = rng(25);
    let rays = 40;
    let (mut least, mut counts) = (1.0f64, [0u32; 3]);
    for index in 0..rays {
        let ray = random_ray(&mut random);
        let depths = Depths::new(&grids, &media, &ray);
        let sigma = sigma.map(f64::from);
        let mut sampler = Sampler::new(rng(2000 + index as u64));
        let mut hero = Hero::choose(&mut sampler.rng);
        let end = (-depths.tau(1e9, sigma)).exp();
        let mut uniform: Vec<f64> = (0..4000)
            .map(|_| {
                let flight =
                    sample_free_flight(&media, &ray, f32::INFINITY, &mut hero, &mut sampler);
                match flight {
                    Some(c) => {
                        counts[c.medium] += 1;
                        1.0 - (-depths.tau(c.t.into(), sigma)).exp()
                    }
                    None => 1.0 - end * random.uniform_f64(),
                }
            })
            .collect();
        let p = ks_p(&mut uniform);
        least = least.min(p);
        assert!(p > sidak(rays), "p = {p:e}: {ray:?}");
    }
    assert!(counts.iter().all(|c| *c > 1000), "all media: {counts:?}");
    println!(
        "free flight: least p {least:.1e} of {rays}, level {:.1e}",
        sidak(rays)
    );
}

/// Colour: weighted by its channel's share, every channel sees its own distribution, and each
/// medium its own share of the collisions.
#[test]
fn chromatic_flights_weigh_to_every_channels_distribution() {
    chromatic_flights(&two_grids(), 1.0);
}

/// The same cell by cell: the first grid is a thousand mean free paths of its spikes wide.
#[test]
fn chromatic_flights_among_spikes_weigh_to_every_channels_distribution() {
    let [_, second] = two_grids();
    let edge = IVec3::splat(16);
    let spikes = grid(-edge, edge, |v| {
        if (v.x + 3 * v.y + 5 * v.z).rem_euclid(97) == 0 {
            2e4
        } else {
            1.0
        }
    });
    chromatic_flights(&[spikes, second], 0.5);
}

fn chromatic_flights(grids: &[Grid; 2], scale: f32) {
    let colours = [
        Vec3::new(0.2, 0.1, 0.03),
        Vec3::new(0.0, 0.06, 0.12),
        Vec3::new(0.05, 0.02, 0.03),
    ]
    .map(|c| c * scale);
    let both = overlapping(grids, colours);
    let mut random = rng(26);
    let (rays, samples, bins) = (12, 20_000, 6);
    let bound = z_bound(2 * rays * 3 * bins);
    let mut worst = 0.0f64;
    for index in 0..2 * rays {
        // One grid alone, and all media together, take different roads.
        let media = if index < rays { &both[..1] } else { &both[..] };
        let ray = random_ray(&mut random);
        let depths = Depths::new(grids, &both, &ray);
        let exact = |c: usize, t: f64| {
            let mut sigma = colours.map(|s| f64::from(s[c]));
            if media.len() == 1 {
                (sigma[1], sigma[2]) = (0.0, 0.0);
            }
            (-depths.tau(t, sigma)).exp()
        };
        let edges: Vec<f64> = (0..bins).map(|i| 25.0 * i as f64).collect();
        let mut sampler = Sampler::new(rng(3000 + index as u64));
        let mut found = vec![[Welford::default(); 3]; bins];
        for _ in 0..samples {
            let mut hero = Hero::<Vec3>::choose(&mut sampler.rng);
            let flight = sample_free_flight(media, &ray, f32::INFINITY, &mut hero, &mut sampler);
            let weight = hero.weight();
            assert!(
                weight.cmpge(Vec3::ZERO).all() && weight.max_element() <= 3.0 + 1e-4,
                "{weight} is beyond the balance heuristic"
            );
            let t = flight.map_or(f64::INFINITY, |c| c.t.into());
            for (i, found) in found.iter_mut().enumerate() {
                let upper = edges.get(i + 1).copied().unwrap_or(f64::INFINITY);
                // The last bin holds the flights that leave.
                let hit = if i + 1 == bins {
                    t == f64::INFINITY
                } else {
                    t >= edges[i] && t < upper
                };
                for c in 0..3 {
                    found[c].add(if hit { f64::from(weight[c]) } else { 0.0 });
                }
            }
        }
        for (i, found) in found.iter().enumerate() {
            for (c, found) in found.iter().enumerate() {
                let expected = if i + 1 == bins {
                    exact(c, 1e9)
                } else {
                    exact(c, edges[i]) - exact(c, edges[i + 1])
                };
                // Bins that expect fewer than 20 flights are not normal.
                if expected * f64::from(samples) < 20.0 {
                    continue;
                }
                let z = found.z(expected, 0.0);
                worst = worst.max(z.abs());
                assert!(
                    z.abs() < bound,
                    "channel {c}, bin {i}: {} +- {}, exactly {expected}: {ray:?}",
                    found.mean(),
                    found.standard_error()
                );
            }
        }
    }
    println!("chromatic flight: worst |z| {worst:.2}, bound {bound:.2}");
}
