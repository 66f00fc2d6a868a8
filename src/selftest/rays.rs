//! Rays through the bounds and through the field, cell by cell: nothing missed, nothing twice.
//!
//! Positions are compared in f64. A point of a ray at t is off by what f32 makes of
//! `origin + t direction`,
//!
//! ```text
//! delta = 4 eps (max |o| + t max |d|)     [voxels]
//! ```
//!
//! so a piece may reach that far beyond its cell, where the field may differ from what the cell
//! says by delta times its steepest slope (3 x range per voxel), and no further. Figures other
//! than counts are in units of what this allows.

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::fields::{direction, generated, ray_through, rng, trilinear, unit};
use super::{SelftestError, Suite, Worst};
use crate::grid::Grid;
use crate::grid::flights::FlightGrid;
use crate::grid::majorant::MajorantGrid;
use crate::grid::segments::MajorantSegment;
use crate::grid::walk::{Piece, integral, walk};
use crate::ray::Ray;
use crate::rng::Rng;

const EPS: f64 = f32::EPSILON as f64;

/// Farthest that rounding moves the point at t.
fn delta(ray: &Ray, t: f64) -> f64 {
    let o = f64::from(ray.origin.abs().max_element());
    let d = f64::from(ray.direction.abs().max_element());
    4.0 * EPS * (o + t.abs() * d)
}

fn at(ray: &Ray, t: f64) -> DVec3 {
    ray.origin.as_dvec3() + t * ray.direction.as_dvec3()
}

/// Steepest change of the field per voxel moved along each axis.
fn slope(grid: &Grid) -> f64 {
    3.0 * f64::from(grid.range()[1] - grid.range()[0])
}

/// Rays that have broken walks: along axes, through corners and edges, on faces, with zero,
/// negative zero and denormal components, tangent, from far away, from inside.
fn adversarial(grid: &Grid, random: &mut Rng) -> Ray {
    let support = grid.support();
    let size = support.size();
    let snap = |x: f32, random: &mut Rng| match random.below(4) {
        0 => x.round(),
        1 => (x / 8.0).round() * 8.0,
        2 => (x / 128.0).round() * 128.0,
        _ => x,
    };
    let mut target = support.min + size * unit(random);
    for axis in 0..3 {
        target[axis] = match random.below(6) {
            0 => support.min[axis],
            1 => support.max[axis],
            _ => snap(target[axis], random),
        };
    }
    let mut d = match random.below(4) {
        // A small integer direction from a corner meets corner after corner.
        0 => IVec3::new(
            random.below(5) as i32 - 2,
            random.below(5) as i32 - 2,
            random.below(5) as i32 - 2,
        )
        .as_vec3(),
        1 => Vec3::AXES[random.below(3) as usize] * (1.0 - 2.0 * random.below(2) as f32),
        2 => direction(random) * 10f32.powi(random.below(9) as i32 - 4),
        _ => direction(random),
    };
    let tiny = [
        0.0, -0.0, 1e-40, -1e-40, 1e-30, -1e-30, 1e-12, -1e-12, 1e-6, -1e-6,
    ];
    for axis in 0..3 {
        if random.below(4) == 0 {
            d[axis] = tiny[random.below(tiny.len() as u32) as usize];
        }
    }
    if d.abs().max_element() < 1e-5 {
        d[random.below(3) as usize] = 1.0;
    }
    let away = match random.below(5) {
        0 => 0.0,
        1 => 1e3,
        2 => 3e5,
        _ => size.length() * random.uniform(),
    };
    Ray {
        origin: target - d * (away / d.length()),
        direction: d,
    }
}

/// Ends of the ray's way through the support.
fn interval(random: &mut Rng) -> (f32, f32) {
    match random.below(4) {
        0 => (0.0, f32::INFINITY),
        1 => (0.0, 200.0 * random.uniform()),
        2 => {
            let t0 = 100.0 * random.uniform();
            (t0, t0 + 100.0 * random.uniform())
        }
        _ => (0.0, 1e30),
    }
}

/// What is asked of the walks through one field.
#[derive(Default)]
struct Found {
    /// Gaps, overlaps, steps back, wrong ends, walks without end.
    tiling: Worst,
    /// Field beyond what a segment or a piece says of it, in units of rounding.
    value: Worst,
    /// Pieces beyond their cell, in units of rounding.
    place: Worst,
}

impl Found {
    fn and(self, other: Self) -> Self {
        Self {
            tiling: self.tiling.and(other.tiling),
            value: self.value.or(other.value),
            place: self.place.or(other.place),
        }
    }

    fn fault(&mut self, fault: bool, what: &str, context: &dyn Fn() -> String) {
        self.tiling
            .count(fault, || format!("{what}: {}", context()));
    }

    /// A difference, and what of it rounding explains.
    fn off(&mut self, off: f64, allowed: f64, context: &dyn Fn() -> String) {
        if off > 0.0 {
            self.value
                .take(off / allowed, || format!("{off:e} off: {}", context()));
        }
    }
}

/// One ray and the part of it that is walked.
struct Way<'a> {
    name: &'a str,
    grid: &'a Grid,
    majorants: &'a MajorantGrid,
    flights: &'a FlightGrid,
    ray: Ray,
    t0: f32,
    t1: f32,
}

impl Way<'_> {
    fn tell(&self) -> String {
        format!("{}: {:?}, {} to {}", self.name, self.ray, self.t0, self.t1)
    }

    /// The segments of marches and those of flights.
    fn check_segments(&self, random: &mut Rng, found: &mut Found) {
        let segments = self.majorants.segments(&self.ray, self.t0, self.t1);
        self.check_tiles(segments, random, found);
        let segments = self.flights.segments(&self.ray, self.t0, self.t1);
        self.check_tiles(segments, random, found);
    }

    /// Segments tile what of [t0, t1] lies in the support, each beginning at the very number where
    /// the last one ended, and are no more than the bricks that a line can cross.
    fn check_tiles(
        &self,
        segments: impl Iterator<Item = MajorantSegment>,
        random: &mut Rng,
        found: &mut Found,
    ) {
        let (grid, ray) = (self.grid, &self.ray);
        let context = || self.tell();
        let bricks = grid.dims().as_ivec3() * 16;
        let most = 3 * bricks.element_sum() as usize;
        let segments: Vec<MajorantSegment> = segments.take(most + 1).collect();
        found.fault(segments.len() > most, "no end", &context);
        let clipped = grid.support().clip(ray, self.t0, self.t1);
        let Some((enter, exit)) = clipped else {
            found.fault(!segments.is_empty(), "outside", &context);
            return;
        };
        let (Some(first), Some(last)) = (segments.first(), segments.last()) else {
            found.fault(true, "nothing", &context);
            return;
        };
        found.fault(first.t_min != enter, "begin", &context);
        found.fault(last.t_max != exit, "end", &context);
        for pair in segments.windows(2) {
            found.fault(pair[0].t_max != pair[1].t_min, "gap", &context);
        }
        self.check_bounds(&segments, random, found);
    }

    /// The field is within the bounds of segments.
    fn check_bounds(&self, segments: &[MajorantSegment], random: &mut Rng, found: &mut Found) {
        let (grid, ray) = (self.grid, &self.ray);
        let context = || self.tell();
        for s in segments {
            found.fault(s.t_min > s.t_max, "backwards", &context);
            let u = random.uniform_f64();
            let t = f64::from(s.t_min) + u * (f64::from(s.t_max) - f64::from(s.t_min));
            let value = trilinear(grid, at(ray, t));
            let beyond = (value - f64::from(s.majorant)).max(f64::from(s.minorant) - value);
            found.off(beyond, slope(grid) * delta(ray, t), &context);
        }
    }

    /// Pieces come in order, without overlap, in one cell each unless constant, where there is
    /// none the field is 0, and their sum is the integral.
    fn check_pieces(&self, random: &mut Rng, found: &mut Found) {
        let (grid, ray) = (self.grid, &self.ray);
        let context = || self.tell();
        let mut pieces: Vec<Piece> = Vec::new();
        walk(
            grid,
            self.majorants,
            &ray.into(),
            self.t0,
            self.t1,
            |piece| {
                pieces.push(piece);
                true
            },
        );
        let (whole, _) = integral(
            grid,
            self.majorants,
            &ray.into(),
            [self.t0, self.t1],
            f64::INFINITY,
        );
        let Some((enter, exit)) = grid.support().clip(ray, self.t0, self.t1) else {
            let any = !pieces.is_empty() || whole != 0.0;
            found.fault(any, "outside", &context);
            return;
        };
        // Pieces too short for f32 are left out of their sum where none follows.
        let sum: f64 = pieces.iter().map(|piece| piece.integral).sum();
        let most = f64::from(grid.range()[1]);
        let ends = delta(ray, exit.into()) / f64::from(ray.direction.length());
        let slack = 1e-12 * sum + most * ends;
        found.off((whole - sum).abs(), slack, &context);
        let mut end = enter;
        for piece in &pieces {
            found.fault(piece.t_min >= piece.t_max, "empty", &context);
            found.fault(piece.t_min < end, "overlap", &context);
            if piece.t_min > end {
                self.check_zero(end, piece.t_min, random, found);
            }
            end = piece.t_max;
            let (a, b) = (f64::from(piece.t_min), f64::from(piece.t_max));
            let slack = delta(ray, b);
            for (t, density) in [a, 0.5 * (a + b), b].into_iter().zip(piece.density) {
                let exact = trilinear(grid, at(ray, t));
                let off = (f64::from(density) - exact).abs();
                found.off(off, slope(grid) * slack + 1e-6 * exact, &context);
            }
            if piece.density[0] != piece.density[1] || piece.density[1] != piece.density[2] {
                let cell = at(ray, 0.5 * (a + b)).floor();
                for point in [at(ray, a), at(ray, b)] {
                    let outside = (cell - point).max(point - cell - DVec3::ONE).max_element();
                    found.place.take(outside / slack, context);
                }
            }
        }
        found.fault(end > exit, "beyond the end", &context);
        if end < exit {
            self.check_zero(end, exit, random, found);
        }
    }

    /// The field is 0 between a and b.
    fn check_zero(&self, a: f32, b: f32, random: &mut Rng, found: &mut Found) {
        let t = f64::from(a) + random.uniform_f64() * (f64::from(b) - f64::from(a));
        let value = trilinear(self.grid, at(&self.ray, t));
        let allowed = slope(self.grid) * delta(&self.ray, t);
        found.off(value, allowed, &|| format!("gap: {}", self.tell()));
    }
}

/// The clip against the support is that of exact arithmetic: each end within four roundings.
fn check_clip(name: &str, grid: &Grid, ray: &Ray, (t0, t1): (f32, f32)) -> Worst {
    let support = grid.support();
    let (mut enter, mut exit) = (f64::from(t0), f64::from(t1));
    for axis in 0..3 {
        let (o, d) = (f64::from(ray.origin[axis]), f64::from(ray.direction[axis]));
        let (low, high) = (f64::from(support.min[axis]), f64::from(support.max[axis]));
        if d.abs() < f64::from(f32::MIN_POSITIVE) {
            // Reaches no face within any t below 1e30.
            if o < low || o > high {
                (enter, exit) = (1.0, 0.0);
            }
            continue;
        }
        let (a, b) = ((low - o) / d, (high - o) / d);
        enter = enter.max(a.min(b));
        exit = exit.min(a.max(b));
    }
    let slack = 4.0 * EPS * (enter.abs() + exit.abs());
    let off = match support.clip(ray, t0, t1) {
        None => exit - enter,
        Some((_, b)) if exit.is_infinite() && b.is_infinite() => 0.0,
        Some((a, b)) => (f64::from(a) - enter)
            .abs()
            .max((f64::from(b) - exit).abs()),
    };
    let mut worst = Worst::default();
    if off > 0.0 {
        worst.take(off / slack, || {
            format!("{name}: {ray:?}, exactly {enter} to {exit}")
        });
    }
    worst
}

/// Walks rays through every field at some extinctions, in parallel.
fn walks(
    fields: &[(&str, Grid)],
    (seed, rays): (u64, u32),
    sigmas: &[f32],
    check: impl Fn(&Way<'_>, &mut Rng, &mut Found) + Sync,
) -> Found {
    let jobs: Vec<(usize, f32)> = (0..fields.len())
        .flat_map(|field| sigmas.iter().map(move |sigma| (field, *sigma)))
        .collect();
    let found: Vec<Found> = jobs
        .par_iter()
        .enumerate()
        .map(|(job, (field, sigma))| {
            let (name, grid) = &fields[*field];
            let mut random = rng(seed + job as u64);
            let majorants = MajorantGrid::new(grid, *sigma, 1.0);
            let flights = FlightGrid::new(grid, *sigma, 1.0);
            let mut found = Found::default();
            for i in 0..rays {
                let ray = if i % 4 == 0 {
                    ray_through(grid, &mut random)
                } else {
                    adversarial(grid, &mut random)
                };
                let (t0, t1) = interval(&mut random);
                let way = Way {
                    name,
                    grid,
                    majorants: &majorants,
                    flights: &flights,
                    ray,
                    t0,
                    t1,
                };
                check(&way, &mut random, &mut found);
            }
            found
        })
        .collect();
    found.into_iter().fold(Found::default(), Found::and)
}

/// The checks of this family.
///
/// # Errors
/// None in practice: the fields are small.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let fields = generated()?;
    // 21 combinations of field and extinction: more than a million rays when exhaustive.
    let rays = suite.choose([5000, 25_000, 60_000]);
    let found = walks(
        &fields,
        (1000, rays),
        &[0.0, 0.05, 10.0],
        |way, random, found| {
            way.check_segments(random, found);
        },
    );
    suite.none(
        "segments tile rays: gaps, overlaps, lost ends",
        found.tiling,
    );
    suite.worst(
        "field beyond a segment's bounds, in roundings",
        found.value,
        1.0,
    );
    let rays = suite.choose([3000, 15_000, 72_000]);
    let found = walks(
        &fields,
        (2000, rays),
        &[0.02, 10.0],
        |way, random, found| {
            way.check_pieces(random, found);
        },
    );
    suite.none("pieces tile rays: gaps, overlaps, lost ends", found.tiling);
    suite.worst("values of pieces, in roundings", found.value, 1.0);
    suite.worst("pieces beyond their cell, in roundings", found.place, 1.0);
    let rays = suite.choose([5000, 20_000, 200_000]);
    let mut random = rng(11);
    let mut worst = Worst::default();
    for (name, grid) in &fields {
        for _ in 0..rays {
            let ray = adversarial(grid, &mut random);
            worst = worst.or(check_clip(name, grid, &ray, interval(&mut random)));
        }
    }
    suite.worst("clip against a box, in roundings", worst, 1.0);
    Ok(())
}
