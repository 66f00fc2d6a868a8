//! Looking a field up: in 16 and in 32 bits a value, and through OpenVDB and NanoVDB.
//!
//! ```text
//! cargo bench --bench lookup [-- FILE.vdb ...]
//! ```
//! `random`: points anywhere in bricks with storage; nothing but the size of the field decides
//! how many of their lookups miss the caches. `rays`: steps of half a voxel along rays across the
//! field, through a cursor, as ray marching takes them (the peers' accessors keep their leaf too), or with
//! `no cursor`. `walk`: all cells on those rays, exactly. `two levels`: through an index of two levels where
//! ours is flat. `no apron`: voxels one by one where a cell reaches into the next brick, as in a grid of
//! bricks without aprons.
//!
//! All are done in turn, a few rounds at a time, on one thread, so that other work on the machine and what is
//! left in the caches hit each alike; the best round counts. The peers' side (`peers/lookup.cpp`) is built
//! if a C++ compiler finds OpenVDB (Debian's libopenvdb-dev and libnanovdb-dev); it gets the same points and
//! the same grid, as many rounds at a time, and its sums must be ours.

mod peers;
mod volumes;

use std::path::Path;

use glam::{IVec3, Vec3};
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::walk::walk;
use vpm_vdb::grid::{Brick, Grid};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};

use peers::{Answer, Peers};
use volumes::{files, load, timed};

/// Turns of each way, and rounds of a turn: the first finds caches full of what others looked up.
const TURNS: usize = 5;
const ROUNDS: usize = 5;
const POINTS: usize = 1 << 18;
const RAYS: usize = 1 << 10;
const RANDOM: &str = "random, trilinear";
const ALONG: &str = "rays, trilinear";

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

/// A field, as it is kept and with two levels of index.
struct Field {
    grid: Grid,
    levels: Grid,
}

impl Field {
    fn new(grid: Grid) -> Self {
        let levels = grid.in_two_levels();
        Self { grid, levels }
    }
}

/// A way of looking up: its name, and what does it; gives a sum and how many values it took.
type Way = (&'static str, fn(&Field, &Work) -> (f64, u64));

fn lookups(grid: &Grid, points: &[Vec3]) -> (f64, u64) {
    let sum: f64 = points.iter().map(|p| f64::from(grid.lookup(*p))).sum();
    (sum, points.len() as u64)
}

fn steps(grid: &Grid, points: &[Vec3]) -> (f64, u64) {
    let mut cursor = grid.cursor();
    let sum: f64 = points.iter().map(|p| f64::from(cursor.lookup(*p))).sum();
    (sum, points.len() as u64)
}

/// As a grid without aprons is looked up: where a cell reaches into the next brick, by voxels.
fn without_apron(grid: &Grid, p: Vec3) -> f32 {
    let cell = p.floor().as_ivec3();
    if (cell & 7i32).max_element() < 7 {
        return grid.lookup(p);
    }
    let f = p - p.floor();
    let at = |x, y, z| grid.voxel(cell + IVec3::new(x, y, z));
    let mix = |a: f32, b: f32, u: f32| (b - a).mul_add(u, a);
    let along_z = |x, y| mix(at(x, y, 0), at(x, y, 1), f.z);
    let along_y = |x| mix(along_z(x, 0), along_z(x, 1), f.y);
    mix(along_y(0), along_y(1), f.x)
}

fn neighbours(grid: &Grid, points: &[Vec3]) -> (f64, u64) {
    let sum: f64 = points
        .iter()
        .map(|p| f64::from(without_apron(grid, *p)))
        .sum();
    (sum, points.len() as u64)
}

fn one_taps(grid: &Grid, points: &[Vec3], uniforms: &[Vec3]) -> (f64, u64) {
    let pairs = points.iter().zip(uniforms.iter().cycle());
    let sum = pairs
        .map(|(p, u)| f64::from(grid.lookup_one_tap(*p, *u)))
        .sum();
    (sum, points.len() as u64)
}

const WAYS: [Way; 8] = [
    (RANDOM, |f, w| lookups(&f.grid, &w.points)),
    ("random, two levels", |f, w| lookups(&f.levels, &w.points)),
    ("random, no apron", |f, w| neighbours(&f.grid, &w.points)),
    ("random, one tap", |f, w| {
        one_taps(&f.grid, &w.points, &w.uniforms)
    }),
    (ALONG, |f, w| steps(&f.grid, &w.steps)),
    ("rays, no cursor", |f, w| lookups(&f.grid, &w.steps)),
    ("rays, one tap", |f, w| {
        one_taps(&f.grid, &w.steps, &w.uniforms)
    }),
    ("walk, per lookup", |f, w| {
        let mut sum = 0.0;
        let mut count = 0;
        for ray in &w.rays {
            count += walk(&f.grid, &w.majorants, &ray.into(), 0.0, 1.0, |piece| {
                sum += piece.integral;
                true
            });
        }
        (sum, count)
    }),
];

/// Best seconds for one lookup, and the sum of all.
#[derive(Clone, Copy)]
struct Best {
    seconds: f64,
    sum: f64,
}

impl Best {
    const NONE: Self = Self {
        seconds: f64::INFINITY,
        sum: 0.0,
    };

    fn take(&mut self, seconds: f64, sum: f64) {
        *self = Self {
            seconds: self.seconds.min(seconds),
            sum,
        };
    }
}

fn main() {
    let peers = Peers::build();
    println!(
        "{:<22}{:<20}{:>9}{:>9}{:>9}{:>9}{:>12}{:>12}",
        "M/s, best of rounds",
        "",
        "16 bits",
        "32 bits",
        "OpenVDB",
        "NanoVDB",
        "/ OpenVDB",
        "/ NanoVDB"
    );
    for file in files() {
        bench(&file, peers.as_ref());
    }
}

/// All ways on one file.
fn bench(file: &Path, peers: Option<&Peers>) {
    let (name, grid) = load(file);
    let wide = grid.widened();
    let work = Work::new(&wide);
    let narrow = (grid.value_bits() == 16).then(|| Field::new(grid));
    let wide = Field::new(wide);
    let own = [narrow.as_ref(), Some(&wide)];
    let megabytes = own.map(|f| {
        f.map_or_else(
            || "-".to_owned(),
            |f| format!("{:.1}", f.grid.memory_bytes() as f64 * 1e-6),
        )
    });
    println!(
        "{name:<22}{:<20}{:>9}{:>9}",
        "megabytes", megabytes[0], megabytes[1]
    );
    let mut best = [[Best::NONE; 2]; WAYS.len()];
    let mut others = [[Best::NONE; 2]; 2];
    let sets = [&work.points, &work.steps];
    for _ in 0..TURNS {
        for ((_, run), best) in WAYS.iter().zip(&mut best) {
            for (field, best) in own.iter().zip(best) {
                let Some(field) = field else { continue };
                for _ in 0..ROUNDS {
                    let (seconds, (sum, count)) = timed(|| run(field, &work));
                    best.take(seconds / count as f64, sum);
                }
            }
        }
        if let Some(peers) = peers {
            for Answer {
                points,
                library,
                seconds,
                sum,
            } in peers.lookups(file, &wide.grid, &sets, ROUNDS)
            {
                let each = seconds / sets[points].len() as f64;
                others[points][library].take(each, sum);
            }
        }
    }
    for ((way, _), best) in WAYS.iter().zip(&best) {
        if narrow.is_some() {
            assert_eq!(best[0].sum, best[1].sum, "{name}: {way}");
        }
        let others = match *way {
            RANDOM => others[0],
            ALONG => others[1],
            _ => [Best::NONE; 2],
        };
        let rate = |b: &Best| {
            if b.seconds.is_finite() {
                format!("{:.1}", 1e-6 / b.seconds)
            } else {
                "-".to_owned()
            }
        };
        let ours = best[0].seconds.min(best[1].seconds);
        let ratio = |b: &Best| {
            if b.seconds.is_finite() {
                let off = (b.sum / best[1].sum - 1.0).abs();
                assert!(off < 1e-4, "{name}: {way}: sums differ by {off:e}");
                format!("{:.2}", b.seconds / ours)
            } else {
                "-".to_owned()
            }
        };
        println!(
            "{name:<22}{way:<20}{:>9}{:>9}{:>9}{:>9}{:>12}{:>12}",
            rate(&best[0]),
            rate(&best[1]),
            rate(&others[0]),
            rate(&others[1]),
            ratio(&others[0]),
            ratio(&others[1])
        );
    }
}
