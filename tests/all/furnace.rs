//! The furnace: media that absorb nothing, in a sky of radiance 1, cannot be seen. Every pixel is 1.
//!
//! A path of albedo 1 carries a throughput of exactly 1 until it leaves, so the path tracer's
//! pixels are 1 to the last bit. The beam estimate blurs the fluence over a disc of radius r, and
//! the fluence, constant inside, ends where the medium does: within r of the outline light is
//! missing, an error that falls with the radius. Photons enough are taken for it to stay below the
//! standard error of the picture's mean.

use glam::{DVec3, IVec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::scene::{Direct, Fog, Light, Method, Optics, Phase, Rgb, Scene};

use crate::fields::{grid, real_density, render, scene, smoke, volume};
use crate::stats::t_bound;

const PHASES: [Phase; 3] = [
    Phase::Isotropic,
    Phase::HenyeyGreenstein(0.85),
    Phase::HenyeyGreenstein(-0.5),
];

/// A furnace around a camera at `distance`.
fn furnace(distance: f64) -> Scene {
    let mut scene = scene(distance, [16, 16]);
    scene.lights.push(Light::Sky { radiance: Rgb::ONE });
    scene.settings.max_bounces = 1_000_000;
    scene
}

/// A furnace with fog in a cube of edge 2.
fn fog(distance: f64, extinction: f32, phase: Phase) -> Scene {
    let mut scene = furnace(distance);
    scene.fogs.push(Fog {
        bounds: Some([DVec3::splat(-1.0), DVec3::ONE]),
        optics: Optics {
            extinction: Rgb::splat(extinction),
            albedo: Rgb::ONE,
            phase,
        },
    });
    scene
}

/// A furnace around a grid, seen from `distance` of its radii.
fn around(grid: &Grid, distance: f64, extinction: f32, phase: Phase) -> Scene {
    let corners = grid.world_corners();
    let middle = corners.iter().sum::<DVec3>() / 8.0;
    let radius = (corners[0] - middle).length();
    let mut scene = furnace(0.0);
    scene.camera.position = middle + DVec3::new(0.3, 0.5, 1.0).normalize() * (radius * distance);
    scene.camera.look_at = middle;
    scene.camera.vertical_fov = 30.0;
    scene
        .volumes
        .push(volume(Rgb::splat(extinction), Rgb::ONE, phase));
    scene
}

fn blob() -> Grid {
    grid(IVec3::splat(-24), IVec3::splat(24), smoke)
}

/// Grids to burn, and extinctions that make them some ten optical depths thick.
fn grids() -> Vec<(&'static str, Grid, f32)> {
    let mut grids = vec![("smoke", blob(), 0.8)];
    if let Some(cloud) = real_density("wdas_cloud_sixteenth.vdb") {
        let corners = cloud.world_corners();
        let size = (corners[7] - corners[0]).length() as f32;
        grids.push(("cloud", cloud, 30.0 / size));
    }
    grids
}

/// Exactly 1 in every pixel: nothing is lost, nothing gained, nothing left to chance.
#[test]
fn path_tracer_sees_nothing_in_a_furnace() {
    for phase in PHASES {
        let mut cases = vec![("fog", fog(4.0, 3.0, phase), None)];
        let grids = grids();
        for (name, grid, extinction) in &grids {
            cases.push((name, around(grid, 2.5, *extinction, phase), Some(grid)));
        }
        for (name, mut scene, grid) in cases {
            scene.settings.method = Method::Path;
            scene.settings.spp = 4;
            let grids: Vec<&Grid> = grid.into_iter().collect();
            let film = render(&scene, &grids, None).film;
            for y in 0..16 {
                for x in 0..16 {
                    assert_eq!(
                        film.mean(x, y),
                        DVec3::ONE,
                        "{name} {phase:?}: pixel {x}, {y}"
                    );
                }
            }
        }
    }
}

const PASSES: u32 = 24;

/// Renders by beams and asks for 1 within the standard error, itself below half a per cent.
fn check_beam(name: &str, mut scene: Scene, grids: &[&Grid], cases: usize) {
    scene.settings.passes = PASSES;
    let film = render(&scene, grids, None).film;
    assert_eq!(
        film.nonfinite_pixels(),
        0,
        "{name}: pixels that are no numbers"
    );
    let estimate = film.image_mean();
    let mean = estimate.mean.x;
    let error = estimate.standard_error.expect("more than one pass").x;
    let t = (mean - 1.0) / error;
    let bound = t_bound(cases, f64::from(PASSES - 1));
    println!("{name}: {mean:.5} +- {error:.5}, t {t:.2}, bound {bound:.2}");
    assert!(error < 0.005, "{name}: standard error {error}");
    assert!(t.abs() < bound, "{name}: {mean} +- {error}");
}

/// Photons that keep the standard error below half a per cent: forward scattering sends most of
/// them on unseen.
fn photons(phase: Phase) -> u64 {
    match phase {
        Phase::HenyeyGreenstein(g) if g > 0.5 => 900_000,
        _ => 90_000,
    }
}

/// Hard outlines and all. A sky's first order comes from photons whether direct light is asked to be sampled or not.
#[test]
fn beam_sees_no_fog_in_a_furnace() {
    for (phase, direct) in [
        (PHASES[0], Direct::Sampled),
        (PHASES[0], Direct::Photons),
        (PHASES[1], Direct::Sampled),
        (PHASES[2], Direct::Sampled),
    ] {
        let mut scene = fog(4.0, 3.0, phase);
        scene.settings.photons = photons(phase);
        scene.settings.direct = direct;
        check_beam(&format!("fog {phase:?} {direct:?}"), scene, &[], 4);
    }
}

/// Rough media, outlines and all.
#[test]
fn beam_sees_no_volume_in_a_furnace() {
    let grids = grids();
    for (name, grid, extinction) in &grids {
        for phase in PHASES {
            let mut scene = around(grid, 2.5, *extinction, phase);
            // The cloud fills more of the picture.
            scene.settings.photons = photons(phase) / if *name == "cloud" { 2 } else { 1 };
            check_beam(
                &format!("{name} {phase:?}"),
                scene,
                &[grid],
                PHASES.len() * grids.len(),
            );
        }
    }
}
