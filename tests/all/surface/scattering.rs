//! How surfaces scatter: energy, adjoints, densities.

use glam::{DVec3, Vec3};
use vpm_vdb::scene::{Material, Rgb, Shape};
use vpm_vdb::surface::{Bsdf, BsdfSample, Hit, SampleKind, Surfaces, Transport};

use super::{WHITE, ball, build, direction, generator, object, uniforms};

/// Standard errors that a z-test tolerates: two-sided 1e-5 per test, so a thousand tests with
/// fixed seeds stand a chance of 0.01 to have ever needed another seed.
const Z: f64 = 4.42;

/// Angles of incidence, as travel directions towards a surface that faces +z.
fn arrivals() -> [Vec3; 3] {
    [0.0_f32, 40.0, 80.0].map(|degrees| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Vec3::new(0.8 * sin, 0.6 * sin, -cos)
    })
}

const GLASS: Material = Material::Glass {
    ior: 1.5,
    roughness: 0.0,
};

fn rough_glass(roughness: f64) -> Material {
    Material::Glass {
        ior: 1.5,
        roughness,
    }
}

fn copper(roughness: f64) -> Material {
    Material::Conductor {
        eta: Rgb::new(0.2, 0.92, 1.1),
        k: Rgb::new(3.91, 2.45, 2.14),
        roughness,
    }
}

/// So large an index of absorption that everything is reflected.
fn silver(roughness: f64) -> Material {
    Material::Conductor {
        eta: Rgb::ONE,
        k: Rgb::splat(1e5),
        roughness,
    }
}

fn rough_materials() -> Vec<(&'static str, Material)> {
    vec![
        ("diffuse", WHITE),
        ("copper 0.1", copper(0.1)),
        ("copper 0.6", copper(0.6)),
        ("glass 0.15", rough_glass(0.15)),
        ("glass 0.5", rough_glass(0.5)),
    ]
}

/// A square that faces +z, and a hit in its middle from direction `w_in`.
fn patch(material: Material) -> Surfaces {
    let quad = Shape::Quad {
        corner: DVec3::new(-1.0, -1.0, 0.0),
        edge_u: DVec3::X * 2.0,
        edge_v: DVec3::Y * 2.0,
    };
    build(&[object(quad, material)])
}

fn hit_on(surfaces: &Surfaces, w_in: Vec3) -> Hit {
    surfaces
        .intersect(-w_in, w_in, 10.0)
        .expect("the patch lies one metre ahead")
}

/// Both sides of a material under three angles.
fn cases(material: &Material) -> Vec<(Bsdf, Vec3)> {
    let surfaces = patch(material.clone());
    arrivals()
        .into_iter()
        .flat_map(|w| [w, Vec3::new(w.x, w.y, -w.z)])
        .map(|w| (surfaces.bsdf(&hit_on(&surfaces, w)), w))
        .collect()
}

#[derive(Default)]
struct Mean {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Mean {
    fn add(&mut self, x: f64) {
        self.n += 1.0;
        self.sum += x;
        self.squares += x * x;
    }

    fn mean(&self) -> f64 {
        self.sum / self.n
    }

    /// Variance of the mean.
    fn variance(&self) -> f64 {
        (self.squares / self.n - self.mean().powi(2)).max(0.0) / (self.n - 1.0)
    }
}

/// z of two independent means; rounding of f32 weights is allowed for as a deviation of its own.
fn z(a: &Mean, b: &Mean) -> f64 {
    let rounding = 1e-5 * a.mean().abs().max(b.mean().abs());
    (a.mean() - b.mean()) / (a.variance() + b.variance() + rounding * rounding).sqrt()
}

fn albedo(bsdf: &Bsdf, w_in: Vec3, seed: u64) -> Mean {
    let mut rng = generator(seed);
    let mut mean = Mean::default();
    for _ in 0..100_000 {
        let sample = bsdf.sample(w_in, uniforms(&mut rng), Transport::Power);
        mean.add(sample.map_or(0.0, |s| f64::from(s.weight.x)));
    }
    mean
}

#[test]
fn white_furnace() {
    // What comes back of light 1 from everywhere: exactly all, without absorption and facets;
    // never more; and of rough white materials what single scattering between facets leaves,
    // least at grazing incidence.
    let mirror = Material::Mirror {
        reflectance: Rgb::ONE,
    };
    for material in [WHITE, mirror, GLASS, silver(0.0), Material::Interface] {
        for (bsdf, w_in) in cases(&material) {
            let mean = albedo(&bsdf, w_in, 11);
            assert!(
                (mean.mean() - 1.0).abs() < 2e-4,
                "{material:?}: {}",
                mean.mean()
            );
        }
    }
    for (alpha, expected) in [
        // int D G2 / (4 v_z) dl by the midpoint rule, at 0, 40 and 80 degrees.
        (0.1, [0.9870, 0.9836, 0.8955]),
        (0.5, [0.6878, 0.6820, 0.8053]),
    ] {
        let cases = cases(&silver(alpha));
        for ((bsdf, w_in), expected) in cases.iter().zip(expected.map(|e| [e, e]).as_flattened()) {
            let mean = albedo(bsdf, *w_in, 13);
            // The expected values have four digits.
            let z = (mean.mean() - expected) / (mean.variance() + 5e-5_f64.powi(2)).sqrt();
            assert!(
                z.abs() < Z,
                "silver {alpha} at {w_in}: {} for {expected}",
                mean.mean()
            );
        }
    }
    for (material, least) in [
        (copper(0.3), 0.5),
        (rough_glass(0.1), 0.85),
        (rough_glass(0.5), 0.60),
    ] {
        for (bsdf, w_in) in cases(&material) {
            let mean = albedo(&bsdf, w_in, 12);
            let excess = (mean.mean() - 1.0) / mean.variance().sqrt().max(1e-6);
            assert!(excess < Z, "{material:?} makes light: {}", mean.mean());
            assert!(
                mean.mean() > least,
                "{material:?} at {w_in} keeps {}",
                mean.mean()
            );
        }
    }
    for (bsdf, w_in) in cases(&Material::Emissive { radiance: Rgb::ONE }) {
        assert!(bsdf.sample(w_in, [0.5; 3], Transport::Power).is_none());
    }
}

#[test]
fn sampled_weights_are_the_integral_of_eval() {
    // int f |cos| dw, by uniform directions and by the sampler's weights, both transports.
    for (name, material) in rough_materials() {
        for (bsdf, w_in) in cases(&material) {
            for transport in [Transport::Radiance, Transport::Power] {
                let mut rng = generator(21);
                let (mut sampled, mut integral) = (Mean::default(), Mean::default());
                for _ in 0..400_000 {
                    let sample = bsdf.sample(w_in, uniforms(&mut rng), transport);
                    sampled.add(sample.map_or(0.0, |s| f64::from(s.weight.x)));
                    let w_out = direction(&mut rng);
                    let value = bsdf.eval(w_in, w_out, transport).x;
                    integral.add(4.0 * std::f64::consts::PI * f64::from(value));
                }
                let z = z(&sampled, &integral);
                let (a, b) = (sampled.mean(), integral.mean());
                assert!(
                    z.abs() < Z,
                    "{name} at {w_in}, {transport:?}: {a} and {b}, z = {z}"
                );
            }
        }
    }
}

#[test]
fn weight_is_eval_over_pdf() {
    for (name, material) in rough_materials() {
        for (bsdf, w_in) in cases(&material) {
            let mut rng = generator(31);
            for _ in 0..2000 {
                let u = uniforms(&mut rng);
                let Some(BsdfSample {
                    direction,
                    weight,
                    pdf,
                    ..
                }) = bsdf.sample(w_in, u, Transport::Radiance)
                else {
                    continue;
                };
                // The facet that is found again from two rounded directions is off by some
                // 2^-23 / alpha, and what is narrow feels it: a bound for alpha >= 0.1, away
                // from grazing facets.
                let again = bsdf.pdf(w_in, direction);
                let grazing = direction.z.abs() < 0.02;
                let bound = if grazing { 0.1 } else { 3e-3 };
                assert!(
                    (again / pdf - 1.0).abs() < bound,
                    "{name}: {again} and {pdf}"
                );
                let value = bsdf.eval(w_in, direction, Transport::Radiance) / pdf;
                let off = ((value - weight).abs() / weight.max(Rgb::splat(1e-6))).max_element();
                assert!(off < bound, "{name}: {value} and {weight}");
            }
        }
    }
}

/// Chi-square statistic as a standard normal (Wilson & Hilferty 1931).
fn chi_square_z(statistic: f64, freedom: f64) -> f64 {
    let scale = 2.0 / (9.0 * freedom);
    ((statistic / freedom).cbrt() - (1.0 - scale)) / scale.sqrt()
}

#[test]
fn directions_follow_their_density() {
    // Bins of equal area over the whole sphere, and one for paths that end. The poles lie across
    // the plane of incidence, so that lobes sit where bins are fine. Expected counts by the
    // midpoint rule over the pdf, fine enough to err far less than the counts do.
    let polar = glam::DMat3::from_cols(
        DVec3::new(0.8, 0.6, 0.0),
        DVec3::Z,
        DVec3::new(0.6, -0.8, 0.0),
    );
    const ROWS: usize = 20;
    const COLUMNS: usize = 16;
    const FINE: usize = 48;
    const SAMPLES: u32 = 200_000;
    for (name, material) in rough_materials() {
        for (bsdf, w_in) in cases(&material) {
            let mut counts = vec![0_u32; ROWS * COLUMNS + 1];
            let mut rng = generator(41);
            for _ in 0..SAMPLES {
                let bin = match bsdf.sample(w_in, uniforms(&mut rng), Transport::Power) {
                    Some(sample) => {
                        let w = polar.transpose() * sample.direction.as_dvec3();
                        let row = ((0.5 * (w.z + 1.0)) * ROWS as f64) as usize;
                        let turn = w.y.atan2(w.x) / std::f64::consts::TAU;
                        let column = (turn.rem_euclid(1.0) * COLUMNS as f64) as usize;
                        row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
                    }
                    None => ROWS * COLUMNS,
                };
                counts[bin] += 1;
            }
            let mut expected = vec![0.0; ROWS * COLUMNS + 1];
            let cell = 4.0 * std::f64::consts::PI / (ROWS * COLUMNS * FINE * FINE) as f64;
            for (bin, value) in expected.iter_mut().take(ROWS * COLUMNS).enumerate() {
                for sub in 0..FINE * FINE {
                    let row = (bin / COLUMNS) as f64 + ((sub / FINE) as f64 + 0.5) / FINE as f64;
                    let column = (bin % COLUMNS) as f64 + ((sub % FINE) as f64 + 0.5) / FINE as f64;
                    let z = 2.0 * row / ROWS as f64 - 1.0;
                    let (sin, cos) = (std::f64::consts::TAU * column / COLUMNS as f64).sin_cos();
                    let r = (1.0 - z * z).sqrt();
                    let w = (polar * DVec3::new(r * cos, r * sin, z)).as_vec3();
                    *value += cell * f64::from(bsdf.pdf(w_in, w));
                }
            }
            let valid: f64 = expected.iter().sum();
            assert!(
                valid < 1.002,
                "{name} at {w_in}: the density integrates to {valid}"
            );
            expected[ROWS * COLUMNS] = (1.0 - valid).max(0.0);
            // Bins with fewer than ten expected counts are pooled.
            let (mut statistic, mut freedom) = (0.0, -1.0);
            let (mut pooled, mut pooled_count) = (0.0, 0.0);
            for (&count, &share) in counts.iter().zip(&expected) {
                let mean = share * f64::from(SAMPLES);
                if mean < 10.0 {
                    pooled += mean;
                    pooled_count += f64::from(count);
                } else {
                    statistic += (f64::from(count) - mean).powi(2) / mean;
                    freedom += 1.0;
                }
            }
            if pooled > 10.0 {
                statistic += (pooled_count - pooled).powi(2) / pooled;
                freedom += 1.0;
            }
            let z = chi_square_z(statistic, freedom);
            assert!(
                z < Z,
                "{name} at {w_in}: chi-square {statistic} of {freedom}, z = {z}"
            );
        }
    }
}

#[test]
fn radiance_one_way_is_power_the_other_way() {
    // The adjoint, with and without a shading normal that differs: a photon that comes along the
    // reversed path is scattered by the same function, per area of the true surface.
    let mut rng = generator(51);
    let mut compared = 0;
    for (name, material) in rough_materials() {
        let surfaces = patch(material);
        for round in 0..4000 {
            let (w_in, w_out) = (direction(&mut rng), direction(&mut rng));
            if w_in.z.abs() < 0.05 || w_out.z.abs() < 0.05 {
                continue;
            }
            let mut hit = hit_on(&surfaces, Vec3::NEG_Z);
            if round % 2 == 1 {
                hit.shading_normal = Vec3::new(0.3, -0.2, 0.9).normalize();
            }
            let n = hit.shading_normal;
            // Where a shading normal faces away it is replaced, and differently so per direction.
            let agree = |w: Vec3| w.dot(n) * w.z > 0.0;
            if !agree(w_in) || !agree(w_out) {
                continue;
            }
            let bsdf = surfaces.bsdf(&hit);
            let radiance = bsdf.eval(w_in, w_out, Transport::Radiance) / w_out.z.abs();
            let power = bsdf.eval(-w_out, -w_in, Transport::Power) / w_in.z.abs();
            let off = (radiance - power).abs().max_element();
            assert!(
                off <= 2e-3 * radiance.max_element().max(1e-3),
                "{name}: {radiance} and {power} for {w_in} -> {w_out}"
            );
            compared += u32::from(radiance != Rgb::ZERO);
        }
    }
    assert!(compared > 5000, "only {compared} pairs scattered at all");
}

#[test]
fn gathered_photons_agree_with_scattered_ones() {
    // f for gathering is eval per cosine; for photons onto a flat diffuse wall rho / pi.
    let surfaces = patch(WHITE);
    let bsdf = surfaces.bsdf(&hit_on(&surfaces, Vec3::NEG_Z));
    let (w_in, w_out) = (Vec3::new(0.6, 0.0, -0.8), Vec3::new(0.0, 0.6, 0.8));
    assert_eq!(
        bsdf.gather(w_in, w_out),
        Rgb::splat(std::f32::consts::FRAC_1_PI)
    );
    assert_eq!(
        bsdf.gather(w_in, -w_out),
        Rgb::ZERO,
        "walls do not shine through"
    );
}

#[test]
fn snell_fresnel_and_total_reflection() {
    let surfaces = patch(GLASS);
    for degrees in [10.0_f32, 35.0, 60.0, 85.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let w_in = Vec3::new(sin, 0.0, -cos);
        let bsdf = surfaces.bsdf(&hit_on(&surfaces, w_in));
        let into = bsdf.sample(w_in, [0.999_999, 0.5, 0.5], Transport::Power);
        let into = into.expect("glass lets light in");
        assert!(into.transmitted && into.kind == SampleKind::Specular);
        assert!(
            (into.direction.x - sin / 1.5).abs() < 1e-6,
            "Snell at {degrees}"
        );
        // Exact Fresnel by another formula: sin and tan of difference and sum.
        let (i, t) = (degrees.to_radians(), (sin / 1.5).asin());
        let exact = 0.5
            * (((i - t).sin() / (i + t).sin()).powi(2) + ((i - t).tan() / (i + t).tan()).powi(2));
        assert!(
            (1.0 - into.pdf - exact).abs() < 1e-5,
            "Fresnel at {degrees}"
        );
        // Radiance is compressed on the way in.
        let radiance = bsdf.sample(w_in, [0.999_999, 0.5, 0.5], Transport::Radiance);
        let weight = radiance.map(|s| s.weight.x);
        assert!((weight.unwrap_or(0.0) - 1.0 / 2.25).abs() < 1e-6);
    }
    // From inside beyond the critical angle (41.8 degrees), whatever the uniform.
    let (sin, cos) = 45.0_f32.to_radians().sin_cos();
    let w_in = Vec3::new(sin, 0.0, cos);
    let bsdf = surfaces.bsdf(&hit_on(&surfaces, w_in));
    for u in [0.0, 0.5, 0.999_999] {
        let out = bsdf.sample(w_in, [u, 0.5, 0.5], Transport::Power);
        let out = out.expect("it reflects");
        assert!(!out.transmitted && out.pdf == 1.0);
        assert!(out.direction.abs_diff_eq(Vec3::new(sin, 0.0, -cos), 1e-6));
    }
}

#[test]
fn smooth_glass_splits_into_what_it_samples() {
    let mut split_ups = 0;
    for (bsdf, w_in) in cases(&GLASS) {
        let drawn = |rng: &mut _| {
            let sample = bsdf.sample(w_in, uniforms(rng), Transport::Radiance);
            sample.expect("smooth glass never ends a path")
        };
        let mut rng = generator(67);
        let Some(both) = bsdf.split(w_in, Transport::Radiance) else {
            // All is reflected.
            assert!((0..1000).all(|_| !drawn(&mut rng).transmitted));
            continue;
        };
        split_ups += 1;
        let mut means = [Mean::default(), Mean::default()];
        for _ in 0..20_000 {
            let sample = drawn(&mut rng);
            let side = usize::from(sample.transmitted);
            assert_eq!(sample.direction, both[side].direction);
            means[side].add(f64::from(sample.weight.x));
            means[1 - side].add(0.0);
        }
        for (part, mean) in both.iter().zip(&means) {
            let exact = f64::from(part.weight.x);
            let z = (mean.mean() - exact) / mean.variance().sqrt();
            assert!(z.abs() < Z, "{} drawn, {exact} split: z {z}", mean.mean());
        }
    }
    assert_eq!(split_ups, 5, "all but the one beyond the critical angle");
    for (name, material) in rough_materials() {
        let none = |(bsdf, w_in): (Bsdf, Vec3)| bsdf.split(w_in, Transport::Power).is_none();
        assert!(cases(&material).into_iter().all(none), "{name}");
    }
}

#[test]
fn a_glass_ball_is_invisible_in_a_furnace() {
    // Radiance 1 everywhere: whatever the path through the ball, its factors cancel on the way
    // out. Rough glass loses what single scattering loses; smooth glass nothing.
    let surfaces = build(&[object(ball(DVec3::ZERO, 1.0), GLASS)]);
    let mut rng = generator(61);
    for _ in 0..20_000 {
        let mut origin = 3.0 * direction(&mut rng);
        let mut d = (0.99 * direction(&mut rng) - origin).normalize();
        let mut throughput = 1.0;
        let mut events = 0;
        while let Some(hit) = surfaces.intersect(origin, d, f32::INFINITY) {
            let sample = surfaces
                .bsdf(&hit)
                .sample(d, uniforms(&mut rng), Transport::Radiance)
                .expect("smooth glass never ends a path");
            throughput *= sample.weight.x;
            (origin, d) = (hit.spawn_origin(sample.direction), sample.direction);
            events += 1;
            assert!(events < 1000, "trapped");
        }
        assert!(
            (throughput - 1.0_f32).abs() < 1e-5,
            "{throughput} after {events} events"
        );
    }
}

#[test]
fn interfaces_pass_straight_through() {
    for (bsdf, w_in) in cases(&Material::Interface) {
        let sample = bsdf
            .sample(w_in, [0.3; 3], Transport::Radiance)
            .expect("it passes");
        assert_eq!((sample.direction, sample.weight), (w_in, Rgb::ONE));
        assert_eq!(sample.kind, SampleKind::Passthrough);
        assert!(bsdf.is_specular() && sample.transmitted);
    }
}
