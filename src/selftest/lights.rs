//! Lights inside media, and surfaces where geometry degenerates.
//!
//! First-order light of a point light in fog, by an integral along the camera ray:
//!
//! ```text
//! L = integral of   exp(-sigma (s + r)) sigma_s p(c) power / (4 pi r^2) dt
//! s, r   way in the fog from the camera to the point, and from the light to it [m]
//! ```
//!
//! The light stands inside the fog, on its face, a thousandth of a metre from the ray (where the
//! integrand is a peak of that width), outside; the camera outside and inside. Surfaces by
//! furnaces: what absorbs nothing cannot be seen, whatever is nested in what, where rays graze,
//! and where the face of a fog is that of a wall.

use glam::{DAffine3, DVec3};

use super::fields::{render, scene};
use super::furnace::furnace;
use super::{SelftestError, Suite, Worst};
use crate::scene::{Fog, Light, Material, Method, Object, Optics, Phase, Rgb, Scene, Shape};
use crate::stats::{t_bound, z_bound};

/// Fog in a cube of edge 8.
const HALF: f64 = 4.0;
const SIGMA: f64 = 0.4;
const ALBEDO: f64 = 0.7;
const G: f64 = 0.5;
const POWER: f64 = 50.0;

/// Length of the segment from a to b inside the cube.
fn inside(a: DVec3, b: DVec3) -> f64 {
    let d = b - a;
    let (mut enter, mut exit) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        if d[axis] == 0.0 {
            if a[axis].abs() > HALF {
                return 0.0;
            }
            continue;
        }
        let (p, q) = ((-HALF - a[axis]) / d[axis], (HALF - a[axis]) / d[axis]);
        enter = enter.max(p.min(q));
        exit = exit.min(p.max(q));
    }
    (exit - enter).max(0.0) * d.length()
}

/// The integral along the axis from a camera at z = `from`, in the variable that flattens the
/// peak near the light: t = t0 + d tan(theta).
fn integral(from: f64, light: DVec3) -> f64 {
    let camera = DVec3::new(0.0, 0.0, from);
    let (start, end) = ((from - HALF).max(0.0), from + HALF);
    let t0 = from - light.z;
    let d = DVec3::new(light.x, light.y, 0.0).length();
    let (low, high) = (((start - t0) / d).atan(), ((end - t0) / d).atan());
    let n = 100_000;
    let step = (high - low) / f64::from(n);
    (0..n)
        .map(|i| {
            let theta = low + (f64::from(i) + 0.5) * step;
            let t = t0 + d * theta.tan();
            let p = camera - DVec3::Z * t;
            let r = p.distance(light);
            // From the light to p, on to the camera at +z.
            let c = (p - light).z / r;
            let phase = (1.0 - G * G)
                / (4.0 * std::f64::consts::PI * (1.0 + G * G - 2.0 * G * c).powf(1.5));
            let way = inside(camera, p) + inside(p, light);
            // dt = d / cos^2 dtheta = (d^2 + (t - t0)^2) / d dtheta = r^2 / d dtheta.
            let arriving = POWER / (4.0 * std::f64::consts::PI * d);
            (-SIGMA * way).exp() * SIGMA * ALBEDO * phase * arriving * step
        })
        .sum()
}

/// First-order pictures of one pixel against the integral.
fn single_scattering(suite: &mut Suite) -> Result<(), SelftestError> {
    let cases = [
        ("inside the fog", 6.0, DVec3::new(1.0, 0.7, -0.5)),
        ("1e-3 m from the ray", 6.0, DVec3::new(1e-3, 0.0, 0.3)),
        ("on the fog's face", 6.0, DVec3::new(1.0, HALF, 0.2)),
        ("outside", 6.0, DVec3::new(2.0, 5.5, 1.0)),
        ("camera and light inside", 1.0, DVec3::new(0.5, -0.5, -1.0)),
        (
            "light behind a camera inside",
            -2.0,
            DVec3::new(0.3, 0.2, 0.5),
        ),
    ];
    let scale = suite.choose([1, 4, 40]);
    let mut worst = Worst::default();
    let mut error = Worst::default();
    for (name, from, light) in cases {
        let mut fog = scene(from, [1, 1]);
        // One pixel, narrow enough that every ray of it is the axis.
        fog.camera.vertical_fov = 1e-4;
        fog.camera.look_at = DVec3::new(0.0, 0.0, from - 1.0);
        fog.fogs.push(Fog {
            bounds: Some([DVec3::splat(-HALF), DVec3::splat(HALF)]),
            optics: Optics {
                extinction: Rgb::splat(SIGMA as f32),
                albedo: Rgb::splat(ALBEDO as f32),
                phase: Phase::HenyeyGreenstein(G as f32),
            },
        });
        fog.lights.push(Light::Point {
            position: light,
            power: Rgb::splat(POWER as f32),
        });
        fog.settings.max_bounces = 1;
        let exact = integral(from, light);
        for (method, spp, passes) in [
            (Method::Path, 40_000 * scale, 1),
            (Method::Beam, 200, 25 * scale),
        ] {
            fog.settings.method = method;
            fog.settings.spp = spp;
            fog.settings.passes = passes;
            let mean = render(&fog, &[], None)?.film.image_mean();
            let off = mean.mean.x - exact;
            let e = mean.standard_error.map_or(f64::NAN, |e| e.x);
            let place = || {
                format!(
                    "{name}, {method:?}: {} +- {e}, exactly {exact}",
                    mean.mean.x
                )
            };
            worst.take((off / e).abs(), place);
            // Path tracing meets the peak of a near light by chance alone.
            if method == Method::Beam {
                error.take(e / exact, place);
            }
        }
    }
    suite.worst(
        "first order of a point light in fog, |z|",
        worst,
        z_bound(2 * cases.len()),
    );
    suite.worst("the same, beams' relative standard error", error, 0.01);
    Ok(())
}

fn object(shape: Shape, material: Material, interior: Option<Optics>) -> Object {
    Object {
        name: "object".to_owned(),
        shape,
        transform: DAffine3::IDENTITY,
        material,
        interior,
    }
}

fn ball(radius: f64) -> Shape {
    Shape::Sphere {
        center: DVec3::ZERO,
        radius,
    }
}

fn cube(min: DVec3, max: DVec3) -> Shape {
    Shape::Box { min, max }
}

/// Furnaces with surfaces, and their names.
fn furnaces() -> Vec<(&'static str, Scene)> {
    let white = |extinction: f32| Optics {
        extinction: Rgb::splat(extinction),
        albedo: Rgb::ONE,
        phase: Phase::HenyeyGreenstein(0.3),
    };
    let glass = |ior, roughness| Material::Glass { ior, roughness };
    let diffuse = || Material::Diffuse {
        reflectance: Rgb::ONE,
        texture: None,
    };
    let start = || {
        let mut scene = furnace(4.0);
        scene.settings.max_bounces = 20_000;
        scene
    };
    let mut all = Vec::new();
    let mut nested = start();
    nested.objects = vec![
        object(ball(1.0), glass(1.5, 0.0), None),
        object(ball(0.7), glass(1.2, 0.0), Some(white(3.0))),
        object(ball(0.4), glass(2.0, 0.0), None),
    ];
    all.push(("glass in a medium in glass in glass", nested));
    // Half the picture's rays graze the ball within a hundredth of its radius.
    let mut grazing = start();
    grazing.objects = vec![object(ball(1.0), glass(1.5, 0.0), Some(white(1.0)))];
    grazing.camera.position = DVec3::new(1.0, 0.0, 4.0);
    grazing.camera.look_at = DVec3::new(1.0, 0.0, 0.0);
    grazing.camera.vertical_fov = 0.3;
    all.push(("rays that graze glass", grazing));
    let mut coplanar = start();
    coplanar.objects = vec![object(
        cube(DVec3::splat(-1.0), DVec3::ONE),
        diffuse(),
        None,
    )];
    coplanar.fogs.push(Fog {
        bounds: Some([DVec3::new(-1.0, 1.0, -1.0), DVec3::new(1.0, 1.5, 1.0)]),
        optics: white(2.0),
    });
    coplanar.fogs.push(Fog {
        bounds: Some([DVec3::new(-1.0, -1.0, 1.0), DVec3::new(1.0, 1.0, 1.5)]),
        optics: white(2.0),
    });
    all.push(("fogs whose faces are a wall's", coplanar));
    let mut touching = start();
    touching.objects = vec![
        object(
            cube(DVec3::splat(-1.0), DVec3::new(0.0, 1.0, 1.0)),
            Material::Interface,
            Some(white(2.0)),
        ),
        object(
            cube(DVec3::new(0.0, -1.0, -1.0), DVec3::ONE),
            Material::Interface,
            Some(white(0.5)),
        ),
    ];
    all.push(("two media that share a face", touching));
    let mut standing = start();
    standing.objects = vec![
        object(
            cube(DVec3::splat(-1.0), DVec3::new(1.0, 0.0, 1.0)),
            diffuse(),
            None,
        ),
        object(
            cube(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 1.0)),
            Material::Interface,
            Some(white(2.0)),
        ),
    ];
    all.push(("a medium that stands on a wall", standing));
    all
}

/// Paths through furnaces with surfaces.
fn invisible(suite: &mut Suite) -> Result<(), SelftestError> {
    let mut worst = Worst::default();
    let mut error = Worst::default();
    let mut cases = 0;
    // 32 passes of 4 paths, or more.
    let passes = suite.choose([32, 64, 1000]);
    for (name, mut scene) in furnaces() {
        scene.settings.method = Method::Path;
        scene.settings.spp = 4 * passes;
        let film = render(&scene, &[], None)?.film;
        let mean = film.image_mean();
        let e = mean.standard_error.map_or(f64::NAN, |e| e.x);
        let off = mean.mean.x - 1.0;
        let place = || format!("{name}: {} +- {e}", mean.mean.x);
        // Throughputs of f32 through hundreds of surfaces.
        let t = if off.abs() < 1e-5 {
            0.0
        } else {
            (off / e).abs()
        };
        let lost = film.nonfinite_pixels() > 0;
        worst.take(if lost { f64::NAN } else { t }, place);
        error.take(e, place);
        cases += 1;
    }
    let bound = t_bound(cases, f64::from(passes - 1));
    suite.worst("furnaces with surfaces by paths, |t|", worst, bound);
    suite.worst("the same, standard error", error, 0.01);
    Ok(())
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    single_scattering(suite)?;
    invisible(suite)
}
