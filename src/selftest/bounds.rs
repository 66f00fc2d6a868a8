//! Bounds of the field: no look-up lies outside them, at faces above all.
//!
//! ```text
//! minorant(C) <= f(p) <= majorant(C)      every p in cell C, faces included
//! x < v                                   as a block tells it, if it does, and as it is
//! ```
//!
//! Stored values are bounded exactly; interpolated ones within the rounding of three nested
//! interpolations of f32. Bounds that hold may still be loose, and cost: those of unmerged bricks
//! are attained, each by one of the 9^3 values under the cells.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::fields::{generated, rng, unit};
use super::{SelftestError, Suite, Worst};
use crate::grid::flights::FlightGrid;
use crate::grid::majorant::MajorantGrid;
use crate::grid::{APRON, BRICK, Grid};
use crate::rng::{Rng, Stage};

/// Three nested interpolations of f32, each of a difference, a product and a sum: at most six
/// roundings of values up to twice the largest corner.
pub const LERP_ROUNDING: f64 = 6.0 * f32::EPSILON as f64;

/// A local point: in the middle of things, on a face, an edge or a corner of voxels or bricks.
#[must_use]
pub fn point(low: Vec3, high: Vec3, rng: &mut Rng) -> Vec3 {
    let mut p = low + (high - low) * unit(rng);
    for axis in 0..3 {
        match rng.below(6) {
            0 => p[axis] = p[axis].round(),
            1 => p[axis] = (p[axis] / 8.0).round() * 8.0,
            2 => p[axis] = (p[axis] / 8.0).round() * 8.0 - 1.0 + rng.uniform() * 2.0,
            _ => {}
        }
    }
    p
}

/// Points of one unit of parallel work.
const CHUNK: u32 = 1 << 14;

/// Points at which bounds do not hold: of a brick's range, of a majorant's cell.
#[must_use]
pub fn violations(name: &str, grid: &Grid, sigma: f32, points: u32, random: &mut Rng) -> Worst {
    let bounds = (
        MajorantGrid::new(grid, sigma, 1.0),
        FlightGrid::new(grid, sigma, 1.0),
    );
    if grid.support().is_empty() {
        return Worst::default();
    }
    let seed = random.bits();
    let chunks: Vec<Worst> = (0..points.div_ceil(CHUNK))
        .into_par_iter()
        .map_init(HashMap::new, |ranges, chunk| {
            let count = CHUNK.min(points - chunk * CHUNK);
            let mut random = Rng::stream(seed, Stage::Check, 0, chunk.into());
            violations_at(name, grid, &bounds, ranges, count, &mut random)
        })
        .collect();
    chunks.into_iter().fold(Worst::default(), Worst::and)
}

/// The same at some points. A brick's range is that of 9^3 values: kept, once it is known.
fn violations_at(
    name: &str,
    grid: &Grid,
    (majorants, flights): &(MajorantGrid, FlightGrid),
    ranges: &mut HashMap<IVec3, [f32; 2]>,
    points: u32,
    random: &mut Rng,
) -> Worst {
    let support = grid.support();
    let mut faults = Worst::default();
    for _ in 0..points {
        let p = point(support.min - 2.0, support.max + 2.0, random);
        let value = grid.lookup(p);
        let slack = (LERP_ROUNDING * f64::from(value.abs())) as f32;
        // A point on a face belongs to the cells on both sides.
        for back in 0..8 {
            let step = Vec3::new(
                (back & 1) as f32,
                (back >> 1 & 1) as f32,
                (back >> 2) as f32,
            );
            let on_face = (p - p.floor()).cmpeq(Vec3::ZERO);
            if back > 0 && (step.cmpgt(Vec3::ZERO) & !on_face).any() {
                continue;
            }
            let inside = p - step * 0.5;
            let brick = inside.floor().as_ivec3() >> 3i32;
            let range = *ranges
                .entry(brick)
                .or_insert_with(|| grid.brick_range(brick));
            let cells = [majorants.bounds_at(inside), flights.bounds_at(inside)];
            for [low, high] in cells.into_iter().chain([range]) {
                faults.count(!(low - slack..=high + slack).contains(&value), || {
                    format!("{name}: {value} at {p}, bounds {low} to {high}")
                });
            }
        }
        let tap = grid.lookup_one_tap(p, unit(random));
        for [low, high] in [majorants.bounds_at(p), flights.bounds_at(p)] {
            faults.count(!(low..=high).contains(&tap), || {
                format!("{name}: tap {tap} at {p}, bounds {low} to {high}")
            });
        }
        let voxel = p.floor().as_ivec3();
        let value = grid.voxel(voxel);
        for x in [
            value,
            value * random.uniform(),
            value.next_up(),
            random.uniform(),
        ] {
            let told = flights.is_below(x.max(0.0), voxel);
            faults.count(
                told.is_some_and(|below| below != (x.max(0.0) < value)),
                || format!("{name}: voxel {voxel} of {value}, below {x}: {told:?}"),
            );
        }
    }
    faults
}

/// Bricks whose range is not that of the values under their cells, or whose bounds are not where
/// no cells merge.
#[must_use]
pub fn loose(name: &str, grid: &Grid) -> Worst {
    // An extinction at which every cell of more than one value is too rough to merge.
    let unmerged = MajorantGrid::new(grid, 1e30, 1.0);
    let bricks = grid.dims().as_ivec3() * 16;
    let mut faults = Worst::default();
    let support = grid.support();
    let low = support.min.floor().as_ivec3() >> 3i32;
    let high = (support.max.ceil().as_ivec3() >> 3i32).min(bricks - IVec3::ONE);
    for x in low.x..=high.x {
        for y in low.y..=high.y {
            for z in low.z..=high.z {
                let brick = IVec3::new(x, y, z);
                let mut exact = [f32::MAX, f32::MIN];
                for i in 0..(APRON * APRON * APRON) as i32 {
                    let n = APRON as i32;
                    let v = grid.voxel(brick * BRICK + IVec3::new(i / n / n, i / n % n, i % n));
                    exact = [exact[0].min(v), exact[1].max(v)];
                }
                let middle = (brick * BRICK + BRICK / 2).as_vec3();
                for range in [grid.brick_range(brick), unmerged.bounds_at(middle)] {
                    faults.count(range != exact, || {
                        format!("{name}: brick {brick} says {range:?}, holds {exact:?}")
                    });
                }
            }
        }
    }
    faults
}

/// The checks of this family.
///
/// # Errors
/// None in practice: the fields are small.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let mut random = rng(3);
    let points = suite.choose([40_000, 200_000, 2_000_000]);
    let (mut outside, mut not_tight) = (Worst::default(), Worst::default());
    for (name, grid) in &generated()? {
        for sigma in [0.0, 0.02, 1.0, 100.0] {
            outside = outside.and(violations(name, grid, sigma, points, &mut random));
        }
        not_tight = not_tight.and(loose(name, grid));
    }
    suite.none("look-ups outside the bounds of their cell", outside);
    suite.none(
        "bricks whose bounds are not those of their footprint",
        not_tight,
    );
    Ok(())
}
