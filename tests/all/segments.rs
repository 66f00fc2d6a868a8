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
//! says by delta times its steepest slope (3 x range per voxel), and no further.

use glam::{DVec3, IVec3, Vec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::majorant::{MajorantGrid, MajorantSegment};
use vpm_vdb::grid::walk::{Piece, walk};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::Rng;

use crate::fields::{direction, generated, ray_through, rng, trilinear, unit};

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

/// Segments tile what of [t0, t1] lies in the support, each beginning at the very number where
/// the last one ended, and are no more than the bricks that a line can cross.
fn check_segments(
    name: &str,
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &Ray,
    (t0, t1): (f32, f32),
    random: &mut Rng,
) -> usize {
    let context = || format!("{name}: {ray:?}, {t0} to {t1}");
    let bricks = grid.dims().as_ivec3() * 16;
    let most = 3 * bricks.element_sum() as usize;
    let segments: Vec<MajorantSegment> = majorants.segments(ray, t0, t1).take(most + 1).collect();
    assert!(segments.len() <= most, "no end: {}", context());
    let Some((enter, exit)) = grid.support().clip(ray, t0, t1) else {
        assert!(segments.is_empty(), "outside: {}", context());
        return 0;
    };
    let (Some(first), Some(last)) = (segments.first(), segments.last()) else {
        panic!("nothing between {enter} and {exit}: {}", context());
    };
    assert_eq!(first.t_min, enter, "begin: {}", context());
    assert_eq!(last.t_max, exit, "end: {}", context());
    for pair in segments.windows(2) {
        assert_eq!(pair[0].t_max, pair[1].t_min, "gap: {}", context());
    }
    for s in &segments {
        assert!(s.t_min <= s.t_max, "backwards {s:?}: {}", context());
        let u = random.uniform_f64();
        let t = f64::from(s.t_min) + u * (f64::from(s.t_max) - f64::from(s.t_min));
        let value = trilinear(grid, at(ray, t));
        let slack = slope(grid) * delta(ray, t);
        assert!(
            value <= f64::from(s.majorant) + slack && value >= f64::from(s.minorant) - slack,
            "{value} at {t}, bounds {s:?}: {}",
            context()
        );
    }
    segments.len()
}

#[test]
fn segments_tile_the_ray_within_their_bounds() {
    let mut random = rng(10);
    let mut rays = 0;
    let mut total = 0;
    for (name, grid) in generated() {
        for sigma in [0.0, 0.05, 10.0] {
            let majorants = MajorantGrid::new(&grid, sigma, 1.0);
            for i in 0..6000 {
                let ray = if i % 4 == 0 {
                    ray_through(&grid, &mut random)
                } else {
                    adversarial(&grid, &mut random)
                };
                let range = interval(&mut random);
                total += check_segments(name, &grid, &majorants, &ray, range, &mut random);
                rays += 1;
            }
        }
    }
    println!("{rays} rays, {total} segments");
}

/// The clip against the support is that of exact arithmetic: each end within four roundings.
#[test]
fn clip_is_that_of_exact_arithmetic() {
    let mut random = rng(11);
    for (name, grid) in generated() {
        let support = grid.support();
        for _ in 0..20_000 {
            let ray = adversarial(&grid, &mut random);
            let (t0, t1) = interval(&mut random);
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
            match support.clip(&ray, t0, t1) {
                None => assert!(exit - enter <= slack, "{name}: missed by {ray:?}"),
                Some((a, b)) => {
                    let off = (f64::from(a) - enter)
                        .abs()
                        .max((f64::from(b) - exit).abs());
                    assert!(
                        off <= slack || (exit.is_infinite() && b.is_infinite()),
                        "{name}: {a} to {b}, exactly {enter} to {exit}: {ray:?}"
                    );
                }
            }
        }
    }
}

/// Pieces come in order, without overlap, in one cell each unless constant, and where there is
/// none the field is 0.
fn check_pieces(
    name: &str,
    grid: &Grid,
    majorants: &MajorantGrid,
    ray: &Ray,
    (t0, t1): (f32, f32),
    random: &mut Rng,
) {
    let context = || format!("{name}: {ray:?}, {t0} to {t1}");
    let mut pieces: Vec<Piece> = Vec::new();
    walk(grid, majorants, ray, t0, t1, |piece| {
        pieces.push(piece);
        true
    });
    let clipped = grid.support().clip(ray, t0, t1);
    let Some((enter, exit)) = clipped else {
        assert!(pieces.is_empty(), "outside: {}", context());
        return;
    };
    let mut end = enter;
    for piece in &pieces {
        assert!(piece.t_min < piece.t_max, "empty {piece:?}: {}", context());
        // A gap is where the field is 0: probed in its middle.
        assert!(piece.t_min >= end, "overlap {piece:?}: {}", context());
        if piece.t_min > end {
            check_zero(grid, ray, end, piece.t_min, random, &context);
        }
        end = piece.t_max;
        let (a, b) = (f64::from(piece.t_min), f64::from(piece.t_max));
        let slack = delta(ray, b);
        for (t, density) in [(a, 0), (0.5 * (a + b), 1), (b, 2)].map(|(t, i)| (t, piece.density[i]))
        {
            let exact = trilinear(grid, at(ray, t));
            assert!(
                (f64::from(density) - exact).abs() <= slope(grid) * slack + 1e-6 * exact,
                "{density} at {t}, exactly {exact}: {piece:?} {}",
                context()
            );
        }
        if piece.density[0] != piece.density[1] || piece.density[1] != piece.density[2] {
            let (p, q) = (at(ray, a), at(ray, b));
            let cell = at(ray, 0.5 * (a + b)).floor();
            for point in [p, q] {
                let outside = (cell - point).max(point - cell - DVec3::ONE).max_element();
                assert!(
                    outside <= slack,
                    "{outside} voxels beyond its cell: {piece:?} {}",
                    context()
                );
            }
        }
    }
    assert!(end <= exit, "beyond the end: {}", context());
    if end < exit {
        check_zero(grid, ray, end, exit, random, &context);
    }
}

/// The field is 0 between a and b.
fn check_zero(
    grid: &Grid,
    ray: &Ray,
    a: f32,
    b: f32,
    random: &mut Rng,
    context: &dyn Fn() -> String,
) {
    let t = f64::from(a) + random.uniform_f64() * (f64::from(b) - f64::from(a));
    let value = trilinear(grid, at(ray, t));
    assert!(
        value <= slope(grid) * delta(ray, t),
        "{value} at {t} in a gap from {a} to {b}: {}",
        context()
    );
}

#[test]
fn pieces_of_a_walk_tile_what_is_not_0() {
    let mut random = rng(12);
    for (name, grid) in generated() {
        for sigma in [0.02, 10.0] {
            let majorants = MajorantGrid::new(&grid, sigma, 1.0);
            for i in 0..4000 {
                let ray = if i % 3 == 0 {
                    ray_through(&grid, &mut random)
                } else {
                    adversarial(&grid, &mut random)
                };
                let range = interval(&mut random);
                check_pieces(name, &grid, &majorants, &ray, range, &mut random);
            }
        }
    }
}
