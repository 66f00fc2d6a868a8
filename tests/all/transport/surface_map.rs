//! The estimate from photons on a surface: brute force, and a flat irradiance.

use std::f32::consts::PI;

use glam::{DAffine3, DVec3, Vec3};
use vpm_vdb::photon::surface::{SurfaceGather, SurfaceMap, SurfacePhoton, SurfaceRadius};
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::{Material, Object, Rgb, Shape};
use vpm_vdb::surface::Surfaces;

/// Photons of irradiance 1 on the square [-1, 1]^2 in the plane z = 0, and as many below it.
fn photons(n: u32, stream: u64) -> Vec<SurfacePhoton<f32>> {
    let mut rng = Rng::stream(11, Stage::Check, 0, stream);
    (0..2 * n)
        .map(|i| {
            let side = if i < n { 1.0 } else { -1.0 };
            SurfacePhoton {
                position: Vec3::new(2.0 * rng.uniform() - 1.0, 2.0 * rng.uniform() - 1.0, 0.0),
                normal: Vec3::Z * side,
                direction: Vec3::new(0.6, 0.0, -0.8 * side),
                power: 4.0 / n as f32,
            }
        })
        .collect()
}

fn floor() -> Surfaces {
    let object = Object {
        name: "floor".to_owned(),
        shape: Shape::Quad {
            corner: DVec3::new(-1.0, -1.0, 0.0),
            edge_u: DVec3::X * 2.0,
            edge_v: DVec3::Y * 2.0,
        },
        transform: DAffine3::IDENTITY,
        material: Material::Diffuse {
            reflectance: Rgb::splat(0.5),
            texture: None,
        },
        interior: None,
    };
    Surfaces::build(&[object], DVec3::ZERO).expect("a floor")
}

#[test]
fn the_tree_finds_what_a_list_finds() {
    let (surfaces, all) = (floor(), photons(3000, 0));
    let radius = SurfaceRadius::new(Vec::new(), 50.0, 1.0, [0.2, 0.2]);
    let gather = SurfaceGather {
        map: SurfaceMap::new(all.clone()),
        radius: &radius,
        scale: 0.5,
    };
    // Sheets have no ends that are found: sums are plain even at the border.
    for p in [
        Vec3::ZERO,
        Vec3::new(0.97, -0.3, 0.0),
        Vec3::new(-0.5, 0.99, 0.0),
    ] {
        let hit = surfaces
            .intersect(p + Vec3::Z, Vec3::NEG_Z, 2.0)
            .expect("floor");
        let (l, count) = gather.radiance((&surfaces, &hit), &surfaces.bsdf(&hit), Vec3::Z, 0.3);
        let (mut sum, mut found) = (0.0f64, 0);
        for photon in &all {
            let x = photon.position.distance_squared(hit.position) / 0.01;
            if x < 1.0 && photon.normal.z > 0.0 {
                sum += f64::from(0.5 / PI * photon.power * (1.0 - x).powi(2));
                found += 1;
            }
        }
        let expected = sum * 3.0 / (std::f64::consts::PI * 0.01);
        assert_eq!(count, found, "photons at {p}");
        assert!(
            (f64::from(l) / expected - 1.0).abs() < 1e-4,
            "{l}, {expected}"
        );
    }
}

#[test]
fn a_flat_irradiance_is_found_inside() {
    // L = rho E / pi, away from the border. The radius comes from pilots for 50 photons.
    let surfaces = floor();
    let radius = SurfaceRadius::new(photons(2000, 1), 50.0, 20.0, [1e-4, 0.2]);
    let gather = SurfaceGather {
        map: SurfaceMap::new(photons(40_000, 2)),
        radius: &radius,
        scale: 1.0,
    };
    let mut rng = Rng::stream(12, Stage::Check, 0, 0);
    let (mut sum, mut squares, mut counts) = (0.0f64, 0.0f64, 0);
    let n = 2000;
    for _ in 0..n {
        let p = Vec3::new(rng.uniform() - 0.5, rng.uniform() - 0.5, 1.0);
        let hit = surfaces.intersect(p, Vec3::NEG_Z, 2.0).expect("floor");
        let (l, count) = gather.radiance((&surfaces, &hit), &surfaces.bsdf(&hit), Vec3::Z, 0.3);
        let relative = f64::from(l * PI / 0.5);
        sum += relative;
        squares += relative * relative;
        counts += count;
    }
    let n = f64::from(n);
    let (mean, per_point) = (sum / n, counts as f64 / n);
    let deviation = (squares / n - mean * mean).sqrt();
    println!("mean {mean:.4}, deviation {deviation:.3}, photons {per_point:.1}");
    // Discs hold some 50 of the 10000 photons here: about 200 independent ones.
    assert!(
        (mean - 1.0).abs() < 4.0 * deviation / 200f64.sqrt(),
        "{mean}"
    );
    assert!((35.0..75.0).contains(&per_point), "{per_point} photons");
}
