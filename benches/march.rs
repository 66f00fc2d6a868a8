//! The exact march: how exact, and at what price.
//!
//! ```text
//! cargo bench --bench march [-- FILE.vdb ...]
//! ```
//! Rays through random places of each volume. `error` is the largest relative error of the
//! integral of the density over all rays, against one in f64 by another rule (Gauss's, between
//! sorted faces). `cells` are the voxel cells with a density that a ray crosses; `price` is the
//! time of the march over that of one look-up in the middle of each. `profile` is the march with
//! its knots kept, as camera rays need it. On one thread, in turn, a few rounds at a time; the best
//! round counts.

#[path = "volumes/media.rs"]
mod media;
mod volumes;

use glam::Vec3;
use std::hint::black_box;
use std::sync::Arc;

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::walk::{integral, walk};
use vpm_vdb::march::Profile;
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::March;
use vpm_vdb::selftest::exact::Depth;
use vpm_vdb::selftest::fields::ray_through;
use vpm_vdb::tracking::Counters;

use media::{MERGINGS, extinction, medium};
use volumes::{files, load, timed};

const RAYS: usize = 2000;
/// Turns of each, and rounds of a turn: the first finds caches full of what others looked up.
const TURNS: usize = 5;
const ROUNDS: usize = 5;

/// Integral of the density along a ray.
fn whole(grid: &Grid, majorants: &MajorantGrid, ray: &Ray) -> f64 {
    let all = [0.0, f32::INFINITY];
    integral(grid, majorants, &ray.into(), all, f64::INFINITY).0
}

/// Keeps the seconds of the fastest round.
fn fastest(best: &mut f64, mut run: impl FnMut()) {
    for _ in 0..ROUNDS {
        *best = best.min(timed(&mut run).0);
    }
}

fn main() {
    println!(
        "{:<24}{:>12}{:>14}{:>12}{:>12}{:>8}{:>10}",
        "", "cells a ray", "error", "ns a cell", "ns look-up", "price", "profile"
    );
    for file in files() {
        let (name, grid) = load(&file);
        let grid = Arc::new(grid);
        let sigma_t = extinction(&grid);
        let majorants = MajorantGrid::new(&grid, sigma_t, 1.0);
        let mut random = Rng::stream(1, Stage::Check, 0, 0);
        let rays: Vec<Ray> = (0..RAYS).map(|_| ray_through(&grid, &mut random)).collect();
        let mut middles: Vec<Vec3> = Vec::new();
        let mut error = 0.0f64;
        for ray in &rays {
            walk(
                &grid,
                &majorants,
                &ray.into(),
                0.0,
                f32::INFINITY,
                |piece| {
                    middles.push(ray.at(0.5 * (piece.t_min + piece.t_max)));
                    true
                },
            );
            let depth = whole(&grid, &majorants, ray);
            let exact = Depth::new(&grid, ray, f64::INFINITY).total();
            if exact > 0.0 {
                error = error.max((depth / exact - 1.0).abs());
            }
        }
        // Nothing is spent: a profile of all cells.
        let thin = medium(&grid, 1e-9 * sigma_t, MERGINGS[0].1);
        let mut profile = Profile::default();
        let mut best = [f64::INFINITY; 3];
        for _ in 0..TURNS {
            let [marching, looking, profiling] = &mut best;
            fastest(marching, || {
                let depths = rays.iter().map(|ray| whole(&grid, &majorants, ray));
                black_box(depths.sum::<f64>());
            });
            fastest(looking, || {
                black_box(middles.iter().map(|p| grid.lookup(*p)).sum::<f32>());
            });
            fastest(profiling, || {
                for ray in &rays {
                    let media = (0, std::slice::from_ref(&thin));
                    let mut counters = Counters::default();
                    profile.march(media, ray, f32::INFINITY, March::Exact, &mut counters);
                }
            });
        }
        let cells = middles.len() as f64;
        println!(
            "{name:<24}{:>12.1}{error:>14.2e}{:>12.2}{:>12.2}{:>8.2}{:>10.2}",
            cells / RAYS as f64,
            1e9 * best[0] / cells,
            1e9 * best[1] / cells,
            best[0] / best[1],
            best[2] / best[1]
        );
    }
}
