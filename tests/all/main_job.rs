//! The scenes that the README begins with, by photons and by paths, block by block.
//!
//! Photons of one pass light many pixels at once: noise of neighbours is correlated, and a film's
//! own standard errors say nothing about the mean of a block. Independent renders do: each block's
//! mean over several seeds of either method, compared by Welch's t-test.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use vpm_vdb::film::Film;
use vpm_vdb::progress::Silent;
use vpm_vdb::render::{Exec, render};
use vpm_vdb::scene::{Method, Scene};

use crate::stats::{Welford, t_bound};

const SEEDS: u64 = 8;
/// Pixels along an edge of a block.
const BLOCK: u32 = 8;

fn film(scene: &Scene) -> Film {
    let stop = AtomicBool::new(false);
    let exec = Exec {
        threads: None,
        progress: &Silent,
        time_limit: None,
        warn: &|_| {},
        stop: &stop,
    };
    render(scene, &exec).expect("the scene renders").film
}

/// Mean luminance of each block, and of the picture.
fn blocks(film: &Film, [width, height]: [u32; 2]) -> Vec<f64> {
    let mean = |x0: u32, y0: u32, w: u32, h: u32| {
        let (mut sum, mut n) = (0.0, 0.0);
        for y in y0..(y0 + h).min(height) {
            for x in x0..(x0 + w).min(width) {
                sum += film
                    .mean(x, y)
                    .dot(glam::DVec3::new(0.2126, 0.7152, 0.0722));
                n += 1.0;
            }
        }
        sum / n
    };
    let mut all = vec![mean(0, 0, width, height)];
    for y in (0..height).step_by(BLOCK as usize) {
        for x in (0..width).step_by(BLOCK as usize) {
            all.push(mean(x, y, BLOCK, BLOCK));
        }
    }
    all
}

fn check(file: &str, resolution: [u32; 2], photons: u64, passes: u32) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes")
        .join(file);
    let mut scene = Scene::load(&path).expect("a scene of the repository");
    scene.camera.resolution = resolution;
    let mut of_method = |method: Method| {
        scene.settings.method = method;
        scene.settings.photons = photons;
        scene.settings.passes = passes;
        // Small kernels: what they blur is less than the noise of a block.
        scene.settings.neighbours = 30;
        scene.settings.spp = if method == Method::Path { 128 } else { 1 };
        let mut all: Vec<Welford> = Vec::new();
        for seed in 0..SEEDS {
            scene.settings.seed = seed;
            let means = blocks(&film(&scene), resolution);
            all.resize(means.len(), Welford::default());
            all.iter_mut().zip(means).for_each(|(w, m)| w.add(m));
        }
        all
    };
    let (beam, path) = (of_method(Method::Beam), of_method(Method::Path));
    let bound = t_bound(2 * beam.len(), (2 * (SEEDS - 1)) as f64);
    let mut worst = 0.0f64;
    for (b, p) in beam.iter().zip(&path) {
        let error = (b.variance_of_mean() + p.variance_of_mean()).sqrt();
        // Background that no medium covers never varies.
        if error > 1e-9 {
            worst = worst.max(((b.mean() - p.mean()) / error).abs());
        }
    }
    let ratio = beam[0].mean() / path[0].mean();
    let error =
        beam[0].standard_error() / beam[0].mean() + path[0].standard_error() / path[0].mean();
    println!(
        "{file}: beam over path {ratio:.5} +- {error:.5}; worst |t| of {} blocks {worst:.2}, bound {bound:.2}",
        beam.len() - 1
    );
    assert!((ratio - 1.0).abs() < 0.01, "{file}: mean ratio {ratio}");
    assert!(error < 0.005, "{file}: error {error} of the ratio of means");
    assert!(worst < bound, "{file}: worst |t| {worst}, bound {bound}");
}

#[test]
fn rising_smoke_is_what_paths_see() {
    check("rising_smoke.toml", [48, 64], 500_000, 2);
}

#[test]
fn cloud_is_what_paths_see() {
    check("cloud.toml", [64, 40], 500_000, 2);
}
