//! Which objects contain a point, and where paths are when they cross surfaces.

use glam::{DVec3, Vec3};
use vpm_vdb::scene::{Material, Object, Optics, Phase, Rgb, Shape};
use vpm_vdb::surface::{Inside, SurfaceError, SurfaceWarning, Surfaces, Transport};

use super::{WHITE, ball, build, cube, direction, generator, mirrored, object, uniforms};

const GLASS: Material = Material::Glass {
    ior: 1.5,
    roughness: 0.0,
};

fn medium() -> Option<Optics> {
    Some(Optics {
        extinction: Rgb::ONE,
        albedo: Rgb::ONE,
        phase: Phase::Isotropic,
    })
}

/// A glass ball, an interface box that overlaps it, an opaque ball and a stretched ball.
fn crowd() -> Vec<Object> {
    let mut stretched = object(ball(DVec3::new(0.2, 0.0, 0.0), 0.5), Material::Interface);
    stretched.transform = mirrored();
    stretched.interior = medium();
    vec![
        object(ball(DVec3::ZERO, 1.0), GLASS),
        object(cube(0.7), Material::Interface),
        object(ball(DVec3::ZERO, 0.3), WHITE),
        stretched,
    ]
}

#[test]
fn a_point_is_inside_what_contains_it() {
    let surfaces = build(&crowd());
    let to_ball = mirrored().inverse();
    let mut rng = generator(71);
    for _ in 0..20_000 {
        let [x, y, z] = uniforms(&mut rng);
        let p = 3.0 * Vec3::new(x, y, z) - 1.5;
        let local = to_ball.transform_point3(p.as_dvec3()) - DVec3::new(0.2, 0.0, 0.0);
        let mut expected = Inside::NOTHING;
        for (object, contains) in [
            (0, p.length() < 1.0),
            (1, p.abs().max_element() < 0.7),
            (3, local.length() < 0.5),
        ] {
            if contains {
                expected.cross(object, true);
            }
        }
        assert_eq!(surfaces.inside_at(p), expected, "at {p}");
    }
}

#[test]
fn a_path_knows_where_it_is() {
    // Walks that cross the glass and the boxes: what the path believes is what the place says.
    let surfaces = build(&crowd());
    let mut rng = generator(72);
    for _ in 0..3000 {
        let mut origin = 3.0 * direction(&mut rng);
        let mut d = (0.8 * direction(&mut rng) - origin).normalize();
        let mut inside = Inside::NOTHING;
        while let Some(hit) = surfaces.intersect(origin, d, f32::INFINITY) {
            let middle = origin + 0.5 * hit.t * d;
            // Closer to a surface than this the place itself is in doubt.
            if hit.t > 1e-4 {
                assert_eq!(surfaces.inside_at(middle), inside, "at {middle}");
            }
            let sample = surfaces
                .bsdf(&hit)
                .sample(d, uniforms(&mut rng), Transport::Power);
            let Some(sample) = sample else { break };
            if sample.transmitted && surfaces.encloses(hit.object) {
                inside.cross(hit.object, hit.front);
            }
            (origin, d) = (hit.spawn_origin(sample.direction), sample.direction);
        }
    }
}

#[test]
fn interiors_need_walls() {
    let quad = Shape::Quad {
        corner: DVec3::ZERO,
        edge_u: DVec3::X,
        edge_v: DVec3::Y,
    };
    let mut open = object(quad.clone(), Material::Interface);
    open.interior = medium();
    let error = Surfaces::build(&[open], DVec3::ZERO).expect_err("a square encloses nothing");
    assert!(
        matches!(error, SurfaceError::OpenInterior { open_edges: 4, .. }),
        "{error}"
    );
    assert_eq!(
        error.to_string(),
        "object `thing`: has an interior medium but is not closed: 4 edges have not exactly two \
         triangles that pass them in opposite directions; close the mesh or drop `interior`"
    );
    // A pane of glass without an inside renders, and says so.
    let pane = build(&[object(quad, GLASS)]);
    assert!(!pane.encloses(0));
    assert!(matches!(
        pane.warnings(),
        [SurfaceWarning::OpenDielectric { open_edges: 4, .. }]
    ));
    // An interior behind an opaque skin is never seen.
    let mut opaque = object(cube(1.0), WHITE);
    opaque.interior = medium();
    let opaque = build(&[opaque]);
    assert!(matches!(
        opaque.warnings(),
        [SurfaceWarning::UnreachableInterior { .. }]
    ));
    assert!(!opaque.encloses(0) && opaque.interior(0).is_some());
}
