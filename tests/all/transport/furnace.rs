//! Furnaces: where light comes in alike from everywhere and nothing absorbs, all radiance is 1.

use super::{block_means, rendered, rendered_by, scene};

const CAMERA: &str = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nup = [0, 1, 0]\n\
    vertical_fov = 40\nresolution = [24, 24]\n[[light]]\nsky = { radiance = 1.0 }\n";

/// Each block is 1 within 5 standard errors, and `bias` for what a kernel blurs.
fn is_one(name: &str, text: &str, method: &str, bias: f64) {
    let scene = scene(&format!(
        "{CAMERA}{text}\n[render]\nmethod = \"{method}\"\nspp = 16\nphotons = 100000\npasses = 2\nmax_bounces = 2000\n"
    ));
    for (i, f) in block_means(&scene, 3, 6).into_iter().enumerate() {
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

#[test]
fn a_white_medium_in_an_interface_is_invisible() {
    let cube = "[[object]]\nshape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n\
        material = \"interface\"\ninterior = { extinction = 2.0, albedo = 1.0 }\n";
    is_one("medium in interface", cube, "path", 0.0);
    // Discs reach over the boundary: less is found within a radius of it.
    is_one("medium in interface", cube, "beam", 0.05);
}

#[test]
fn a_white_medium_in_glass_is_invisible() {
    let ball = "[[object]]\nshape = { sphere = { center = [0, 0, 0], radius = 1 } }\n\
        material = { glass = { ior = 1.3 } }\ninterior = { extinction = 2.0, albedo = 1.0, phase = { henyey_greenstein = { g = 0.5 } } }\n";
    is_one("medium in glass", ball, "path", 0.0);
    is_one("medium in glass", ball, "beam", 0.05);
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
