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
//! All integrate to 1 over their disc or ball. Source: Silverman 1986, section 4.2.

use std::f32::consts::FRAC_1_PI;

use wide::f32x8;

use crate::scene::Kernel;

/// Shape at x = d^2 / r^2 in [0, 1), and its factor over the disc of radius 1.
pub trait KernelShape: Copy + Send + Sync + 'static {
    /// 1 over the integral of the shape over the unit disc.
    const DISC: f32;
    /// 1 over the integral of the shape over the unit ball.
    const BALL: f32;
    /// The shape; 1 in the middle.
    fn shape(x: f32) -> f32;
    /// The shape at eight points.
    fn shape8(x: f32x8) -> f32x8;
}

/// Constant.
#[derive(Debug, Clone, Copy)]
pub struct Constant;
/// Epanechnikov.
#[derive(Debug, Clone, Copy)]
pub struct Epanechnikov;
/// Biweight.
#[derive(Debug, Clone, Copy)]
pub struct Biweight;

impl KernelShape for Constant {
    const DISC: f32 = FRAC_1_PI;
    const BALL: f32 = 0.75 * FRAC_1_PI;
    #[inline]
    fn shape(_x: f32) -> f32 {
        1.0
    }
    #[inline]
    fn shape8(_x: f32x8) -> f32x8 {
        f32x8::ONE
    }
}

impl KernelShape for Epanechnikov {
    const DISC: f32 = 2.0 * FRAC_1_PI;
    const BALL: f32 = 15.0 / 8.0 * FRAC_1_PI;
    #[inline]
    fn shape(x: f32) -> f32 {
        1.0 - x
    }
    #[inline]
    fn shape8(x: f32x8) -> f32x8 {
        f32x8::ONE - x
    }
}

impl KernelShape for Biweight {
    const DISC: f32 = 3.0 * FRAC_1_PI;
    const BALL: f32 = 105.0 / 32.0 * FRAC_1_PI;
    #[inline]
    fn shape(x: f32) -> f32 {
        (1.0 - x) * (1.0 - x)
    }
    #[inline]
    fn shape8(x: f32x8) -> f32x8 {
        (f32x8::ONE - x) * (f32x8::ONE - x)
    }
}

/// Runs `$body` with `$k` naming the kernel's type: chosen once, outside the hot loop.
#[macro_export]
macro_rules! with_kernel {
    ($kernel:expr, $k:ident => $body:expr) => {
        match $kernel {
            $crate::scene::Kernel::Constant => {
                type $k = $crate::estimate::kernel::Constant;
                $body
            }
            $crate::scene::Kernel::Epanechnikov => {
                type $k = $crate::estimate::kernel::Epanechnikov;
                $body
            }
            $crate::scene::Kernel::Biweight => {
                type $k = $crate::estimate::kernel::Biweight;
                $body
            }
        }
    };
}

/// Value of a kernel at d^2 in its disc. \[1/m2\]
#[must_use]
pub fn disc(kernel: Kernel, d2: f32, radius: f32) -> f32 {
    let x = d2 / (radius * radius);
    with_kernel!(kernel, K => if x < 1.0 { K::DISC * K::shape(x) / (radius * radius) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn integrals<K: KernelShape>() -> (f64, f64) {
        let n = 200_000;
        (0..n).fold((0.0, 0.0), |(disc, ball), i| {
            let d = (f64::from(i) + 0.5) / f64::from(n);
            let shape = f64::from(K::shape((d * d) as f32)) / f64::from(n);
            (
                disc + 2.0 * PI * d * shape * f64::from(K::DISC),
                ball + 4.0 * PI * d * d * shape * f64::from(K::BALL),
            )
        })
    }

    #[test]
    fn integrate_to_one() {
        for (disc, ball) in [
            integrals::<Constant>(),
            integrals::<Epanechnikov>(),
            integrals::<Biweight>(),
        ] {
            assert!((disc - 1.0).abs() < 1e-6, "disc {disc}");
            assert!((ball - 1.0).abs() < 1e-6, "ball {ball}");
        }
    }
}
