//! The rate of the progressive beam estimate: bias² and variance against passes, each beside what
//! the schedule of radii says of it (`study::rate`), and relMSE beside the theory's N^(-2/3).
//!
//! A small lamp in thin fog, single scattering, all light from photons, radii the same everywhere
//! and wide beside a pixel: nothing but what the theory is about. A lamp of 100 W and a radius of 1 cm,
//! since radii are not the same around one that is a point. The reference is a quadrature,
//!
//! ```text
//! L = ∫ σ_s / 4π · Φ / (4π d²) · exp(-σ_t (d + t)) dt         d distance from the light
//! ```
//!
//! over the ray's way t through the fog, averaged over the pixel.

use std::ops::ControlFlow;
use std::path::Path;

use glam::DVec3;

use vpm_vdb::render::PassDone;
use vpm_vdb::scene::Scene;
use vpm_vdb::study::rate::{Law, bias_factor, photon_factor};
use vpm_vdb::study::store::Pixels;
use vpm_vdb::study::{Figures, Interval, Reference, figures, slope};

use super::pixels;
use crate::stats::{Welford, t_bound};

const SCENE: &str = "\
[camera]
position = [0.0, 0.0, 12.0]
look_at = [0.0, 0.0, 0.0]
vertical_fov = 4.8
resolution = [8, 8]
[render]
photons = 4000
passes = 64
spp = 9
neighbours = 1000000
max_bounces = 1
direct = \"photons\"
kernel = \"constant\"
[[fog]]
box = { min = [-4, -4, -4], max = [4, 4, 4] }
extinction = 0.1
albedo = 0.9
[[light]]
sphere = { center = [0.0, 1.3, 0.0], radius = 0.01, radiance = 25330.296 }
";

const PASSES: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];

/// The picture by quadrature, the mean of 6 x 6 rays in each pixel.
fn exact(scene: &Scene) -> Reference {
    use std::f64::consts::PI;
    const ACROSS: u32 = 6;
    const STEPS: u32 = 1000;
    let (sigma_t, albedo, power) = (0.1, 0.9, 100.0);
    let light = DVec3::new(0.0, 1.3, 0.0);
    let [width, height] = scene.camera.resolution;
    let half = (0.5 * scene.camera.vertical_fov.to_radians()).tan();
    let radiance = |u: f64, v: f64| {
        let side = half * f64::from(width) / f64::from(height);
        let ray = DVec3::new(u * side, v * half, -1.0).normalize();
        // From z = 4 to z = -4; rays this close to the axis leave by no other face.
        let [enter, leave] = [8.0, 16.0].map(|z: f64| z / -ray.z);
        let step = (leave - enter) / f64::from(STEPS);
        let sum: f64 = (0..STEPS)
            .map(|i| {
                let t = (f64::from(i) + 0.5) * step;
                let d = light.distance(scene.camera.position + ray * (enter + t));
                (-sigma_t * (d + t)).exp() / (d * d)
            })
            .sum();
        sum * step * albedo * sigma_t * power / (16.0 * PI * PI)
    };
    let mean = (0..width * height)
        .map(|i| {
            let at = |whole: u32, part: u32, of: u32| {
                let place = f64::from(whole) + (f64::from(part) + 0.5) / f64::from(ACROSS);
                2.0 * place / f64::from(of) - 1.0
            };
            let sum: f64 = (0..ACROSS * ACROSS)
                .map(|k| {
                    let u = at(i % width, k % ACROSS, width);
                    let v = -at(i / width, k / ACROSS, height);
                    radiance(u, v)
                })
                .sum();
            [sum / f64::from(ACROSS * ACROSS); 3]
        })
        .collect::<Vec<_>>();
    Reference {
        variance: vec![[0.0; 3]; mean.len()],
        mean,
    }
}

/// Pictures of each checkpoint for each of `seeds` seeds.
fn rendered(scene: &Scene, seeds: u64) -> Vec<Vec<Pixels>> {
    let mut all = vec![Vec::new(); PASSES.len()];
    for seed in 0..seeds {
        let mut scene = scene.clone();
        scene.settings.seed = seed;
        let mut keep = |done: &PassDone<'_>| {
            if let Some(i) = PASSES.iter().position(|n| *n == done.film.passes()) {
                let [_, _, width, height] = done.film.crop();
                let picture = (0..width * height)
                    .map(|p| done.film.mean(p % width, p / width).as_vec3().to_array())
                    .collect();
                all[i].push(picture);
            }
            ControlFlow::Continue(())
        };
        pixels(&scene, &[], &mut keep);
    }
    all
}

#[test]
fn bias_and_variance_fall_at_the_rate_of_the_theory() {
    const SEEDS: usize = 24;
    const GROUPS: usize = 12;
    let scene = Scene::from_text(Path::new("rate.toml"), SCENE.to_owned()).expect("the scene");
    let reference = exact(&scene);
    let all = rendered(&scene, SEEDS as u64);
    // Slopes of bias², variance, relMSE over all seeds but those of a group.
    let slopes = |without: Option<usize>| {
        let of = |pictures: &[Pixels]| -> Figures {
            let some: Vec<Pixels> = pictures
                .iter()
                .enumerate()
                .filter(|(seed, _)| Some(seed % GROUPS) != without)
                .map(|(_, p)| p.clone())
                .collect();
            figures(&some, &reference, None)
        };
        let figures: Vec<Figures> = all.iter().map(|p| of(p)).collect();
        let parts: Vec<(u32, Interval, f64)> = PASSES
            .iter()
            .zip(&figures)
            .map(|(n, f)| {
                (
                    *n,
                    f.bias2.expect("seeds"),
                    f.variance.expect("seeds").value,
                )
            })
            .collect();
        let fit = |value: &dyn Fn(usize) -> f64| {
            let points: Vec<(f64, f64)> = (0..PASSES.len())
                .map(|i| (f64::from(PASSES[i]), value(i)))
                .collect();
            slope(&points).expect("figures above 0")
        };
        let found = [
            fit(&|i| parts[i].1.value),
            fit(&|i| parts[i].2),
            fit(&|i| figures[i].relmse.value),
        ];
        (found, parts)
    };
    let (found, parts) = slopes(None);
    let law = Law::fitted(&parts, 2).expect("a law");
    println!(
        "{:>6} {:>10} {:>10} {:>10} {:>10}",
        "passes", "bias2", "law", "variance", "law"
    );
    for (n, bias2, variance) in &parts {
        let [b, v] = law.at(*n);
        println!(
            "{n:>6} {:>10.3e} {b:>10.3e} {variance:>10.3e} {v:>10.3e}",
            bias2.value
        );
    }
    let by_schedule = |factor: fn(u32, u32) -> f64| {
        let points = PASSES.map(|n| (f64::from(n), factor(n, 2)));
        slope(&points).expect("a law")
    };
    let expected = [by_schedule(bias_factor), by_schedule(photon_factor)];
    // Jackknife over groups of seeds.
    let without: Vec<[f64; 3]> = (0..GROUPS).map(|g| slopes(Some(g)).0).collect();
    let names = ["bias2", "variance", "relMSE"];
    for i in 0..3 {
        let spread: Welford = without.iter().map(|s| s[i]).collect();
        let error = (GROUPS as f64 - 1.0) * spread.standard_error();
        println!("slope of {}: {:.3} +- {error:.3}", names[i], found[i]);
        if let Some(expected) = expected.get(i) {
            let t = (found[i] - expected) / error;
            println!("    of the schedule {expected:.3}, t {t:.2}");
            let bound = t_bound(2, GROUPS as f64 - 1.0);
            assert!(t.abs() < bound, "{}: {} for {expected}", names[i], found[i]);
            assert!(error < 0.05, "{}: the test is blunt, {error}", names[i]);
        }
    }
    assert!(
        (found[2] + 2.0 / 3.0).abs() < 0.1,
        "relMSE falls like photons to the {}",
        found[2]
    );
    // Either part is seen: the bias is not lost in the noise, nor the noise in the bias.
    let share = parts[0].1.value / (parts[0].1.value + parts[0].2);
    assert!(
        (0.1..0.9).contains(&share),
        "bias is {share} of the first error"
    );
}
