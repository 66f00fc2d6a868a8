//! The point estimate: equal to a plain loop over all photons, to paths within its standard error,
//! invisible in a furnace, free of step-size bias, and converging as the steps shrink.

use glam::{DVec3, Vec3};

use vpm_vdb::estimate::kernel::Kernel;
use vpm_vdb::estimate::point::{PointMap, Sphere};
use vpm_vdb::grid::Grid;
use vpm_vdb::march::Profile;
use vpm_vdb::photon::deposit::DepositRate;
use vpm_vdb::photon::radius::RadiusField;
use vpm_vdb::photon::{Heading, Packed, Photon, TraceSettings, trace_photons};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::{Direct, Fog, Light, March, Method, Optics, Phase, Rgb, Scene, Search};
use vpm_vdb::spectrum::Spectrum;
use vpm_vdb::tracking::{Counters, Sampler};
use vpm_vdb::world::World;

use crate::agreement::{FORWARD, blob, blocks, image, lights, replicates, smoky, z};
use crate::fields::{loaded, render, scene, volume};
use crate::stats::{t_bound, z_bound};

const SEARCHES: [Search; 2] = [Search::Nearest, Search::Radius];

/// Photons of a scene with random radii, and what their estimate needs.
struct Traced<S: Spectrum, H> {
    world: World<S>,
    rate: DepositRate,
    radii: RadiusField,
    photons: [Vec<Photon<S, H>>; 2],
}

fn traced<S: Spectrum, H: Heading>(scene: &Scene, grids: &[&Grid]) -> Traced<S, H> {
    let world = World::<S>::new(scene, loaded(grids)).expect("no surfaces to fail");
    let rate = DepositRate::new(&world.media, &world.parts);
    let found = trace_photons::<S, H>(
        &world,
        &TraceSettings {
            rate: &rate,
            emit: 4000,
            seed: 1,
            stage: Stage::Check,
            pass: 0,
            direct: Direct::Photons,
            surface_photons: false,
        },
    );
    let mut photons = [found.first, found.higher];
    let mut random = crate::fields::rng(40);
    for photon in photons.iter_mut().flatten() {
        photon.set_radius(3.0f32.mul_add(random.uniform(), 1.0));
    }
    let places = photons.iter().flatten().map(|p| p.position).collect();
    let radii = RadiusField::new(places, 20.0, 1.0, [0.1, 10.0]);
    Traced {
        world,
        rate,
        radii,
        photons,
    }
}

/// What a point adds, photon by photon in f64.
fn plain<S: Spectrum, H: Heading>(
    all: &Traced<S, H>,
    scene: &Scene,
    ray: &Ray,
    profile: &Profile<S>,
    t: f32,
) -> [S; 2] {
    let settings = &scene.settings;
    let p = ray.at(t);
    let d2 =
        |photon: &Photon<S, H>| (photon.position.as_dvec3() - p.as_dvec3()).length_squared() as f32;
    let mut sorted: Vec<f32> = all.photons.iter().flatten().map(d2).collect();
    sorted.sort_by(f32::total_cmp);
    let reach2 = all.rate.reach(p).powi(2);
    let sphere = sorted[settings.neighbours as usize].min(reach2);
    std::array::from_fn(|layer| {
        let mut sum = S::ZERO;
        for photon in &all.photons[layer] {
            let r2 = match settings.search {
                Search::Nearest => sphere,
                Search::Radius => photon.radius() * photon.radius(),
            };
            let d2 = d2(photon);
            if d2 >= r2 {
                continue;
            }
            let kernel = settings.kernel.ball() * r2.powf(-1.5) * settings.kernel.shape(d2 / r2);
            profile.media_at(t, |medium, sigma_t| {
                let medium = &all.world.media[medium];
                let phase = if H::KEPT {
                    medium.phase.p(photon.heading.direction(), -ray.direction)
                } else {
                    vpm_vdb::phase::ISOTROPIC
                };
                sum += sigma_t * medium.albedo * photon.power() * (kernel * phase);
            });
        }
        sum * profile.transmittance(t)
    })
}

fn check_sums<S: Spectrum, H: Heading>(scene: &Scene, grids: &[&Grid]) {
    let all = traced::<S, H>(scene, grids);
    let (mut worst, mut largest) = (0.0f32, 0.0f32);
    let mut met = 0;
    for (search, kernel) in [
        (Search::Nearest, Kernel::Constant),
        (Search::Nearest, Kernel::Biweight),
        (Search::Radius, Kernel::Epanechnikov),
    ] {
        let mut scene = scene.clone();
        scene.settings.search = search;
        scene.settings.kernel = kernel;
        let map = PointMap::new(
            all.photons.clone(),
            (&all.radii, &all.rate),
            [1.0; 2],
            &scene.settings,
        );
        let mut sphere = Sphere::default();
        let mut random = crate::fields::rng(5);
        for i in 0..40 {
            let pixel = [24.0 * random.uniform(), 24.0 * random.uniform()];
            let ray = all.world.camera.ray(pixel, [0.0; 2]);
            let mut profile = Profile::default();
            profile.march(
                (0, &all.world.media),
                &ray,
                f32::INFINITY,
                March::Exact,
                &mut Counters::default(),
            );
            // Rays that meet fog alone have no voxels to step by.
            if profile
                .media()
                .all(|m| all.world.media[m].voxel_size().is_none())
            {
                continue;
            }
            let mut sampler = Sampler::new(Rng::stream(7, Stage::Check, 0, i));
            let mut same = sampler.clone();
            let found = map.radiance(
                &all.world.media,
                0,
                &profile,
                &ray,
                &mut sphere,
                &mut sampler,
            );
            met += sampler.counters.gathered_photons;
            // The march's own numbers: the roulette's, which thin media never need, and the shift.
            let _ = same.uniform();
            let shift = same.uniform();
            let (mut t, end) = profile.extent();
            let March::Step(step) = scene.settings.march else {
                panic!("a fixed step, in voxels of a metre");
            };
            let mut sums = [S::ZERO; 2];
            while t < end {
                let dt = (step as f32).min(end - t);
                let add = plain(&all, &scene, &ray, &profile, dt.mul_add(shift, t));
                for (sum, add) in sums.iter_mut().zip(add) {
                    *sum += add * dt;
                }
                t += dt;
            }
            for (a, b) in found.iter().zip(sums) {
                for c in 0..S::CHANNELS {
                    let (a, b) = (a.channel(c), b.channel(c));
                    worst = worst.max((a - b).abs());
                    largest = largest.max(b);
                }
            }
        }
    }
    let worst = worst / largest;
    println!("{met} photons met; sums differ by {worst:.1e} of the largest");
    assert!(met > 10_000, "photons are met");
    // Places on the ray, some 70 m from the camera, are known to 4e-6 m of 0.5 m and more.
    assert!(worst < 2e-5, "sums differ by {worst:e}");
}

#[test]
fn sums_equal_a_plain_loop_over_all_photons() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    let mut one = smoky(lights);
    one.settings.march = March::Step(1.5);
    one.settings.neighbours = 12;
    // Thinner than the depth at which the roulette begins.
    one.volumes[0].optics.extinction = Rgb::splat(0.02);
    check_sums::<f32, ()>(&one, &[&blob]);
    check_sums::<f32, Packed>(&one, &[&blob]);
    one.volumes[0].optics.extinction = Rgb::new(0.02, 0.01, 0.004);
    one.fogs.push(Fog {
        bounds: Some([DVec3::splat(-15.0), DVec3::splat(30.0)]),
        optics: Optics {
            extinction: Rgb::splat(0.002),
            albedo: Rgb::splat(0.9),
            phase: Phase::Rayleigh,
        },
    });
    check_sums::<Vec3, Packed>(&one, &[&blob]);
}

const SEEDS: u64 = 12;

/// A point render whose kernels blur less than the noise of a block.
fn pointed(scene: &Scene, search: Search) -> Scene {
    let mut point = scene.clone();
    point.settings.method = Method::Point;
    point.settings.search = search;
    point.settings.photons = 80_000;
    point.settings.neighbours = 20;
    point.settings.passes = 1;
    point
}

#[test]
fn points_agree_with_paths() {
    let blob = blob();
    let (name, lights) = lights().swap_remove(0);
    let mut path = smoky(lights);
    path.settings.method = Method::Path;
    path.settings.spp = 256;
    let reference = blocks(&render(&path, &[&blob], None).film);
    for direct in [Direct::Photons, Direct::Sampled] {
        for search in SEARCHES {
            let mut point = pointed(&path, search);
            point.settings.spp = 1;
            point.settings.direct = direct;
            let found = replicates(&point, &[&blob], SEEDS);
            let bound = t_bound(4 * found.len(), (SEEDS - 1) as f64);
            let mut worst = 0.0f64;
            for (found, (mean, variance)) in found.iter().zip(&reference) {
                let t = (found.mean() - mean) / (found.variance_of_mean() + variance).sqrt();
                worst = worst.max(t.abs());
            }
            let (Some(point), Some((path, variance))) = (found.last(), reference.last()) else {
                panic!("there are blocks");
            };
            println!(
                "{name} {direct:?} {search:?}: point / path {:.5} +- {:.5}; worst block t {worst:.2} of {}, bound {bound:.2}",
                point.mean() / path,
                (point.variance_of_mean() + variance).sqrt() / path,
                found.len()
            );
            assert!(worst < bound, "{name} {direct:?} {search:?}: t {worst}");
        }
    }
}

/// Three channels, whose extinctions differ, in two media with phase functions of their own.
#[test]
fn colours_and_overlapping_media_agree_with_beams() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    let mut beam = smoky(lights);
    beam.volumes[0].optics.extinction = Rgb::new(0.5, 0.25, 0.1);
    beam.volumes[0].optics.albedo = Rgb::new(0.95, 0.8, 0.6);
    beam.fogs.push(Fog {
        bounds: Some([DVec3::splat(-30.0), DVec3::splat(30.0)]),
        optics: Optics {
            extinction: Rgb::splat(0.02),
            albedo: Rgb::splat(0.7),
            phase: Phase::Rayleigh,
        },
    });
    beam.settings.photons = 30_000;
    beam.settings.passes = 16;
    beam.settings.neighbours = 20;
    // A film tells its error by its passes: few of them, as many degrees of freedom.
    let bound = t_bound(6, f64::from(beam.settings.passes - 1));
    for search in SEARCHES {
        let mut point = pointed(&beam, search);
        point.settings.photons = 30_000;
        point.settings.passes = beam.settings.passes;
        point.settings.seed = 1;
        for channel in 0..3 {
            let (a, b) = (
                image(&point, &[&blob], channel),
                image(&beam, &[&blob], channel),
            );
            println!(
                "{search:?} channel {channel}: {a:.5?}, beam {b:.5?}, z {:.2}",
                z(a, b)
            );
            assert!(z(a, b).abs() < bound, "{search:?} {channel}: {a:?} {b:?}");
        }
    }
}

#[test]
fn point_sees_nothing_in_a_furnace() {
    let blob = blob();
    let passes = 24;
    for search in SEARCHES {
        for in_fog in [true, false] {
            let mut point = scene(if in_fog { 4.0 } else { 75.0 }, [16, 16]);
            point.lights.push(Light::Sky { radiance: Rgb::ONE });
            point.settings.max_bounces = 1_000_000;
            let optics = Optics {
                extinction: Rgb::splat(3.0),
                albedo: Rgb::ONE,
                phase: Phase::HenyeyGreenstein(-0.5),
            };
            let mut grids = vec![];
            if in_fog {
                point.fogs.push(Fog {
                    bounds: Some([DVec3::splat(-1.0), DVec3::ONE]),
                    optics,
                });
            } else {
                point
                    .volumes
                    .push(volume(Rgb::splat(0.8), Rgb::ONE, FORWARD));
                grids.push(&blob);
            }
            point.settings.method = Method::Point;
            point.settings.search = search;
            point.settings.photons = 90_000;
            point.settings.passes = passes;
            let film = render(&point, &grids, None).film;
            let estimate = film.image_mean();
            let error = estimate.standard_error.expect("more than one pass").x;
            let t = (estimate.mean.x - 1.0) / error;
            let bound = t_bound(4, f64::from(passes - 1));
            println!(
                "{search:?}, fog {in_fog}: {:.5} +- {error:.5}, t {t:.2}, bound {bound:.2}",
                estimate.mean.x
            );
            assert!(error < 0.005, "{search:?}: standard error {error}");
            assert!(t.abs() < bound, "{search:?}, fog {in_fog}: {estimate:?}");
        }
    }
}

/// The same photons with ever shorter steps: the sums converge, and long steps have the same mean.
#[test]
fn steps_cost_noise_and_no_bias() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    let mut scene = smoky(lights);
    // Thinner than the depth at which the roulette begins.
    scene.volumes[0].optics.extinction = Rgb::splat(0.02);
    scene.settings.search = Search::Radius;
    let all = traced::<f32, Packed>(&scene, &[&blob]);
    let rays: Vec<_> = (0..12)
        .map(|i| {
            let pixel = [6.0 + i as f32, 8.0 + 0.7 * i as f32];
            let ray = all.world.camera.ray(pixel, [0.0; 2]);
            let mut profile = Profile::default();
            let media = (0, &all.world.media[..]);
            let mut counters = Counters::default();
            profile.march(media, &ray, f32::INFINITY, March::Exact, &mut counters);
            (ray, profile)
        })
        .collect();
    let mut sphere = Sphere::default();
    let mut sums = |step: f64, shifts: u64| -> Vec<Vec<f64>> {
        scene.settings.march = March::Step(step);
        let settings = &scene.settings;
        let map = PointMap::new(
            all.photons.clone(),
            (&all.radii, &all.rate),
            [1.0; 2],
            settings,
        );
        let mut sum = |ray: &Ray, profile: &Profile<f32>, shift: u64| {
            let mut sampler = Sampler::new(Rng::stream(9, Stage::Check, shift, 0));
            let media = &all.world.media;
            let [a, b] = map.radiance(media, 0, profile, ray, &mut sphere, &mut sampler);
            f64::from(a + b)
        };
        rays.iter()
            .map(|(ray, profile)| (0..shifts).map(|i| sum(ray, profile, i)).collect())
            .collect()
    };
    let exact: Vec<f64> = sums(1.0 / 64.0, 8)
        .iter()
        .map(|sums| sums.iter().sum::<f64>() / 8.0)
        .collect();
    let mut last = f64::INFINITY;
    for step in [8.0, 4.0, 2.0, 1.0, 0.5] {
        let shifts = 400;
        let found = sums(step, shifts);
        let (mut square, mut worst) = (0.0, 0.0f64);
        for (sums, exact) in found.iter().zip(&exact) {
            let off = sums.iter().map(|s| s / exact - 1.0);
            let mean = off.clone().sum::<f64>() / shifts as f64;
            let variance = off.map(|o| (o - mean).powi(2)).sum::<f64>() / (shifts - 1) as f64;
            square += variance / rays.len() as f64;
            worst = worst.max(mean.abs() / (variance / shifts as f64).sqrt());
        }
        let noise = square.sqrt();
        println!("step {step}: noise {noise:.4}, worst mean off by {worst:.2} standard errors");
        assert!(
            worst < z_bound(5 * exact.len()),
            "step {step}: biased by {worst} errors"
        );
        assert!(
            noise < 0.7 * last,
            "step {step}: noise {noise}, longer ones {last}"
        );
        last = noise;
    }
    assert!(last < 0.01, "half a voxel leaves {last}");
}
