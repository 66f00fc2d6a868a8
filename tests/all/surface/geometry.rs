//! Where rays go: no leaks, no acne, right sides, right distances.

use glam::{DAffine3, DVec3, Vec3};
use vpm_vdb::scene::{Material, Object, Shape};
use vpm_vdb::surface::Surfaces;

use super::{WHITE, ball, build, cube, direction, generator, mirrored, object, turned, uniform};

const RAYS: u32 = 200_000;

fn sphere_mesh(radius: f64) -> (tempfile::TempDir, Shape) {
    // Latitude bands, so that many slivers meet at the poles.
    use std::fmt::Write;
    let (rows, columns) = (24, 36);
    let mut text = String::new();
    writeln!(text, "v 0 {radius} 0").expect("strings take everything");
    for row in 1..rows {
        let (y, r) = {
            let (sin, cos) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
            (radius * cos, radius * sin)
        };
        for column in 0..columns {
            let (sin, cos) =
                (std::f64::consts::TAU * f64::from(column) / f64::from(columns)).sin_cos();
            writeln!(text, "v {} {y} {}", r * cos, -r * sin).expect("strings take everything");
        }
    }
    writeln!(text, "v 0 {} 0", -radius).expect("strings take everything");
    let at = |row: i32, column: i32| {
        if row == 0 {
            1
        } else if row == rows {
            2 + (rows - 1) * columns
        } else {
            2 + (row - 1) * columns + column % columns
        }
    };
    for row in 0..rows {
        for c in 0..columns {
            let (a, b, d, e) = (
                at(row, c),
                at(row + 1, c),
                at(row + 1, c + 1),
                at(row, c + 1),
            );
            if row + 1 < rows {
                writeln!(text, "f {a} {b} {d}").expect("strings take everything");
            }
            if row > 0 {
                writeln!(text, "f {a} {d} {e}").expect("strings take everything");
            }
        }
    }
    let folder = tempfile::tempdir().expect("a scratch folder");
    let file = folder.path().join("sphere.obj");
    std::fs::write(&file, text).expect("the scratch folder is writable");
    (folder, Shape::Mesh { file })
}

fn closed_shapes() -> (Vec<tempfile::TempDir>, Vec<Object>) {
    let (folder, mesh) = sphere_mesh(1.0);
    let mut objects = vec![
        object(cube(1.0), WHITE),
        object(ball(DVec3::ZERO, 1.0), WHITE),
        object(mesh, WHITE),
    ];
    for i in 0..3 {
        let mut copy = objects[i].clone();
        copy.transform = mirrored();
        objects.push(copy);
    }
    (vec![folder], objects)
}

#[test]
fn closed_meshes_do_not_leak() {
    // From inside, every ray must hit, and hit a back side; aimed at vertices and edges as well
    // as anywhere, from generic points and from the exact middle.
    let (_folders, objects) = closed_shapes();
    let mut rng = generator(1);
    for (i, object) in objects.iter().enumerate() {
        let surfaces = build(std::slice::from_ref(object));
        for ray in 0..RAYS {
            let origin = match ray % 4 {
                0 => Vec3::ZERO,
                1 => Vec3::new(0.0, 0.25, 0.0),
                _ => 0.3 * direction(&mut rng),
            };
            let mut d = direction(&mut rng);
            if ray % 3 == 0 {
                // Axis-aligned components hit edges and vertices exactly.
                d = d.signum() * (d.abs() * 2.0).round();
                if d == Vec3::ZERO {
                    d = Vec3::X;
                }
                d = d.normalize();
            }
            let hit = surfaces.intersect(origin, d, f32::INFINITY);
            let hit = hit.unwrap_or_else(|| panic!("object {i}: {origin} -> {d} leaks"));
            assert!(!hit.front, "object {i}: {origin} -> {d} met the front");
            assert!(
                surfaces.occluded(origin, d, f32::INFINITY),
                "object {i} lets light out"
            );
        }
    }
}

#[test]
fn spawned_rays_leave_from_1e_minus_3_to_1e6_metres() {
    // From a hit, into the inside: one more hit, on a back side. To the outside: none.
    let (_folders, objects) = closed_shapes();
    let mut rng = generator(2);
    for scale in [1e-3, 1.0, 1e3, 1e6] {
        for shift in [0.0, 3.0, 1000.0] {
            for (i, object) in objects.iter().enumerate() {
                let mut object = object.clone();
                object.transform =
                    DAffine3::from_translation(DVec3::new(shift, -shift, 0.7 * shift) * scale)
                        * DAffine3::from_scale(DVec3::splat(scale))
                        * object.transform;
                let surfaces = build(std::slice::from_ref(&object));
                let (min, max) = surfaces.bounds().expect("there is a surface");
                let (center, size) = (0.5 * (min + max), (max - min).max_element());
                for _ in 0..RAYS / 100 {
                    let origin = center + size * direction(&mut rng);
                    let target = center + 0.3 * size * direction(&mut rng);
                    let d = (target - origin).normalize();
                    let Some(hit) = surfaces.intersect(origin, d, f32::INFINITY) else {
                        continue;
                    };
                    let what = format!("object {i} at scale {scale}, shifted {shift}");
                    assert!(hit.front, "{what}: from outside comes the front");
                    let on = direction(&mut rng);
                    let from = hit.spawn_origin(on);
                    let again = surfaces.intersect(from, on, f32::INFINITY);
                    if on.dot(hit.normal) < 0.0 {
                        let again = again.unwrap_or_else(|| panic!("{what}: leaks inside"));
                        assert!(!again.front, "{what}: acne at t = {}", again.t);
                    } else {
                        assert!(again.is_none(), "{what}: acne at {:?}", again.map(|a| a.t));
                    }
                }
            }
        }
    }
}

#[test]
fn occlusion_agrees_with_the_nearest_hit() {
    let (_folders, mut objects) = closed_shapes();
    let mut rng = generator(3);
    for (i, object) in objects.iter_mut().enumerate() {
        object.transform =
            DAffine3::from_translation(DVec3::new(2.0 * i as f64, 0.0, 0.0)) * turned();
    }
    let surfaces = build(&objects);
    for _ in 0..RAYS {
        let origin = Vec3::new(10.0 * uniform(&mut rng), 3.0, 3.0 * uniform(&mut rng));
        let d = direction(&mut rng);
        let t_max = 6.0 * uniform(&mut rng);
        let hit = surfaces.intersect(origin, d, t_max);
        assert_eq!(hit.is_some(), surfaces.occluded(origin, d, t_max));
        if let Some(hit) = hit {
            assert!(hit.t > 0.0 && hit.t < t_max, "t = {}", hit.t);
            let along = (origin + hit.t * d - hit.position).length();
            assert!(along < 1e-5, "the position is off the ray by {along} m");
            assert!(
                !surfaces.occluded(origin, d, hit.t),
                "something lies before the nearest"
            );
        }
    }
}

#[test]
fn sides_and_normals() {
    let quad = Shape::Quad {
        corner: DVec3::ZERO,
        edge_u: DVec3::X,
        edge_v: DVec3::Y,
    };
    let surfaces = build(&[object(quad.clone(), WHITE)]);
    let down = surfaces
        .intersect(Vec3::new(0.25, 0.75, 1.0), Vec3::NEG_Z, 10.0)
        .expect("the quad lies below");
    assert!(down.front, "the front is edge_u x edge_v");
    assert_eq!((down.normal, down.t), (Vec3::Z, 1.0));
    assert_eq!(down.uv.to_array(), [0.25, 0.75]);
    // Mirrored in z, the front looks down.
    let mut flipped = object(quad, WHITE);
    flipped.transform = DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0));
    let down = build(&[flipped])
        .intersect(Vec3::new(0.25, 0.75, 1.0), Vec3::NEG_Z, 10.0)
        .expect("the quad lies below");
    assert!(!down.front, "mirrored with everything else");
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    // The same ball around zero, and at 1e8 m with the scene's origin there.
    let far = DVec3::new(1e8, -2e8, 3e8);
    let near = build(&[object(ball(DVec3::ZERO, 1.0), WHITE)]);
    let away = Surfaces::build(&[object(ball(far, 1.0), WHITE)], far).expect("a sound ball");
    let mut rng = generator(4);
    for _ in 0..1000 {
        let (origin, d) = (3.0 * direction(&mut rng), direction(&mut rng));
        let t = |s: &Surfaces| s.intersect(origin, d, 100.0).map(|h| (h.t, h.position));
        assert_eq!(t(&near), t(&away));
    }
}

#[test]
fn interfaces_do_not_occlude_but_are_hit() {
    let shell = object(ball(DVec3::ZERO, 1.0), Material::Interface);
    let surfaces = build(&[shell, object(ball(DVec3::X * 5.0, 1.0), WHITE)]);
    let (origin, d) = (Vec3::new(-3.0, 0.0, 0.0), Vec3::X);
    assert_eq!(surfaces.intersect(origin, d, 100.0).map(|h| h.t), Some(2.0));
    let mut crossings = Vec::new();
    assert!(!surfaces.occluded(origin, d, 5.0));
    assert!(!surfaces.blocked(origin, d, 5.0, &mut crossings));
    let ts: Vec<(f32, bool)> = crossings.iter().map(|c| (c.t, c.inwards)).collect();
    assert_eq!(ts, [(2.0, true), (4.0, false)]);
    assert!(surfaces.occluded(origin, d, 100.0));
    assert!(surfaces.blocked(origin, d, 100.0, &mut crossings));
}
