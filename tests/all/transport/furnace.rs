//! Furnaces: where light comes in alike from everywhere and nothing absorbs, all radiance is 1.

use super::{block_means, rendered, rendered_by, scene};

const CAMERA: &str = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nup = [0, 1, 0]\n\
    vertical_fov = 40\nresolution = [24, 24]\n[[light]]\nsky = { radiance = 1.0 }\n";

/// Each block is 1 within 5 standard errors of 12 seeds, and `bias` for what a kernel blurs. Student's t
/// of 11 degrees of freedom is beyond that once in 2500 blocks, of the 5 of half as many once in 240.
fn is_one(name: &str, text: &str, method: &str, bias: f64) {
    is_one_by(12, name, text, method, bias);
}

/// The same by so many seeds.
fn is_one_by(seeds: u64, name: &str, text: &str, method: &str, bias: f64) {
    let scene = scene(&format!(
        "{CAMERA}{text}\n[render]\nmethod = \"{method}\"\nspp = 16\nphotons = 100000\npasses = 2\nmax_bounces = 2000\n"
    ));
    for (i, f) in block_means(&scene, 3, seeds).into_iter().enumerate() {
        println!("{name} {method} block {i}: {:.4} +- {:.4}", f.mean, f.error);
        assert!(
            (f.mean - 1.0).abs() < 5.0 * f.error + bias + 1e-5,
            "{name}, {method}, block {i}: {} +- {}",
            f.mean,
            f.error
        );
    }
}

const GLASS: &str = "[[object]]\nshape = { sphere = { center = [0, 0, 0], radius = 1 } }\n\
    material = { glass = { ior = 1.5 } }\n";

#[test]
fn glass_in_a_sky_is_invisible() {
    for method in ["path", "beam"] {
        is_one("glass", GLASS, method, 0.0);
    }
}

#[test]
fn a_white_box_in_a_sky_is_invisible() {
    let cube = "[[object]]\nshape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n\
        material = { diffuse = { reflectance = 1.0 } }\n";
    // Convex: all its light comes straight from the sky.
    for method in ["path", "beam"] {
        is_one("white box", cube, method, 0.0);
    }
}

/// A white wall, seen at 35 degrees from its plane, through a white medium: the discs of most photons
/// near it reach into the wall, where there are none. No share of bias is allowed.
#[test]
fn a_white_wall_in_a_white_medium_is_invisible() {
    let wall = "[[fog]]\nbox = { min = [-1.6, -1.6, -1.6], max = [1.6, 1.6, 1.6] }\nextinction = 1.2\nalbedo = 1.0\n\
        [[object]]\nshape = { box = { min = [-5, -5, -2], max = [5, 5, 0] } }\n\
        material = { diffuse = { reflectance = 1.0 } }\ntransform = { rotate = [0, 55, 0] }\n";
    is_one("white wall", wall, "beam", 0.0);
}

/// Floor and two walls that meet, and a block that stands on them: discs of photons reach into walls
/// and over the block's edges, where there are none.
#[test]
fn a_white_corner_in_a_sky_is_invisible() {
    let block = |name: &str, low: &str, high: &str| {
        format!(
            "[[object]]\nname = \"{name}\"\nshape = {{ box = {{ min = {low}, max = {high} }} }}\n\
            material = {{ diffuse = {{ reflectance = 1.0 }} }}\n"
        )
    };
    let corner = [
        block("floor", "[-1, -1.2, -1.2]", "[4, -1.0, 4]"),
        block("back", "[-1, -1.2, -1.4]", "[4, 4, -1.2]"),
        block("left", "[-1.2, -1.2, -1.4]", "[-1, 4, 4]"),
        block("block", "[0.0, -1.0, -0.4]", "[0.5, -0.3, 0.2]"),
    ];
    is_one("white corner", &corner.concat(), "beam", 0.0);
}

#[test]
fn a_white_medium_in_an_interface_is_invisible() {
    let cube = "[[object]]\nshape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n\
        material = \"interface\"\ninterior = { extinction = 2.0, albedo = 1.0 }\n";
    for method in ["path", "beam"] {
        is_one("medium in interface", cube, method, 0.0);
    }
}

#[test]
fn a_white_medium_in_glass_is_invisible() {
    let ball = "[[object]]\nshape = { sphere = { center = [0, 0, 0], radius = 1 } }\n\
        material = { glass = { ior = 1.3 } }\ninterior = { extinction = 2.0, albedo = 1.0, phase = { henyey_greenstein = { g = 0.5 } } }\n";
    is_one("medium in glass", ball, "path", 0.0);
    // What a few photons bring to the middle through the glass differs much from seed to seed.
    is_one_by(48, "medium in glass", ball, "beam", 0.0);
}

/// Media, glass, metal, floor and colours, all together.
fn everything() -> vpm_vdb::scene::Scene {
    scene(&format!(
        "{CAMERA}{GLASS}interior = {{ extinction = 1.0, albedo = 0.7 }}\n\
        [[object]]\nshape = {{ quad = {{ corner = [-2, -1.5, -2], edge_u = [0, 0, 4], edge_v = [4, 0, 0] }} }}\n\
        material = {{ diffuse = {{ reflectance = [0.2, 0.5, 0.8] }} }}\n\
        [[object]]\nshape = {{ sphere = {{ center = [1.5, 0, 0], radius = 0.4 }} }}\n\
        material = {{ mirror = {{ reflectance = 0.8 }} }}\n\
        [[fog]]\nextinction = [0.1, 0.2, 0.3]\nalbedo = 0.8\nbox = {{ min = [-2, -1.4, -2], max = [2, 2, 2] }}\n\
        [render]\nphotons = 50000\npasses = 2\nmax_bounces = 8\n"
    ))
}

#[test]
fn threads_change_nothing() {
    let scene = everything();
    let [one, three] = [1, 3].map(|threads| rendered_by(&scene, threads).film.to_bytes());
    assert!(one == three, "one thread and three render the same bytes");
}

#[test]
fn energy_is_accounted_for() {
    let scene = everything();
    let e = rendered(&scene).energy;
    let out = e.absorbed + e.on_surfaces + e.escaped + e.cut_off;
    println!("{e:?}");
    assert!(e.absorbed > 0.0 && e.on_surfaces > 0.0 && e.escaped > 0.0);
    // Colours change weights within a free flight, whose mean alone is conserved: 1e5 photons
    // whose weights lie within [0, 3] have a standard error below 3 / sqrt(1e5) = 1 %.
    assert!(
        (out / e.emitted - 1.0).abs() < 0.02,
        "{out} of {}",
        e.emitted
    );
}
