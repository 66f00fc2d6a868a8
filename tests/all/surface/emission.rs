//! Light from emissive objects: uniform points and what they sum to.

use glam::{DAffine3, DVec3, Vec3};
use vpm_vdb::scene::{Material, Object, Rgb, Shape};

use super::{WHITE, ball, build, cube, direction, generator, mirrored, object, uniforms};

const SHINES: Material = Material::Emissive {
    radiance: Rgb::new(1.0, 2.0, 3.0),
};

fn shining() -> [(&'static str, Object); 4] {
    let quad = Shape::Quad {
        corner: DVec3::new(-1.0, -0.5, 0.0),
        edge_u: DVec3::X * 2.0,
        edge_v: DVec3::Y,
    };
    let mut egg = object(ball(DVec3::ZERO, 0.7), SHINES);
    egg.transform = mirrored();
    let mut tilted = object(cube(0.6), SHINES);
    tilted.transform = mirrored();
    let mut face_down = object(quad, SHINES);
    face_down.transform = DAffine3::from_rotation_x(std::f64::consts::PI);
    [
        ("quad", face_down),
        ("ball", object(ball(DVec3::ZERO, 0.7), SHINES)),
        ("egg", egg),
        ("box", tilted),
    ]
}

#[test]
fn area_sampling_and_looking_see_the_same_light() {
    // Irradiance at a point below that faces up, from points on the light and from directions:
    // int L cos cos' / r^2 dA = int L cos dw. A z-test between the two.
    for (name, object) in shining() {
        let surfaces = build(&[object]);
        let [emitter] = surfaces.emitters() else {
            panic!("{name}: one object shines");
        };
        let below = Vec3::new(0.4, 0.2, -2.0);
        let mut rng = generator(81);
        let (mut by_area, mut by_direction) = ([0.0_f64; 2], [0.0_f64; 2]);
        let n = 400_000;
        for _ in 0..n {
            let point = surfaces.sample_emitter(emitter, uniforms(&mut rng));
            let point = point.expect("it has an area");
            let to = point.position - below;
            let (r2, w) = (to.length_squared(), to.normalize());
            let facing = (-w).dot(point.normal);
            let from = point.spawn_origin(-w);
            if facing > 0.0 && !surfaces.occluded(from, -w, (from - below).length()) {
                let value = point.radiance.y * w.z.max(0.0) * facing / (r2 * point.pdf);
                by_area[0] += f64::from(value);
                by_area[1] += f64::from(value).powi(2);
            }
            let w = direction(&mut rng);
            if w.z > 0.0
                && let Some(hit) = surfaces.intersect(below, w, f32::INFINITY)
            {
                let value = surfaces.emission(&hit).y * w.z * 4.0 * std::f32::consts::PI;
                by_direction[0] += f64::from(value);
                by_direction[1] += f64::from(value).powi(2);
            }
        }
        let n = f64::from(n);
        let mean = |sums: [f64; 2]| sums[0] / n;
        let variance = |sums: [f64; 2]| (sums[1] / n - mean(sums).powi(2)) / n;
        let difference = mean(by_area) - mean(by_direction);
        let z = difference / (variance(by_area) + variance(by_direction)).sqrt();
        assert!(mean(by_area) > 0.01, "{name}: no light");
        assert!(
            z.abs() < 4.0,
            "{name}: {} and {}",
            mean(by_area),
            mean(by_direction)
        );
    }
}

#[test]
fn densities_belong_to_the_points() {
    // The density at a point, found again through a hit, is the one it was drawn with; the mean
    // of its inverse is the area.
    for (name, object) in shining() {
        let surfaces = build(&[object]);
        let emitter = &surfaces.emitters()[0];
        let mut rng = generator(82);
        let (mut sum, mut squares) = (0.0, 0.0);
        let n = 50_000;
        for _ in 0..n {
            let point = surfaces.sample_emitter(emitter, uniforms(&mut rng));
            let point = point.expect("it has an area");
            let back = -point.normal;
            let hit = surfaces.intersect(point.position - 0.1 * back, back, 1.0);
            let hit = hit.expect("the point is on the surface");
            let again = surfaces.emission_pdf(emitter, &hit);
            assert!(
                (again / point.pdf - 1.0).abs() < 1e-4,
                "{name}: {again}, {}",
                point.pdf
            );
            let inverse = 1.0 / f64::from(point.pdf);
            sum += inverse;
            squares += inverse * inverse;
        }
        let n = f64::from(n);
        let (mean, area) = (sum / n, f64::from(emitter.area));
        let deviation = ((squares / n - mean * mean).max(0.0) / n).sqrt() + 1e-4 * area;
        assert!(
            (mean - area).abs() < 4.0 * deviation,
            "{name}: {mean} and {area}"
        );
        let power = emitter.power().z / (3.0 * std::f32::consts::PI * emitter.area);
        assert!((power - 1.0).abs() < 1e-6);
    }
}

#[test]
fn only_the_front_shines() {
    let surfaces = build(&[shining()[1].1.clone(), object(cube(5.0), WHITE)]);
    let outside = surfaces.intersect(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z, 10.0);
    let inside = surfaces.intersect(Vec3::ZERO, Vec3::NEG_Z, 10.0);
    let emission = |hit| surfaces.emission(&hit);
    assert_eq!(outside.map(emission), Some(Rgb::new(1.0, 2.0, 3.0)));
    assert_eq!(inside.map(emission), Some(Rgb::ZERO));
    assert_eq!(surfaces.emitters().len(), 1);
}
