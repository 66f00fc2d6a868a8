//! The reference picture of smoke over a floor under a quad light, rendered by another renderer.
//!
//! Not part of the repository; the test says so and passes where the files are not there.

use std::path::Path;

use super::{rendered, scene};

/// Values of a version 1 .npy file of little-endian f32.
fn npy(file: &Path) -> Vec<f32> {
    let bytes = std::fs::read(file).expect("the reference can be read");
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[start..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

#[test]
fn smoke_over_a_floor() {
    let peers = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/peers");
    let volume = peers.join("volumes/plume.vdb");
    if !volume.exists() {
        println!("no reference here");
        return;
    }
    let reference: Vec<f64> = npy(&peers.join("refs/smoke.1.npy"))
        .iter()
        .zip(npy(&peers.join("refs/smoke.2.npy")))
        .map(|(a, b)| 0.5 * f64::from(a + b))
        .collect();
    // A 0.8 m square that faces (0, 0, 1.4) from (2.6, -1, 3.8).
    let center = glam::DVec3::new(2.6, -1.0, 3.8);
    let normal = (glam::DVec3::new(0.0, 0.0, 1.4) - center).normalize();
    let u = 0.8 * normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let corner = center - 0.5 * (u + v);
    for (method, spp, passes) in [("path", 64, 1), ("beam", 1, 4)] {
        let scene = scene(&format!(
            "[camera]\nposition = [0, -6.5, 1.8]\nlook_at = [0, 0, 1.5]\nup = [0, 0, 1]\nvertical_fov = 32\nresolution = [200, 200]\n\
            [[volume]]\nfile = \"{}\"\nextinction = 40.0\nalbedo = 0.8\n\
            [[light]]\nquad = {{ corner = {:?}, edge_u = {:?}, edge_v = {:?}, radiance = 60.0 }}\n\
            [[object]]\nshape = {{ quad = {{ corner = [-10, -10, 0], edge_u = [20, 0, 0], edge_v = [0, 20, 0] }} }}\nmaterial = {{ diffuse = {{ reflectance = 0.5 }} }}\n\
            [render]\nmethod = \"{method}\"\nspp = {spp}\npasses = {passes}\nphotons = 500000\nmax_bounces = 1000\n",
            volume.display(),
            corner.to_array(),
            u.to_array(),
            v.to_array()
        ));
        let out = rendered(&scene);
        let (mut sum, mut wanted, mut relmse) = (0.0, 0.0, 0.0);
        let mean = reference.iter().sum::<f64>() / reference.len() as f64;
        let mut layers = [0.0f64; 2];
        let mut patches = vec![[0.0; 2]; 64];
        for (i, r) in (0u32..).zip(&reference) {
            let (x, y) = (i % 200, i / 200);
            let l = out.film.mean(x, y).y;
            sum += l;
            let means = out.film.means(x, y);
            layers[0] += means.direct.y / reference.len() as f64;
            layers[1] += means.indirect.y / reference.len() as f64;
            wanted += r;
            relmse += (l - r).powi(2) / (r * r + 0.01 * mean * mean) / reference.len() as f64;
            let patch = &mut patches[(y / 25 * 8 + x / 25) as usize];
            patch[0] += l;
            patch[1] += r;
        }
        // Patches of 25 x 25 pixels that are not nearly black.
        let ratios: Vec<f64> = patches
            .iter()
            .filter(|[_, r]| *r > 0.2 * 625.0 * mean)
            .map(|[l, r]| l / r)
            .collect();
        let rms =
            (ratios.iter().map(|r| (r - 1.0).powi(2)).sum::<f64>() / ratios.len() as f64).sqrt();
        let range = ratios
            .iter()
            .fold([1.0f64; 2], |[a, b], r| [a.min(*r), b.max(*r)]);
        println!(
            "smoke {method}: mean ratio {:.4}, {} patches rms {rms:.4}, {range:.3?}, relMSE {relmse:.4}, {:.1} s; direct {:.5}, indirect {:.5}",
            sum / wanted,
            ratios.len(),
            out.report.time_s.total,
            layers[0],
            layers[1],
        );
        // The other renderer's own means scatter by 0.2 %, and agree with a third within 1 %.
        assert!(
            (sum / wanted - 1.0).abs() < 0.02,
            "{method}: {}",
            sum / wanted
        );
    }
}
