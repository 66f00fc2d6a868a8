//! Different roads to one picture.
//!
//! ```text
//! 1, 2, 3, 8 threads, and again      the same bytes
//! a grid of ones                      a fog
//! photons, sampled first order        paths             means of picture and quarters
//! first order of all                  all of first order
//! radius -> 0                         paths             m(r) = path + b r^2
//! ```
//!
//! Pixels of a pass of photons are not independent: the errors of the means come from renders with
//! other seeds.

use glam::{DVec3, IVec3};

use super::energy::smoky;
use super::fields::{grid, render, scene, volume};
use super::furnace::blob;
use super::{SelftestError, Suite, Worst};
use crate::film::Film;
use crate::grid::Grid;
use crate::scene::{Direct, Fog, Lens, Light, Method, Optics, Phase, Rgb, Scene, Search};
use crate::stats::{Welford, t_bound};

/// Scenes that take different roads through the renderer.
fn roads() -> Vec<Scene> {
    let grey = Rgb::splat(0.8);
    let colour = Rgb::new(0.9, 0.8, 0.6);
    let forward = Phase::HenyeyGreenstein(0.7);
    let mut scenes = vec![
        smoky(grey, Phase::Isotropic),
        smoky(grey, forward),
        smoky(colour, forward),
        smoky(colour, Phase::Rayleigh),
        smoky(colour, forward),
        smoky(grey, Phase::Isotropic),
        smoky(grey, Phase::Isotropic),
        smoky(colour, forward),
    ];
    scenes[3].settings.direct = Direct::Photons;
    scenes[4].settings.method = Method::Path;
    // A lens takes the gather of single rays.
    scenes[5].camera.lens = Some(Lens {
        radius: 0.5,
        focus_distance: 60.0,
    });
    for (scene, search) in scenes[6..]
        .iter_mut()
        .zip([Search::Nearest, Search::Radius])
    {
        scene.settings.method = Method::Point;
        scene.settings.search = search;
    }
    scenes
}

/// Films that differ by one bit or more from those of one thread; another seed that does not.
fn threads(suite: &mut Suite) -> Result<(), SelftestError> {
    let blob = blob()?;
    let photons = suite.choose([2000, 20_000, 200_000]);
    let mut faults = Worst::default();
    for (index, mut scene) in roads().into_iter().enumerate() {
        scene.settings.photons = photons;
        let first = render(&scene, &[&blob], Some(1))?;
        for threads in [1, 2, 3, 8] {
            let again = render(&scene, &[&blob], Some(threads))?;
            let same = first.film.to_bytes() == again.film.to_bytes()
                && first.energy == again.energy
                && first.report.counters == again.report.counters;
            faults.count(!same, || format!("scene {index}, {threads} threads"));
        }
        scene.settings.seed = 1;
        let other = render(&scene, &[&blob], Some(2))?;
        let same = first.film.to_bytes() == other.film.to_bytes();
        faults.count(same, || format!("scene {index}: two seeds, one picture"));
    }
    suite.none(
        "pictures of 1, 2, 3, 8 threads that differ by a bit",
        faults,
    );
    Ok(())
}

/// Means of the four quarters and of the whole picture.
fn means(film: &Film, value: impl Fn(&Film, u32, u32) -> f64) -> [f64; 5] {
    let [width, height] = film.resolution();
    let mut sums = [0.0; 5];
    for y in 0..height {
        for x in 0..width {
            let v = value(film, x, y) / f64::from(width * height);
            sums[usize::from(2 * x >= width) + 2 * usize::from(2 * y >= height)] += 4.0 * v;
            sums[4] += v;
        }
    }
    sums
}

fn colour(film: &Film, x: u32, y: u32) -> f64 {
    film.mean(x, y).x
}

/// The same over renders of several seeds.
fn replicates(
    scene: &Scene,
    grids: &[&Grid],
    seeds: u64,
    value: impl Fn(&Film, u32, u32) -> f64 + Copy,
) -> Result<[Welford; 5], SelftestError> {
    let mut all = [Welford::default(); 5];
    let mut scene = scene.clone();
    for seed in 0..seeds {
        scene.settings.seed = seed;
        let film = render(&scene, grids, None)?.film;
        all.iter_mut()
            .zip(means(&film, value))
            .for_each(|(w, m)| w.add(m));
    }
    Ok(all)
}

/// Worst |t| of means that should agree.
fn compare(name: &str, a: &[Welford; 5], b: &[Welford; 5]) -> Worst {
    let mut worst = Worst::default();
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        let error = (a.variance_of_mean() + b.variance_of_mean()).sqrt();
        let t = (a.mean() - b.mean()) / error;
        worst.take(t.abs(), || {
            format!("{name}, part {i}: {} and {} +- {error}", a.mean(), b.mean())
        });
    }
    worst
}

/// Far from its border a grid of ones is a fog.
fn constant(suite: &mut Suite) -> Result<(), SelftestError> {
    let ones = grid(IVec3::splat(-40), IVec3::splat(40), |_| 1.0)?;
    let albedo = Rgb::splat(0.8);
    let forward = Phase::HenyeyGreenstein(0.6);
    let seeds = suite.choose([12, 16, 100]);
    let mut worst = Worst::default();
    for method in [Method::Path, Method::Beam] {
        let mut clear = scene(4.0, [16, 16]);
        clear.camera.vertical_fov = 60.0;
        clear.lights.push(Light::Point {
            position: DVec3::new(2.0, 3.0, 0.0),
            power: Rgb::splat(100.0),
        });
        clear.settings.method = method;
        clear.settings.spp = if method == Method::Path { 8 } else { 1 };
        clear.settings.photons = suite.choose([5000, 30_000, 100_000]);
        clear.settings.passes = 1;
        let (mut voxels, mut fog) = (clear.clone(), clear);
        // Forty mean free paths to the border: exp(-40) of it is seen.
        voxels.volumes.push(volume(Rgb::ONE, albedo, forward));
        fog.fogs.push(Fog {
            bounds: Some([DVec3::splat(-40.5), DVec3::splat(40.5)]),
            optics: Optics {
                extinction: Rgb::ONE,
                albedo,
                phase: forward,
            },
        });
        fog.settings.seed = 1000;
        let a = replicates(&voxels, &[&ones], seeds, colour)?;
        let b = replicates(&fog, &[], seeds, colour)?;
        worst = worst.or(compare(method.name(), &a, &b));
    }
    let bound = t_bound(10, (seeds - 1) as f64);
    suite.worst("a grid of ones against a fog, |t|", worst, bound);
    Ok(())
}

/// Photons and paths, first orders sampled and stored, one order and the layer of it.
fn methods(suite: &mut Suite) -> Result<(), SelftestError> {
    let blob = blob()?;
    let mut path = scene(75.0, [16, 16]);
    let forward = Phase::HenyeyGreenstein(0.6);
    path.volumes
        .push(volume(Rgb::splat(0.3), Rgb::splat(0.9), forward));
    path.lights = smoky(Rgb::ONE, forward).lights;
    path.settings.method = Method::Path;
    path.settings.spp = suite.choose([8, 64, 512]);
    let mut beam = path.clone();
    beam.settings.method = Method::Beam;
    beam.settings.spp = 1;
    beam.settings.passes = 1;
    beam.settings.photons = suite.choose([10_000, 60_000, 400_000]);
    // Small kernels: what they blur is less than the noise.
    beam.settings.neighbours = 10;
    let seeds = suite.choose([12, 16, 64]);
    let reference = replicates(&path, &[&blob], seeds, colour)?;
    let mut worst = Worst::default();
    for direct in [Direct::Sampled, Direct::Photons] {
        beam.settings.direct = direct;
        let found = replicates(&beam, &[&blob], seeds, colour)?;
        worst = worst.or(compare(&format!("{direct:?}"), &found, &reference));
    }
    let bound = t_bound(10, (seeds - 1) as f64);
    suite.worst("photons of small kernels against paths, |t|", worst, bound);
    shrinking(suite, &beam, &blob, &reference)?;

    let layer = |film: &Film, x: u32, y: u32| film.means(x, y).direct.x;
    let mut worst = Worst::default();
    beam.settings.direct = Direct::Sampled;
    for scene in [&path, &beam] {
        let mut single = (*scene).clone();
        single.settings.max_bounces = 1;
        let all = replicates(scene, &[&blob], seeds, layer)?;
        let one = replicates(&single, &[&blob], seeds, layer)?;
        let name = scene.settings.method.name();
        let t = compare(name, &all, &one);
        // The same random numbers may have made the same first order.
        let same = (0..5).all(|i| (all[i].mean() / one[i].mean() - 1.0).abs() < 1e-6);
        worst = if same { worst } else { worst.or(t) };
    }
    suite.worst("first order of all orders, and alone, |t|", worst, bound);
    Ok(())
}

/// The limit of the radius to 0 is the path's picture. k photons are within r^2 of k of them, so
/// with the same photons two counts give the limit: (4 m(k) - m(4 k)) / 3.
fn shrinking(
    suite: &mut Suite,
    beam: &Scene,
    grid: &Grid,
    reference: &[Welford; 5],
) -> Result<(), SelftestError> {
    let mut beam = beam.clone();
    let seeds = suite.choose([12, 16, 64]);
    let mut limit = [Welford::default(); 5];
    for seed in 0..seeds {
        beam.settings.seed = seed;
        let mut of = |neighbours: u32| -> Result<[f64; 5], SelftestError> {
            beam.settings.neighbours = neighbours;
            Ok(means(&render(&beam, &[grid], None)?.film, colour))
        };
        let (narrow, wide) = (of(NARROW)?, of(4 * NARROW)?);
        for (limit, (a, b)) in limit.iter_mut().zip(narrow.iter().zip(&wide)) {
            limit.add((4.0 * a - b) / 3.0);
        }
    }
    let worst = compare("radius to 0", &limit, reference);
    let bound = t_bound(5, (seeds - 1) as f64);
    suite.worst(
        "limit of photons as their radius goes to 0 against paths, |t|",
        worst,
        bound,
    );
    Ok(())
}

/// Neighbours within the narrowest kernels.
const NARROW: u32 = 4;

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    threads(suite)?;
    constant(suite)?;
    methods(suite)
}
