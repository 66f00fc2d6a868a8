//! Power: what is emitted is absorbed, escapes, or is left over at the last order.
//!
//! ```text
//! emitted = absorbed in media + absorbed by surfaces + escaped + cut off        [W]
//! ```
//!
//! Each photon's sums are f32 and some ten long, the totals f64: 1e-6 of the whole. Colours change
//! the weights within a free flight, whose mean alone is conserved: those scenes by Student's t
//! over independent renders.

use glam::{DAffine3, DVec3};

use super::fields::{render, scene, volume};
use super::furnace::blob;
use super::{SelftestError, Suite, Worst};
use crate::grid::Grid;
use crate::photon::Energy;
use crate::scene::{Direct, Light, Material, Object, Phase, Rgb, Scene, Shape};
use crate::stats::{Welford, t_bound};

/// Smoke under a sun and a sky, grey or not.
#[must_use]
pub fn smoky(albedo: Rgb, phase: Phase) -> Scene {
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

/// A floor below the smoke, and a ball of glass in it.
fn objects() -> Vec<Object> {
    let object = |name: &str, shape, material| Object {
        name: name.to_owned(),
        shape,
        transform: DAffine3::IDENTITY,
        material,
        interior: None,
    };
    vec![
        object(
            "floor",
            Shape::Quad {
                corner: DVec3::new(-40.0, -30.0, -40.0),
                edge_u: DVec3::new(0.0, 0.0, 80.0),
                edge_v: DVec3::new(80.0, 0.0, 0.0),
            },
            Material::Diffuse {
                reflectance: Rgb::splat(0.6),
                texture: None,
            },
        ),
        object(
            "ball",
            Shape::Sphere {
                center: DVec3::new(5.0, 0.0, 3.0),
                radius: 8.0,
            },
            Material::Glass {
                ior: 1.5,
                roughness: 0.0,
            },
        ),
    ]
}

/// What is missing of the emitted power, over it.
#[must_use]
pub fn missing(energy: &Energy) -> f64 {
    let Energy {
        emitted,
        absorbed,
        escaped,
        cut_off,
        on_surfaces,
    } = energy;
    (absorbed + escaped + cut_off + on_surfaces) / emitted - 1.0
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let blob: Grid = blob()?;
    let forward = Phase::HenyeyGreenstein(0.5);
    let photons = suite.choose([10_000, 50_000, 1_000_000]);
    let (mut worst, mut faults) = (Worst::default(), Worst::default());
    for surfaces in [false, true] {
        for (albedo, max_bounces) in [(0.8, 128), (1.0, 100_000), (0.3, 128), (0.95, 3), (0.5, 1)] {
            let mut scene = smoky(Rgb::splat(albedo), forward);
            scene.camera.resolution = [8, 8];
            scene.settings.passes = 1;
            scene.settings.photons = photons;
            scene.settings.max_bounces = max_bounces;
            scene.settings.direct = Direct::Photons;
            if surfaces {
                scene.objects = objects();
            }
            let energy = render(&scene, &[&blob], None)?.energy;
            let place = || {
                format!("albedo {albedo}, {max_bounces} orders, surfaces {surfaces}: {energy:?}")
            };
            worst.take(missing(&energy).abs(), place);
            // Media of albedo 1 absorb nothing, others something; surfaces, where a photon goes on.
            let absorbs = energy.absorbed > 0.0;
            let on_surfaces = surfaces && max_bounces > 1;
            let wrong = absorbs != (albedo < 1.0) || (energy.on_surfaces > 0.0) != on_surfaces;
            faults.count(wrong, place);
        }
    }
    suite.worst("emitted power unaccounted for, grey scenes", worst, 1e-6);
    suite.none(
        "power absorbed by what cannot absorb, or not by what can",
        faults,
    );

    let seeds = suite.choose([16, 32, 64]);
    let mut missed = Welford::default();
    for seed in 0..seeds {
        let mut scene = smoky(Rgb::new(0.9, 0.7, 0.4), forward);
        scene.volumes[0].optics.extinction = Rgb::new(0.6, 0.4, 0.2);
        scene.camera.resolution = [8, 8];
        scene.settings.passes = 1;
        scene.settings.photons = photons;
        scene.settings.seed = seed;
        missed.add(missing(&render(&scene, &[&blob], None)?.energy));
    }
    let t = missed.z(0.0, 1e-6).abs();
    let bound = t_bound(1, (seeds - 1) as f64);
    suite.at_most(
        "emitted power unaccounted for, coloured scene, |t|",
        t,
        bound,
    );
    Ok(())
}
