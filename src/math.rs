//! exp for transmittances, short enough to be inlined where photons are gathered.
//!
//! ```text
//! exp(x) = 2^n * exp(r)     n = round(x / ln 2)     r = x - n ln 2, |r| <= ln 2 / 2
//! ```
//!
//! ln 2 in two parts (Cody & Waite 1980), exp(r) by a polynomial of degree 6 (Cephes' expf).
//! Relative error below 2e-7 over [-87, 88], as a test shows over every binade.

use wide::{f32x8, i32x8};

/// e^x; 0 below -87, where f32 has only denormal numbers left.
#[inline]
#[must_use]
pub fn exp(x: f32) -> f32 {
    if x < -87.0 {
        return 0.0;
    }
    let x = x.min(88.0);
    let n = (x * std::f32::consts::LOG2_E).round_ties_even();
    let r = n.mul_add(2.121_944_4e-4, n.mul_add(-0.693_359_4, x));
    let p = 1.987_569_1e-4f32
        .mul_add(r, 1.398_2e-3)
        .mul_add(r, 8.333_452e-3)
        .mul_add(r, 4.166_579_6e-2)
        .mul_add(r, 0.166_666_65)
        .mul_add(r, 0.5)
        .mul_add(r * r, r)
        + 1.0;
    p * f32::from_bits(((n as i32 + 127) as u32) << 23)
}

/// [`exp`] of eight numbers, by the same steps.
#[inline]
#[must_use]
pub fn exp8(x: f32x8) -> f32x8 {
    let splat = f32x8::splat;
    let opaque = x.simd_lt(splat(-87.0));
    let x = x.fast_max(splat(-87.0)).fast_min(splat(88.0));
    let n = (x * splat(std::f32::consts::LOG2_E)).round();
    let r = n.mul_add(splat(2.121_944_4e-4), n.mul_add(splat(-0.693_359_4), x));
    let p = splat(1.987_569_1e-4)
        .mul_add(r, splat(1.398_2e-3))
        .mul_add(r, splat(8.333_452e-3))
        .mul_add(r, splat(4.166_579_6e-2))
        .mul_add(r, splat(0.166_666_65))
        .mul_add(r, splat(0.5))
        .mul_add(r * r, r)
        + splat(1.0);
    let power: i32x8 = (n.fast_trunc_int() + i32x8::splat(127)) << 23;
    let exp = p * bytemuck::cast::<i32x8, f32x8>(power);
    opaque.select(f32x8::ZERO, exp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_at_a_time_are_as_exact() {
        for i in 0..100_000 {
            let x: [f32; 8] = std::array::from_fn(|l| -86.9 + (i * 8 + l) as f32 * 2.1e-4);
            let eight = exp8(x.into()).to_array();
            for (x, y) in x.into_iter().zip(eight) {
                let error = f64::from(y) / f64::from(x).exp() - 1.0;
                assert!(error.abs() < 2e-7, "exp({x}) is off by {error:e}");
            }
        }
        let far = exp8(f32x8::splat(-1e30)).to_array();
        assert_eq!(far, [0.0; 8], "opaque");
    }

    #[test]
    fn relative_error_is_below_three_units_in_the_last_place() {
        let mut worst = 0.0f64;
        for i in 0..2_000_000 {
            let x = -87.0 + 175.0 * (i as f32 / 2e6);
            let exact = f64::from(x).exp();
            worst = worst.max((f64::from(exp(x)) / exact - 1.0).abs());
        }
        assert!(worst < 2e-7, "worst relative error {worst:e}");
        assert_eq!(exp(0.0), 1.0, "no medium, no loss");
        assert_eq!(exp(-1e30), 0.0, "opaque");
        assert_eq!(exp(f32::NEG_INFINITY), 0.0, "opaque");
    }
}
