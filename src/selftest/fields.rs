//! Fields, media, rays and scenes of the checks: made in memory, no file is read.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DVec3, IVec3, Vec3};

use super::SelftestError;
use crate::grid::Grid;
use crate::grid::build::BuildError;
use crate::medium::{Field, GridField, Medium};
use crate::phase::PhaseFunction;
use crate::progress::Silent;
use crate::ray::Ray;
use crate::render::{Exec, Rendered, render_loaded};
use crate::rng::{Rng, Stage};
use crate::scene::{Camera, Convert, Optics, Phase, Rgb, Scene, Settings, Volume};
use crate::spectrum::Spectrum;
use crate::world::LoadedVolume;

/// Random numbers of a check.
#[must_use]
pub fn rng(seed: u64) -> Rng {
    Rng::stream(seed, Stage::Check, 0, 0)
}

/// Uniform in the unit cube.
pub fn unit(rng: &mut Rng) -> Vec3 {
    Vec3::new(rng.uniform(), rng.uniform(), rng.uniform())
}

/// Uniform over directions.
pub fn direction(rng: &mut Rng) -> Vec3 {
    let z = 2.0 * rng.uniform() - 1.0;
    let (s, c) = (std::f32::consts::TAU * rng.uniform()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * c, r * s, z)
}

/// A value of 0..1 for each voxel, without structure.
#[must_use]
pub fn noise(v: IVec3, seed: u32) -> f32 {
    let mut h = seed ^ 0x9e37_79b9;
    for c in [v.x, v.y, v.z] {
        h = (h ^ c as u32).wrapping_mul(0x85eb_ca6b);
        h ^= h >> 13;
        h = h.wrapping_mul(0xc2b2_ae35);
        h ^= h >> 16;
    }
    (h >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// Noise with holes: a quarter of the blocks of 8^3 empty, a quarter constant.
#[must_use]
pub fn patchy(v: IVec3) -> f32 {
    match noise((v + IVec3::splat(3)) >> 3i32, 7) {
        x if x < 0.25 => 0.0,
        x if x < 0.5 => 0.5,
        _ => noise(v, 1).powi(3),
    }
}

/// A field by its values over a box, unit voxels.
///
/// # Errors
/// [`BuildError`]: a box too wide.
pub fn grid(min: IVec3, max: IVec3, f: impl Fn(IVec3) -> f32 + Sync) -> Result<Grid, BuildError> {
    Grid::from_fn(min, max, DAffine3::IDENTITY, f)
}

/// Fields with different faults to find, and their names.
///
/// # Errors
/// None in practice: the boxes are small.
pub fn generated() -> Result<Vec<(&'static str, Grid)>, BuildError> {
    let cube = |n: i32| [IVec3::splat(-n), IVec3::splat(n)];
    let make = |name, [a, b]: [IVec3; 2], f: &(dyn Fn(IVec3) -> f32 + Sync)| {
        grid(a, b, f).map(|grid| (name, grid))
    };
    [
        make("patchy", cube(40), &patchy),
        make(
            "ramp",
            [IVec3::new(-20, 3, 5), IVec3::new(43, 66, 68)],
            &|v| (v.x + 21) as f32 / 64.0,
        ),
        make("blob", cube(32), &blob),
        make("checkerboard", cube(20), &|v| {
            ((v.x + v.y + v.z) & 1) as f32
        }),
        make("one cell", [IVec3::splat(7), IVec3::splat(8)], &|v| {
            0.1 + noise(v, 3)
        }),
        make("spikes", cube(60), &|v| {
            f32::from(u8::from(noise(v, 5) > 0.999)) * 100.0
        }),
        make(
            "constant",
            [IVec3::new(-3, -3, -3), IVec3::new(140, 140, 30)],
            &|_| 0.75,
        ),
    ]
    .into_iter()
    .collect()
}

/// A Gaussian blob of sigma 10 voxels.
#[must_use]
pub fn blob(v: IVec3) -> f32 {
    (-v.as_vec3().length_squared() / 200.0).exp()
}

/// Puffs of noise on several scales inside a ball of 22 voxels: rough, with empty pockets.
#[must_use]
pub fn smoke(v: IVec3) -> f32 {
    let edge = 1.0 - v.as_vec3().length() / 22.0;
    if edge <= 0.0 {
        return 0.0;
    }
    let coarse = noise(v >> 3i32, 11) + 0.6 * noise(v >> 2i32, 12) + 0.4 * noise(v >> 1i32, 13);
    (edge.sqrt() * 1.5 * (coarse - 0.5)).max(0.0)
}

/// Trilinear interpolation in f64 of the grid's voxels at a local point.
#[must_use]
pub fn trilinear(grid: &Grid, p: DVec3) -> f64 {
    let floor = p.floor();
    cell_value(&corners(grid, floor.as_ivec3()), p - floor)
}

/// The eight values of a cell, z fastest.
#[must_use]
pub fn corners(grid: &Grid, cell: IVec3) -> [f64; 8] {
    std::array::from_fn(|i| {
        let c = IVec3::new((i >> 2) as i32, (i >> 1 & 1) as i32, (i & 1) as i32);
        f64::from(grid.voxel(cell + c))
    })
}

/// Trilinear at f in a cell of the eight values.
#[must_use]
pub fn cell_value(values: &[f64; 8], f: DVec3) -> f64 {
    values
        .iter()
        .enumerate()
        .map(|(i, v)| {
            let w = |bit: usize, f: f64| if i >> bit & 1 == 1 { f } else { 1.0 - f };
            v * w(2, f.x) * w(1, f.y) * w(0, f.z)
        })
        .sum()
}

/// A medium of a grid with unit voxels at its own place.
#[must_use]
pub fn medium<S: Spectrum>(grid: &Grid, sigma_t: S) -> Medium<S> {
    medium_at(grid, &DAffine3::IDENTITY, sigma_t)
}

/// The same, moved, turned and stretched.
#[must_use]
pub fn medium_at<S: Spectrum>(grid: &Grid, after: &DAffine3, sigma_t: S) -> Medium<S> {
    let (field, sigma_t) = GridField::in_units(grid.clone(), after, DVec3::ZERO, sigma_t);
    Medium {
        sigma_t,
        albedo: S::ONE,
        phase: PhaseFunction::Isotropic,
        field: Field::Grid(Box::new(field)),
        emission: None,
    }
}

/// A ray through a random point of a grid's support, from a random point around it. \[local\]
pub fn ray_through(grid: &Grid, rng: &mut Rng) -> Ray {
    let support = grid.support();
    let target = support.min + support.size() * unit(rng);
    let away = support.radius() * (0.1 + 2.0 * rng.uniform());
    let direction = direction(rng);
    Ray {
        origin: target - direction * away,
        direction,
    }
}

/// A volume entry for a grid that is handed over loaded.
#[must_use]
pub fn volume(extinction: Rgb, albedo: Rgb, phase: Phase) -> Volume {
    Volume {
        file: PathBuf::new(),
        density: None,
        optics: Optics {
            extinction,
            albedo,
            phase,
        },
        emission: None,
        transform: DAffine3::IDENTITY,
        convert: Convert::None,
        strict: false,
    }
}

/// A scene without media or lights, seen from `distance` metres along +z.
#[must_use]
pub fn scene(distance: f64, resolution: [u32; 2]) -> Scene {
    Scene {
        name: "test".to_owned(),
        camera: Camera {
            position: DVec3::new(0.0, 0.0, distance),
            look_at: DVec3::ZERO,
            up: DVec3::Y,
            vertical_fov: 40.0,
            resolution,
            lens: None,
        },
        settings: Settings::default(),
        volumes: Vec::new(),
        fogs: Vec::new(),
        lights: Vec::new(),
        objects: Vec::new(),
    }
}

/// Renders a scene whose volumes are `grids`, in order.
///
/// # Errors
/// [`SelftestError`]: what the renderer refuses.
pub fn render(
    scene: &Scene,
    grids: &[&Grid],
    threads: Option<usize>,
) -> Result<Rendered, SelftestError> {
    let volumes = grids
        .iter()
        .map(|g| LoadedVolume {
            density: (*g).clone().into(),
            temperature: None,
        })
        .collect();
    let stop = AtomicBool::new(false);
    let exec = Exec {
        threads,
        progress: &Silent,
        time_limit: None,
        warn: &|_| {},
        stop: &stop,
    };
    Ok(render_loaded(scene, volumes, &exec)?)
}
