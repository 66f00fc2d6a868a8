//! Scale and place: the picture does not change with the unit of length, nor with where it is.
//!
//! ```text
//! lengths by s, extinction by 1 / s, irradiance as it is       the same picture
//! grid, camera and sun moved, turned, mirrored alike            the same picture
//! ```
//!
//! Rays first: the optical depth through a grid under an affine transform, against f64 all the
//! way from the world's coordinates (`exact`). Then pictures, with the same seed: first-order
//! light is a smooth function of the camera ray, so that pictures differ by rounding alone. Of all
//! orders, single decisions of a path fall differently by rounding, and paths from there on: the
//! differences of means over some seeds have mean 0, by Student's t.

use glam::{DAffine3, DMat3, DQuat, DVec3, IVec3};

use super::exact::Depth;
use super::fields::{blob, direction, grid, render, rng, scene, smoke, unit, volume};
use super::{SelftestError, Suite, Worst};
use crate::film::Film;
use crate::grid::Grid;
use crate::grid::build::BuildError;
use crate::march::Profile;
use crate::medium::{Field, GridField, Medium};
use crate::phase::PhaseFunction;
use crate::ray::Ray;
use crate::scene::{Direct, Light, March, Method, Phase, Rgb, Scene};
use crate::stats::{Welford, t_bound};
use crate::tracking::Counters;

/// Transforms of index space to the world, and their names.
fn transforms() -> Vec<(String, DAffine3)> {
    let mut all = Vec::new();
    for exponent in [-6, -3, 0, 3, 6] {
        let s = 10f64.powi(exponent);
        all.push((
            format!("voxels of 1e{exponent} m"),
            DAffine3::from_scale(DVec3::splat(s)),
        ));
        all.push((
            format!("voxels of 1e{exponent} m, 1e7 of them away"),
            DAffine3::from_scale_rotation_translation(
                DVec3::splat(s),
                DQuat::IDENTITY,
                DVec3::new(1e7, -1e7, 1e7) * s,
            ),
        ));
    }
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 1.1);
    all.push(("turned".to_owned(), DAffine3::from_quat(turn)));
    all.push((
        "mirrored".to_owned(),
        DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
    ));
    let shear = DMat3::from_cols(
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.7, 1.0, 0.0),
        DVec3::new(-0.4, 0.3, 0.5),
    );
    all.push(("sheared".to_owned(), DAffine3::from_mat3(shear)));
    all.push((
        "sheared, turned, mirrored and far away".to_owned(),
        DAffine3::from_translation(DVec3::splat(3e6))
            * DAffine3::from_quat(turn)
            * DAffine3::from_scale(DVec3::new(2.0, -2.0, 2.0))
            * DAffine3::from_mat3(shear),
    ));
    all
}

/// Worst relative error of the optical depth of rays through a grid under a transform.
fn depth_error(name: &str, grid: &Grid, transform: &DAffine3, rays: u32) -> Worst {
    let placed = *transform * grid.local_to_world();
    let support = grid.support();
    let middle = placed.transform_point3(support.center().as_dvec3());
    let size = transform.matrix3.determinant().abs().cbrt();
    // As the world does: relative to a point in the middle.
    let field = GridField::new(grid.clone(), transform, middle, 1.0);
    let exact_map = (DAffine3::from_translation(-middle) * placed).inverse();
    let media = [Medium {
        // A depth of some 0.1: nothing is spent.
        sigma_t: (0.01 / size) as f32,
        albedo: 1.0f32,
        phase: PhaseFunction::Isotropic,
        field: Field::Grid(Box::new(field)),
        emission: None,
    }];
    let mut random = rng(70);
    let mut profile = Profile::default();
    let mut worst = Worst::default();
    let radius = f64::from(support.radius()) * size;
    for _ in 0..rays {
        // Through the middle half, where the field is not small.
        let target = (unit(&mut random) - 0.5).as_dvec3() * radius;
        let d = direction(&mut random);
        let away = radius * (1.0 + 2.0 * random.uniform_f64());
        let ray = Ray {
            origin: (target - d.as_dvec3() * away).as_vec3(),
            direction: d,
        };
        let exact = Depth::of(
            grid,
            exact_map.transform_point3(ray.origin.as_dvec3()),
            exact_map.transform_vector3(d.as_dvec3()),
            f64::INFINITY,
        );
        let nothing = &mut Counters::default();
        profile.march((0, &media), &ray, f32::INFINITY, March::Exact, nothing);
        let found = f64::from(profile.optical_depth(profile.t_end));
        let tau = f64::from(media[0].sigma_t) * exact.total();
        // A mean free path of a hundredth at least.
        if exact.total() > size {
            worst.take((found / tau - 1.0).abs(), || format!("{name}: {ray:?}"));
        }
    }
    worst
}

/// Smoke on a lattice, seen from 75 voxels away under a sun.
fn picture(resolution: u32) -> Scene {
    let mut scene = scene(75.0, [resolution; 2]);
    let forward = Phase::HenyeyGreenstein(0.5);
    scene
        .volumes
        .push(volume(Rgb::splat(0.3), Rgb::splat(0.9), forward));
    scene.lights.push(Light::Sun {
        direction: DVec3::new(0.3, -1.0, -0.2).normalize(),
        irradiance: Rgb::splat(3.0),
        angular_diameter: 2.0,
    });
    scene
}

/// The lattice of a field: index to world, and which voxel of the field stands where.
struct Lattice {
    name: &'static str,
    to_world: DAffine3,
    voxel: fn(IVec3) -> IVec3,
}

/// Other lattices with the same field in the world.
fn lattices() -> [Lattice; 3] {
    let columns = |x, y, z| DAffine3::from_mat3(DMat3::from_cols(x, y, z));
    [
        Lattice {
            name: "mirrored lattice",
            to_world: columns(DVec3::NEG_X, DVec3::Y, DVec3::Z),
            voxel: |v| IVec3::new(-v.x, v.y, v.z),
        },
        Lattice {
            name: "lattice with its axes exchanged",
            to_world: columns(DVec3::Y, DVec3::Z, DVec3::X),
            voxel: |v| IVec3::new(v.z, v.x, v.y),
        },
        Lattice {
            name: "lattice turned by a right angle",
            to_world: columns(DVec3::Z, DVec3::Y, DVec3::NEG_X),
            voxel: |v| IVec3::new(-v.z, v.y, v.x),
        },
    ]
}

/// A scene and its grid, in another place or unit.
struct Variant {
    name: String,
    scene: Scene,
    grid: Grid,
}

/// The scene with all its lengths times `s`, then turned and moved.
fn moved(scene: &Scene, s: f64, turn: DQuat, by: DVec3) -> Scene {
    let place = |p: DVec3| turn * (p * s) + by;
    let mut moved = scene.clone();
    moved.camera.position = place(scene.camera.position);
    moved.camera.look_at = place(scene.camera.look_at);
    moved.camera.up = turn * scene.camera.up;
    for volume in &mut moved.volumes {
        volume.optics.extinction /= s as f32;
        volume.transform =
            DAffine3::from_scale_rotation_translation(DVec3::splat(s), turn, by) * volume.transform;
    }
    for light in &mut moved.lights {
        if let Light::Sun { direction, .. } = light {
            *direction = turn * *direction;
        }
    }
    moved
}

fn variants(base: &Scene, grid: &Grid) -> Result<Vec<Variant>, BuildError> {
    let mut all = Vec::new();
    let mut add = |name: String, scene: Scene, grid: &Grid| {
        all.push(Variant {
            name,
            scene,
            grid: grid.clone(),
        });
    };
    for exponent in [-6, -3, 3, 6] {
        let s = 10f64.powi(exponent);
        let scene = moved(base, s, DQuat::IDENTITY, DVec3::ZERO);
        add(format!("voxels of 1e{exponent} m"), scene, grid);
        let far = DVec3::new(1e7, 1e7, -1e7) * s;
        let scene = moved(base, s, DQuat::IDENTITY, far);
        add(
            format!("voxels of 1e{exponent} m, 1e7 of them away"),
            scene,
            grid,
        );
    }
    let scene = moved(base, 1.0, DQuat::IDENTITY, DVec3::splat(1e7));
    add("1e7 voxels away".to_owned(), scene, grid);
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 1.1);
    add(
        "turned".to_owned(),
        moved(base, 1.0, turn, DVec3::ZERO),
        grid,
    );
    for lattice in lattices() {
        let edge = IVec3::splat(24);
        let grid = Grid::from_fn(-edge, edge, lattice.to_world, |v| smoke((lattice.voxel)(v)))?;
        add(lattice.name.to_owned(), base.clone(), &grid);
    }
    Ok(all)
}

/// Root mean square of the difference of two pictures, over the mean of the first.
fn difference(a: &Film, b: &Film) -> f64 {
    let [width, height] = a.resolution();
    let (mut sum, mut squares) = (0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let (p, q) = (a.means(x, y), b.means(x, y));
            sum += p.direct.x + p.alpha;
            squares += (p.direct.x - q.direct.x).powi(2) + (p.alpha - q.alpha).powi(2);
        }
    }
    let n = f64::from(width * height);
    (squares / n).sqrt() / (sum / n)
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let smooth = grid(IVec3::splat(-32), IVec3::splat(32), blob)?;
    let rays = suite.choose([1000, 5000, 100_000]);
    let mut worst = Worst::default();
    for (name, transform) in transforms() {
        worst = worst.or(depth_error(&name, &smooth, &transform, rays));
    }
    suite.worst(
        "optical depth under any transform, relative error",
        worst,
        DEPTH,
    );

    let smoke = grid(IVec3::splat(-24), IVec3::splat(24), smoke)?;
    let mut single = picture(24);
    single.settings.max_bounces = 1;
    single.settings.passes = 1;
    single.settings.direct = Direct::Sampled;
    let first = render(&single, &[&smoke], None)?.film;
    let mut worst = Worst::default();
    for v in variants(&single, &smoke)? {
        let film = render(&v.scene, &[&v.grid], None)?.film;
        worst.take(difference(&first, &film), || v.name);
    }
    suite.worst(
        "first order in another place, rms difference",
        worst,
        SINGLE,
    );

    let seeds = suite.choose([12, 16, 64]);
    for method in [Method::Path, Method::Beam] {
        let mut many = picture(16);
        many.settings.method = method;
        many.settings.passes = 1;
        many.settings.spp = if method == Method::Path { 4 } else { 1 };
        many.settings.photons = suite.choose([3000, 12_000, 100_000]);
        let mean = |scene: &Scene, grid: &Grid, seed: u64| -> Result<f64, SelftestError> {
            let mut scene = scene.clone();
            scene.settings.seed = seed;
            Ok(render(&scene, &[grid], None)?.film.image_mean().mean.x)
        };
        let base: Vec<f64> = (0..seeds)
            .map(|seed| mean(&many, &smoke, seed))
            .collect::<Result<_, _>>()?;
        let variants = variants(&many, &smoke)?;
        let n = variants.len();
        let mut worst = Worst::default();
        for v in variants {
            let mut off = Welford::default();
            for (seed, base) in (0..).zip(&base) {
                off.add(mean(&v.scene, &v.grid, seed)? / base - 1.0);
            }
            worst.take(off.z(0.0, 1e-5).abs(), || {
                format!("{}: {} +- {}", v.name, off.mean(), off.standard_error())
            });
        }
        let what = method.name();
        let bound = t_bound(2 * n, (seeds - 1) as f64);
        suite.worst(
            format!("all orders in another place, {what}, |t|"),
            worst,
            bound,
        );
    }
    Ok(())
}

/// Relative error of an optical depth: rounding of the values and of the knots.
const DEPTH: f64 = 1e-6;

/// Difference of pictures of first-order light: rounding, and few samples of the sun that fall on
/// the other side of a voxel's face.
const SINGLE: f64 = 2e-4;
