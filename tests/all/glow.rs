//! Media that shine: the photons that they send out; and the pixels that look at them, or at lamps.

use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DVec3, IVec3, Vec3};

use vpm_vdb::estimate::direct::DirectLights;
use vpm_vdb::estimate::emission;
use vpm_vdb::grid::Grid;
use vpm_vdb::light::{Glow, Light};
use vpm_vdb::march::Profile;
use vpm_vdb::medium::Medium;
use vpm_vdb::render::render_loaded;
use vpm_vdb::scene::{self, Emission, Fog, March, Optics, Phase, Rgb, Scene};
use vpm_vdb::surface::Inside;
use vpm_vdb::tracking::{Counters, Sampler};
use vpm_vdb::world::{LoadedVolume, World};

use crate::effects::scenes::exec;
use crate::fields::{grid, noise, rng, scene, unit, volume};
use crate::stats::{Welford, z_bound};

const LOW: i32 = -6;
const HIGH: i32 = 7;

/// A medium that shines by the temperatures of a grid, seen from z = 40.
fn fire(albedo: f32, resolution: [u32; 2]) -> Scene {
    let mut scene = scene(40.0, resolution);
    scene.camera.vertical_fov = 24.0;
    let mut volume = volume(
        Rgb::new(0.3, 0.2, 0.25),
        Rgb::splat(albedo),
        Phase::Isotropic,
    );
    volume.emission = Some(Emission::Blackbody {
        temperature: "heat".to_owned(),
        scale: 2000.0,
        radiance: 1.0,
    });
    scene.volumes.push(volume);
    scene
}

fn cube(f: impl Fn(IVec3) -> f32 + Sync) -> Grid {
    grid(IVec3::splat(LOW), IVec3::splat(HIGH), f)
}

/// A hot edge, some thousand times as bright as the rest, in rough smoke.
fn heat(v: IVec3) -> f32 {
    let edge = (v - IVec3::new(4, -3, 0)).as_vec3() * Vec3::new(1.0, 1.0, 0.1);
    0.3 + 0.3 * noise(v, 4) + 0.8 * (-0.5 * edge.length_squared()).exp()
}

fn loaded(density: &Grid, heat: &Grid) -> Vec<LoadedVolume> {
    vec![LoadedVolume {
        density: density.clone().into(),
        temperature: Some(heat.clone().into()),
    }]
}

fn glow_of(world: &World<Vec3>) -> &Glow<Vec3> {
    let glow = world.lights.iter().find_map(|light| match light {
        Light::Glow(glow) => Some(glow),
        _ => None,
    });
    glow.expect("the medium shines")
}

/// 4 pi (1 - albedo) sigma_t L_e at a point. \[W/m3\]
fn power_density(medium: &Medium<Vec3>, p: Vec3) -> DVec3 {
    let l = medium.emission.as_ref().expect("it shines").radiance_at(p);
    let absorption = (Vec3::ONE - medium.albedo) * medium.sigma_t * medium.density(p);
    4.0 * PI * (absorption * l).as_dvec3()
}

/// Whatever the candidates of a photon are, and however one of them is chosen, photons carry the
/// medium's power, in every channel, from where it shines, and to all sides alike: their means are
/// those of a fine sum over the medium. In rough smoke, and where the density is one value, which
/// has a closed form.
#[test]
fn photons_of_a_medium_carry_its_power_from_where_it_shines() {
    let smokes = [
        cube(|v| noise(v, 3).powi(3)),
        Grid::from_fn(
            IVec3::splat(LOW),
            IVec3::splat(HIGH),
            DAffine3::IDENTITY,
            |_| 0.5,
        )
        .expect("a small grid can be built"),
    ];
    let scene = fire(0.25, [8, 8]);
    let tests = 2 * (3 * 4 + 3);
    for (smoke, name) in smokes.iter().zip(["rough", "of one value"]) {
        let world = World::<Vec3>::new(&scene, loaded(smoke, &cube(heat))).expect("a world");
        let medium = &world.media[0];
        let origin = world.origin;
        // Midpoints of eighths of voxels, over the support and the cells around it.
        let fine = 8;
        let n = (HIGH - LOW + 2) * fine;
        let mut exact = [DVec3::ZERO; 4];
        for i in 0..n * n * n {
            let c = IVec3::new(i % n, i / n % n, i / (n * n)).as_dvec3() + 0.5;
            let p = c / f64::from(fine) + f64::from(LOW - 1) - origin;
            let density = power_density(medium, p.as_vec3()) * f64::from(fine).powi(-3);
            exact[0] += density;
            for axis in 0..3 {
                exact[1 + axis] += density * p[axis];
            }
        }
        let glow = glow_of(&world);
        let mut random = rng(91);
        let mut sums = [[Welford::default(); 3]; 4];
        let mut ways = [Welford::default(); 3];
        for _ in 0..60_000 {
            let u = std::array::from_fn(|_| random.uniform());
            let emitted = glow.emit(&world, u, &mut random);
            let (power, place, way) = emitted.map_or_else(Default::default, |e| {
                (e.power.as_dvec3(), e.ray.origin.as_dvec3(), e.ray.direction)
            });
            for c in 0..3 {
                sums[0][c].add(power[c]);
                for axis in 0..3 {
                    sums[1 + axis][c].add(power[c] * place[axis]);
                }
            }
            for axis in 0..3 {
                ways[axis].add(f64::from(way[axis]));
            }
        }
        let bound = z_bound(tests);
        for (moment, (sums, exact)) in sums.iter().zip(exact).enumerate() {
            for (c, sum) in sums.iter().enumerate() {
                assert!(
                    sum.z(exact[c], 0.0).abs() < bound,
                    "{name}, moment {moment}, channel {c}: {} +- {}, exactly {}",
                    sum.mean(),
                    sum.standard_error(),
                    exact[c]
                );
            }
        }
        for way in ways {
            assert!(way.z(0.0, 0.0).abs() < bound, "{name}: {}", way.mean());
        }
    }
}

/// Pixels that look at a flame have the mean over their rays, and the grain of less than a
/// sixteenth of the variance of one ray.
#[test]
fn a_flame_seen_directly_is_right_and_steady() {
    let (passes, rays) = (24u32, 256u32);
    let mut scene = fire(0.0, [20, 20]);
    scene.settings.passes = passes;
    let volumes = || loaded(&cube(|v| noise(v, 3).powi(3)), &cube(heat));
    let seen = render_loaded(&scene, volumes(), &exec(&AtomicBool::new(false)))
        .expect("the scene can be rendered")
        .film;
    let world = World::<Vec3>::new(&scene, volumes()).expect("a world");
    let mut random = rng(92);
    let counters = &mut Counters::default();
    let mut profile = Profile::default();
    let (mut one, mut several) = (0.0, 0.0);
    for y in 0..20 {
        // Means over rows of pixels, whose rays have nothing in common.
        let (mut difference, mut variance) = (0.0, 0.0);
        for x in 0..20 {
            let mut luminance = Welford::default();
            for _ in 0..rays {
                let u = unit(&mut random);
                let ray = world.camera.ray([x as f32 + u.x, y as f32 + u.y], [0.0; 2]);
                let media = (0, &world.media[..]);
                profile.march(media, &ray, f32::INFINITY, March::Exact, counters);
                let l = emission::radiance(&world, &ray, &profile, counters);
                luminance.add(f64::from(l.y));
            }
            let error = seen.standard_error(x, y).expect("passes")[1];
            difference += seen.mean(x, y)[1] - luminance.mean();
            variance += error * error + luminance.variance_of_mean();
            one += luminance.variance_of_mean() * f64::from(rays);
            several += error * error * f64::from(passes);
        }
        assert!(
            difference.abs() < z_bound(20) * variance.sqrt() + 1e-12,
            "row {y}: off by {difference} +- {}",
            variance.sqrt()
        );
    }
    assert!(one > 0.0, "rays of a pixel differ");
    assert!(
        several < one / 16.0,
        "variance {several} of a pass, {one} of a ray"
    );
}

/// Pixels around a lamp in the mist likewise; elsewhere they are those of one ray.
#[test]
fn a_lamp_in_mist_is_right_and_steady() {
    let (passes, rays, n) = (32u32, 512u32, 20);
    let mut scene = scene(4.0, [n, n]);
    scene.settings.passes = passes;
    scene.settings.max_bounces = 1;
    scene.fogs.push(Fog {
        bounds: Some([DVec3::splat(-1.0), DVec3::ONE]),
        optics: Optics {
            extinction: Rgb::splat(0.5),
            albedo: Rgb::ONE,
            phase: Phase::Isotropic,
        },
    });
    scene.lights.push(scene::Light::Point {
        position: DVec3::new(0.07, -0.04, 0.1),
        power: Rgb::splat(10.0),
    });
    let seen = render_loaded(&scene, Vec::new(), &exec(&AtomicBool::new(false)))
        .expect("the scene can be rendered")
        .film;
    let world = World::<f32>::new(&scene, Vec::new()).expect("a world");
    let lights = DirectLights::new(&world, None, u64::from(n * n));
    let mut sampler = Sampler::new(rng(93));
    let mut profile = Profile::default();
    let (mut one, mut several) = (0.0, 0.0);
    for y in 0..n {
        let (mut difference, mut variance) = (0.0, 0.0);
        for x in 0..n {
            let mut luminance = Welford::default();
            for _ in 0..rays {
                let [u, v] = sampler.uniform2();
                let ray = world.camera.ray([x as f32 + u, y as f32 + v], [0.0; 2]);
                let media = (0, &world.media[..]);
                profile.march(
                    media,
                    &ray,
                    f32::INFINITY,
                    March::Exact,
                    &mut sampler.counters,
                );
                let l = lights.radiance(&world, &ray, &Inside::NOTHING, &profile, &mut sampler);
                luminance.add(f64::from(l));
            }
            let error = seen.standard_error(x, y).expect("passes")[1];
            difference += seen.mean(x, y)[1] - luminance.mean();
            variance += error * error + luminance.variance_of_mean();
            // The radiance of the pixel with the lamp grows as one over the distance from it, and its
            // variance has no bound: how much of it a number of rays finds is chance.
            let around = x.abs_diff(n / 2) < 3 && y.abs_diff(n / 2) < 3;
            if around && (x, y) != (n / 2, n / 2) {
                one += luminance.variance_of_mean() * f64::from(rays);
                several += error * error * f64::from(passes);
            }
        }
        assert!(
            difference.abs() < z_bound(n as usize) * variance.sqrt(),
            "row {y}: off by {difference} +- {}",
            variance.sqrt()
        );
    }
    assert!(
        several < one / 16.0,
        "variance {several} of a pass, {one} of a ray"
    );
}
