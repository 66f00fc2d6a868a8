//! Rays against a mesh of 51 thousand triangles: ours, and obvhs with its own tests.
//!
//! Directions are random, so rays share nothing: the worst case of a renderer.

use std::path::Path;
use std::time::Duration;

use divan::Bencher;
use divan::counter::ItemsCount;
use glam::{DAffine3, DVec3, Vec3};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use vpm_vdb::scene::{Material, Object, Rgb, Shape};
use vpm_vdb::surface::{Mesh, Surfaces};

const RAYS: usize = 20_000;

fn main() {
    divan::main();
}

fn file() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/bust.ply")
}

fn surfaces() -> Surfaces {
    let bust = Object {
        name: "bust".into(),
        shape: Shape::Mesh { file: file() },
        transform: DAffine3::IDENTITY,
        material: Material::Diffuse {
            reflectance: Rgb::ONE,
            texture: None,
        },
        interior: None,
    };
    Surfaces::build(&[bust], DVec3::ZERO).expect("the mesh is part of the repository")
}

fn stock() -> (CwBvh, Vec<Triangle>) {
    let mesh = Mesh::load(&file()).expect("the mesh is part of the repository");
    let triangles: Vec<Triangle> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [v0, v1, v2] = t.map(|i| mesh.positions[i as usize].as_vec3a());
            Triangle { v0, v1, v2 }
        })
        .collect();
    let mut params = BvhBuildParams::slow_build();
    params.pre_split = false;
    let tree = build_cwbvh_from_tris(&triangles, params, &mut Duration::default());
    let ordered = tree
        .primitive_indices
        .iter()
        .map(|&i| triangles[i as usize])
        .collect();
    (tree, ordered)
}

/// Rays from a sphere around the bust towards points in its box.
fn rays() -> Vec<(Vec3, Vec3)> {
    let mut state = 1_u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u32 << 24) as f32
    };
    (0..RAYS)
        .map(|_| {
            let mut point = || Vec3::new(uniform() - 0.5, uniform() - 0.5, uniform() - 0.5);
            let center = Vec3::new(0.0, 0.3, 0.0);
            let origin = center + 2.0 * point().normalize();
            let target = center + point() * Vec3::new(0.35, 0.6, 0.24);
            (origin, (target - origin).normalize())
        })
        .collect()
}

#[divan::bench]
fn nearest_ours(bencher: Bencher<'_, '_>) {
    let (surfaces, rays) = (surfaces(), rays());
    bencher.counter(ItemsCount::new(RAYS)).bench(|| {
        rays.iter()
            .filter(|(o, d)| surfaces.intersect(*o, *d, f32::INFINITY).is_some())
            .count()
    });
}

#[divan::bench]
fn nearest_stock(bencher: Bencher<'_, '_>) {
    let ((tree, triangles), rays) = (stock(), rays());
    bencher.counter(ItemsCount::new(RAYS)).bench(|| {
        rays.iter()
            .filter(|(o, d)| {
                let ray = Ray::new_inf((*o).into(), (*d).into());
                tree.ray_traverse(ray, &mut RayHit::none(), |ray, id| {
                    triangles[id].intersect(ray)
                })
            })
            .count()
    });
}

#[divan::bench]
fn occluded_ours(bencher: Bencher<'_, '_>) {
    let (surfaces, rays) = (surfaces(), rays());
    bencher.counter(ItemsCount::new(RAYS)).bench(|| {
        rays.iter()
            .filter(|(o, d)| surfaces.occluded(*o, *d, f32::INFINITY))
            .count()
    });
}

#[divan::bench]
fn occluded_stock(bencher: Bencher<'_, '_>) {
    let ((tree, triangles), rays) = (stock(), rays());
    bencher.counter(ItemsCount::new(RAYS)).bench(|| {
        rays.iter()
            .filter(|(o, d)| {
                let ray = Ray::new_inf((*o).into(), (*d).into());
                !tree.ray_traverse_miss(ray, |ray, id| triangles[id].intersect(ray))
            })
            .count()
    });
}

#[divan::bench]
fn build() -> Surfaces {
    surfaces()
}
