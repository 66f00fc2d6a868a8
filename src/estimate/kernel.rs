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

    #[test]
    fn eight_are_as_one() {
        let x = std::array::from_fn::<f32, 8, _>(|i| i as f32 / 8.0);
        for kernel in [Kernel::Constant, Kernel::Epanechnikov, Kernel::Biweight] {
            let eight = kernel.shape8(f32x8::from(x)).to_array();
            assert_eq!(eight, x.map(|x| kernel.shape(x)), "{kernel:?}");
        }
    }
}
