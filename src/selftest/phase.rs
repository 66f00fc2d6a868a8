//! Phase functions: normalised, with the mean cosine that they claim, and sampled as evaluated.
//!
//! ```text
//! integral of p = 1      integral of c p = g                       by quadrature
//! F(x) = P(1 - c < x) = (1 - g^2) / 2g (1 / (1 - g) - 1 / sqrt((1 - g)^2 + 2 g x))     g > 0
//! F(x) = 1/2 - (c^3 + 3 c) / 8                                     Rayleigh
//! ```
//!
//! F of samples is uniform, and so is their azimuth: chi-square over 16 x 8 equal cells. For g < 0
//! the pole is the other one, x = 1 + c. Directions are f32: 1 - c is taken as half the squared
//! distance of two unit vectors, in f64, which resolves the pole of |g| = 0.9999.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::fields::rng;
use super::{SelftestError, Suite, Worst};
use crate::phase::PhaseFunction;
use crate::stats::{Welford, chi_square_bound, z_bound};

const FORMS: [PhaseFunction; 11] = [
    PhaseFunction::Isotropic,
    PhaseFunction::Rayleigh,
    PhaseFunction::HenyeyGreenstein { g: 1e-3 },
    PhaseFunction::HenyeyGreenstein { g: 0.5 },
    PhaseFunction::HenyeyGreenstein { g: -0.5 },
    PhaseFunction::HenyeyGreenstein { g: 0.85 },
    PhaseFunction::HenyeyGreenstein { g: -0.95 },
    PhaseFunction::HenyeyGreenstein { g: 0.999 },
    PhaseFunction::HenyeyGreenstein { g: -0.999 },
    PhaseFunction::HenyeyGreenstein { g: 0.9999 },
    PhaseFunction::HenyeyGreenstein { g: -0.9999 },
];

/// Cells over the distance from the pole, and over the azimuth.
const CELLS: [usize; 2] = [16, 8];

/// The pole that the phase function favours, for light that travels along +z: +1 or -1.
fn pole(phase: PhaseFunction) -> f64 {
    if phase.mean_cosine() < 0.0 { -1.0 } else { 1.0 }
}

/// P(distance from the pole < x), x = 1 - c for the forward pole.
fn cumulative(phase: PhaseFunction, x: f64) -> f64 {
    match phase {
        PhaseFunction::Isotropic => 0.5 * x,
        PhaseFunction::Rayleigh => {
            let c = 1.0 - x;
            0.5 - (c * c * c + 3.0 * c) / 8.0
        }
        PhaseFunction::HenyeyGreenstein { g } => {
            let g = f64::from(g.abs());
            let gap = 1.0 - g;
            let root = (gap * gap + 2.0 * g * x).sqrt();
            // 1 / gap - 1 / root, without its cancellation at the pole.
            (1.0 - g * g) * x / (gap * root * (root + gap))
        }
    }
}

/// Integral of p less 1, and the mean cosine less g.
fn quadrature(phase: PhaseFunction) -> [f64; 2] {
    let n = 40_000;
    let (mut total, mut cosine) = (0.0, 0.0);
    let pole = pole(phase);
    for i in 0..n {
        // Dense at the pole: x = 2 q^4.
        let q = (f64::from(i) + 0.5) / f64::from(n);
        let x = 2.0 * q.powi(4);
        let weight = 2.0 * PI * 8.0 * q.powi(3) / f64::from(n);
        let sin = (x * (2.0 - x)).sqrt();
        let w = Vec3::new(sin as f32, 0.0, (pole * (1.0 - x)) as f32);
        let p = f64::from(phase.p(Vec3::Z, w));
        total += weight * p;
        cosine += weight * p * (1.0 - x) * pole;
    }
    [total - 1.0, cosine - f64::from(phase.mean_cosine())]
}

/// Relative error of p toward both poles against the closed form.
fn at_poles(phase: PhaseFunction) -> Worst {
    let mut worst = Worst::default();
    for (out, c) in [(Vec3::Z, 1.0), (Vec3::NEG_Z, -1.0)] {
        let exact = match phase {
            PhaseFunction::Isotropic => 0.25 / PI,
            PhaseFunction::Rayleigh => 6.0 / (16.0 * PI),
            PhaseFunction::HenyeyGreenstein { g } => {
                let g = f64::from(g);
                let d = 1.0 - c * g;
                (1.0 - g * g) / (4.0 * PI * d * d * d)
            }
        };
        let off = (f64::from(phase.p(Vec3::Z, out)) / exact - 1.0).abs();
        worst.take(off, || format!("{phase:?} at cosine {c}"));
    }
    worst
}

/// What samples show.
struct Sampled {
    /// Chi-square per degree of freedom.
    chi_square: f64,
    /// Mean distance from the pole, in standard errors from 1 - |g|.
    z: f64,
    /// Largest deviation of a length from 1.
    length: f64,
}

fn sample(phase: PhaseFunction, axis: Vec3, samples: u32, seed: u64) -> Sampled {
    let mut random = rng(seed);
    let (u, v) = axis.any_orthonormal_pair();
    let (axis64, u, v) = (axis.as_dvec3(), u.as_dvec3(), v.as_dvec3());
    let mut cells = [0u32; CELLS[0] * CELLS[1]];
    let mut mean = Welford::default();
    let mut length = 0.0f64;
    for _ in 0..samples {
        let w = phase.sample(axis, [random.uniform(), random.uniform()]);
        length = length.max((f64::from(w.length()) - 1.0).abs());
        let w: DVec3 = w.as_dvec3();
        let x = 0.5 * (w - axis64 * pole(phase)).length_squared();
        mean.add(x);
        let turn = w.dot(v).atan2(w.dot(u)) / (2.0 * PI) + 0.5;
        let cell = |u: f64, n: usize| ((u * n as f64) as usize).min(n - 1);
        let at = cell(cumulative(phase, x), CELLS[0]) * CELLS[1] + cell(turn, CELLS[1]);
        cells[at] += 1;
    }
    let expected = f64::from(samples) / cells.len() as f64;
    let sum: f64 = cells
        .iter()
        .map(|n| (f64::from(*n) - expected).powi(2) / expected)
        .sum();
    Sampled {
        chi_square: sum / (cells.len() - 1) as f64,
        z: mean.z(1.0 - f64::from(phase.mean_cosine().abs()), 0.0),
        length,
    }
}

/// The checks of this family.
///
/// # Errors
/// None.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let mut integral = Worst::default();
    let mut cosine = Worst::default();
    let mut poles = Worst::default();
    let mut chi_square = Worst::default();
    let mut mean = Worst::default();
    let mut length = Worst::default();
    let samples = suite.choose([400_000, 2_000_000, 20_000_000]);
    for (i, phase) in (0..).zip(FORMS) {
        let place = || format!("{phase:?}");
        let [total, c] = quadrature(phase);
        integral.take(total.abs(), place);
        cosine.take(c.abs(), place);
        poles = poles.or(at_poles(phase));
        let axis = Vec3::new(0.3, -0.5, 0.8).normalize();
        let found = sample(phase, axis, samples, 60 + i);
        chi_square.take(found.chi_square, place);
        mean.take(found.z.abs(), place);
        length.take(found.length, place);
    }
    suite.worst("integral of the phase function, off 1", integral, 1e-6);
    suite.worst("mean cosine by quadrature, off g", cosine, 1e-6);
    suite.worst("value at both poles, relative error", poles, 1e-6);
    let cells = CELLS[0] * CELLS[1];
    suite.worst(
        "sampled directions, chi-square per degree of freedom",
        chi_square,
        chi_square_bound(cells - 1, FORMS.len()),
    );
    suite.worst("sampled mean cosine, |z|", mean, z_bound(FORMS.len()));
    suite.worst("length of sampled directions, off 1", length, 3e-7);
    Ok(())
}
