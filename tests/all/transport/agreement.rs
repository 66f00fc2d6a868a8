//! Photons, by beams and by points, against paths, block by block.
//!
//! Blocks differ by no more than 5 standard errors and a share of their radiance that the kernels
//! may blur away: a photon's disc that reaches over the border of its medium (or of its floor)
//! counts too little there, by an amount that falls with the radius. Media with hard borders in
//! few passes show it most.

use super::{Figure, block_means, scene};
use crate::stats::t_bound;

/// What is to agree, and how well.
struct Case {
    name: &'static str,
    text: &'static str,
    /// Share of the mean that kernels may blur away.
    bias: f64,
    spp: u32,
    /// Photon estimates to compare.
    methods: &'static [&'static str],
}

fn agree(case: &Case) {
    let camera = "[camera]\nposition = [0, 1.2, 5]\nlook_at = [0, 0.8, 0]\nup = [0, 1, 0]\n\
        vertical_fov = 36\nresolution = [32, 32]\n";
    let figures = |method: &str| {
        let spp = if method == "path" { case.spp } else { 4 };
        block_means(
            &scene(&format!(
                "{camera}{}\n[render]\nmethod = \"{method}\"\nspp = {spp}\nphotons = 200000\npasses = 4\n",
                case.text
            )),
            4,
            6,
        )
    };
    let path = figures("path");
    for method in case.methods {
        compare(case, &path, method, &figures(method));
    }
}

/// Blocks of a photon estimate, `beam`, against those of paths.
fn compare(case: &Case, path: &[Figure], method: &str, beam: &[Figure]) {
    let mean = path.iter().map(|f| f.mean).sum::<f64>() / path.len() as f64;
    let ratio = beam.iter().map(|f| f.mean).sum::<f64>() / path.len() as f64 / mean;
    println!("{}: {method} / path {ratio:.4}", case.name);
    let mut worst = 0.0f64;
    for (i, (p, b)) in path.iter().zip(beam).enumerate() {
        let error = p.error.hypot(b.error).max(1e-6 * p.mean + 1e-12);
        let z = (b.mean - p.mean) / error;
        println!(
            "  {i:2}: path {:.5} +- {:.5}  {method} {:.5} +- {:.5}  ratio {:.4} z {z:.1}",
            p.mean,
            p.error,
            b.mean,
            b.error,
            b.mean / p.mean
        );
        let excess = (b.mean - p.mean).abs() - 5.0 * error;
        worst = worst.max(excess / (case.bias * p.mean.max(0.2 * mean)));
    }
    assert!(
        worst < 1.0,
        "{} by {method}: {worst} of the bias allowed",
        case.name
    );
}

const FLOOR: &str = "[[object]]\nshape = { quad = { corner = [-3, 0, -3], edge_u = [0, 0, 6], edge_v = [6, 0, 0] } }\n\
    material = { diffuse = { reflectance = 0.6 } }\n";

#[test]
fn floor_and_smoke_under_a_quad() {
    agree(&Case {
        name: "floor and smoke",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-0.7, 0.3, -0.7], max = [0.7, 1.7, 0.7] }\nextinction = 4.0\nalbedo = 0.9\n\
            [[light]]\nquad = { corner = [-0.5, 3, -0.5], edge_u = [1, 0, 0], edge_v = [0, 0, 1], radiance = 10.0 }\n",
        ]),
        bias: 0.02,
        spp: 64,
        methods: &["beam"],
    });
}

#[test]
fn glass_in_fog_under_a_ball() {
    agree(&Case {
        name: "glass in fog",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-3, 0.01, -3], max = [3, 3, 3] }\nextinction = 0.1\nalbedo = 0.9\n\
            [[object]]\nshape = { sphere = { center = [0, 0.8, 0], radius = 0.6 } }\nmaterial = { glass = { ior = 1.5 } }\n\
            [[light]]\nsphere = { center = [1.2, 3.5, 0], radius = 0.8, radiance = 5.0 }\n",
        ]),
        bias: 0.03,
        spp: 256,
        methods: &["beam", "point"],
    });
}

/// The volume caustic: fog below a glass ball under a lamp so large that paths find it through the
/// glass. Blocks of fog alone, the ball out of view, by t-tests without any allowance. The light
/// that the ball focuses is a seventh of what the upper middle blocks show.
#[test]
fn a_volume_caustic_agrees_with_converged_paths() {
    let text = "[camera]\nposition = [0, 0.15, 4]\nlook_at = [0, 0.15, 0]\nvertical_fov = 12\n\
        resolution = [16, 16]\n\
        [[fog]]\nbox = { min = [-1.2, -0.6, -1.2], max = [1.2, 1.4, 1.2] }\nextinction = 0.4\nalbedo = 0.9\n\
        [[light]]\nquad = { corner = [-0.8, 2.6, -0.8], edge_u = [1.6, 0, 0], edge_v = [0, 0, 1.6], radiance = 5.0 }\n";
    let ball = "[[object]]\nshape = { sphere = { center = [0, 0.9, 0], radius = 0.3 } }\n\
        material = { glass = { ior = 1.5 } }\n";
    let beam =
        "[render]\nmethod = \"beam\"\nphotons = 60000\npasses = 1\nneighbours = 20\nspp = 4\n";
    let path = "[render]\nmethod = \"path\"\nspp = 2048\n";
    let seeds = 10;
    let blocks = |parts: &[&str]| block_means(&scene(&parts.concat()), 4, seeds);
    let (beam, path) = (blocks(&[text, ball, beam]), blocks(&[text, ball, path]));
    let without = blocks(&[text, "[render]\nmethod = \"path\"\nspp = 1024\n"]);
    let t = |a: &Figure, b: &Figure| (a.mean - b.mean) / a.error.hypot(b.error);
    let bound = t_bound(beam.len(), (seeds - 1) as f64);
    for (i, (b, p)) in beam.iter().zip(&path).enumerate() {
        let t = t(b, p);
        println!("block {i}: {:.4}, t {t:.2}", b.mean / p.mean);
        assert!(t.abs() < bound, "block {i}: t {t}, at most {bound}");
    }
    for i in [1, 2] {
        let t = t(&path[i], &without[i]);
        println!(
            "block {i}: {:.4} of it without the ball, t {t:.1}",
            without[i].mean / path[i].mean
        );
        assert!(t > bound, "block {i} shows the caustic: t {t}");
    }
}

#[test]
fn a_mirror_shows_smoke_and_floor() {
    agree(&Case {
        name: "mirror",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-0.5, 0.3, 0.4], max = [0.5, 1.3, 1.2] }\nextinction = 3.0\nalbedo = 0.8\n\
            [[object]]\nshape = { quad = { corner = [-1.5, 0.2, -1], edge_u = [3, 0, 0], edge_v = [0, 2, 0] } }\nmaterial = { mirror = { reflectance = 0.9 } }\n\
            [[light]]\nquad = { corner = [-0.5, 3, -0.5], edge_u = [1, 0, 0], edge_v = [0, 0, 1], radiance = 10.0 }\n",
        ]),
        bias: 0.03,
        spp: 64,
        methods: &["beam"],
    });
}

#[test]
fn an_emissive_ball_in_a_room_with_smoke() {
    agree(&Case {
        name: "emissive ball",
        text: joined(&[
            "[[object]]\nshape = { box = { min = [-2, 0, -2], max = [2, 3, 6] } }\nmaterial = { diffuse = { reflectance = 0.5 } }\n\
            [[object]]\nshape = { sphere = { center = [0, 2.3, 0], radius = 0.3 } }\nmaterial = { emissive = { radiance = 8.0 } }\n\
            [[fog]]\nbox = { min = [-0.6, 0.4, -0.6], max = [0.6, 1.5, 0.6] }\nextinction = 3.0\nalbedo = 0.9\n",
        ]),
        bias: 0.03,
        spp: 64,
        methods: &["beam"],
    });
}

#[test]
fn milk_in_an_interface_and_rough_metal() {
    agree(&Case {
        name: "milk and metal",
        text: joined(&[
            FLOOR,
            "[[object]]\nshape = { sphere = { center = [-0.7, 0.7, 0], radius = 0.6 } }\nmaterial = \"interface\"\n\
            interior = { extinction = 5.0, albedo = 0.95 }\n\
            [[object]]\nshape = { sphere = { center = [0.7, 0.7, 0], radius = 0.6 } }\nmaterial = { conductor = { eta = 0.2, k = 3.0, roughness = 0.4 } }\n\
            [[light]]\nquad = { corner = [-0.5, 3, -0.5], edge_u = [1, 0, 0], edge_v = [0, 0, 1], radiance = 10.0 }\n\
            [[light]]\nsky = { radiance = 0.3 }\n",
        ]),
        bias: 0.06,
        spp: 64,
        methods: &["beam", "point"],
    });
}

/// At 6000 K, where paths that find the flames by chance find all of them alike bright: at 1500 K a
/// few voxels shine for all others, and no affordable number of paths has seen them.
#[test]
fn a_fire_lights_floor_and_mist() {
    agree(&Case {
        name: "fire",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-1.5, 0.05, -1], max = [1.5, 1.8, 1] }\nextinction = 0.3\nalbedo = 0.9\n\
            [[object]]\nshape = { sphere = { center = [0.9, 0.5, 0.2], radius = 0.4 } }\nmaterial = { diffuse = { reflectance = 0.7 } }\n\
            [[volume]]\nextinction = 25.0\nalbedo = 0.3\n\
            emission = { blackbody = { scale = 6000.0 } }\ntransform = { scale = 1.6, translate = [-0.4, 0.1, 0] }\nfile = \"../volumes/fire.vdb\"\n",
        ]),
        bias: 0.04,
        spp: 96,
        methods: &["beam"],
    });
}

#[test]
fn a_picture_of_the_sky_lights_floor_and_smoke() {
    agree(&Case {
        name: "sky picture",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-0.7, 0.4, -0.7], max = [0.7, 1.6, 0.7] }\nextinction = 3.0\nalbedo = 0.9\n\
            [[light]]\nsky = { scale = 2.0, file = \"skies/sunset.exr\" }\n",
        ]),
        bias: 0.02,
        spp: 64,
        methods: &["beam"],
    });
}

/// Rows of black and white, and a red corner: what the photons bring and what is sampled have to
/// show the same slide the same way round.
#[test]
fn a_slide_before_a_spot() {
    let folder = tempfile::tempdir().expect("a folder for the slide");
    let slide = folder.path().join("slide.png");
    let pixels: Vec<u8> = (0..16 * 16)
        .flat_map(|i| match (i % 16, i / 16) {
            (0..6, 0..6) => [255, 30, 0],
            (_, y) if y % 4 < 2 => [255, 255, 255],
            _ => [0, 0, 60],
        })
        .collect();
    vpm_vdb::image::write_rgb8(&slide, 16, 16, &pixels).expect("the slide can be written");
    agree(&Case {
        name: "slide",
        text: joined(&[
            FLOOR,
            "[[fog]]\nbox = { min = [-1.2, 0.02, -1.2], max = [1.2, 1.6, 1.2] }\nextinction = 1.0\nalbedo = 0.9\n\
            [[light]]\nspot = { position = [1, 4, 1], look_at = [0, 0.4, 0], power = 60, cone_angle = 18, image = ",
            &format!("{slide:?}"),
            " }\n",
        ]),
        bias: 0.03,
        spp: 64,
        methods: &["beam"],
    });
}

/// Scene texts, one after the other.
fn joined(parts: &[&str]) -> &'static str {
    parts.concat().leak()
}
