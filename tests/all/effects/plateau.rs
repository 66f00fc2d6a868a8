//! Grids of one value all over a box, in closed form: which they are, and that nothing of them
//! changes.

use glam::{IVec3, Vec3};

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::medium::{Field, Medium};
use vpm_vdb::ray::Ray;
use vpm_vdb::scene::Convert;
use vpm_vdb::selftest::exact::Depth;
use vpm_vdb::tracking::{Hero, Sampler, sample_free_flight, transmittance};
use vpm_vdb::vdb::Archive;

use crate::fields::{grid, medium, ray_through, rng, unit};
use crate::stats::{ks_p, sidak};
use crate::vdb_files;

/// Boxes of one voxel, flat ones, within a brick, over bricks and tables, far from 0.
fn boxes() -> Vec<(IVec3, IVec3)> {
    let at = IVec3::new;
    vec![
        (at(0, 0, 0), at(0, 0, 0)),
        (at(7, 8, -9), at(7, 8, -9)),
        (at(-3, 4, 5), at(60, 4, 7)),
        (at(1, 1, 1), at(6, 6, 6)),
        (at(0, 0, 0), at(7, 15, 23)),
        (at(-30, -17, 11), at(45, 33, 52)),
        (at(-3, -3, -3), at(150, 140, 30)),
        (at(900_001, -800_003, 5), at(900_040, -799_990, 29)),
    ]
}

/// The same medium, its grid a plateau.
fn closed(open: &Medium<f32>) -> Medium<f32> {
    let Field::Grid(field) = &open.field else {
        panic!("a medium of a grid");
    };
    Medium {
        field: Field::Plateau(Box::new(field.plateau().expect("a plateau"))),
        emission: None,
        ..*open
    }
}

#[test]
fn plateaus_are_found_and_nothing_else_is() {
    for (low, high) in boxes() {
        let plateau = grid(low, high, |_| 0.7)
            .plateau()
            .expect("one value all over a box");
        assert_eq!(plateau.value, 0.7, "value of {low} to {high}");
        let size = plateau.core.size().as_ivec3();
        assert_eq!(size, high - low, "size of {low} to {high}");
    }
    let (low, high) = (IVec3::new(-30, -17, 11), IVec3::new(45, 33, 52));
    let middle = (low + high) / 2;
    let dented = [
        low,
        high,
        middle,
        IVec3::new(low.x, middle.y, middle.z),
        IVec3::new(high.x, high.y, middle.z),
    ];
    for dent in dented {
        for value in [0.0, 0.699_999, 0.8] {
            let other = grid(low, high, |v| if v == dent { value } else { 0.7 });
            assert_eq!(other.plateau(), None, "{value} at {dent}");
        }
    }
    let with_lump = grid(low, high + 9, |v| {
        let inside = v.cmple(high).all();
        if inside || v == high + 9 { 0.7 } else { 0.0 }
    });
    assert_eq!(with_lump.plateau(), None, "a voxel outside the box");
    assert_eq!(grid(low, high, |_| 0.0).plateau(), None, "nothing at all");
}

/// The field, its integral along rays (against f64 sums over voxel cells) and the march's and the
/// tracker's transmittance.
#[test]
fn a_plateau_is_the_field_of_its_grid() {
    let mut rng = rng(5);
    for (low, high) in boxes() {
        let one = grid(low, high, |_| 0.7);
        let open = medium(&one, 0.9f32);
        let plateau = one.plateau().expect("a plateau");
        let support = one.support();
        assert_eq!(plateau.support(), support, "{low} to {high}");
        for _ in 0..2000 {
            let p = support.min + support.size() * unit(&mut rng);
            let (a, b) = (plateau.at(p), one.lookup(p));
            // Products of three ramps, each rounded as the coordinate is.
            let rounding = 8.0 * f32::EPSILON * p.max_element().max(1.0);
            assert!(
                (a - b).abs() <= rounding,
                "{low} to {high} at {p}: {a}, grid {b}"
            );
        }
        let closed = closed(&open);
        for _ in 0..300 {
            let local = ray_through(&one, &mut rng);
            let exact = Depth::new(&one, &local, f64::from(f32::MAX)).total();
            let mut sum = 0.0f64;
            plateau.pieces(&(&local).into(), 0.0, f32::INFINITY, |piece| {
                sum += piece.integral;
                true
            });
            // Ends of pieces are f32, as far from 0 as the ray starts and the box is long.
            let scale = f64::from(local.origin.length() + support.size().length());
            let rounding = 16.0 * f64::from(f32::EPSILON) * scale;
            assert!(
                (sum - exact).abs() <= rounding,
                "{low} to {high}: integral {sum}, exactly {exact}, rounding {rounding:e}"
            );
            let ray = Ray {
                origin: local.origin + one.origin().as_vec3(),
                direction: local.direction,
            };
            if low.abs().max_element() > 1000 {
                // World coordinates without a re-centred origin have lost the voxels.
                continue;
            }
            let mut sampler = Sampler::new(rng.clone());
            let tr = transmittance(
                std::slice::from_ref(&closed),
                &ray,
                f32::INFINITY,
                &mut sampler,
            );
            let wanted = (-0.9 * exact).exp();
            assert!(
                (f64::from(tr) - wanted).abs() <= rounding + 1e-6,
                "{low} to {high}: transmittance {tr}, exactly {wanted}"
            );
            assert_eq!(sampler.counters.density_lookups, 0, "no look-ups");
        }
    }
}

/// exp(-tau) of the distances is uniform, where rays that get through take the rest.
#[test]
fn free_flights_through_a_plateau_follow_its_optical_depth() {
    let mut rng = rng(6);
    let one = grid(IVec3::new(2, 3, 1), IVec3::new(21, 9, 30), |_| 0.7);
    let closed = [closed(&medium(&one, 0.2f32))];
    let mut uniforms = Vec::new();
    for _ in 0..20_000 {
        let local = ray_through(&one, &mut rng);
        let ray = Ray {
            origin: local.origin + one.origin().as_vec3(),
            ..local
        };
        let exact = Depth::new(&one, &local, 1e6);
        let mut sampler = Sampler::new(rng.clone());
        rng.uniform();
        let mut hero = Hero::choose(&mut sampler.rng);
        let hit = sample_free_flight(&closed, &ray, f32::INFINITY, &mut hero, &mut sampler);
        assert_eq!(sampler.counters.density_lookups, 0, "no look-ups");
        let through = (-f64::from(0.2f32) * exact.total()).exp();
        uniforms.push(match hit {
            Some(hit) => (-f64::from(0.2f32) * exact.at(f64::from(hit.t))).exp(),
            None => through * f64::from(rng.uniform()),
        });
    }
    let p = ks_p(&mut uniforms);
    println!("KS p {p:.3}");
    assert!(p > sidak(1), "free flights: p = {p:e}");
}

/// Files of the OpenVDB library: those of one value are plateaus, and equal their grids.
#[test]
fn files_of_one_value_are_plateaus() {
    let Some(folder) = vdb_files::folder("corpus") else {
        return;
    };
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let mut rng = rng(7);
    let mut found = Vec::new();
    for path in vdb_files::vdb_files(&folder) {
        let Ok(archive) = Archive::open(&path) else {
            continue;
        };
        for header in archive.grids() {
            let Ok(loaded) = load_grid(&archive, &path, Some(&header.label()), taking) else {
                continue;
            };
            let one: Grid = loaded.grid;
            let Some(plateau) = one.plateau() else {
                continue;
            };
            let support = one.support();
            for _ in 0..500 {
                let p = support.min + support.size() * unit(&mut rng);
                let gap = (plateau.at(p) - one.lookup(p)).abs();
                let rounding = 8.0 * f32::EPSILON * p.max_element().max(1.0) * plateau.value.abs();
                assert!(gap <= rounding, "{} at {p}: {gap}", path.display());
            }
            let middle = 0.5 * (support.min + support.max);
            assert!(
                one.lookup(middle.max(Vec3::ZERO)) > 0.0,
                "{}",
                path.display()
            );
            let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            found.push(stem.unwrap_or_default());
        }
    }
    println!("{found:?}");
    let expected = ["single_voxel", "constant_leaf"];
    for name in expected {
        assert!(
            found.iter().any(|f| f.starts_with(name)),
            "{name} is one: {found:?}"
        );
    }
    for name in ["random_values", "fog_default"] {
        assert!(!found.iter().any(|f| f.starts_with(name)), "{name} is none");
    }
}
