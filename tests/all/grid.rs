//! The grid against brute force: what the tree says at every voxel, trilinear between.

use std::collections::HashMap;
use std::path::Path;

use glam::{DAffine3, DVec3, IVec3, Vec3};

use vpm_vdb::grid::build::{BuildError, Tile, Topology};
use vpm_vdb::grid::flights::FlightGrid;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::{BRICK_VALUES, Brick, Grid, corner_index};
use vpm_vdb::info::{self, InfoOptions};
use vpm_vdb::rng::Rng;
use vpm_vdb::scene::Convert;
use vpm_vdb::vdb::{Archive, GridClass};

use vpm_vdb::selftest::bounds::{LERP_ROUNDING, point, violations};

use crate::fields::{generated, noise, patchy, real, rng, unit};
use crate::stats::{Welford, z_bound};
use crate::vdb_files;

/// A tree, read voxel by voxel in OpenVDB's order: leaf, finest tile, background in its box.
struct Tree {
    topology: Topology,
    leaves: HashMap<[i32; 3], usize>,
}

/// Values of a leaf, by its number: noise, or constant for every fourth.
fn leaf_value(leaf: usize, voxel: IVec3) -> f32 {
    match leaf % 4 {
        3 => 0.25,
        _ => noise(voxel, leaf as u32),
    }
}

impl Tree {
    fn new(background: f32, tiles: Vec<Tile>, leaves: Vec<IVec3>, active: [IVec3; 2]) -> Self {
        let index = leaves.iter().enumerate();
        Self {
            leaves: index.map(|(i, l)| (l.to_array(), i)).collect(),
            topology: Topology {
                background,
                tiles,
                leaves,
                active: Some(active),
                index_to_world: DAffine3::from_scale(DVec3::splat(0.1)),
            },
        }
    }

    fn build(&self) -> Grid {
        let leaves = &self.topology.leaves;
        Grid::build::<BuildError>(&self.topology, |values| {
            for (i, brick) in values.chunks_mut(BRICK_VALUES).enumerate() {
                for n in 0..512 {
                    let v = IVec3::new(n >> 6, n >> 3 & 7, n & 7);
                    brick[corner_index(v)] = leaf_value(i, leaves[i] + v);
                }
            }
            Ok(())
        })
        .expect("a small grid can be built")
    }

    /// Value of an index voxel.
    fn value(&self, voxel: IVec3) -> f32 {
        let topology = &self.topology;
        if let (true, Some([a, b])) = (topology.background != 0.0, topology.active)
            && (voxel.cmplt(a).any() || voxel.cmpgt(b).any())
        {
            return 0.0;
        }
        if let Some(leaf) = self.leaves.get(&((voxel >> 3i32) << 3i32).to_array()) {
            return leaf_value(*leaf, voxel);
        }
        topology
            .tiles
            .iter()
            .filter(|t| (voxel >> (t.log2_size as i32)) == (t.origin >> t.log2_size as i32))
            .min_by_key(|t| t.log2_size)
            .map_or(topology.background, |t| t.value)
    }

    /// Trilinear at an index point, and the largest corner.
    fn at(&self, p: DVec3) -> (f64, f64) {
        let floor = p.floor();
        let f = p - floor;
        let (mut sum, mut largest) = (0.0, 0.0f64);
        for i in 0..8 {
            let c = IVec3::new(i >> 2, i >> 1 & 1, i & 1);
            let w = |up: i32, f: f64| if up == 1 { f } else { 1.0 - f };
            let v = f64::from(self.value(floor.as_ivec3() + c));
            sum += v * w(c.x, f.x) * w(c.y, f.y) * w(c.z, f.z);
            largest = largest.max(v.abs());
        }
        (sum, largest)
    }
}

fn tile(origin: [i32; 3], log2_size: u32, value: f32) -> Tile {
    Tile {
        origin: origin.into(),
        log2_size,
        value,
    }
}

/// Leaves and tiles of all sizes on both sides of 0, touching at faces, edges and corners.
fn trees() -> Vec<(&'static str, Tree)> {
    let leaves: Vec<IVec3> = [
        [0, 0, 0],
        [8, 0, 0],
        [8, 8, 0],
        [16, 16, 16],
        [-8, -8, -8],
        [-16, 0, 0],
        [-136, 0, 0],
        [120, 120, 120],
        [128, 120, 120],
        [40, 40, 40],
        [40, 40, 56],
        [-128, -128, 248],
    ]
    .map(IVec3::from)
    .to_vec();
    let small = vec![
        tile([24, 24, 24], 3, 0.5),
        tile([48, 40, 40], 3, 0.3),
        tile([0, 0, 8], 3, 0.25),
        tile([-8, 0, 0], 3, 1.5),
        tile([200, 0, 0], 3, 0.9),
    ];
    let mut large = small.clone();
    large.push(tile([128, 0, -128], 7, 0.6));
    large.push(tile([-256, -128, 0], 7, 0.2));
    large.push(tile([-256, -128, 128], 7, 0.2));
    let mut huge = large.clone();
    huge.push(tile([0, 0, 0], 12, 0.7));
    huge.push(tile([-4096, 0, 0], 12, 0.35));
    let wide = [IVec3::new(-300, -200, -200), IVec3::new(300, 200, 300)];
    let odd = [IVec3::new(-131, -13, -140), IVec3::new(213, 131, 77)];
    vec![
        (
            "leaves and small tiles",
            Tree::new(0.0, small.clone(), leaves.clone(), wide),
        ),
        (
            "tiles of 128",
            Tree::new(0.0, large.clone(), leaves.clone(), wide),
        ),
        (
            "a background in its box",
            Tree::new(0.4, small, leaves.clone(), odd),
        ),
        (
            "a background around tiles of 128",
            Tree::new(0.4, large, leaves.clone(), odd),
        ),
        (
            "tiles of 4096 cut by the active box",
            Tree::new(0.4, huge, leaves, odd),
        ),
    ]
}

/// Large constant regions whose faces would take millions of bricks of their own.
fn vast() -> Vec<(&'static str, Tree)> {
    let all = [IVec3::splat(-8192), IVec3::splat(8191)];
    // A leaf against a face, one against an edge, one inside the tile.
    let leaves = [[-8, 40, 40], [4096, 4096, 16], [2048, 0, 4088]].map(IVec3::from);
    let chequered = (0..512)
        .filter(|i| (i ^ (i >> 3) ^ (i >> 6)) & 1 == 0)
        .map(|i| tile([(i >> 6) * 128, (i >> 3 & 7) * 128, (i & 7) * 128], 7, 0.8))
        .collect();
    let cut = [IVec3::splat(-77), IVec3::new(4111, 4096, 4099)];
    vec![
        (
            "a tile of 4096",
            Tree::new(0.0, vec![tile([0, 0, 0], 12, 0.7)], Vec::new(), all),
        ),
        (
            "a tile of 4096 and leaves",
            Tree::new(0.0, vec![tile([0, 0, 0], 12, 0.7)], leaves.to_vec(), all),
        ),
        (
            "a tile of 4096 in a background in its box",
            Tree::new(0.4, vec![tile([0, 0, 0], 12, 0.7)], leaves.to_vec(), cut),
        ),
        (
            "tiles of 128 by turns",
            Tree::new(0.0, chequered, Vec::new(), all),
        ),
    ]
}

/// A local point within two voxels of a face of a box, on two of them every third time.
fn on_a_face(low: Vec3, high: Vec3, rng: &mut Rng) -> Vec3 {
    let mut p = point(low, high, rng);
    for _ in 0..=rng.below(3) / 2 {
        let axis = rng.below(3) as usize;
        let face = if rng.below(2) == 0 { low } else { high };
        p[axis] = face[axis] + 4.0 * rng.uniform() - 2.0;
    }
    p
}

#[test]
fn lookup_is_trilinear_in_the_values_of_the_tree() {
    let mut random = rng(1);
    for (name, tree) in trees().into_iter().chain(vast()) {
        let grid = tree.build();
        let support = grid.support();
        let origin = grid.origin();
        let mut near: Vec<IVec3> = tree.topology.leaves.clone();
        near.extend(tree.topology.tiles.iter().map(|t| t.origin));
        let mut cursor = grid.cursor();
        for i in 0..200_000 {
            let p = if i % 4 == 0 {
                on_a_face(support.min, support.max, &mut random)
            } else if i % 2 == 0 || near.is_empty() {
                point(support.min - 9.0, support.max + 9.0, &mut random)
            } else {
                let corner = near[random.below(near.len() as u32) as usize] - origin;
                point(corner.as_vec3() - 9.0, corner.as_vec3() + 17.0, &mut random)
            };
            let (exact, largest) = tree.at(p.as_dvec3() + origin.as_dvec3());
            let found = f64::from(grid.lookup(p));
            assert!(
                (found - exact).abs() <= LERP_ROUNDING * largest,
                "{name}: {found} at local {p}, exactly {exact}"
            );
            assert_eq!(
                f64::from(cursor.lookup(p)),
                found,
                "{name}: a cursor at {p}"
            );
            let voxel = p.floor().as_ivec3();
            assert_eq!(
                grid.voxel(voxel),
                tree.value(voxel + origin),
                "{name}: voxel {voxel}"
            );
        }
    }
}

/// 1.6 million bricks on the faces of a tile of 4096^3 voxels (4.6 GB if each were stored), in
/// 6144 tables (100 MB): what they share fits in a few megabytes, bounds included.
#[test]
fn faces_of_large_tiles_share_their_bricks() {
    for (name, tree) in vast() {
        let grid = tree.build();
        let majorants = MajorantGrid::new(&grid, 1.0, 1.0);
        let flights = FlightGrid::new(&grid, 1.0, 1.0);
        let field = grid.memory_bytes();
        let bounds = majorants.memory_bytes() + flights.memory_bytes();
        println!(
            "{name}: {} bricks, {field} B, bounds {bounds} B",
            grid.bricks()
        );
        assert!(grid.bricks() < 2000, "{name}: {} bricks", grid.bricks());
        assert!(
            field + bounds < 8 << 20,
            "{name}: {field} B, bounds {bounds} B"
        );
    }
}

#[test]
fn from_fn_is_the_function_inside_its_box_and_0_outside() {
    let (min, max) = (IVec3::new(-13, -1, 5), IVec3::new(29, 20, 140));
    let grid = crate::fields::grid(min, max, patchy);
    for x in min.x - 3..=max.x + 3 {
        for y in min.y - 3..=max.y + 3 {
            for z in min.z - 3..=max.z + 3 {
                let v = IVec3::new(x, y, z);
                let inside = v.cmpge(min).all() && v.cmple(max).all();
                let expected = if inside { patchy(v) } else { 0.0 };
                assert_eq!(grid.voxel(v - grid.origin()), expected, "voxel {v}");
            }
        }
    }
}

/// The support is the box of all cells with a corner that is not 0, and no larger.
#[test]
fn support_is_the_smallest_box_of_cells_that_are_not_0() {
    for (name, tree) in trees() {
        let grid = tree.build();
        let topology = &tree.topology;
        let [a, b] = topology.active.expect("there is an active box");
        let filled = |axis: usize, at: i32| {
            let (u, w) = ((axis + 1) % 3, (axis + 2) % 3);
            (a[u]..=b[u]).any(|i| {
                (a[w]..=b[w]).any(|j| {
                    let mut v = IVec3::ZERO;
                    (v[axis], v[u], v[w]) = (at, i, j);
                    tree.value(v) != 0.0
                })
            })
        };
        let low = IVec3::from_array([0, 1, 2].map(|axis| {
            let found = (a[axis]..=b[axis]).find(|at| filled(axis, *at));
            found.expect("something is there")
        }));
        let high = IVec3::from_array([0, 1, 2].map(|axis| {
            let found = (a[axis]..=b[axis]).rev().find(|at| filled(axis, *at));
            found.expect("something is there")
        }));
        let support = grid.support();
        let expected = [
            low - IVec3::ONE - grid.origin(),
            high + IVec3::ONE - grid.origin(),
        ];
        assert_eq!(
            [support.min, support.max],
            expected.map(|v| v.as_vec3()),
            "{name}"
        );
    }
}

#[test]
fn one_tap_is_trilinear_in_expectation() {
    let grid = crate::fields::grid(IVec3::splat(-20), IVec3::splat(20), patchy);
    let support = grid.support();
    let mut random = rng(2);
    let (points, taps) = (400, 2000);
    let bound = z_bound(points);
    let mut worst = 0.0f64;
    for _ in 0..points {
        let p = point(support.min, support.max, &mut random);
        let mean: Welford = (0..taps)
            .map(|_| f64::from(grid.lookup_one_tap(p, unit(&mut random))))
            .collect();
        let exact = crate::fields::trilinear(&grid, p.as_dvec3());
        let z = mean.z(exact, 1e-7);
        worst = worst.max(z.abs());
        assert!(
            z.abs() < bound,
            "{} +- {} at {p}, exactly {exact}",
            mean.mean(),
            mean.standard_error()
        );
    }
    println!("one tap: worst |z| {worst:.2} of {points}, bound {bound:.2}");
}

/// No look-up lies outside the bounds of its cell.
fn check_bounds(name: &str, grid: &Grid, sigma: f32, points: u32, random: &mut Rng) {
    let faults = violations(name, grid, sigma, points, random);
    assert_eq!(faults.figure, 0.0, "{name}: {}", faults.place);
}

#[test]
fn bounds_hold_on_trees() {
    let mut random = rng(3);
    for (name, tree) in trees().into_iter().chain(vast()) {
        check_bounds(name, &tree.build(), 0.1, 40_000, &mut random);
    }
}

/// Bounds on every density of the real volumes, `points` each.
fn on_real_volumes(points: u32) {
    let mut random = rng(4);
    let grids = real();
    for (name, grid) in &grids {
        check_bounds(name, grid, 0.3, points, &mut random);
    }
    println!(
        "bounds held at {points} points of each of {} real grids",
        grids.len()
    );
}

#[test]
fn bounds_hold_on_real_volumes() {
    on_real_volumes(30_000);
}

#[test]
#[ignore = "ten million points on every real volume: minutes"]
fn bounds_hold_at_ten_million_points_of_every_real_volume() {
    on_real_volumes(10_000_000);
}

/// A brick is stored or constant, its range is that of its 9^3 values, and those are the voxels.
#[test]
fn bricks_hold_their_voxels_and_aprons() {
    for (name, grid) in generated() {
        let high = (grid.support().max.as_ivec3() >> 3i32) + IVec3::ONE;
        for x in -1..=high.x {
            for y in -1..=high.y {
                for z in -1..=high.z {
                    let brick = IVec3::new(x, y, z);
                    let [low, top] = grid.brick_range(brick);
                    let (mut least, mut most) = (f32::MAX, f32::MIN);
                    for n in 0..BRICK_VALUES as i32 {
                        let v = IVec3::new(n / 81, n / 9 % 9, n % 9);
                        let value = match grid.brick(brick) {
                            Brick::Constant(value) => value,
                            Brick::Values(values) => values.at(v),
                        };
                        assert_eq!(value, grid.voxel(brick * 8 + v), "{name}: {brick} {v}");
                        (least, most) = (least.min(value), most.max(value));
                    }
                    assert_eq!([least, most], [low, top], "{name}: range of {brick}");
                }
            }
        }
    }
}

/// `info` says what grids take: the field to the byte, its bounds within 10 % of the whole where
/// the medium is so dense that none merge, never too little.
#[test]
fn info_tells_the_memory_of_rendering() {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes");
    let folders = [vdb_files::folder("real"), own.is_dir().then_some(own)];
    let mut compared = 0;
    for path in folders
        .iter()
        .flatten()
        .flat_map(|f| vdb_files::vdb_files(f))
    {
        let options = InfoOptions {
            json: true,
            ..InfoOptions::default()
        };
        let mut out = Vec::new();
        // Files with grids that no renderer reads are told of all the same.
        let _ = info::run(&path, &options, &mut out);
        let told: serde_json::Value = serde_json::from_slice(&out).expect("info prints JSON");
        let archive = Archive::open(&path).expect("the file opens");
        for (header, told) in archive.grids().iter().zip(told.as_array().expect("a list")) {
            let label = header.label();
            let convert = match header.class {
                GridClass::LevelSet => Convert::LevelSet,
                _ => Convert::None,
            };
            let taking = Taking {
                convert,
                strict: false,
            };
            let Ok(loaded) = load_grid(&archive, &path, Some(&label), taking) else {
                assert!(told["memory_bytes"].is_null(), "{label} is not rendered");
                continue;
            };
            let grid = loaded.grid;
            assert_eq!(told["memory_bytes"], grid.memory_bytes(), "{label}");
            assert_eq!(told["brick_value_bits"], grid.value_bits(), "{label}");
            assert_eq!(told["bricks"], grid.bricks(), "{label}");
            let most = told["bounds_bytes_at_most"].as_u64().expect("a number") as f64;
            let bounds = |sigma| {
                let marches = MajorantGrid::new(&grid, sigma, 1.0).memory_bytes();
                (marches + FlightGrid::new(&grid, sigma, 1.0).memory_bytes()) as f64
            };
            let field = grid.memory_bytes() as f64;
            let (dense, thin) = (bounds(1e9), bounds(0.01));
            assert!(most >= thin, "{label}: bounds take {thin} B, told {most} B");
            assert!(
                most >= dense && field + most <= 1.1 * (field + dense),
                "{label}: {field} B and at most {most} B, takes {dense} B"
            );
            let number = |key: &str| told[key].as_f64().unwrap_or(f64::NAN);
            println!(
                "{:32} {label:16} {:7} {:10} {:6.2} {:6.2} {:9} {:9}",
                path.file_stem().unwrap_or_default().to_string_lossy(),
                grid.bricks(),
                grid.memory_bytes(),
                number("memory_per_leaf_value"),
                number("memory_per_active_value"),
                told["leaves"],
                most
            );
            compared += 1;
        }
    }
    println!("{compared} grids");
}
