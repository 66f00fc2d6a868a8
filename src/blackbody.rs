//! Light of a black body.
//!
//! ```text
//! B(lambda, T) = 2 h c^2 / lambda^5 / (exp(h c / (lambda k T)) - 1)     [W/(m2 sr m)]
//! rgb(T)       = sRGB(B(T)) / Y(B(scale))
//! ```
//!
//! Planck's law, seen through the CIE 1931 colour matching functions (the Gaussian fits of Wyman,
//! Sloan & Shirley 2013) and taken to linear sRGB; colours outside the gamut are brought in by
//! raising the negative channel to 0. Divided by the luminance at `scale`, so that a scene's
//! `radiance` is the emission's luminance where the temperature grid is 1. A table over 1/T, in
//! which the logarithm is nearly straight, makes a look-up of it.

use crate::scene::Rgb;

/// Entries of the table.
const ENTRIES: usize = 1024;
/// Coolest temperature that is looked at: a black body of 500 K emits 1e-9 of the visible light
/// of one at 1500 K. \[K\]
pub const COOLEST: f64 = 500.0;
/// Hottest of the table; beyond it, the Rayleigh-Jeans law takes over. \[K\]
const HOTTEST: f64 = 40_000.0;

/// Linear sRGB of a black body over temperature.
#[derive(Debug, Clone)]
pub struct Blackbody {
    /// Natural logarithms of the channels over 1/T, even steps.
    table: Vec<[f32; 3]>,
}

/// Radiance of a black body. \[W/(m2 sr m)\]
fn planck(lambda: f64, kelvin: f64) -> f64 {
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 299_792_458.0;
    const K: f64 = 1.380_649e-23;
    2.0 * H * C * C / lambda.powi(5) / (H * C / (lambda * K * kelvin)).exp_m1()
}

/// CIE 1931 x, y, z at a wavelength \[nm\]; fits of Wyman, Sloan & Shirley 2013.
fn colour_matching(nm: f64) -> [f64; 3] {
    let lobe = |peak: f64, low: f64, high: f64| {
        let t = (nm - peak) * if nm < peak { low } else { high };
        (-0.5 * t * t).exp()
    };
    [
        0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323)
            - 0.065 * lobe(501.1, 0.0490, 0.0382),
        0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322),
        1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725),
    ]
}

/// XYZ of a black body.
fn xyz(kelvin: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for nm in (360..=830).step_by(2) {
        let b = planck(f64::from(nm) * 1e-9, kelvin) * 2e-9;
        let bars = colour_matching(f64::from(nm));
        for c in 0..3 {
            sum[c] += b * bars[c];
        }
    }
    sum
}

impl Blackbody {
    /// The table, with luminance 1 at `scale` \[K\].
    #[must_use]
    pub fn new(scale: f64) -> Self {
        let white = xyz(scale)[1];
        let table = (0..ENTRIES)
            .map(|i| {
                let inverse = 1.0 / HOTTEST
                    + (1.0 / COOLEST - 1.0 / HOTTEST) * i as f64 / (ENTRIES - 1) as f64;
                let [x, y, z] = xyz(1.0 / inverse).map(|v| v / white);
                let rgb = [
                    3.240_454_2 * x - 1.537_138_5 * y - 0.498_531_4 * z,
                    -0.969_266_0 * x + 1.876_010_8 * y + 0.041_556_0 * z,
                    0.055_643_4 * x - 0.204_025_9 * y + 1.057_225_2 * z,
                ];
                rgb.map(|v| v.max(1e-30).ln() as f32)
            })
            .collect();
        Self { table }
    }

    /// Radiance at a temperature over the luminance at `scale`.
    #[must_use]
    pub fn rgb(&self, kelvin: f32) -> Rgb {
        if kelvin < COOLEST as f32 {
            return Rgb::ZERO;
        }
        let hot = (kelvin / HOTTEST as f32).max(1.0);
        let inverse = f64::from(1.0 / kelvin.min(HOTTEST as f32));
        let x = ((inverse - 1.0 / HOTTEST) / (1.0 / COOLEST - 1.0 / HOTTEST) * (ENTRIES - 1) as f64)
            as f32;
        let i = (x as usize).min(ENTRIES - 2);
        let f = x - i as f32;
        let (a, b) = (self.table[i], self.table[i + 1]);
        Rgb::from_array(std::array::from_fn(|c| {
            ((b[c] - a[c]).mul_add(f, a[c])).exp()
        })) * hot
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luminance_is_one_at_the_scale_and_colour_goes_from_red_to_blue() {
        let body = Blackbody::new(1500.0);
        let y = |c: Rgb| 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
        // The gamut's edge cuts blue at 1500 K; luminance keeps within 2 %.
        assert!(
            (y(body.rgb(1500.0)) - 1.0).abs() < 0.02,
            "luminance {}",
            y(body.rgb(1500.0))
        );
        let (warm, cold) = (body.rgb(1200.0), body.rgb(12_000.0));
        assert!(warm.x > warm.y && warm.y > warm.z, "embers are red: {warm}");
        assert!(cold.z > cold.x, "a blue star is blue: {cold}");
        assert_eq!(body.rgb(300.0), Rgb::ZERO, "a room does not glow");
    }

    /// sRGB's white is D65: a black body of 6504 K is within a few percent of grey.
    #[test]
    fn daylight_is_nearly_white() {
        let c = Blackbody::new(6504.0).rgb(6504.0);
        assert!(
            (c.max_element() - c.min_element()) / c.max_element() < 0.08,
            "6504 K is {c}"
        );
    }
}
