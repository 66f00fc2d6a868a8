//! Surfaces: leaks, spawned rays, scattering, loading.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};
use vpm_vdb::scene::{Material, Object, Rgb, Shape};
use vpm_vdb::surface::Surfaces;

mod emission;
mod geometry;
mod interiors;
mod loading;
mod scattering;
mod solid;

/// A uniform in [0, 1) with 24 bits.
fn uniform(rng: &mut Xoshiro256PlusPlus) -> f32 {
    (rng.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
}

fn uniforms(rng: &mut Xoshiro256PlusPlus) -> [f32; 3] {
    [uniform(rng), uniform(rng), uniform(rng)]
}

/// A uniform direction.
fn direction(rng: &mut Xoshiro256PlusPlus) -> Vec3 {
    let z = 1.0 - 2.0 * uniform(rng);
    let (sin, cos) = (std::f32::consts::TAU * uniform(rng)).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z).normalize()
}

fn generator(seed: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(seed)
}

const WHITE: Material = Material::Diffuse {
    reflectance: Rgb::ONE,
    texture: None,
};

fn object(shape: Shape, material: Material) -> Object {
    Object {
        name: "thing".into(),
        shape,
        transform: DAffine3::IDENTITY,
        material,
        interior: None,
    }
}

fn ball(center: DVec3, radius: f64) -> Shape {
    Shape::Sphere { center, radius }
}

fn cube(half: f64) -> Shape {
    Shape::Box {
        min: DVec3::splat(-half),
        max: DVec3::splat(half),
    }
}

fn build(objects: &[Object]) -> Surfaces {
    Surfaces::build(objects, DVec3::ZERO).expect("the objects are sound")
}

/// An unremarkable rotation.
fn turned() -> DAffine3 {
    DAffine3::from_quat(DQuat::from_axis_angle(
        DVec3::new(1.0, 2.0, 3.0).normalize(),
        0.7,
    ))
}

/// A transform that stretches, turns and mirrors.
fn mirrored() -> DAffine3 {
    turned() * DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.5, 0.8, 1.1)))
}
