//! Free flights: by the cells of the bounds that delta tracking steps through, by how it looks the field
//! up, and side by side or one by one.
//!
//! ```text
//! cargo bench --bench free_flight [-- FILE.vdb ...]
//! ```
//! Paths of an albedo of 1 through each volume, 30 mean free paths thick through its middle: a
//! photon comes in from outside, flies, turns anywhere, flies on until it is out or has turned
//! often. All variants fly from the same places, in turn, a few rounds at a time, on one thread;
//! the best round counts. Look-ups per flight do not depend on the machine.
//!
//! `lanes`: flights as photons fly, side by side, every lane along a path of its own. `alone`: the
//! same flights one by one. Both look up one corner of eight, chosen at random, and only if the bounds
//! of small blocks leave a collision open (a global majorant has no blocks). `book`: delta tracking as
//! it is in books, one by one, a trilinear look-up at every collision, through the same bounds.
//! `set out`: flights alone that end in the cell they begin in, which none is without.
//!
//! Speeds are over a global majorant in lanes, alone, and as in books.

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
use vpm_vdb::tracking::{Flights, Hero, Sampler, lanes_of, sample_free_flight};

use media::{MERGINGS, extinction, medium};
use volumes::{files, load, timed};

const PATHS: usize = 2000;
const MOST_TURNS: usize = 64;
/// Turns of each variant, and rounds of a turn: the first finds caches full of what others looked up.
const TURNS: usize = 5;
const ROUNDS: usize = 5;
/// Names of kinds.
const KINDS: [&str; 4] = ["lanes", "alone", "book", "set out"];
/// Where flights end that only set out. \[voxels\]
const AT_ONCE: f32 = 1e-6;

/// Flies from all places of all paths; the sum of the lengths, and look-ups.
type Fly = fn(&Medium<f32>, &[Vec<Ray>], u64) -> (f32, u64);

/// The renderer's, up to `t_max`.
fn flight(medium: &Medium<f32>, ray: &Ray, t_max: f32, sampler: &mut Sampler) -> Option<f32> {
    let mut hero = Hero::choose(&mut sampler.rng);
    let media = std::slice::from_ref(medium);
    sample_free_flight(media, ray, t_max, &mut hero, sampler).map(|c| c.t)
}

/// The renderer's.
fn alone(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
    flight(medium, ray, f32::INFINITY, sampler)
}

/// The renderer's, ended at once.
fn set_out(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
    flight(medium, ray, AT_ONCE, sampler)
}

/// That of books. The grid's voxels are the world here.
fn book(medium: &Medium<f32>, ray: &Ray, sampler: &mut Sampler) -> Option<f32> {
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

/// One after the other.
fn each(
    medium: &Medium<f32>,
    paths: &[Vec<Ray>],
    round: u64,
    flight: impl Fn(&Medium<f32>, &Ray, &mut Sampler) -> Option<f32>,
) -> (f32, u64) {
    let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 3, round));
    let mut distance = 0.0;
    for ray in paths.iter().flatten() {
        distance += flight(medium, ray, &mut sampler).unwrap_or(0.0);
    }
    (distance, sampler.counters.density_lookups)
}

/// Who flies in a lane: what is left of its path.
struct Lane<'p> {
    path: &'p [Ray],
    hero: Hero<f32>,
    sampler: Sampler,
}

impl<'p> Lane<'p> {
    /// Begins the next flight; false if there is none.
    fn set_out(
        &mut self,
        flights: &mut Flights<'_>,
        lane: usize,
        paths: &mut std::slice::Iter<'p, Vec<Ray>>,
    ) -> bool {
        loop {
            let Some(ray) = self.path.split_off_first() else {
                let Some(path) = paths.next() else {
                    return false;
                };
                self.path = path;
                continue;
            };
            if flights.set_out(lane, ray, f32::INFINITY, &mut self.hero, &mut self.sampler) {
                return true;
            }
        }
    }
}

/// As photons fly: every lane follows a path.
fn lanes(medium: &Medium<f32>, paths: &[Vec<Ray>], round: u64) -> (f32, u64) {
    let mut paths = paths.iter();
    let mut flights = Flights::new(medium).expect("a grey medium of a grid");
    let mut lanes: Vec<Lane<'_>> = (0..Flights::LANES)
        .map(|lane| {
            let mut rng = Rng::stream(1, Stage::Check, 3 + lane as u64, round);
            Lane {
                path: &[],
                hero: Hero::choose(&mut rng),
                sampler: Sampler::new(rng),
            }
        })
        .collect();
    let mut distance = 0.0;
    let mut flying = 0;
    for (lane, who) in lanes.iter_mut().enumerate() {
        flying += usize::from(who.set_out(&mut flights, lane, &mut paths));
    }
    while flying > 0 {
        let ended = flights.advance();
        for lane in lanes_of(ended.collided | ended.left) {
            let who = &mut lanes[lane];
            let t = flights.end(lane, &mut who.sampler);
            distance += if ended.collided >> lane & 1 == 1 {
                t
            } else {
                0.0
            };
            flying -= usize::from(!who.set_out(&mut flights, lane, &mut paths));
        }
    }
    (distance, flights.lookups())
}

/// Where photons fly from, flown once.
fn starts(medium: &Medium<f32>, first: &[Ray]) -> Vec<Vec<Ray>> {
    let mut random = Rng::stream(1, Stage::Check, 1, 0);
    let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 2, 0));
    let mut all = Vec::new();
    for ray in first {
        let mut ray = *ray;
        let mut path = Vec::new();
        for _ in 0..MOST_TURNS {
            path.push(ray);
            let Some(t) = alone(medium, &ray, &mut sampler) else {
                break;
            };
            ray = Ray {
                origin: ray.at(t),
                direction: direction(&mut random),
            };
        }
        all.push(path);
    }
    all
}

/// What flies, and what was measured.
struct Variant {
    bounds: usize,
    kind: usize,
    /// Of the best round. \[s\]
    seconds: f64,
    /// Of all rounds.
    count: u64,
    /// Distances summed over all rounds \[voxels\]: the same for all variants, but for noise.
    distance: f64,
}

fn main() {
    println!(
        "{:<22}{:<11}{:<9}{:>8}{:>19}{:>13}{:>13}{:>27}",
        "",
        "bounds",
        "",
        "flights",
        "look-ups a flight",
        "mean length",
        "M flights/s",
        "over global lanes alone book"
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
        let fly: [Fly; 4] = [
            lanes,
            |medium, paths, round| each(medium, paths, round, alone),
            |medium, paths, round| each(medium, paths, round, book),
            |medium, paths, round| each(medium, paths, round, set_out),
        ];
        let variant = |i: usize| Variant {
            bounds: i % media.len(),
            kind: i / media.len(),
            seconds: f64::INFINITY,
            count: 0,
            distance: 0.0,
        };
        // Setting out is the same in all bounds.
        let count = 3 * media.len() + 1;
        let mut variants: Vec<Variant> = (0..count).map(variant).collect();
        for turn in 0..TURNS {
            for of in &mut variants {
                let medium = &media[of.bounds];
                let fly = fly[of.kind];
                for round in turn * ROUNDS..(turn + 1) * ROUNDS {
                    let round = round as u64;
                    let (seconds, (distance, lookups)) = timed(|| fly(medium, &starts, round));
                    of.seconds = of.seconds.min(seconds);
                    of.count += lookups;
                    of.distance += f64::from(distance);
                }
            }
        }
        let count = starts.iter().map(Vec::len).sum::<usize>() as f64;
        let all = count * (TURNS * ROUNDS) as f64;
        let globals = [0, 1, 2].map(|kind| variants[media.len() * (kind + 1) - 1].seconds);
        for of in &variants {
            println!(
                "{name:<22}{:<11}{:<9}{count:>8}{:>19.3}{:>13.2}{:>13.2}{:>11.2}{:>8.2}{:>8.2}",
                MERGINGS[of.bounds].0,
                KINDS[of.kind],
                of.count as f64 / all,
                of.distance / all,
                1e-6 * count / of.seconds,
                globals[0] / of.seconds,
                globals[1] / of.seconds,
                globals[2] / of.seconds
            );
        }
    }
}
