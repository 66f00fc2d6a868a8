//! Phase functions: where light goes when a medium scatters it.
//!
//! ```text
//! isotropic           p = 1 / 4 pi
//! Henyey-Greenstein   p = (1 - g^2) / (4 pi (1 + g^2 - 2 g c)^(3/2))
//! Rayleigh            p = 3 (1 + c^2) / 16 pi
//! c = w_in . w_out, both directions of travel; g = mean cosine, forward above 0; p in \[1/sr\]
//! ```
//!
//! Sources: Henyey & Greenstein 1941; Rayleigh's cubic inverted by Frisvad 2011.
//! Conditioning: near the pole that |g| -> 1 favours, 1 + g^2 - 2 g c cancels in f32; written as
//! (1 - |g|)^2 + 2 |g| (1 -+ c), with 1 -+ c from the directions' difference or sum where they
//! are at hand, it does not.

use std::f32::consts::PI;

use glam::Vec3;
use wide::f32x8;

use crate::scene::Phase;

/// 1 / 4 pi.
pub const ISOTROPIC: f32 = 0.25 / PI;

/// Phase function of a medium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhaseFunction {
    /// The same in every direction.
    Isotropic,
    /// Henyey-Greenstein.
    HenyeyGreenstein {
        /// Mean cosine, within (-1, 1) and not 0.
        g: f32,
    },
    /// Rayleigh.
    Rayleigh,
}

impl From<Phase> for PhaseFunction {
    fn from(phase: Phase) -> Self {
        match phase {
            Phase::Isotropic | Phase::HenyeyGreenstein(0.0) => Self::Isotropic,
            Phase::HenyeyGreenstein(g) => Self::HenyeyGreenstein { g },
            Phase::Rayleigh => Self::Rayleigh,
        }
    }
}

impl PhaseFunction {
    /// True where the direction does not matter.
    #[must_use]
    pub fn is_isotropic(self) -> bool {
        matches!(self, Self::Isotropic)
    }

    /// Mean cosine between the directions of travel before and after.
    #[must_use]
    pub fn mean_cosine(self) -> f32 {
        match self {
            Self::Isotropic | Self::Rayleigh => 0.0,
            Self::HenyeyGreenstein { g } => g,
        }
    }

    /// Density of scattering from travel along `w_in` into travel along `w_out`. \[1/sr\]
    #[inline]
    #[must_use]
    pub fn p(self, w_in: Vec3, w_out: Vec3) -> f32 {
        match self {
            Self::Isotropic => ISOTROPIC,
            Self::HenyeyGreenstein { g } => {
                // |w_in -+ w_out|^2 = 2 (1 -+ c): exact near the favoured pole.
                let twice = if g > 0.0 {
                    (w_in - w_out).length_squared()
                } else {
                    (w_in + w_out).length_squared()
                };
                let gap = 1.0 - g.abs();
                let d = g.abs().mul_add(twice, gap * gap);
                ISOTROPIC * gap * (1.0 + g.abs()) / (d * d.sqrt())
            }
            Self::Rayleigh => {
                let c = w_in.dot(w_out);
                3.0 / (16.0 * PI) * c.mul_add(c, 1.0)
            }
        }
    }

    /// [`Self::p`] of eight directions of arrival, x, y and z apart.
    #[inline]
    #[must_use]
    pub fn p8(self, w_in: [f32x8; 3], w_out: Vec3) -> f32x8 {
        let splat = f32x8::splat;
        let [x, y, z] = w_in;
        match self {
            Self::Isotropic => splat(ISOTROPIC),
            Self::HenyeyGreenstein { g } => {
                let pole = w_out * g.signum();
                let d = [x - splat(pole.x), y - splat(pole.y), z - splat(pole.z)];
                let twice = d[0].mul_add(d[0], d[1].mul_add(d[1], d[2] * d[2]));
                let gap = 1.0 - g.abs();
                let d = splat(g.abs()).mul_add(twice, splat(gap * gap));
                splat(ISOTROPIC * gap * (1.0 + g.abs())) / (d * d.sqrt())
            }
            Self::Rayleigh => {
                let c = x.mul_add(
                    splat(w_out.x),
                    y.mul_add(splat(w_out.y), z * splat(w_out.z)),
                );
                splat(3.0 / (16.0 * PI)) * c.mul_add(c, f32x8::ONE)
            }
        }
    }

    /// Samples the direction of travel after scattering, with density `p`.
    #[inline]
    #[must_use]
    pub fn sample(self, w_in: Vec3, u: [f32; 2]) -> Vec3 {
        // 1 - c and 1 + c of the sampled cosine, neither by cancellation.
        let (one_minus, one_plus) = match self {
            Self::Isotropic => (2.0 * u[0], 2.0 - 2.0 * u[0]),
            Self::HenyeyGreenstein { g } => {
                // With a = |g| and the cosine towards the favoured pole, Henyey & Greenstein's
                // inversion gives 1 - c = 2 v (1 - a)^2 (1 + a (1 - v)) ... / (1 - a + 2 a w)^2;
                // v = 1 - w runs over (0, 1).
                let a = g.abs();
                let w = 1.0 - u[0];
                let d = (2.0 * a).mul_add(w, 1.0 - a);
                let near = 2.0 * (1.0 - w) * (1.0 - a) * (1.0 - a) * a.mul_add(w, 1.0) / (d * d);
                let far = 2.0 * w * (1.0 + a) * (1.0 + a) * (1.0 - a * (1.0 - w)) / (d * d);
                if g > 0.0 { (near, far) } else { (far, near) }
            }
            Self::Rayleigh => {
                let z = 4.0 * u[0] - 2.0;
                let s = z.mul_add(z, 1.0).sqrt();
                let root = (z.abs() + s).cbrt();
                let c = ((root - 1.0 / root).copysign(z)).clamp(-1.0, 1.0);
                (1.0 - c, 1.0 + c)
            }
        };
        around(w_in, one_minus, one_plus, 2.0 * PI * u[1])
    }
}

/// The unit vector at cosine c to `axis` (given as 1 - c and 1 + c) and azimuth `phi`.
#[inline]
#[must_use]
pub fn around(axis: Vec3, one_minus: f32, one_plus: f32, phi: f32) -> Vec3 {
    let sin = (one_minus * one_plus).max(0.0).sqrt();
    let cos = 1.0 - one_minus;
    let (s, c) = phi.sin_cos();
    let (x, y) = axis.any_orthonormal_pair();
    (x * (sin * c) + y * (sin * s) + axis * cos).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight at a time are what one is, up to the rounding of a fused product.
    #[test]
    fn eight_at_a_time_agree_with_one() {
        let phases = [-0.9, 0.3, 0.999].map(|g| PhaseFunction::HenyeyGreenstein { g });
        let out = Vec3::new(0.6, 0.0, -0.8);
        for phase in phases
            .into_iter()
            .chain([PhaseFunction::Isotropic, PhaseFunction::Rayleigh])
        {
            let w_in: [Vec3; 8] = std::array::from_fn(|i| {
                let (one_minus, phi) = (2.0 * i as f32 / 7.0, 0.9 * i as f32);
                around(out, one_minus, 2.0 - one_minus, phi)
            });
            let eight = phase.p8([0, 1, 2].map(|a| f32x8::from(w_in.map(|w| w[a]))), out);
            for (w, p8) in w_in.iter().zip(eight.to_array()) {
                let p = phase.p(*w, out);
                assert!((p8 / p - 1.0).abs() < 1e-5, "{phase:?} {w:?}: {p8} {p}");
            }
        }
    }
    use crate::rng::{Rng, Stage};

    const FORMS: [PhaseFunction; 9] = [
        PhaseFunction::Isotropic,
        PhaseFunction::Rayleigh,
        PhaseFunction::HenyeyGreenstein { g: 0.5 },
        PhaseFunction::HenyeyGreenstein { g: -0.5 },
        PhaseFunction::HenyeyGreenstein { g: 0.85 },
        PhaseFunction::HenyeyGreenstein { g: -0.95 },
        PhaseFunction::HenyeyGreenstein { g: 0.999 },
        PhaseFunction::HenyeyGreenstein { g: 0.9999 },
        PhaseFunction::HenyeyGreenstein { g: -0.9999 },
    ];

    /// Direction at 1 - c = x from +z, in the plane y = 0.
    fn at(x: f64) -> Vec3 {
        Vec3::new(((x * (2.0 - x)).sqrt()) as f32, 0.0, (1.0 - x) as f32)
    }

    #[test]
    fn integrates_to_one_with_the_mean_cosine() {
        for phase in FORMS {
            // Quadrature in q with 1 - c = 2 q^4 (or 1 + c for g < 0): dense at the peak.
            let n = 400_000;
            let (mut total, mut cosine) = (0.0, 0.0);
            for i in 0..n {
                let q = (f64::from(i) + 0.5) / f64::from(n);
                let gap = 2.0 * q.powi(4);
                let weight = 2.0 * std::f64::consts::PI * 8.0 * q.powi(3) / f64::from(n);
                let flip = if phase.mean_cosine() < 0.0 { -1.0 } else { 1.0 };
                let mut w = at(gap);
                w.z *= flip as f32;
                let p = f64::from(phase.p(Vec3::Z, w));
                total += weight * p;
                cosine += weight * p * (1.0 - gap) * flip;
            }
            assert!(
                (total - 1.0).abs() < 2e-4,
                "{phase:?} integrates to {total}"
            );
            assert!(
                (cosine - f64::from(phase.mean_cosine())).abs() < 2e-4,
                "{phase:?} has mean cosine {cosine}"
            );
        }
    }

    #[test]
    fn samples_have_the_mean_cosine_and_unit_length() {
        for phase in FORMS {
            let axis = Vec3::new(0.3, -0.5, 0.8).normalize();
            let mut rng = Rng::stream(1, Stage::Check, 0, 0);
            let n = 400_000;
            let (mut sum, mut square) = (0.0f64, 0.0f64);
            for _ in 0..n {
                let w = phase.sample(axis, [rng.uniform(), rng.uniform()]);
                assert!((w.length() - 1.0).abs() < 1e-5, "unit length");
                let c = f64::from(w.dot(axis));
                sum += c;
                square += c * c;
            }
            let mean = sum / f64::from(n);
            let error = ((square / f64::from(n) - mean * mean).max(0.0) / f64::from(n)).sqrt();
            // 4 standard errors over nine forms, and f32's resolution of a cosine near 1.
            assert!(
                (mean - f64::from(phase.mean_cosine())).abs() < 4.0 * error + 1e-6,
                "{phase:?}: mean cosine {mean} +- {error}"
            );
        }
    }
}
