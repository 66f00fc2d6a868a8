//! Boxes that hold the inside of an object, and where photons are deposited for it.

use std::path::Path;

use glam::{DVec3, Vec3};
use vpm_vdb::photon::deposit::DepositRate;
use vpm_vdb::ray::Bounds;
use vpm_vdb::scene::{Material, Object, Optics, Phase, Rgb, Shape};
use vpm_vdb::surface::{Inside, Surfaces};
use vpm_vdb::world::World;

use super::{ball, build, cube, generator, mirrored, object, uniforms};
use crate::fields::scene;

fn solids() -> Vec<(&'static str, Object)> {
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/bust.ply");
    let mut stretched = object(ball(DVec3::new(0.2, 0.0, 0.0), 0.5), Material::Interface);
    stretched.transform = mirrored();
    let shapes = [
        ("ball", object(ball(DVec3::ZERO, 0.4), Material::Interface)),
        ("stretched ball", stretched),
        ("cube", object(cube(0.3), Material::Interface)),
        (
            "bust",
            object(Shape::Mesh { file: mesh }, Material::Interface),
        ),
    ];
    shapes
        .map(|(name, mut object)| {
            object.interior = Some(Optics {
                extinction: Rgb::splat(500.0),
                albedo: Rgb::splat(0.9),
                phase: Phase::Isotropic,
            });
            (name, object)
        })
        .into()
}

/// Points in and around an object's box, and whether they are inside.
fn points(surfaces: &Surfaces, count: usize) -> Vec<(Vec3, bool)> {
    let mut rng = generator(71);
    let (min, max) = surfaces.object_bounds(0);
    (0..count)
        .map(|_| {
            let u = Vec3::from(uniforms(&mut rng)) * 1.2 - 0.1;
            let p = min + (max - min) * u;
            (p, surfaces.inside_at(p) != Inside::NOTHING)
        })
        .collect()
}

/// All of the inside lies in the boxes; of a bust they are far less than the box around it.
#[test]
fn boxes_hold_the_inside() {
    for (name, object) in solids() {
        let surfaces = build(&[object]);
        let boxes = surfaces.filled(0);
        let mut inside = 0;
        for (p, is_inside) in points(&surfaces, 4000) {
            if is_inside {
                inside += 1;
                assert!(
                    boxes.iter().any(|b| b.contains(p)),
                    "{name}: {p} is in no box"
                );
            }
        }
        assert!(inside > 500, "{name}: {inside} points inside");
        let volume: f32 = boxes.iter().map(|b| b.size().element_product()).sum();
        let (min, max) = surfaces.object_bounds(0);
        let share = volume / (max - min).element_product();
        if name == "bust" {
            assert!(share < 0.5, "boxes take {share} of the box around a {name}");
        }
    }
}

/// Photons are deposited within a kernel's reach of every point inside, and nowhere far from it.
#[test]
fn deposits_are_kept_where_kernels_reach() {
    for (name, object) in solids() {
        let mut scene = scene(4.0, [8, 8]);
        scene.objects.push(object);
        let world = World::<f32>::new(&scene, Vec::new()).expect("a world");
        let reach = world.parts[0].reach;
        let surfaces = world.surfaces.as_ref().expect("surfaces");
        let rate = DepositRate::new(&world.media, &world.parts);
        let mut rng = generator(72);
        let (mut far, mut kept_far) = (0, 0);
        let all = points(surfaces, 4000);
        let inside: Vec<Vec3> = all.iter().filter(|(_, i)| *i).map(|(p, _)| *p).collect();
        for p in &inside {
            let u = Vec3::from(uniforms(&mut rng)) * 2.0 - 1.0;
            let beside = *p + u.normalize() * (0.999 * reach);
            for p in [*p, beside] {
                assert!(
                    rate.reach(p) == reach,
                    "{name}: {} at {p}, {reach} expected",
                    rate.reach(p)
                );
            }
        }
        let boxes = surfaces.filled(0);
        let (min, max) = surfaces.object_bounds(0);
        let around = world.parts[0].reached();
        // Whole cells are marked.
        let beyond = reach + 0.03 * (max - min).max_element();
        for (p, _) in &all {
            let off = |b: &Bounds| p.clamp(b.min, b.max).distance(*p);
            if around.contains(*p) && boxes.iter().all(|b| off(b) > beyond) {
                far += 1;
                kept_far += u32::from(rate.reach(*p) > 0.0);
            }
        }
        assert!(
            kept_far == 0 && (name != "bust" || far > 500),
            "{name}: deposits at {kept_far} of {far} places far from it"
        );
    }
}
