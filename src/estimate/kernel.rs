//! Kernels of the density estimate.
//!
//! ```text
//!              2-D (beam)                   3-D (point)
//! constant     1 / (pi r^2)                 3 / (4 pi r^3)
//! Epanechnikov 2 / (pi r^2) (1 - x)         15 / (8 pi r^3) (1 - x)
//! biweight     3 / (pi r^2) (1 - x)^2       105 / (32 pi r^3) (1 - x)^2
//! x = d^2 / r^2 in [0, 1), 0 beyond         [1/m^2], [1/m^3]
//! ```
//!
//! All integrate to 1 over their disc or ball. Which one is asked once per eight photons, not
//! compiled in: a branch that is always taken alike. Source: Silverman 1986, section 4.2.

use std::f32::consts::FRAC_1_PI;

use wide::f32x8;

/// Kernel of the density estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Constant over the disc or ball.
    Constant,
    /// Biweight.
    Biweight,
    /// Epanechnikov.
    Epanechnikov,
}

impl Kernel {
    /// One over the integral of the shape over the unit disc.
    #[inline]
    #[must_use]
    pub fn disc(self) -> f32 {
        match self {
            Self::Constant => FRAC_1_PI,
            Self::Epanechnikov => 2.0 * FRAC_1_PI,
            Self::Biweight => 3.0 * FRAC_1_PI,
        }
    }

    /// One over the integral of the shape over the unit ball.
    #[inline]
    #[must_use]
    pub fn ball(self) -> f32 {
        match self {
            Self::Constant => 0.75 * FRAC_1_PI,
            Self::Epanechnikov => 15.0 / 8.0 * FRAC_1_PI,
            Self::Biweight => 105.0 / 32.0 * FRAC_1_PI,
        }
    }

    /// The shape at x = d^2 / r^2 in [0, 1); 1 in the middle.
    #[inline]
    #[must_use]
    pub fn shape(self, x: f32) -> f32 {
        match self {
            Self::Constant => 1.0,
            Self::Epanechnikov => 1.0 - x,
            Self::Biweight => (1.0 - x) * (1.0 - x),
        }
    }

    /// Share of the disc's mass within `rho` of its middle, in radii, from 0 to 1:
    /// `rho^2`, `1 - (1 - rho^2)^2`, `1 - (1 - rho^2)^3`.
    #[must_use]
    pub fn disc_within(self, rho: f32) -> f32 {
        let beyond = 1.0 - rho * rho;
        match self {
            Self::Constant => rho * rho,
            Self::Epanechnikov => 1.0 - beyond * beyond,
            Self::Biweight => 1.0 - beyond * beyond * beyond,
        }
    }

    /// Share of the disc's mass on the middle's side of a line at distance `z` from it, in radii,
    /// from 0 to 1: 1/2 plus the integral of the kernel's marginal,
    /// `2/pi (1 - u^2)^(1/2)`, `8/(3 pi) (1 - u^2)^(3/2)`, `16/(5 pi) (1 - u^2)^(5/2)`.
    #[must_use]
    pub fn mass_within(self, z: f32) -> f32 {
        let w2 = (1.0 - z * z).max(0.0);
        // Integrals of (1 - u^2)^(1/2), ^(3/2), ^(5/2) from 0 to z, each from the one before.
        let one = 0.5 * (z * w2.sqrt() + z.min(1.0).asin());
        let three = 0.25 * z * w2 * w2.sqrt() + 0.75 * one;
        let five = z * w2 * w2 * w2.sqrt() / 6.0 + 5.0 / 6.0 * three;
        0.5 + FRAC_1_PI
            * match self {
                Self::Constant => 2.0 * one,
                Self::Epanechnikov => 8.0 / 3.0 * three,
                Self::Biweight => 16.0 / 5.0 * five,
            }
    }

    /// The shape at eight points.
    #[inline]
    #[must_use]
    pub fn shape8(self, x: f32x8) -> f32x8 {
        match self {
            Self::Constant => f32x8::ONE,
            Self::Epanechnikov => f32x8::ONE - x,
            Self::Biweight => (f32x8::ONE - x) * (f32x8::ONE - x),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn integrals(kernel: Kernel) -> (f64, f64) {
        let n = 200_000;
        (0..n).fold((0.0, 0.0), |(disc, ball), i| {
            let d = (f64::from(i) + 0.5) / f64::from(n);
            let shape = f64::from(kernel.shape((d * d) as f32)) / f64::from(n);
            (
                disc + 2.0 * PI * d * shape * f64::from(kernel.disc()),
                ball + 4.0 * PI * d * d * shape * f64::from(kernel.ball()),
            )
        })
    }

    #[test]
    fn integrate_to_one() {
        for kernel in [Kernel::Constant, Kernel::Epanechnikov, Kernel::Biweight] {
            let (disc, ball) = integrals(kernel);
            assert!((disc - 1.0).abs() < 1e-6, "{kernel:?} disc {disc}");
            assert!((ball - 1.0).abs() < 1e-6, "{kernel:?} ball {ball}");
        }
    }

    /// The mass of a cut disc against a sum over its points.
    #[test]
    fn cut_discs_have_their_mass() {
        let n = 1500;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
        for kernel in [Kernel::Constant, Kernel::Epanechnikov, Kernel::Biweight] {
            for z in [0.0, 0.2, 0.5, 0.83, 1.0] {
                let mut mass = 0.0;
                for i in (0..n).filter(|i| at(*i) < z) {
                    for j in 0..n {
                        let x = at(i).powi(2) + at(j).powi(2);
                        if x < 1.0 {
                            mass += f64::from(kernel.shape(x as f32) * kernel.disc());
                        }
                    }
                }
                mass *= 4.0 / f64::from(n * n);
                let found = f64::from(kernel.mass_within(z as f32));
                // A row of points is 1 / n of the disc's width, of a marginal of up to 1.02.
                assert!(
                    (found - mass).abs() < 1.1 / f64::from(n),
                    "{kernel:?} {z}: {found} {mass}"
                );
            }
        }
    }

    #[test]
    fn eight_are_as_one() {
        let x = std::array::from_fn::<f32, 8, _>(|i| i as f32 / 8.0);
        for kernel in [Kernel::Constant, Kernel::Epanechnikov, Kernel::Biweight] {
            let eight = kernel.shape8(f32x8::from(x)).to_array();
            assert_eq!(eight, x.map(|x| kernel.shape(x)), "{kernel:?}");
        }
    }
}
