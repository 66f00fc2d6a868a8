//! Loading a volume, side by side with OpenVDB in one run.
//!
//! ```text
//! benches/make_volumes.py out          once
//! cargo bench --bench load [-- FOLDER]
//! ```
//! Ours: read the file, decode every leaf into bricks of 9 x 9 x 9 values, on one and on two
//! threads. OpenVDB: `read` of its Python module with delayed loading off, in a fresh process, so
//! that both take fresh memory from the system. Rounds alternate, so that other work on the machine
//! hits all alike; the best round counts. On a busy machine compare processor times.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use vpm_vdb::vdb::Archive;

const ROUNDS: usize = 9;
const OPENVDB: &str = "
import sys, time
import pyopenvdb as vdb
start, busy = time.perf_counter(), time.process_time()
grid = vdb.read(sys.argv[1], 'density')
print(time.perf_counter() - start, time.process_time() - busy, grid.activeVoxelCount(),
      '.'.join(map(str, vdb.LIBRARY_VERSION)))
";

/// What one load took.
#[derive(Clone, Copy)]
struct Time {
    seconds: f64,
    /// Processor time of the busiest of its threads, where the system tells it.
    busy: f64,
}

impl Time {
    const NONE: Self = Self {
        seconds: f64::INFINITY,
        busy: f64::INFINITY,
    };

    fn best(&mut self, other: Self) {
        self.seconds = self.seconds.min(other.seconds);
        self.busy = self.busy.min(other.busy);
    }
}

/// OpenVDB's time, active voxels and version, if it is installed.
fn load_openvdb(file: &Path) -> Option<(Time, u64, String)> {
    let output = Command::new("/usr/bin/python3")
        .args(["-c", OPENVDB])
        .arg(file)
        .env("OPENVDB_DISABLE_DELAYED_LOAD", "1")
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let mut words = text.split_whitespace();
    let seconds = words.next()?.parse().ok()?;
    let busy = words.next()?.parse().ok()?;
    Some((
        Time { seconds, busy },
        words.next()?.parse().ok()?,
        words.next()?.to_owned(),
    ))
}

/// Processor time of this thread. [s]
fn busy() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text
        .split_whitespace()
        .next()
        .and_then(|w| w.parse::<f64>().ok());
    nanoseconds.map_or(f64::INFINITY, |ns| 1e-9 * ns)
}

/// Our time on the threads of `pool`, active voxels and bytes of bricks.
fn load_ours(pool: &rayon::ThreadPool, file: &Path) -> (Time, u64, usize) {
    let before = pool.broadcast(|_| busy());
    let (seconds, voxels, bricks) = pool.install(|| load(file));
    let after = pool.broadcast(|_| busy());
    let busy = before
        .iter()
        .zip(&after)
        .map(|(b, a)| a - b)
        .fold(0.0, f64::max);
    (Time { seconds, busy }, voxels, bricks)
}

/// Seconds, active voxels and bytes of bricks.
fn load(file: &Path) -> (f64, u64, usize) {
    let start = Instant::now();
    let archive = Archive::open(file).expect("the file opens");
    let found = archive.find("density").expect("the grid is there");
    let grid = archive.read_scalar(found.index).expect("the grid loads");
    let mut bricks = vec![0.0f32; 729 * grid.leaf_origins.len()];
    grid.decode_leaves(&mut bricks, 729, |_, values, brick| {
        for (slab, brick) in values.chunks_exact(64).zip(brick.chunks_exact_mut(81)) {
            for (row, brick) in slab.chunks_exact(8).zip(brick.chunks_exact_mut(9)) {
                brick[..8].copy_from_slice(row);
            }
        }
    })
    .expect("the leaves decode");
    let seconds = start.elapsed().as_secs_f64();
    let voxels = grid
        .leaf_masks
        .iter()
        .flatten()
        .map(|w| u64::from(w.count_ones()))
        .sum();
    (seconds, voxels, 4 * bricks.len())
}

/// The most memory this process has held.
fn peak() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    peak.map_or("unknown".to_owned(), |p| p.trim().to_owned())
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads start")
}

fn main() {
    let folder = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    let folder = folder.map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("out"),
        PathBuf::from,
    );
    println!("best of {ROUNDS} rounds");
    let mut first_load = true;
    let (one, two) = (pool(1), pool(2));
    for name in ["zip.vdb", "blosc_half.vdb"] {
        let file = folder.join(name);
        if !file.is_file() {
            println!(
                "{name}: not in {}; benches/make_volumes.py writes it",
                folder.display()
            );
            continue;
        }
        let (mut first, mut second, mut theirs) = (Time::NONE, Time::NONE, Time::NONE);
        let (mut voxels, mut version) = (0, None);
        for _ in 0..ROUNDS {
            let (time, ours, size) = load_ours(&one, &file);
            if std::mem::take(&mut first_load) {
                let whole = std::fs::metadata(&file).map_or(0, |m| m.len() as usize) + size;
                println!(
                    "peak of memory {}; file and bricks are {} kB",
                    peak(),
                    whole / 1024
                );
            }
            first.best(time);
            second.best(load_ours(&two, &file).0);
            if let Some((time, count, name)) = load_openvdb(&file) {
                assert_eq!(count, ours, "both read the same");
                theirs.best(time);
                version = Some(name);
            }
            voxels = ours;
        }
        println!("\n{name}: {voxels} active voxels");
        let rate = |s: f64| {
            format!(
                "{:7.1} ms {:6.1} Mvoxel/s",
                1e3 * s,
                voxels as f64 / s / 1e6
            )
        };
        if let Some(version) = version {
            println!("  OpenVDB {version:<9}{}", rate(theirs.seconds));
            println!("    processor time {}", rate(theirs.busy));
        } else {
            println!("  OpenVDB's Python module is not installed");
        }
        let gain = theirs.seconds / first.seconds;
        println!(
            "  ours, 1 thread   {}  {gain:.2} x as fast",
            rate(first.seconds)
        );
        let gain = theirs.busy / first.busy;
        println!(
            "    processor time {}  {gain:.2} x as fast",
            rate(first.busy)
        );
        let gain = theirs.seconds / second.seconds;
        println!(
            "  ours, 2 threads  {}  {gain:.2} x as fast",
            rate(second.seconds)
        );
        let gain = theirs.busy / second.busy;
        println!(
            "    busier thread  {}  {gain:.2} x as fast",
            rate(second.busy)
        );
    }
}
