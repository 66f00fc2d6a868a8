//! Looking a field up, in 16 and in 32 bits a value, side by side.
//!
//! ```text
//! cargo bench --bench lookup [-- FILE.vdb ...]      files with a grid of 16-bit floats
//! ```
//! `random`: points anywhere in bricks with storage; nothing but the size of the field decides
//! how many of their lookups miss the caches. `rays`: steps of half a voxel along rays across the
//! field, as ray marching takes them. `walk`: all cells on those rays, exactly. Each is done with
//! either storage in turn, round by round, so that other work on the machine hits both alike; the
//! best round counts.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::Vec3;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::walk::walk;
use vpm_vdb::grid::{Brick, Grid};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::Convert;
use vpm_vdb::vdb::Archive;

const ROUNDS: usize = 25;
const POINTS: usize = 1 << 18;
const RAYS: usize = 1 << 10;

fn files() -> Vec<PathBuf> {
    // cargo adds --bench.
    let given: Vec<PathBuf> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .map(PathBuf::from)
        .collect();
    if !given.is_empty() {
        return given;
    }
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes");
    ["cumulus.vdb", "rising_smoke.vdb"]
        .map(|name| own.join(name))
        .into_iter()
        .collect()
}

fn uniforms(random: &mut Rng) -> Vec3 {
    Vec3::new(random.uniform(), random.uniform(), random.uniform())
}

/// What is looked up.
struct Work {
    points: Vec<Vec3>,
    uniforms: Vec<Vec3>,
    /// Ends of rays across the field, t = 0 and 1.
    rays: Vec<Ray>,
    steps: Vec<Vec3>,
    majorants: MajorantGrid,
}

impl Work {
    fn new(grid: &Grid) -> Self {
        let mut random = Rng::stream(1, Stage::Check, 0, 0);
        let support = grid.support();
        let extent = support.max - support.min;
        let mut point = || support.min + extent * uniforms(&mut random);
        let stored = |p: &Vec3| {
            let brick = p.floor().as_ivec3() >> 3i32;
            matches!(grid.brick(brick), Brick::Values(_))
        };
        let points: Vec<Vec3> = std::iter::repeat_with(&mut point)
            .filter(stored)
            .take(POINTS)
            .collect();
        let rays: Vec<Ray> = (0..RAYS)
            .map(|_| {
                let origin = point();
                let direction = point() - origin;
                Ray { origin, direction }
            })
            .collect();
        let steps = rays
            .iter()
            .flat_map(|ray| {
                let count = (2.0 * ray.direction.length()) as usize;
                (0..count).map(move |i| ray.at((i as f32 + 0.5) / count as f32))
            })
            .collect();
        let mut random = Rng::stream(1, Stage::Check, 1, 0);
        Self {
            points,
            uniforms: (0..1024).map(|_| uniforms(&mut random)).collect(),
            rays,
            steps,
            majorants: MajorantGrid::new(grid, 1.0, 1.0),
        }
    }
}

/// A way of looking up: its name, and what does it; gives a sum and how many values it took.
type Way = (&'static str, fn(&Grid, &Work) -> (f32, u64));

fn lookups(grid: &Grid, points: &[Vec3]) -> (f32, u64) {
    let sum = points.iter().map(|p| grid.lookup(*p)).sum();
    (sum, points.len() as u64)
}

fn one_taps(grid: &Grid, points: &[Vec3], uniforms: &[Vec3]) -> (f32, u64) {
    let pairs = points.iter().zip(uniforms.iter().cycle());
    let sum = pairs.map(|(p, u)| grid.lookup_one_tap(*p, *u)).sum();
    (sum, points.len() as u64)
}

const WAYS: [Way; 5] = [
    ("random, trilinear", |g, w| lookups(g, &w.points)),
    ("random, one tap", |g, w| {
        one_taps(g, &w.points, &w.uniforms)
    }),
    ("rays, trilinear", |g, w| lookups(g, &w.steps)),
    ("rays, one tap", |g, w| one_taps(g, &w.steps, &w.uniforms)),
    ("walk, per lookup", |g, w| {
        let mut sum = 0.0;
        let mut count = 0;
        for ray in &w.rays {
            count += walk(g, &w.majorants, ray, 0.0, 1.0, |piece| {
                sum += piece.integral();
                true
            });
        }
        (sum, count)
    }),
];

fn main() {
    println!(
        "{:<26}{:<20}{:>12}{:>12}{:>8}",
        "M/s, best of rounds", "", "16 bits", "32 bits", "ratio"
    );
    for file in files() {
        let taking = Taking {
            convert: Convert::None,
            strict: false,
        };
        let archive = Archive::open(&file).expect("the file opens");
        let grid = load_grid(&archive, &file, None, taking)
            .expect("the file holds a density")
            .grid;
        let name = file
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default();
        if grid.value_bits() == 32 {
            println!("{name}: full floats, kept in 32 bits");
            continue;
        }
        let grids = [grid.widened(), grid].map(|g| (g.value_bits(), g));
        let [(_, wide), (_, narrow)] = &grids;
        let work = Work::new(narrow);
        let mb = |g: &Grid| g.memory_bytes() as f64 * 1e-6;
        println!(
            "{name:<26}{:<20}{:>12.1}{:>12.1}{:>8.2}",
            "megabytes",
            mb(narrow),
            mb(wide),
            mb(narrow) / mb(wide)
        );
        for (way, run) in WAYS {
            let mut best = [f64::INFINITY; 2];
            let mut sums = [0.0; 2];
            for _ in 0..ROUNDS {
                for (i, (_, grid)) in grids.iter().enumerate() {
                    let start = Instant::now();
                    let (sum, count) = std::hint::black_box(run(grid, &work));
                    best[i] = best[i].min(start.elapsed().as_secs_f64() / count as f64);
                    sums[i] = sum;
                }
            }
            assert_eq!(sums[0].to_bits(), sums[1].to_bits(), "{name}: {way}");
            let [wide, narrow] = best.map(|seconds| 1e-6 / seconds);
            println!(
                "{name:<26}{way:<20}{narrow:>12.1}{wide:>12.1}{:>8.2}",
                narrow / wide
            );
        }
    }
}
