//! Surfaces and media together: furnaces, energy, and photons against paths.
//!
//! Every picture is rendered several times with seeds of its own. The standard error of a block of
//! pixels comes from the scatter of its means over the seeds, since the photons of a pass are
//! shared by all pixels and the pixels' own errors cannot simply be added.

mod agreement;
mod furnace;
mod peers;
mod surface_map;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use vpm_vdb::progress::Silent;
use vpm_vdb::render::{Exec, Rendered, render};
use vpm_vdb::scene::Scene;

/// Reads a scene; volumes are looked up in the repository's folder `scenes`.
fn scene(text: &str) -> Scene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/test.toml");
    Scene::from_text(&file, text.to_owned()).expect("the scene of a test is valid")
}

fn rendered(scene: &Scene) -> Rendered {
    rendered_by(scene, 2)
}

fn rendered_by(scene: &Scene, threads: usize) -> Rendered {
    let exec = Exec {
        threads: Some(threads),
        progress: &Silent,
        time_limit: None,
        warn: &|text| panic!("unexpected warning: {text}"),
        stop: &AtomicBool::new(false),
    };
    let rendered = render(scene, &exec).expect("it renders");
    assert_eq!(rendered.film.nonfinite_pixels(), 0, "no NaN");
    rendered
}

/// Mean and standard error.
#[derive(Debug, Clone, Copy)]
struct Figure {
    mean: f64,
    error: f64,
}

/// Means over `blocks` x `blocks` blocks of the picture, of `seeds` renders.
fn block_means(scene: &Scene, blocks: u32, seeds: u64) -> Vec<Figure> {
    let mut scene = scene.clone();
    let mut sums = vec![[0.0f64; 2]; (blocks * blocks) as usize];
    for seed in 0..seeds {
        scene.settings.seed = 1000 + seed;
        let film = rendered(&scene).film;
        let [width, height] = film.resolution();
        let (w, h) = (width / blocks, height / blocks);
        for (i, sum) in (0..).zip(&mut sums) {
            let (x0, y0) = (i % blocks * w, i / blocks * h);
            let mut mean = 0.0;
            for y in y0..y0 + h {
                for x in x0..x0 + w {
                    mean += film.mean(x, y).y / f64::from(w * h);
                }
            }
            sum[0] += mean;
            sum[1] += mean * mean;
        }
    }
    let n = seeds as f64;
    let figure = |[sum, squares]: [f64; 2]| {
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(0.0) / (n - 1.0);
        Figure {
            mean,
            error: variance.sqrt(),
        }
    };
    sums.into_iter().map(figure).collect()
}
