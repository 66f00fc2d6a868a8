//! Different roads to one picture: photons and paths, sampled and stored first orders, grids and
//! fog, colours together and one by one, and every gather of the same photons.
//!
//! Pixels of a path-traced picture are independent, those of a pass of photons are not: means of
//! blocks of 8 x 8 pixels of the beam estimate get their variance from independent renders
//! (other seeds), and Student's t bounds what few of those can tell.

use glam::{DVec3, IVec3, Vec3};

use vpm_vdb::estimate::bands::{Bands, TILE, TILE_RAYS, TileGrid};
use vpm_vdb::estimate::beam::{self, Stretch};
use vpm_vdb::estimate::kernel::Kernel;
use vpm_vdb::estimate::tiles::TileRays;
use vpm_vdb::estimate::wall::Wall;
use vpm_vdb::film::Film;
use vpm_vdb::grid::Grid;
use vpm_vdb::march::Profile;
use vpm_vdb::photon::deposit::DepositRate;
use vpm_vdb::photon::map::PhotonMap;
use vpm_vdb::photon::{Heading, Packed, TraceSettings, trace_photons};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::Stage;
use vpm_vdb::scene::{Direct, Fog, Light, March, Method, Optics, Phase, Rgb, Scene};
use vpm_vdb::spectrum::Spectrum;
use vpm_vdb::tracking::Counters;
use vpm_vdb::world::World;

use crate::fields::{grid, loaded, render, rng, scene, smoke, volume};
use crate::stats::{Welford, chi_square_p, sidak, t_bound, z_bound};

pub(crate) const FORWARD: Phase = Phase::HenyeyGreenstein(0.6);

pub(crate) fn blob() -> Grid {
    grid(IVec3::splat(-24), IVec3::splat(24), smoke)
}

/// Smoke of some five optical depths, one metre to a voxel.
pub(crate) fn smoky(lights: Vec<Light>) -> Scene {
    let mut scene = scene(75.0, [24, 24]);
    scene
        .volumes
        .push(volume(Rgb::splat(0.3), Rgb::splat(0.9), FORWARD));
    scene.lights = lights;
    scene
}

pub(crate) fn lights() -> Vec<(&'static str, Vec<Light>)> {
    let at = DVec3::new(20.0, 45.0, 15.0);
    vec![
        (
            "sun and sky",
            vec![
                Light::Sun {
                    direction: DVec3::new(0.3, -1.0, -0.2).normalize(),
                    irradiance: Rgb::splat(3.0),
                    angular_diameter: 2.0,
                },
                Light::Sky {
                    radiance: Rgb::splat(0.3),
                },
            ],
        ),
        (
            "point",
            vec![Light::Point {
                position: at,
                power: Rgb::splat(40_000.0),
            }],
        ),
        (
            "spot",
            vec![Light::Spot {
                position: at,
                direction: -at.normalize(),
                power: Rgb::splat(4000.0),
                cone_angle: 20.0,
                penumbra: 5.0,
                image: None,
            }],
        ),
        (
            "quad",
            vec![Light::Quad {
                corner: DVec3::new(-10.0, 40.0, -10.0),
                edge_u: DVec3::new(20.0, 0.0, 0.0),
                edge_v: DVec3::new(0.0, 0.0, 20.0),
                radiance: Rgb::splat(10.0),
            }],
        ),
        (
            "sphere",
            vec![Light::Sphere {
                center: at,
                radius: 6.0,
                radiance: Rgb::splat(10.0),
            }],
        ),
        (
            "disk",
            vec![Light::Disk {
                center: at,
                normal: DVec3::new(-0.3, -1.0, -0.1).normalize(),
                radius: 8.0,
                radiance: Rgb::splat(10.0),
            }],
        ),
        ("spots and a disk, more than are all sampled", many()),
    ]
}

/// Six lights, spots among them whose narrow cones miss most rays.
fn many() -> Vec<Light> {
    let mut lights: Vec<Light> = (0..5)
        .map(|i| {
            let turn = f64::from(i) * 1.3;
            let position = DVec3::new(40.0 * turn.cos(), 20.0 - 6.0 * turn, 40.0 * turn.sin());
            Light::Spot {
                position,
                direction: -position.normalize(),
                power: Rgb::splat(1000.0 + 700.0 * i as f32),
                cone_angle: 5.0 + 2.0 * f64::from(i),
                penumbra: 2.0,
                image: None,
            }
        })
        .collect();
    lights.push(Light::Disk {
        center: DVec3::new(-12.0, 28.0, 0.0),
        normal: DVec3::new(0.5, -1.0, 0.0).normalize(),
        radius: 3.0,
        radiance: Rgb::splat(20.0),
    });
    lights
}

/// Means of 8 x 8 blocks and, last, of the whole picture, with the variances of independent pixels.
pub(crate) fn blocks(film: &Film) -> Vec<(f64, f64)> {
    let [width, height] = film.resolution();
    let mut out = Vec::new();
    for y in (0..height).step_by(8) {
        for x in (0..width).step_by(8) {
            let (mut sum, mut variance) = (0.0, 0.0);
            for j in 0..8 {
                for i in 0..8 {
                    sum += film.mean(x + i, y + j).x;
                    variance += film.standard_error(x + i, y + j).map_or(0.0, |e| e.x * e.x);
                }
            }
            out.push((sum / 64.0, variance / 4096.0));
        }
    }
    let n = out.len() as f64;
    let (sum, variance) = out.iter().fold((0.0, 0.0), |(s, v), b| (s + b.0, v + b.1));
    out.push((sum / n, variance / (n * n)));
    out
}

/// Block means over renders of `seeds` seeds.
pub(crate) fn replicates(scene: &Scene, grids: &[&Grid], seeds: u64) -> Vec<Welford> {
    let mut out: Vec<Welford> = Vec::new();
    for seed in 0..seeds {
        let mut scene = scene.clone();
        scene.settings.seed = seed;
        let blocks = blocks(&render(&scene, grids, None).film);
        out.resize(blocks.len(), Welford::default());
        for (sum, (mean, _)) in out.iter_mut().zip(blocks) {
            sum.add(mean);
        }
    }
    out
}

const SEEDS: u64 = 10;

#[test]
fn beams_agree_with_paths() {
    let blob = blob();
    let lights = lights();
    let cases = lights.len() * 2;
    for (name, lights) in lights {
        let mut path = smoky(lights.clone());
        path.settings.method = Method::Path;
        path.settings.spp = 256;
        let reference = blocks(&render(&path, &[&blob], None).film);
        for direct in [Direct::Sampled, Direct::Photons] {
            let mut beam = smoky(lights.clone());
            beam.settings.direct = direct;
            beam.settings.photons = 150_000;
            beam.settings.neighbours = 20;
            beam.settings.passes = 1;
            let found = replicates(&beam, &[&blob], SEEDS);
            let n = found.len();
            let bound = t_bound(cases * n, (SEEDS - 1) as f64);
            let mut worst = 0.0f64;
            for (i, (found, (mean, variance))) in found.iter().zip(&reference).enumerate() {
                let t = (found.mean() - mean) / (found.variance_of_mean() + variance).sqrt();
                worst = worst.max(t.abs());
                assert!(
                    t.abs() < bound,
                    "{name} {direct:?}, block {i}: beam {} +- {}, path {mean} +- {}",
                    found.mean(),
                    found.standard_error(),
                    variance.sqrt()
                );
            }
            let (Some(beam), Some((path, variance))) = (found.last(), reference.last()) else {
                panic!("there are blocks");
            };
            println!(
                "{name} {direct:?}: beam / path {:.5} +- {:.5}; worst block t {worst:.2} of {n}, bound {bound:.2}",
                beam.mean() / path,
                (beam.variance_of_mean() + variance).sqrt() / path
            );
        }
    }
}

/// Mean over the picture, and its standard error, of one channel.
pub(crate) fn image(scene: &Scene, grids: &[&Grid], channel: usize) -> (f64, f64) {
    let estimate = render(scene, grids, None).film.image_mean();
    let error = estimate.standard_error.expect("more than one pass");
    (estimate.mean[channel], error[channel])
}

pub(crate) fn z(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0) / a.1.hypot(b.1)
}

/// Orders up to 1, 2, 4 and all: beams and paths agree at every one, and the chi-square of all.
#[test]
fn orders_add_up_to_the_whole() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    let (mut sum, mut last) = (0.0, 0.0);
    let orders = [1, 2, 4, 128];
    for max_bounces in orders {
        let mut beam = smoky(lights.clone());
        beam.settings.max_bounces = max_bounces;
        beam.settings.photons = 150_000;
        beam.settings.neighbours = 20;
        let mut path = beam.clone();
        path.settings.method = Method::Path;
        path.settings.spp = 128;
        let (beam, path) = (image(&beam, &[&blob], 0), image(&path, &[&blob], 0));
        let z = z(beam, path);
        println!("up to order {max_bounces}: beam {beam:.5?}, path {path:.5?}, z {z:.2}");
        assert!(
            z.abs() < z_bound(orders.len()),
            "up to order {max_bounces}: beam {beam:?}, path {path:?}"
        );
        assert!(path.0 > last, "each order adds light");
        last = path.0;
        sum += z * z;
    }
    let p = chi_square_p(sum, orders.len());
    assert!(p > sidak(1), "all orders: p = {p:e}");
}

/// Smoke in fog, each with a phase function of its own or both with none: photons of one medium
/// light no other, where a ray meets both and where it meets one.
#[test]
fn overlapping_media_agree_with_paths() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    for phases in [
        [Phase::Isotropic, Phase::Isotropic],
        [FORWARD, Phase::Rayleigh],
    ] {
        let mut beam = smoky(lights.clone());
        beam.volumes[0].optics.phase = phases[0];
        beam.fogs.push(Fog {
            bounds: Some([DVec3::splat(-30.0), DVec3::splat(30.0)]),
            optics: Optics {
                extinction: Rgb::splat(0.02),
                albedo: Rgb::splat(0.7),
                phase: phases[1],
            },
        });
        beam.settings.photons = 150_000;
        beam.settings.neighbours = 20;
        let mut path = beam.clone();
        path.settings.method = Method::Path;
        path.settings.spp = 128;
        let (beam, path) = (image(&beam, &[&blob], 0), image(&path, &[&blob], 0));
        println!(
            "{phases:?}: beam {beam:.5?}, path {path:.5?}, z {:.2}",
            z(beam, path)
        );
        assert!(
            z(beam, path).abs() < z_bound(2),
            "{phases:?}: {beam:?}, {path:?}"
        );
    }
}

/// Far from its border a grid of ones is a fog.
#[test]
fn constant_grid_is_a_homogeneous_fog() {
    let ones = grid(IVec3::splat(-40), IVec3::splat(40), |_| 1.0);
    let albedo = Rgb::splat(0.8);
    for method in [Method::Path, Method::Beam] {
        let mut clear = scene(4.0, [16, 16]);
        clear.camera.vertical_fov = 60.0;
        clear.lights.push(Light::Point {
            position: DVec3::new(2.0, 3.0, 0.0),
            power: Rgb::splat(100.0),
        });
        clear.settings.method = method;
        clear.settings.spp = if method == Method::Path { 512 } else { 4 };
        clear.settings.photons = 60_000;
        clear.settings.passes = 16;
        let (mut voxels, mut fog) = (clear.clone(), clear);
        // Forty mean free paths to the border: exp(-40) of it is seen.
        voxels.volumes.push(volume(Rgb::ONE, albedo, FORWARD));
        fog.fogs.push(Fog {
            bounds: Some([DVec3::splat(-40.5), DVec3::splat(40.5)]),
            optics: Optics {
                extinction: Rgb::ONE,
                albedo,
                phase: FORWARD,
            },
        });
        let (a, b) = (image(&voxels, &[&ones], 0), image(&fog, &[], 0));
        println!("{method:?}: grid {a:.5?}, fog {b:.5?}, z {:.2}", z(a, b));
        assert!(z(a, b).abs() < z_bound(2), "{method:?}: {a:?}, {b:?}");
    }
}

/// ```text
/// L = integral over the ray   exp(-sigma (t + r)) sigma_s p(c) power / (4 pi r^2) dt
/// ```
#[test]
fn single_scattering_of_a_point_light_is_that_of_the_integral() {
    let (sigma, albedo, g) = (0.4f64, 0.7f64, 0.5f64);
    let light = DVec3::new(1.0, 0.7, -0.5);
    let (low, high) = (DVec3::splat(-4.0), DVec3::splat(4.0));
    let power = 50.0;
    let mut fog = scene(6.0, [1, 1]);
    // One pixel, narrow enough that every ray of it is the axis: 1e-5 rad.
    fog.camera.vertical_fov = 1e-3;
    fog.fogs.push(Fog {
        bounds: Some([low, high]),
        optics: Optics {
            extinction: Rgb::splat(sigma as f32),
            albedo: Rgb::splat(albedo as f32),
            phase: Phase::HenyeyGreenstein(g as f32),
        },
    });
    fog.lights.push(Light::Point {
        position: light,
        power: Rgb::splat(power as f32),
    });
    fog.settings.max_bounces = 1;
    let n = 200_000;
    let exact: f64 = (0..n)
        .map(|i| {
            let depth = 8.0 * (f64::from(i) + 0.5) / f64::from(n);
            let p = DVec3::new(0.0, 0.0, 4.0 - depth);
            let r = p.distance(light);
            // From the light to p, on to the camera at +z.
            let c = (p - light).z / r;
            let phase = (1.0 - g * g)
                / (4.0 * std::f64::consts::PI * (1.0 + g * g - 2.0 * g * c).powf(1.5));
            let arriving = power / (4.0 * std::f64::consts::PI * r * r);
            (-sigma * (depth + r)).exp() * sigma * albedo * phase * arriving * 8.0 / f64::from(n)
        })
        .sum();
    for (method, spp, passes) in [(Method::Path, 80_000, 1), (Method::Beam, 400, 50)] {
        let mut scene = fog.clone();
        scene.settings.method = method;
        scene.settings.spp = spp;
        scene.settings.passes = passes;
        let found = image(&scene, &[], 0);
        let z = z(found, (exact, 0.0));
        println!("{method:?}: {found:.6?}, integral {exact:.6}, z {z:.2}");
        assert!(
            z.abs() < z_bound(2),
            "{method:?}: {found:?}, exactly {exact}"
        );
    }
}

/// Three colours at once are three grey renders.
#[test]
fn colours_are_three_grey_pictures() {
    let blob = blob();
    let extinction = Rgb::new(0.5, 0.25, 0.1);
    let albedo = Rgb::new(0.95, 0.8, 0.6);
    let (_, lights) = lights().swap_remove(0);
    let mut worst = 0.0f64;
    for method in [Method::Path, Method::Beam] {
        let mut colour = smoky(lights.clone());
        colour.volumes[0].optics.extinction = extinction;
        colour.volumes[0].optics.albedo = albedo;
        colour.settings.method = method;
        colour.settings.photons = 100_000;
        colour.settings.neighbours = 20;
        colour.settings.spp = if method == Method::Path { 64 } else { 1 };
        for channel in 0..3 {
            let mut grey = colour.clone();
            grey.volumes[0].optics.extinction = Rgb::splat(extinction[channel]);
            grey.volumes[0].optics.albedo = Rgb::splat(albedo[channel]);
            grey.settings.seed = 1 + channel as u64;
            let (a, b) = (image(&colour, &[&blob], channel), image(&grey, &[&blob], 0));
            println!(
                "{method:?} channel {channel}: {a:.5?}, grey {b:.5?}, z {:.2}",
                z(a, b)
            );
            worst = worst.max(z(a, b).abs());
        }
    }
    assert!(worst < z_bound(6), "worst |z| {worst}");
}

/// What a distance of some 70 m is known to \[m\]: a disc of 1 m to 4 times as much of its height at worst.
const DISTANCE: f32 = 1e-5;

/// The hierarchy, the tiles and a plain loop over all photons, for the same photons and rays.
fn check_gathers<S: Spectrum, H: Heading>(scene: &Scene, grids: &[&Grid]) {
    let world = World::<S>::new(scene, loaded(grids)).expect("no surfaces to fail");
    let rate = DepositRate::new(&world.media, &world.parts);
    let trace = TraceSettings {
        rate: &rate,
        emit: 30_000,
        seed: 1,
        stage: Stage::Check,
        pass: 0,
        direct: Direct::Photons,
        surface_photons: false,
    };
    let traced = trace_photons::<S, H>(&world, &trace);
    let mut photons = [traced.first, traced.higher].concat();
    let mut random = rng(40);
    for photon in &mut photons {
        photon.set_radius(3.0f32.mul_add(random.uniform(), 1.0));
    }
    let tile_grid = TileGrid {
        low: [0, 0],
        high: scene.camera.resolution,
    };
    let map = PhotonMap::new(photons.clone());
    let bands = Bands::new(photons.clone(), &world.camera, &tile_grid);
    let mut rays = TileRays::<S, H>::default();
    let (mut met, mut worst) = (0u64, 0.0f32);
    for band in 0..tile_grid.bands() {
        let tiles = bands.tiles(band, 0);
        for column in 0..tile_grid.columns() {
            let mut plain = [(S::ZERO, S::ZERO); TILE_RAYS];
            let mut counts = [Counters::default(); 3];
            for (i, (plain, slack)) in plain.iter_mut().enumerate() {
                let (x, y) = (
                    column * TILE + i as u32 % TILE,
                    band * TILE + i as u32 / TILE,
                );
                let pixel = [x as f32 + random.uniform(), y as f32 + random.uniform()];
                let ray: Ray = world.camera.ray(pixel, [0.0; 2]);
                let mut profile = Profile::default();
                profile.march(
                    (0, &world.media),
                    &ray,
                    f32::INFINITY,
                    March::Exact,
                    &mut Counters::default(),
                );
                // A clear ray has nowhere for a photon to be.
                for photon in photons.iter().filter(|_| !profile.is_clear()) {
                    let to = (photon.position - ray.origin).as_dvec3();
                    let t = to.dot(ray.direction.as_dvec3());
                    let d2 = (to - t * ray.direction.as_dvec3()).length_squared() as f32;
                    let t = t as f32;
                    if d2 < photon.radius() * photon.radius() && t > 0.0 && t < profile.t_end {
                        counts[0].gathered_photons += 1;
                        let add = |t, d2| {
                            beam::contribution(
                                Kernel::Biweight,
                                &world.media,
                                &profile,
                                &ray,
                                photon,
                                t,
                                d2,
                            )
                        };
                        *plain += add(t, d2);
                        // At its rim a kernel is known to rounding of its height only, and at the rim
                        // of the medium a density to what it changes within that of the distance.
                        let change = add(t + DISTANCE, 0.0) + add(t - DISTANCE, 0.0) * -1.0;
                        *slack += add(t, 0.0) * (4.0 * DISTANCE) + change.map(f32::abs);
                    }
                }
                let hierarchy = beam::radiance(
                    Kernel::Biweight,
                    &world.media,
                    &map,
                    &Stretch {
                        ray: &ray,
                        profile: &profile,
                        compartment: 0,
                        walls: [Wall::NONE; 2],
                    },
                    &mut counts[1],
                );
                worst = worst.max(difference(hierarchy, *plain, *slack));
                rays.rays[i] = ray;
                rays.profiles[i] = profile;
            }
            rays.arrange(&[true; TILE_RAYS]);
            let mut sums = [S::ZERO; TILE_RAYS];
            rays.gather(
                &world.media,
                (world.camera.position, 0),
                tiles.tile(column),
                &mut sums,
                &mut counts[2],
            );
            for (sum, (plain, slack)) in sums.iter().zip(&plain) {
                worst = worst.max(difference(*sum, *plain, *slack));
            }
            met += counts[0].gathered_photons;
        }
    }
    println!("{met} photons met; the gathers differ by {worst:.2} of what rounding may do at most");
    assert!(met > 10_000, "photons are met");
    assert!(
        worst < 1.0,
        "gathers differ by {worst} of what rounding may do"
    );
}

/// Difference relative to what it may be.
fn difference<S: Spectrum>(a: S, b: S, slack: S) -> f32 {
    (0..S::CHANNELS)
        .map(|c| (a.channel(c) - b.channel(c)).abs() / slack.channel(c).max(f32::MIN_POSITIVE))
        .fold(0.0, f32::max)
}

#[test]
fn every_gather_is_the_sum_over_all_photons() {
    let blob = blob();
    let (_, lights) = lights().swap_remove(0);
    let mut one = smoky(lights);
    // Thinner than the depth at which tiles play roulette with photons.
    one.volumes[0].optics.extinction = Rgb::splat(0.02);
    check_gathers::<f32, ()>(&one, &[&blob]);
    check_gathers::<f32, Packed>(&one, &[&blob]);
    one.volumes[0].optics.extinction = Rgb::new(0.05, 0.025, 0.01);
    check_gathers::<Vec3, Packed>(&one, &[&blob]);
    one.fogs.push(Fog {
        bounds: Some([DVec3::splat(-15.0), DVec3::splat(30.0)]),
        optics: Optics {
            extinction: Rgb::splat(0.01),
            albedo: Rgb::splat(0.9),
            phase: Phase::Rayleigh,
        },
    });
    check_gathers::<Vec3, Packed>(&one, &[&blob]);
    // From inside, where spheres reach behind the camera.
    one.volumes[0].optics.extinction = Rgb::splat(0.02);
    one.camera.position = DVec3::new(3.0, 2.0, 9.0);
    one.camera.vertical_fov = 90.0;
    check_gathers::<f32, Packed>(&one, &[&blob]);
}
