//! What `plan` foretells: that it is there, scales as it should, and agrees with the render where it
//! counts rather than times.

use std::sync::atomic::AtomicBool;

use vpm_vdb::render::{Forecast, plan_loaded};
use vpm_vdb::scene::Scene;

use super::scenes::{Case, cases, exec};

fn forecast(case: &Case, scene: &Scene) -> Forecast {
    let stop = AtomicBool::new(false);
    let exec = exec(&stop);
    let (_, forecast) = plan_loaded(scene, case.volumes(), &exec).expect("the scene is planned");
    forecast
}

fn case(name: &str) -> Case {
    let found = cases().into_iter().find(|c| c.name == name);
    found.expect("one of the scenes")
}

fn bytes(forecast: &Forecast, name: &str) -> u64 {
    let stage = forecast.stages.iter().find(|s| s.name == name);
    stage
        .and_then(|s| s.memory_bytes)
        .expect("a stage with memory")
}

#[test]
fn stages_that_do_not_exist_cost_nothing() {
    for (name, traced) in [
        ("absorption only", false),
        ("single scattering", false),
        ("grey", true),
    ] {
        let case = case(name);
        let forecast = forecast(&case, &case.scene);
        for stage in &forecast.stages {
            let seconds = stage.seconds_estimate.expect("known");
            assert!(seconds.is_finite() && seconds >= 0.0, "{name}: {stage:?}");
            if stage.name == "photons" || stage.name == "map" {
                assert_eq!(seconds > 0.0, traced, "{name}: {stage:?}");
                assert_eq!(stage.memory_bytes > Some(0), traced, "{name}: {stage:?}");
            }
        }
        assert_eq!(forecast.photons.emitted > 0, traced, "{name}");
    }
}

/// Twice the photons and passes: as many times the bytes and photons. Radii and time are not exact.
#[test]
fn photons_and_memory_follow_the_settings() {
    let case = case("grey");
    let mut scene = case.scene.clone();
    scene.settings.photons = 200_000;
    let once = forecast(&case, &scene);
    scene.settings.photons *= 2;
    scene.settings.passes *= 3;
    scene.camera.resolution = [32, 16];
    let more = forecast(&case, &scene);
    assert_eq!(more.photons.emitted, 6 * once.photons.emitted, "emitted");
    let stored = more.photons.stored as f64 / once.photons.stored as f64;
    assert!((stored / 6.0 - 1.0).abs() < 0.02, "stored {stored} times");
    // Rates of deposits settle from pilots of the same seed: the ratio is nearly exact.
    let photons = bytes(&more, "photons") as f64 / bytes(&once, "photons") as f64;
    assert!(
        (photons / 2.0 - 1.0).abs() < 0.02,
        "photons {photons} times"
    );
    assert_eq!(bytes(&more, "gather"), 2 * bytes(&once, "gather"), "film");
    assert_eq!(bytes(&more, "load"), bytes(&once, "load"), "grids");
}

/// Stored photons, which are counted, are foretold within 4 standard errors. A path leaves two on
/// average, geometrically many: the variance of their sum is some four times the count.
#[test]
fn stored_photons_are_those_of_the_render() {
    let case = case("grey");
    let foretold = forecast(&case, &case.scene).photons;
    let rendered = case.render(true, 0).report.photons;
    assert_eq!(foretold.emitted, rendered.emitted, "emitted");
    let (a, b) = (foretold.stored as f64, rendered.stored as f64);
    let passes = f64::from(case.scene.settings.passes);
    // Foretold from one pass: its scatter counts for each of the others.
    let error = (4.0 * (passes * a + b)).sqrt();
    println!("foretold {a}, rendered {b}, +- {error:.0}");
    assert!(
        (a - b).abs() < 4.0 * error,
        "foretold {a}, rendered {b} +- {error}"
    );
}
