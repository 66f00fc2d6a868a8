//! Transmittance of rays: ratio tracking by the cells of its bounds, and marches.
//!
//! ```text
//! cargo bench --bench transmittance [-- FILE.vdb ...]
//! ```
//! Rays through random places of each volume, 30 mean free paths thick through its middle. The
//! cost of an estimator at equal variance is (look-ups a ray) x (variance), with the variance of
//! one estimate about the exact transmittance, averaged over the rays; `cost` is that over the
//! one of a global majorant. `shadow` is the march of shadow rays, with its roulette; `march` is
//! the whole exact march, without variance. On one thread, in turn, round by round; the best
//! round counts.

#[path = "volumes/media.rs"]
mod media;
mod volumes;

use std::sync::Arc;

use vpm_vdb::march;
use vpm_vdb::medium::{Field, Medium};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::selftest::exact::Depth;
use vpm_vdb::selftest::fields::ray_through;
use vpm_vdb::tracking::{Sampler, transmittance};

use media::{MERGINGS, extinction, medium};
use volumes::{files, load, timed};

const RAYS: usize = 1000;
const ESTIMATES: usize = 16;

/// Look-ups, seconds and mean square error of an estimator, per ray and estimate.
fn measure(
    medium: &Medium<f32>,
    rays: &[(Ray, f64)],
    estimate: fn(&[Medium<f32>], &Ray, f32, &mut Sampler) -> f32,
) -> [f64; 3] {
    let mut sampler = Sampler::new(Rng::stream(1, Stage::Check, 4, 0));
    let media = std::slice::from_ref(medium);
    let mut best = f64::INFINITY;
    let mut square = 0.0;
    for _ in 0..ESTIMATES {
        let (seconds, sum) = timed(|| {
            rays.iter().fold(0.0, |sum, (ray, exact)| {
                let t = estimate(media, ray, f32::INFINITY, &mut sampler);
                sum + (f64::from(t) - exact).powi(2)
            })
        });
        best = best.min(seconds);
        square += sum;
    }
    let count = (rays.len() * ESTIMATES) as f64;
    [
        sampler.counters.density_lookups as f64 / count,
        best / rays.len() as f64,
        square / count,
    ]
}

fn main() {
    println!(
        "{:<24}{:<12}{:>16}{:>14}{:>12}{:>10}",
        "", "", "look-ups a ray", "variance", "M rays/s", "cost"
    );
    for file in files() {
        let (name, grid) = load(&file);
        let grid = Arc::new(grid);
        let sigma_t = extinction(&grid);
        let mut random = Rng::stream(1, Stage::Check, 0, 0);
        let rays: Vec<(Ray, f64)> = (0..RAYS)
            .map(|_| {
                let ray = ray_through(&grid, &mut random);
                let depth = Depth::new(&grid, &ray, f64::INFINITY).total();
                (ray, (-f64::from(sigma_t) * depth).exp())
            })
            .collect();
        let media = MERGINGS.map(|(_, merging)| medium(&grid, sigma_t, merging));
        let mut rows: Vec<(&str, [f64; 3])> = MERGINGS
            .iter()
            .zip(&media)
            .map(|((name, _), medium)| (*name, measure(medium, &rays, transmittance)))
            .collect();
        let global = rows[2].1[0] * rows[2].1[2];
        rows.push(("shadow", measure(&media[0], &rays, march::transmittance)));
        rows.push(("march", measure(&media[0], &rays, whole_march)));
        for (what, [lookups, seconds, variance]) in rows {
            println!(
                "{name:<24}{what:<12}{lookups:>16.2}{variance:>14.2e}{:>12.2}{:>10.3}",
                1e-6 / seconds,
                lookups * variance / global
            );
        }
    }
}

/// Exact, all the way.
fn whole_march(media: &[Medium<f32>], ray: &Ray, t_max: f32, sampler: &mut Sampler) -> f32 {
    let mut depth = 0.0;
    for medium in media {
        let Field::Grid(field) = &medium.field else {
            continue;
        };
        let (along, lookups) = vpm_vdb::grid::walk::integral(
            &field.grid,
            &field.majorants,
            &ray.into(),
            [0.0, t_max],
            f64::INFINITY,
        );
        sampler.counters.density_lookups += lookups;
        depth += f64::from(medium.sigma_t) * along;
    }
    (-depth).exp() as f32
}
