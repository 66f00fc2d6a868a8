//! Free flights, by the cells of the bounds that delta tracking steps through, and by how it looks
//! the field up.
//!
//! ```text
//! cargo bench --bench free_flight [-- FILE.vdb ...]
//! ```
//! Paths of an albedo of 1 through each volume, 30 mean free paths thick through its middle: a
//! photon comes in from outside, flies, turns anywhere, flies on until it is out or has turned
//! often. All variants fly from the same places, in turn, round by round, on one thread; the best
//! round counts. Look-ups per flight do not depend on the machine.
//!
//! `one tap`: the renderer's flights, which look up one corner of eight, chosen at random, and only
//! if the bounds of small blocks leave a collision open (a global majorant has no blocks).
//! `trilinear`: delta tracking as it is in books, a look-up of eight corners at every collision,
//! through the same bounds. `set out`: flights of the renderer's that end in the cell they begin in,
//! which none is without.

#[path = "volumes/media.rs"]
mod media;
mod volumes;

use std::sync::Arc;

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::medium::{Field, Medium};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::selftest::fields::{direction, ray_through};
use vpm_vdb::tracking::{Hero, Sampler, sample_free_flight};

use media::{MERGINGS, extinction, medium};
use volumes::{files, load, timed};

const PATHS: usize = 2000;
const MOST_TURNS: usize = 64;
const ROUNDS: usize = 25;
/// Names of [`Variant`]s.
const LOOKUPS: [&str; 3] = ["one tap", "trilinear", "set out"];
/// Where flights end that only set out. \[voxels\]
const AT_ONCE: f32 = 1e-6;

/// A flight of a medium from a place.
type Flight = fn(&Medium<f32>, &Ray, &mut Sampler) -> Option<f32>;

/// The renderer's, up to `t_max`.
fn flight(medium: &Medium<f32>, ray: &Ray, t_max: f32, sampler: &mut Sampler) -> Option<f32> {
    let mut hero = Hero::choose(&mut sampler.rng);
    let media = std::slice::from_ref(medium);
    sample_free_flight(media, ray, t_max, &mut hero, sampler).map(|c| c.t)
}

/// The renderer's.
fn one_tap(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
    flight(medium, ray, f32::INFINITY, sampler)
}

/// The renderer's, ended at once.
fn set_out(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
    flight(medium, ray, AT_ONCE, sampler)
}

/// That of books. The grid's voxels are the world here.
fn trilinear(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
    let Field::Grid(field) = &medium.field else {
        return None;
    };
    let (grid, bounds): (&Grid, &MajorantGrid) = (&field.grid, &field.majorants);
    let mut budget = sampler.exponential();
    for segment in bounds.segments(ray, 0.0, f32::INFINITY) {
        let sigma_maj = medium.sigma_t * segment.majorant;
        let mut t = segment.t_min;
        while budget < (segment.t_max - t) * sigma_maj {
            t += budget / sigma_maj;
            sampler.counters.density_lookups += 1;
            if sampler.uniform() * segment.majorant < grid.lookup(ray.at(t)) {
                return Some(t);
            }
            budget = sampler.exponential();
        }
        budget -= (segment.t_max - t) * sigma_maj;
    }
    None
}

/// Where photons fly from, flown once.
fn starts(medium: &Medium<f32>, first: &[Ray]) -> Vec<Ray> {
    let mut random = Rng::stream(1, Stage::Check, 1, 0);
    let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 2, 0));
    let mut all = Vec::new();
    for ray in first {
        let mut ray = *ray;
        for _ in 0..MOST_TURNS {
            all.push(ray);
            let Some(t) = one_tap(medium, &ray, &mut sampler) else {
                break;
            };
            ray = Ray {
                origin: ray.at(t),
                direction: direction(&mut random),
            };
        }
    }
    all
}

/// Bounds and look-ups, and what was measured.
struct Variant {
    bounds: usize,
    lookups: usize,
    /// Of the best round. \[s\]
    seconds: f64,
    /// Of all rounds.
    count: u64,
    /// Distances summed over all rounds \[voxels\]: the same for all variants, but for noise.
    distance: f64,
}

fn main() {
    println!(
        "{:<22}{:<11}{:<11}{:>9}{:>20}{:>14}{:>12}{:>11}{:>11}",
        "",
        "bounds",
        "look-ups",
        "flights",
        "look-ups a flight",
        "mean length",
        "M flights/s",
        "to global",
        "to book's"
    );
    for file in files() {
        let (name, grid) = load(&file);
        let grid = Arc::new(grid);
        let sigma_t = extinction(&grid);
        let media = MERGINGS.map(|(_, merging)| medium(&grid, sigma_t, merging));
        let mut random = Rng::stream(1, Stage::Check, 0, 0);
        let first: Vec<Ray> = (0..PATHS)
            .map(|_| ray_through(&grid, &mut random))
            .collect();
        let starts = starts(&media[0], &first);
        let flights: [Flight; 3] = [one_tap, trilinear, set_out];
        let variant = |i: usize| Variant {
            bounds: i % media.len(),
            lookups: i / media.len(),
            seconds: f64::INFINITY,
            count: 0,
            distance: 0.0,
        };
        // Setting out is the same in all bounds.
        let count = 2 * media.len() + 1;
        let mut variants: Vec<Variant> = (0..count).map(variant).collect();
        for round in 0..ROUNDS {
            for of in &mut variants {
                let medium = &media[of.bounds];
                let flight = flights[of.lookups];
                let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 3, round as u64));
                let (seconds, distance) = timed(|| {
                    let mut distance = 0.0;
                    for ray in &starts {
                        distance += flight(medium, ray, &mut sampler).unwrap_or(0.0);
                    }
                    distance
                });
                of.seconds = of.seconds.min(seconds);
                of.count += sampler.counters.density_lookups;
                of.distance += f64::from(distance);
            }
        }
        let count = starts.len() as f64;
        let all = count * ROUNDS as f64;
        let globals = [0, 1, 1].map(|lookups| variants[media.len() * (lookups + 1) - 1].seconds);
        for of in &variants {
            println!(
                "{name:<22}{:<11}{:<11}{count:>9}{:>20.3}{:>14.2}{:>12.2}{:>11.2}{:>11.2}",
                MERGINGS[of.bounds].0,
                LOOKUPS[of.lookups],
                of.count as f64 / all,
                of.distance / all,
                1e-6 * count / of.seconds,
                globals[of.lookups] / of.seconds,
                globals[1] / of.seconds
            );
        }
    }
}
