//! Bricks in 16 bits hold exactly what they hold in 32.

use glam::{DAffine3, IVec3, Vec3};
use half::f16;

use vpm_vdb::grid::build::{BuildError, Topology};
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::walk::{Piece, walk};
use vpm_vdb::grid::{BRICK_VALUES, Grid, corner_index};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::Rng;

use crate::fields::{grid, noise, patchy, real, rng, unit};

/// Half the edge of the fields. \[voxels\]
const REACH: i32 = 40;

/// `patchy` rounded to 16 bits, over many magnitudes.
fn rounded(v: IVec3) -> f32 {
    let scale = (noise(v >> 3i32, 9) * 24.0).floor() - 12.0;
    f16::from_f32(patchy(v) * scale.exp2()).to_f32()
}

/// `rounded`, and one leaf far away, all `beyond`.
fn with_neighbour(beyond: f32) -> Grid {
    let cells = |r: std::ops::Range<i32>| r.step_by(8);
    let leaves: Vec<IVec3> = cells(-REACH..REACH)
        .flat_map(|x| {
            cells(-REACH..REACH)
                .flat_map(move |y| cells(-REACH..REACH).map(move |z| IVec3::new(x, y, z)))
        })
        .chain([IVec3::splat(1000)])
        .collect();
    let topology = Topology {
        background: 0.0,
        tiles: Vec::new(),
        leaves: leaves.clone(),
        active: None,
        index_to_world: DAffine3::IDENTITY,
    };
    Grid::build::<BuildError>(&topology, |values| {
        for (brick, &leaf) in values.chunks_mut(BRICK_VALUES).zip(&leaves) {
            for n in 0..512 {
                let v = IVec3::new(n >> 6, n >> 3 & 7, n & 7);
                let far = leaf.x == 1000;
                brick[corner_index(v)] = if far { beyond } else { rounded(leaf + v) };
            }
        }
        Ok(())
    })
    .expect("a small grid can be built")
}

fn bits(piece: Piece) -> [u32; 5] {
    let [a, m, b] = piece.density;
    [piece.t_min, piece.t_max, a, m, b].map(f32::to_bits)
}

/// Compares lookups, one taps and walks inside a box, bit for bit; returns the pieces walked.
fn compare(name: &str, a: &Grid, b: &Grid, min: Vec3, max: Vec3, random: &mut Rng) -> usize {
    let points = 4000;
    let mut point = || min + (max - min) * unit(random);
    let mut taps = rng(12);
    for _ in 0..points {
        let (p, u) = (point(), unit(&mut taps));
        let [x, y] = [a, b].map(|g| g.lookup(p).to_bits());
        assert_eq!(x, y, "{name}: lookup at {p}");
        let [x, y] = [a, b].map(|g| g.lookup_one_tap(p, u).to_bits());
        assert_eq!(x, y, "{name}: one tap at {p}, {u}");
    }
    let [ours, theirs] = [a, b].map(|g| MajorantGrid::new(g, 0.3, 1.0));
    let mut walked = 0;
    for _ in 0..200 {
        let origin = point();
        let ray = Ray {
            origin,
            direction: point() - origin,
        };
        let pieces = |grid: &Grid, majorants: &MajorantGrid| {
            let mut pieces = Vec::new();
            walk(grid, majorants, &(&ray).into(), 0.0, 1.0, |piece| {
                pieces.push(bits(piece));
                true
            });
            pieces
        };
        let pieces = [pieces(a, &ours), pieces(b, &theirs)];
        walked += pieces[0].len();
        assert_eq!(pieces[0], pieces[1], "{name}: from {ray:?}");
    }
    walked
}

#[test]
fn halves_are_their_f32_twin() {
    let ours = with_neighbour(0.5);
    let twin = with_neighbour(0.1);
    assert_eq!([ours.value_bits(), twin.value_bits()], [16, 32]);
    assert_eq!(ours.bricks(), twin.bricks());
    // Two bytes of each stored value: of what a brick holds, the box that is not 0, no more.
    let saved = twin.memory_bytes() - ours.memory_bytes();
    assert!(saved > 0 && saved < 2 * BRICK_VALUES * ours.bricks());
    assert_eq!(saved, twin.widened().memory_bytes() - ours.memory_bytes());
    for x in -REACH - 1..=REACH {
        for y in -REACH - 1..=REACH {
            for z in -REACH - 1..=REACH {
                let v = IVec3::new(x, y, z);
                let at = v - ours.origin();
                let inside = v.cmpge(IVec3::splat(-REACH)) & v.cmplt(IVec3::splat(REACH));
                let told = if inside.all() { rounded(v) } else { 0.0 };
                assert_eq!(ours.voxel(at).to_bits(), told.to_bits(), "{v}");
                assert_eq!(twin.voxel(at).to_bits(), told.to_bits(), "twin at {v}");
            }
        }
    }
    let min = Vec3::splat(-REACH as f32) - ours.origin().as_vec3();
    let max = min + 2.0 * REACH as f32;
    let walked = compare("twin", &ours, &twin, min, max, &mut rng(21));
    let support = ours.support();
    let wide = ours.widened();
    assert_eq!(wide.value_bits(), 32);
    assert_eq!(wide.memory_bytes(), twin.memory_bytes());
    compare(
        "widened",
        &ours,
        &wide,
        support.min,
        support.max,
        &mut rng(22),
    );
    println!("{walked} pieces walked, {} bricks", ours.bricks());
}

#[test]
fn every_half_of_a_density_is_kept() {
    let edge = 40;
    // All 31,744 finite bit patterns of densities, subnormals and 65504 among them.
    let finite: Vec<f32> = (0..=u16::MAX)
        .map(f16::from_bits)
        .filter(|v| v.is_finite() && v.is_sign_positive())
        .map(f16::to_f32)
        .collect();
    assert_eq!(finite.len(), 31_744);
    let value = |v: IVec3| finite[((v.x * edge + v.y) * edge + v.z) as usize % finite.len()];
    let high = IVec3::splat(edge - 1);
    let grid = grid(IVec3::ZERO, high, value);
    assert_eq!(grid.value_bits(), 16);
    for x in 0..edge {
        for y in 0..edge {
            for z in 0..edge {
                let v = IVec3::new(x, y, z);
                let kept = grid.voxel(v - grid.origin());
                assert_eq!(kept.to_bits(), value(v).to_bits(), "{v}");
            }
        }
    }
    assert_eq!(grid.range(), [0.0, 65504.0]);
}

#[test]
fn one_value_of_more_bits_keeps_all_in_32() {
    let least = f16::MIN_POSITIVE_SUBNORMAL.to_f32();
    let beyond = 39f32.exp2();
    let greatest = 65504.0 / 65536.0 * beyond;
    let high = IVec3::splat(30);
    // One voxel of 30,000, in the first brick, the last, or one between and in others' aprons.
    let with =
        |odd: f32, at: IVec3| grid(IVec3::ZERO, high, move |v| if v == at { odd } else { 1.0 });
    for odd in [
        0.1,
        1.0 + 0.5 * f16::EPSILON.to_f32(),
        0.5 * least,
        f32::MIN_POSITIVE,
        -1.0,
        -least,
        65505.0,
        65520.0,
        beyond,
        1e30,
        -1e30,
        f32::INFINITY,
    ] {
        for at in [IVec3::ZERO, high, IVec3::new(7, 8, 15)] {
            let grid = with(odd, at);
            assert_eq!(grid.value_bits(), 32, "{odd:e}");
            let kept = grid.voxel(at - grid.origin());
            assert_eq!(kept.to_bits(), odd.to_bits(), "{odd:e}");
        }
    }
    for even in [least, 1.5 * least, 65504.0, greatest, 0.0, 0.5] {
        let grid = with(even, high);
        assert_eq!(grid.value_bits(), 16, "{even:e}");
        let kept = grid.voxel(high - grid.origin());
        assert_eq!(kept.to_bits(), even.to_bits(), "{even:e}");
    }
    // The sign of 0 is let go.
    let grid = with(-0.0, high);
    assert_eq!(grid.value_bits(), 16);
    assert_eq!(grid.voxel(high - grid.origin()).to_bits(), 0);
}

#[test]
fn real_volumes_are_the_same_in_either() {
    let mut random = rng(23);
    let grids = real();
    let mut halves = 0;
    for (name, grid) in &grids {
        if grid.bricks() == 0 || grid.value_bits() == 32 {
            continue;
        }
        halves += 1;
        let support = grid.support();
        let wide = grid.widened();
        assert!(wide.memory_bytes() > grid.memory_bytes(), "{name}");
        compare(name, grid, &wide, support.min, support.max, &mut random);
    }
    println!("{halves} of {} grids are kept in 16 bits", grids.len());
    assert!(
        halves > 0 || grids.is_empty(),
        "some files hold 16-bit floats"
    );
}
