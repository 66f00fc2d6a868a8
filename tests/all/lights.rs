//! Lights: where they can be seen from, and the power that they send out.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use vpm_vdb::light::Light;
use vpm_vdb::ray::{Bounds, Ray};
use vpm_vdb::scene::{self, Rgb};

use crate::fields::rng;
use crate::stats::{Welford, z_bound};

/// A direction uniform on the sphere.
fn direction(rng: &mut vpm_vdb::rng::Rng) -> Vec3 {
    let z = 2.0 * rng.uniform() - 1.0;
    let (sin, cos) = (std::f32::consts::TAU * rng.uniform()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

fn place(rng: &mut vpm_vdb::rng::Rng, size: f32) -> Vec3 {
    Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * (2.0 * size) - Vec3::splat(size)
}

/// A light sends something to a point of a ray exactly if the point is on the stretch that the
/// light says it shines along (spots of more than 90 degrees say "all of it"); points within
/// rounding of the ends aside.
#[test]
fn lights_are_seen_from_their_stretch_alone() {
    let mut rng = rng(31);
    let (mut lit, mut dark) = (0, 0);
    for _ in 0..3000 {
        let axis = direction(&mut rng).as_dvec3();
        let position = place(&mut rng, 3.0).as_dvec3();
        let lights = [
            scene::Light::Spot {
                position,
                direction: axis,
                power: Rgb::ONE,
                cone_angle: 1.0 + 88.0 * f64::from(rng.uniform()).powi(2),
                penumbra: 0.5,
                image: None,
            },
            scene::Light::Disk {
                center: position,
                normal: axis,
                radius: 1e-3,
                radiance: Rgb::ONE,
            },
            scene::Light::Quad {
                corner: position,
                edge_u: 1e-3 * axis.any_orthonormal_pair().0,
                edge_v: 1e-3 * axis.any_orthonormal_pair().1,
                radiance: Rgb::ONE,
            },
        ];
        let ray = Ray {
            origin: place(&mut rng, 3.0),
            direction: direction(&mut rng),
        };
        for described in lights {
            let light: Light<f32> =
                Light::from_scene(&described, DVec3::ZERO).expect("a light of this kind");
            let stretch = light.shines_along(&ray, (0.0, 10.0));
            for i in 0..200 {
                let t = 0.05 * (i as f32 + 0.5);
                let seen = light.sample(ray.at(t), [0.5, 0.5]).is_some();
                let near = stretch.is_some_and(|(a, b)| (t - a).abs().min((t - b).abs()) < 5e-3);
                let inside = stretch.is_some_and(|(a, b)| t > a && t < b);
                // Where the ray leaves a narrow cone near its tip, both ends are close.
                let tip = ray.at(t).distance(position.as_vec3()) < 0.05;
                assert!(
                    seen == inside || near || tip,
                    "{described:?} from {ray:?} at {t}: seen {seen}, stretch {stretch:?}"
                );
                lit += u32::from(seen);
                dark += u32::from(!seen);
            }
        }
    }
    assert!(lit > 100_000 && dark > 100_000, "{lit} lit, {dark} dark");
}

/// Photons that leave a light toward a target around it carry its whole power.
#[test]
fn photons_carry_the_power_of_a_light() {
    let (radius, radiance) = (0.4, 3.0);
    let disk = scene::Light::Disk {
        center: DVec3::new(0.1, 0.2, 0.3),
        normal: DVec3::new(0.0, -2.0, 1.0),
        radius,
        radiance: Rgb::splat(radiance),
    };
    let spot = scene::Light::Spot {
        position: DVec3::ZERO,
        direction: DVec3::new(1.0, 1.0, 0.0),
        power: Rgb::splat(7.0),
        cone_angle: 35.0,
        penumbra: 12.0,
        image: None,
    };
    let cases = [
        (
            "disk",
            disk,
            PI * PI * radius * radius * f64::from(radiance),
        ),
        ("spot", spot, 7.0),
    ];
    let around = Bounds {
        min: Vec3::splat(-5.0),
        max: Vec3::splat(5.0),
    };
    let bound = z_bound(cases.len());
    for (name, described, power) in cases {
        let light: Light<f32> = Light::from_scene(&described, DVec3::ZERO).expect("of this kind");
        let mut rng = rng(32);
        let mut found = Welford::default();
        for _ in 0..40_000 {
            let u = [rng.uniform(), rng.uniform(), rng.uniform(), rng.uniform()];
            let photon = light.emit(&around, u, &mut rng);
            found.add(photon.map_or(0.0, |photon| f64::from(photon.power)));
        }
        let z = found.z(power, 1e-5 * power);
        assert!(z.abs() < bound, "{name}: {} for {power}", found.mean());
    }
}
