//! From radiance to the eight bits of a picture for a screen.
//!
//! ```text
//! x  = 2^exposure · L                          exposure in stops
//! u  = (1 - d) x + d · mean(x)                 inset: light spills into the other channels
//! f  = s u (a s u + b) / (s u (c s u + d') + e)   the filmic curve, per channel
//! v  = ((f - d · mean(f)) / (1 - d))           outset: undoes the inset where f is straight
//! sRGB transfer (IEC 61966-2-1), then 8 bits with a dither of one step
//! ```
//!
//! The curve is Narkowicz's fit of the ACES reference tone mapping (2015; a = 2.51, b = 0.03,
//! c = 2.43, d' = 0.59, e = 0.14), scaled by s so that middle grey 0.18 stays 0.18. Applied alone,
//! channel by channel, it turns an overexposed flame pure yellow, for red and green saturate while
//! blue stays dark; the inset, an idea of AgX (Sobotka), lets bright saturated colours go to white
//! instead, as film does. Only the PNG is tone-mapped: the EXR keeps radiance.

/// Scale on radiance ahead of the curve; pinned by `middle_grey_stays`.
const SCALE: f64 = 0.7226;

/// Share of each channel spilled over all three. Less, and flames turn to flat yellow; more, and
/// blue skies turn grey.
const INSET: f64 = 0.12;

/// Tone-mapped, display-encoded RGB from radiance. Results lie in 0 to 1, for NaN too.
pub fn map(radiance: [f64; 3], exposure: f64) -> [f64; 3] {
    let x = radiance.map(|l| (l * exposure.exp2()).max(0.0));
    let f = blend(x, INSET).map(filmic);
    // The inverse of blending with d is blending with -d / (1 - d).
    blend(f, -INSET / (1.0 - INSET)).map(|v| encode_srgb(v.clamp(0.0, 1.0)))
}

/// Moves every channel towards the mean of the three.
fn blend(c: [f64; 3], share: f64) -> [f64; 3] {
    let mean = (c[0] + c[1] + c[2]) / 3.0;
    c.map(|v| v + share * (mean - v))
}

/// 0 at 0, 1 near 8, then held there.
fn filmic(u: f64) -> f64 {
    // Beyond this both polynomials overflow to infinity; the curve has long reached 1.
    let u = (SCALE * u).min(1e6);
    (u * (2.51 * u + 0.03) / (u * (2.43 * u + 0.59) + 0.14)).min(1.0)
}

/// Transfer function of sRGB, for 0 to 1.
fn encode_srgb(v: f64) -> f64 {
    if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
}

/// Eight bits from 0 to 1, rounded up or down at random so that soft gradients of fog do not band.
/// The choice depends on the pixel and channel only.
pub fn quantise(v: f64, x: u32, y: u32, channel: u32) -> u8 {
    let h = hash(x ^ hash(y ^ hash(channel)));
    let dither = f64::from(h) / (f64::from(u32::MAX) + 1.0);
    (v * 255.0 + dither).floor().clamp(0.0, 255.0) as u8
}

/// Mixes 32 bits (Wellons 2018, "lowbias32").
fn hash(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x7feb_352d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middle_grey_stays() {
        let [r, g, b] = map([0.18; 3], 0.0);
        let expected = encode_srgb(0.18);
        for v in [r, g, b] {
            assert!((v - expected).abs() < 1e-3, "{v} against {expected}");
        }
    }

    #[test]
    fn black_white_and_beyond() {
        assert_eq!(map([0.0; 3], 0.0), [0.0; 3]);
        for l in [100.0, 1e30, f64::INFINITY] {
            assert!(map([l; 3], 0.0)[0] > 0.999, "{l}");
        }
        assert_eq!(map([-1.0; 3], 0.0), [0.0; 3]);
        assert!(
            map([f64::NAN; 3], 0.0)
                .iter()
                .all(|v| (0.0..=1.0).contains(v)),
            "NaN"
        );
    }

    #[test]
    fn brighter_is_never_darker() {
        let mut last = 0.0;
        for i in 0..400 {
            let v = map([(f64::from(i) * 0.05 - 10.0).exp2(); 3], 0.0)[1];
            assert!(v >= last, "step {i}: {v} after {last}");
            last = v;
        }
    }

    #[test]
    fn a_stop_doubles() {
        assert_eq!(map([0.1, 0.2, 0.3], 1.0), map([0.2, 0.4, 0.6], 0.0));
    }

    /// What the inset is for: a flame ten stops over is white, not yellow.
    #[test]
    fn overexposed_colours_go_to_white() {
        let v = map([800.0, 300.0, 50.0], 0.0);
        assert!(v.iter().all(|v| *v > 0.95), "{v:?}");
    }

    /// The dither is unbiased and never leaves black or white.
    #[test]
    fn dither_keeps_the_mean() {
        let n = 128;
        let mut sum = 0.0;
        for y in 0..n {
            for x in 0..n {
                sum += f64::from(quantise(100.3 / 255.0, x, y, 0));
                assert_eq!(quantise(0.0, x, y, 0), 0);
                assert_eq!(quantise(1.0, x, y, 0), 255);
            }
        }
        let count = f64::from(n * n);
        // A coin that falls on 101 with p = 0.3: 4 standard errors.
        let bound = 4.0 * (0.3_f64 * 0.7 / count).sqrt();
        assert!((sum / count - 100.3).abs() < bound, "{}", sum / count);
    }
}
