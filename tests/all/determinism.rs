//! The same picture to the last bit on any number of threads, and no power lost on the way.

use glam::{DVec3, IVec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::photon::Energy;
use vpm_vdb::scene::{Direct, Light, Method, Phase, Rgb, Scene, Search};

use crate::fields::{grid, render, scene, smoke, volume};

fn blob() -> Grid {
    grid(IVec3::splat(-24), IVec3::splat(24), smoke)
}

/// Smoke under a sun and a sky, grey or not.
fn smoky(albedo: Rgb, phase: Phase) -> Scene {
    let mut scene = scene(70.0, [40, 27]);
    scene.volumes.push(volume(Rgb::splat(0.5), albedo, phase));
    scene.lights.push(Light::Sun {
        direction: DVec3::new(0.3, -1.0, 0.2).normalize(),
        irradiance: Rgb::splat(3.0),
        angular_diameter: 0.53,
    });
    scene.lights.push(Light::Sky {
        radiance: albedo * 0.4,
    });
    scene.settings.photons = 20_000;
    scene.settings.passes = 2;
    scene.settings.spp = 4;
    scene
}

#[test]
fn threads_change_no_bit_of_the_film() {
    let blob = blob();
    let grey = Rgb::splat(0.8);
    let colour = Rgb::new(0.9, 0.8, 0.6);
    let forward = Phase::HenyeyGreenstein(0.7);
    let mut scenes = [
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
    scenes[5].camera.lens = Some(vpm_vdb::scene::Lens {
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
    for (index, scene) in scenes.iter().enumerate() {
        let first = render(scene, &[&blob], Some(1));
        for threads in [1, 2, 3] {
            let again = render(scene, &[&blob], Some(threads));
            assert!(
                first.film.to_bytes() == again.film.to_bytes(),
                "scene {index}: {threads} threads give another picture"
            );
            assert_eq!(
                first.energy, again.energy,
                "scene {index}: {threads} threads"
            );
            assert_eq!(
                first.report.counters, again.report.counters,
                "scene {index}: {threads} threads"
            );
        }
        let mut other = scene.clone();
        other.settings.seed = 1;
        let other = render(&other, &[&blob], Some(2));
        assert!(
            first.film.to_bytes() != other.film.to_bytes(),
            "scene {index}: another seed gives the same picture"
        );
    }
}

/// Emitted power is absorbed, escapes, or is left over at the last order; each photon's sums are
/// in f32 and some ten long, the totals in f64: 1e-6 of the whole.
#[test]
fn no_power_is_lost() {
    let blob = blob();
    for (albedo, max_bounces) in [(0.8, 128), (1.0, 128), (0.3, 128), (0.95, 3), (0.5, 1)] {
        let mut scene = smoky(Rgb::splat(albedo), Phase::HenyeyGreenstein(0.5));
        scene.settings.max_bounces = max_bounces;
        scene.settings.direct = Direct::Photons;
        let Energy {
            emitted,
            absorbed,
            escaped,
            cut_off,
            on_surfaces,
        } = render(&scene, &[&blob], None).energy;
        println!(
            "albedo {albedo}, {max_bounces} orders: absorbed {:.4}, escaped {:.4}, cut off {:.4}",
            absorbed / emitted,
            escaped / emitted,
            cut_off / emitted
        );
        let off = (absorbed + escaped + cut_off + on_surfaces) / emitted - 1.0;
        assert!(
            emitted > 0.0 && off.abs() < 1e-6,
            "albedo {albedo}: off by {off:e}"
        );
        assert_eq!(
            absorbed > 0.0,
            albedo < 1.0,
            "media of albedo 1 absorb nothing, others something"
        );
    }
}
