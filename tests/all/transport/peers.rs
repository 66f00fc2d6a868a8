//! Pictures that another renderer made of the same scenes: a cloud in a sun and a sky, with
//! isotropic and forward scattering, and smoke over a floor under a quad light.
//!
//! Block by block, by z-tests: our means over several seeds against those of two independent halves
//! of the reference. The halves' difference tells the reference's error, the seeds' scatter ours: a
//! block's own or that of all blocks together, whichever is more, since eight seeds alone may agree
//! by chance.
//!
//! Not part of the repository; the tests say so and pass where the files are not there.

use std::path::{Path, PathBuf};

use super::{rendered, scene};
use crate::stats::{Welford, z_bound};

/// Edge of the references. \[px\]
const EDGE: usize = 200;
/// Blocks along an edge.
const BLOCKS: usize = 8;
const SEEDS: u64 = 8;

/// Values of a version 1 .npy file of little-endian f32.
fn npy(file: &Path) -> Vec<f64> {
    let bytes = std::fs::read(file).expect("the reference can be read");
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[start..]
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect()
}

/// Mean of the picture, then of each block, of a picture of rows.
fn means(value: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let edge = EDGE / BLOCKS;
    let mut all = vec![0.0; 1 + BLOCKS * BLOCKS];
    for y in 0..EDGE {
        for x in 0..EDGE {
            let block = y / edge * BLOCKS + x / edge;
            all[1 + block] += value(x, y) / (edge * edge) as f64;
        }
    }
    all[0] = all[1..].iter().sum::<f64>() / (BLOCKS * BLOCKS) as f64;
    all
}

/// Compares a scene, all of it but the volume's file and what a method needs, with its reference.
fn compare(name: &str, volume: &str, world: &str, photons: u32) {
    let peers = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/peers");
    let volume: PathBuf = peers.join("volumes").join(volume);
    if !volume.exists() {
        println!("no reference here");
        return;
    }
    let halves = [1, 2].map(|i| {
        let values = npy(&peers.join(format!("refs/{name}.{i}.npy")));
        means(|x, y| values[y * EDGE + x])
    });
    let reference: Vec<f64> = (halves[0].iter().zip(&halves[1]))
        .map(|(a, b)| 0.5 * (a + b))
        .collect();
    let lit: Vec<usize> = (0..reference.len())
        .filter(|i| reference[*i] > 0.05 * reference[0])
        .collect();
    // Relative error of a block of the reference: half the difference of its halves, over all.
    let squares = lit[1..]
        .iter()
        .map(|i| (0.5 * (halves[0][*i] - halves[1][*i]) / reference[*i]).powi(2));
    let own = squares.sum::<f64>() / (lit.len() - 1) as f64;
    for (method, spp, passes) in [("path", 16, 1), ("beam", 1, 2)] {
        let text = format!(
            "{world}[render]\nmethod = \"{method}\"\nspp = {spp}\npasses = {passes}\n\
            photons = {photons}\nneighbours = 15\nmax_bounces = 1000\n",
        );
        let mut scene = scene(&text.replace("VOLUME", &volume.display().to_string()));
        let mut found = vec![Welford::default(); reference.len()];
        for seed in 0..SEEDS {
            scene.settings.seed = seed;
            let film = rendered(&scene).film;
            let of_seed = means(|x, y| film.mean(x as u32, y as u32).y);
            found.iter_mut().zip(of_seed).for_each(|(w, m)| w.add(m));
        }
        let relative = |i: usize| found[i].variance_of_mean() / reference[i].powi(2);
        let pooled = lit[1..].iter().map(|i| relative(*i)).sum::<f64>() / (lit.len() - 1) as f64;
        let z = |i: usize| {
            let (ours, theirs) = if i == 0 {
                (relative(0), own / (lit.len() - 1) as f64)
            } else {
                (relative(i).max(pooled), own)
            };
            (found[i].mean() / reference[i] - 1.0) / (ours + theirs).sqrt()
        };
        let worst = lit[1..].iter().map(|i| z(*i).abs()).fold(0.0, f64::max);
        let bound = z_bound(2 * lit.len());
        println!(
            "{name} {method}: mean over the reference's {:.4} +- {:.4}, z {:.2}; worst |z| of {} blocks \
            {worst:.2}, bound {bound:.2}; error of a block: reference {:.4}, ours {:.4}",
            found[0].mean() / reference[0],
            found[0].standard_error() / reference[0],
            z(0),
            lit.len() - 1,
            own.sqrt(),
            pooled.sqrt()
        );
        assert!(z(0).abs() < bound, "{name} {method}: mean, z {}", z(0));
        assert!(worst < bound, "{name} {method}: blocks, worst |z| {worst}");
    }
}

/// A cloud of this mean cosine.
fn cloud(g: f32) -> String {
    format!(
        "[camera]\nposition = [350, -1500, 250]\nlook_at = [0, 0, 320]\nup = [0, 0, 1]\n\
        vertical_fov = 32\nresolution = [200, 200]\n\
        [[volume]]\nfile = \"VOLUME\"\nextinction = 0.065\nalbedo = 0.99\n\
        phase = {{ henyey_greenstein = {{ g = {g:.1} }} }}\n\
        [[light]]\nsun = {{ direction = [0.6, 0.35, -0.72], irradiance = {} }}\n\
        [[light]]\nsky = {{ radiance = 0.2 }}\n",
        std::f64::consts::PI
    )
}

#[test]
fn a_cloud_is_what_another_renderer_sees() {
    compare("cloud_g0", "cumulus.vdb", &cloud(0.0), 60_000);
}

#[test]
fn a_cloud_that_scatters_forward_is_too() {
    compare("cloud_g8", "cumulus.vdb", &cloud(0.8), 100_000);
}

#[test]
fn smoke_over_a_floor_is_too() {
    // A 0.8 m square that faces (0, 0, 1.4) from (2.6, -1, 3.8).
    let center = glam::DVec3::new(2.6, -1.0, 3.8);
    let normal = (glam::DVec3::new(0.0, 0.0, 1.4) - center).normalize();
    let u = 0.8 * normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let corner = center - 0.5 * (u + v);
    let world = format!(
        "[camera]\nposition = [0, -6.5, 1.8]\nlook_at = [0, 0, 1.5]\nup = [0, 0, 1]\n\
        vertical_fov = 32\nresolution = [200, 200]\n\
        [[volume]]\nfile = \"VOLUME\"\nextinction = 40.0\nalbedo = 0.8\n\
        [[light]]\nquad = {{ corner = {:?}, edge_u = {:?}, edge_v = {:?}, radiance = 60.0 }}\n\
        [[object]]\nshape = {{ quad = {{ corner = [-10, -10, 0], edge_u = [20, 0, 0], edge_v = [0, 20, 0] }} }}\n\
        material = {{ diffuse = {{ reflectance = 0.5 }} }}\n",
        corner.to_array(),
        u.to_array(),
        v.to_array()
    );
    compare("smoke", "plume.vdb", &world, 200_000);
}
