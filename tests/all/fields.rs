//! Generated fields, real volumes and scenes that the physics tests share.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DVec3, IVec3, Vec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::medium::{Field, GridField, Medium};
use vpm_vdb::phase::PhaseFunction;
use vpm_vdb::progress::Silent;
use vpm_vdb::ray::Ray;
use vpm_vdb::render::{Exec, Rendered, render_loaded};
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::{Camera, Convert, Optics, Phase, Rgb, Scene, Settings, Volume};
use vpm_vdb::vdb::Archive;
use vpm_vdb::world::LoadedVolume;

use crate::vdb_files;

/// Random numbers of a test.
pub(crate) fn rng(seed: u64) -> Rng {
    Rng::stream(seed, Stage::Check, 0, 0)
}

/// Uniform in the unit cube.
pub(crate) fn unit(rng: &mut Rng) -> Vec3 {
    Vec3::new(rng.uniform(), rng.uniform(), rng.uniform())
}

/// Uniform over directions.
pub(crate) fn direction(rng: &mut Rng) -> Vec3 {
    let z = 2.0 * rng.uniform() - 1.0;
    let (s, c) = (std::f32::consts::TAU * rng.uniform()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * c, r * s, z)
}

/// A value of 0..1 for each voxel, without structure.
pub(crate) fn noise(v: IVec3, seed: u32) -> f32 {
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
pub(crate) fn patchy(v: IVec3) -> f32 {
    match noise((v + IVec3::splat(3)) >> 3i32, 7) {
        x if x < 0.25 => 0.0,
        x if x < 0.5 => 0.5,
        _ => noise(v, 1).powi(3),
    }
}

/// A field by its values over a box, unit voxels.
pub(crate) fn grid(min: IVec3, max: IVec3, f: impl Fn(IVec3) -> f32 + Sync) -> Grid {
    Grid::from_fn(min, max, DAffine3::IDENTITY, f).expect("a small grid can be built")
}

/// Fields with different faults to find, and their names.
pub(crate) fn generated() -> Vec<(&'static str, Grid)> {
    let cube = |n: i32| (IVec3::splat(-n), IVec3::splat(n));
    let make = |name, (a, b), f: &(dyn Fn(IVec3) -> f32 + Sync)| (name, grid(a, b, f));
    vec![
        make("patchy", cube(40), &patchy),
        make(
            "ramp",
            (IVec3::new(-20, 3, 5), IVec3::new(43, 66, 68)),
            &|v| (v.x + 21) as f32 / 64.0,
        ),
        make("blob", cube(32), &blob),
        make("checkerboard", cube(20), &|v| {
            ((v.x + v.y + v.z) & 1) as f32
        }),
        make("one cell", (IVec3::splat(7), IVec3::splat(8)), &|v| {
            0.1 + noise(v, 3)
        }),
        make("spikes", cube(60), &|v| {
            f32::from(u8::from(noise(v, 5) > 0.999)) * 100.0
        }),
        make(
            "constant",
            (IVec3::new(-3, -3, -3), IVec3::new(140, 140, 30)),
            &|_| 0.75,
        ),
    ]
}

/// A Gaussian blob of sigma 10 voxels.
pub(crate) fn blob(v: IVec3) -> f32 {
    (-v.as_vec3().length_squared() / 200.0).exp()
}

/// Puffs of noise on several scales inside a ball of 22 voxels: rough, with empty pockets.
pub(crate) fn smoke(v: IVec3) -> f32 {
    let edge = 1.0 - v.as_vec3().length() / 22.0;
    if edge <= 0.0 {
        return 0.0;
    }
    let coarse = noise(v >> 3i32, 11) + 0.6 * noise(v >> 2i32, 12) + 0.4 * noise(v >> 1i32, 13);
    (edge.sqrt() * 1.5 * (coarse - 0.5)).max(0.0)
}

/// The densities of the test volumes and of the repository's own, with their names.
pub(crate) fn real() -> Vec<(String, Grid)> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes");
    let folders = [vdb_files::folder("real"), own.is_dir().then_some(own)];
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let mut grids = Vec::new();
    for path in folders
        .iter()
        .flatten()
        .flat_map(|f| vdb_files::vdb_files(f))
    {
        let Ok(archive) = Archive::open(&path) else {
            continue;
        };
        for header in archive.grids() {
            let label = header.label();
            let Ok(loaded) = load_grid(&archive, &path, Some(&label), taking) else {
                continue;
            };
            let file = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            grids.push((format!("{} {label}", file.unwrap_or_default()), loaded.grid));
        }
    }
    grids
}

/// One density of the test volumes; none, with a word, where they are absent.
pub(crate) fn real_density(file: &str) -> Option<Grid> {
    let path: PathBuf = vdb_files::folder("real")?.join(file);
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let archive = Archive::open(&path).expect("a test volume can be opened");
    let loaded = load_grid(&archive, &path, None, taking).expect("its density can be read");
    Some(loaded.grid)
}

/// Trilinear interpolation in f64 of the grid's voxels at a local point.
pub(crate) fn trilinear(grid: &Grid, p: DVec3) -> f64 {
    let floor = p.floor();
    cell_value(&corners(grid, floor.as_ivec3()), p - floor)
}

/// The eight values of a cell, z fastest.
pub(crate) fn corners(grid: &Grid, cell: IVec3) -> [f64; 8] {
    std::array::from_fn(|i| {
        let c = IVec3::new((i >> 2) as i32, (i >> 1 & 1) as i32, (i & 1) as i32);
        f64::from(grid.voxel(cell + c))
    })
}

/// Trilinear at f in a cell of the eight values.
pub(crate) fn cell_value(values: &[f64; 8], f: DVec3) -> f64 {
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
pub(crate) fn medium<S: vpm_vdb::spectrum::Spectrum>(grid: &Grid, sigma_t: S) -> Medium<S> {
    let field = GridField::new(
        grid.clone(),
        &DAffine3::IDENTITY,
        DVec3::ZERO,
        sigma_t.max_channel(),
    );
    Medium {
        sigma_t,
        albedo: S::ONE,
        phase: PhaseFunction::Isotropic,
        field: Field::Grid(Box::new(field)),
        emission: None,
    }
}

/// A ray through a random point of a grid's support, from a random point around it. \[local\]
pub(crate) fn ray_through(grid: &Grid, rng: &mut Rng) -> Ray {
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
pub(crate) fn volume(extinction: Rgb, albedo: Rgb, phase: Phase) -> Volume {
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
pub(crate) fn scene(distance: f64, resolution: [u32; 2]) -> Scene {
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
pub(crate) fn render(scene: &Scene, grids: &[&Grid], threads: Option<usize>) -> Rendered {
    let volumes = grids
        .iter()
        .map(|g| LoadedVolume {
            density: (*g).clone(),
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
    render_loaded(scene, volumes, &exec).expect("the scene can be rendered")
}
