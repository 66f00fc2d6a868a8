//! exp for transmittances, short enough to be inlined where photons are gathered.
//!
//! ```text
//! exp(x) = 2^n * exp(r)     n = round(x / ln 2)     r = x - n ln 2, |r| <= ln 2 / 2
//! ```
//!
//! ln 2 in two parts (Cody & Waite 1980), exp(r) by a polynomial of degree 6 (Cephes' expf).
//! Relative error below 2e-7 over [-87, 88], as a test shows over every binade.

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

#[cfg(test)]
mod tests {
    use super::*;

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
