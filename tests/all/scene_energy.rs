//! Power in every scene of the repository: what is emitted arrives somewhere.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use vpm_vdb::frames;
use vpm_vdb::progress::Silent;
use vpm_vdb::render::{Exec, render};
use vpm_vdb::scene::Scene;
use vpm_vdb::selftest::energy::missing;

use crate::stats::{Welford, t_bound};

/// Colours change the weights within a free flight, whose mean alone is conserved: a t-test over
/// seeds, and rounding for grey scenes.
#[test]
fn no_power_is_lost_in_any_scene() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .expect("the folder of scenes")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    assert!(files.len() >= 4, "the scenes of the repository: {files:?}");
    let seeds = 8;
    let bound = t_bound(files.len(), (seeds - 1) as f64);
    for file in &files {
        let mut scene = Scene::load(file).expect("a scene of the repository");
        for volume in &mut scene.volumes {
            if frames::is_pattern(&volume.file) {
                volume.file = frames::file_of(&volume.file, 1);
            }
        }
        scene.camera.resolution = [8, 8];
        scene.settings.photons = 5000;
        scene.settings.passes = 1;
        scene.settings.crop = None;
        let mut off = Vec::new();
        for seed in 0..seeds {
            scene.settings.seed = seed;
            let exec = Exec {
                threads: None,
                progress: &Silent,
                time_limit: None,
                warn: &|_| {},
                stop: &AtomicBool::new(false),
            };
            let energy = render(&scene, &exec).expect("the scene renders").energy;
            // Scenes whose media only absorb and glow send out no photons.
            if energy.emitted > 0.0 {
                off.push(missing(&energy));
            }
        }
        if off.is_empty() {
            println!("{}: no photons", file.display());
            continue;
        }
        let off: Welford = off.into_iter().collect();
        let t = off.z(0.0, 1e-6);
        println!(
            "{}: {:.2e} +- {:.1e} of the power missing, t {t:.2}, bound {bound:.2}",
            file.display(),
            off.mean(),
            off.standard_error()
        );
        assert!(t.abs() <= bound, "{}: t {t}", file.display());
    }
}
