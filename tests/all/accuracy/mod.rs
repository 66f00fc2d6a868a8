//! What accuracy costs: studies, rates, and the errors that renders state. What these share.

mod progressive;
mod study;
mod target_error;

use std::sync::atomic::AtomicBool;

use vpm_vdb::progress::Silent;
use vpm_vdb::render::{Exec, Watch, render_watched};
use vpm_vdb::rng::Rng;
use vpm_vdb::scene::Scene;
use vpm_vdb::world::LoadedVolume;

/// A standard normal number (Box & Muller 1958).
fn normal(rng: &mut Rng) -> f64 {
    let (u, v) = (1.0 - rng.uniform_f64(), rng.uniform_f64());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A box of fog under a point light, with these keys of `[camera]` and `[render]`.
fn fog(resolution: [u32; 2], extinction: f64, render: &str) -> String {
    format!(
        "[camera]\nposition = [0.0, 0.0, 4.0]\nlook_at = [0.0, 0.0, 0.0]\nvertical_fov = 40.0\n\
         resolution = {resolution:?}\n[render]\n{render}\n[[fog]]\n\
         box = {{ min = [-1, -1, -1], max = [1, 1, 1] }}\nextinction = {extinction}\n\
         albedo = 0.8\n[[light]]\npoint = {{ position = [0.0, 2.0, 1.0], power = 50.0 }}\n"
    )
}

/// Renders with a watch; colours of the picture, row by row.
fn pixels(scene: &Scene, volumes: &[LoadedVolume], watch: &mut dyn Watch) -> Vec<[f64; 3]> {
    let stop = AtomicBool::new(false);
    let exec = Exec {
        threads: None,
        progress: &Silent,
        time_limit: None,
        warn: &|_| {},
        stop: &stop,
    };
    let film = render_watched(scene, volumes.to_vec(), &exec, watch)
        .expect("the scene renders")
        .film;
    let [width, height] = scene.camera.resolution;
    (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| film.mean(x, y).to_array())
        .collect()
}
