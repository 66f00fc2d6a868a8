//! Free flights, by the cells of the bounds that delta tracking steps through.
//!
//! ```text
//! cargo bench --bench free_flight [-- FILE.vdb ...]
//! ```
//! Paths of an albedo of 1 through each volume, 30 mean free paths thick through its middle: a
//! photon comes in from outside, flies, turns anywhere, flies on until it is out or has turned
//! often. All variants fly from the same places, in turn, round by round, on one thread; the best
//! round counts. Look-ups per flight do not depend on the machine.

#[path = "volumes/media.rs"]
mod media;
mod volumes;

use std::sync::Arc;

use vpm_vdb::medium::Medium;
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::selftest::fields::{direction, ray_through};
use vpm_vdb::tracking::{Hero, Sampler, sample_free_flight};

use media::{MERGINGS, extinction, medium};
use volumes::{files, load, timed};

const PATHS: usize = 2000;
const MOST_TURNS: usize = 64;
const ROUNDS: usize = 25;

/// Where photons fly from, flown once.
fn starts(medium: &Medium<f32>, first: &[Ray]) -> Vec<Ray> {
    let mut random = Rng::stream(1, Stage::Check, 1, 0);
    let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 2, 0));
    let mut all = Vec::new();
    for ray in first {
        let mut ray = *ray;
        let mut hero = Hero::choose(&mut sampler.rng);
        for _ in 0..MOST_TURNS {
            all.push(ray);
            let media = std::slice::from_ref(medium);
            let flight = sample_free_flight(media, &ray, f32::INFINITY, &mut hero, &mut sampler);
            let Some(collision) = flight else { break };
            ray = Ray {
                origin: ray.at(collision.t),
                direction: direction(&mut random),
            };
        }
    }
    all
}

fn main() {
    println!(
        "{:<24}{:<12}{:>10}{:>18}{:>16}{:>14}",
        "", "bounds", "flights", "look-ups a flight", "M flights/s", "to global"
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
        let mut best = [f64::INFINITY; 3];
        let mut lookups = [0.0; 3];
        for round in 0..ROUNDS {
            for ((medium, best), lookups) in media.iter().zip(&mut best).zip(&mut lookups) {
                let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 3, round as u64));
                let (seconds, ()) = timed(|| {
                    for ray in &starts {
                        let mut hero = Hero::choose(&mut sampler.rng);
                        let media = std::slice::from_ref(medium);
                        std::hint::black_box(sample_free_flight(
                            media,
                            ray,
                            f32::INFINITY,
                            &mut hero,
                            &mut sampler,
                        ));
                    }
                });
                *best = best.min(seconds);
                *lookups += sampler.counters.density_lookups as f64;
            }
        }
        let flights = starts.len() as f64;
        for (i, (merging, _)) in MERGINGS.iter().enumerate() {
            println!(
                "{name:<24}{merging:<12}{flights:>10}{:>18.3}{:>16.2}{:>14.2}",
                lookups[i] / (flights * ROUNDS as f64),
                1e-6 * flights / best[i],
                best[2] / best[i]
            );
        }
    }
}
