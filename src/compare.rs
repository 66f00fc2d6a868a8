//! Two pictures in figures: is A what B is?
//!
//! With a and b the values of A and of the reference B, and means over pixels and channels:
//!
//! ```text
//! mean ratio  mean(a) / mean(b), per channel            bias of the whole picture
//! RMSE        √ mean( (a - b)² )                        [W/(m2 sr)]
//! relMSE      mean( (a - b)² / (b² + 0.01 mean(b)²) )
//! max abs     max |a - b|                               [W/(m2 sr)]
//! chi²        mean( (a - b)² / (s_a² + s_b²) )          1 if noise explains it all
//! ```
//!
//! The 0.01 mean(b)² keeps black pixels from dividing by zero; mean(b) is over all channels, so
//! that a channel without light is no exception. chi² needs the standard errors s of both
//! pictures, passes enough that they mean something, and different seeds: equal seeds share noise. Pixels that are not finite in either are
//! counted, left out of the figures, and fail any bound.

use serde::Serialize;

use crate::image::Picture;

/// Pictures that cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the pictures differ in size: {a} against {b}; they have to show the same pixels")]
pub struct SizeError {
    a: String,
    b: String,
}

/// What [`compare`] found. What is not a number, such as a ratio to black, is null in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Mean of A over mean of B, per channel; 1 where both are black.
    pub mean_ratio: [f64; 3],
    /// Root of the mean squared difference. \[W/(m2 sr)\]
    pub rmse: f64,
    /// Relative mean squared difference.
    pub relmse: f64,
    /// Largest difference. \[W/(m2 sr)\]
    pub max_abs: f64,
    /// Squared difference in units of its variance; null without standard errors in both files.
    pub chi2: Option<f64>,
    /// Pixels left out because a value is NaN or infinite.
    pub nonfinite_pixels: u64,
}

impl Figures {
    /// Is it within the bound? A picture with values that are not finite never is.
    pub fn within(&self, max_relmse: f64) -> bool {
        self.nonfinite_pixels == 0 && self.relmse <= max_relmse
    }
}

fn describe(p: &Picture) -> String {
    let [x, y] = p.origin;
    match (x, y) {
        (0, 0) => format!("{}x{}", p.width, p.height),
        _ => format!("{}x{} at {x},{y}", p.width, p.height),
    }
}

/// Values of the pixels that are finite in both.
fn finite_pairs<'a>(
    a: &'a Picture,
    b: &'a Picture,
) -> impl Iterator<Item = (usize, [f64; 3], [f64; 3])> + 'a {
    let pixels = a.rgb.iter().zip(&b.rgb).enumerate();
    pixels
        .filter(|(_, (a, b))| a.iter().chain(*b).all(|v| v.is_finite()))
        .map(|(i, (a, b))| (i, a.map(f64::from), b.map(f64::from)))
}

/// (a - b)² / (b² + floor), 0 where both are black.
fn relative(a: f64, b: f64, floor: f64) -> f64 {
    let difference = a - b;
    if difference == 0.0 {
        0.0
    } else {
        difference * difference / (b * b + floor)
    }
}

/// 0.01 mean(b)².
fn floor(b_sum: [f64; 3], pixels: f64) -> f64 {
    0.01 * (b_sum.iter().sum::<f64>() / (3.0 * pixels)).powi(2)
}

fn sums(a: &Picture, b: &Picture) -> (f64, [f64; 3], [f64; 3]) {
    let start = (0.0, [0.0; 3], [0.0; 3]);
    finite_pairs(a, b).fold(start, |(n, mut sa, mut sb), (_, pa, pb)| {
        for c in 0..3 {
            sa[c] += pa[c];
            sb[c] += pb[c];
        }
        (n + 1.0, sa, sb)
    })
}

/// Figures of A against the reference B.
pub fn compare(a: &Picture, b: &Picture) -> Result<Figures, SizeError> {
    if (a.width, a.height, a.origin) != (b.width, b.height, b.origin) {
        let (a, b) = (describe(a), describe(b));
        return Err(SizeError { a, b });
    }
    let (n, sa, sb) = sums(a, b);
    let floor = floor(sb, n.max(1.0));
    let (mut squares, mut relatives, mut max_abs) = (0.0, 0.0, 0.0_f64);
    let (mut chi2, mut chi2_count) = (0.0, 0.0);
    for (i, pa, pb) in finite_pairs(a, b) {
        for c in 0..3 {
            let difference = pa[c] - pb[c];
            squares += difference * difference;
            relatives += relative(pa[c], pb[c], floor);
            max_abs = max_abs.max(difference.abs());
            if let (Some(ea), Some(eb)) = (&a.standard_error, &b.standard_error) {
                let variance = f64::from(ea[i][c]).powi(2) + f64::from(eb[i][c]).powi(2);
                if variance > 0.0 {
                    chi2 += difference * difference / variance;
                    chi2_count += 1.0;
                }
            }
        }
    }
    let count = (3.0 * n).max(1.0);
    Ok(Figures {
        mean_ratio: [0, 1, 2].map(|c| if sa[c] == sb[c] { 1.0 } else { sa[c] / sb[c] }),
        rmse: (squares / count).sqrt(),
        relmse: relatives / count,
        max_abs,
        chi2: (chi2_count > 0.0).then(|| chi2 / chi2_count),
        nonfinite_pixels: a.rgb.len() as u64 - n as u64,
    })
}

/// Where A is brighter than B, red; darker, blue; equal, white; green, not finite. Full colour at
/// a relative difference of one half, of the sum of the channels and with the floor of relMSE. Bias
/// shows as a tint, noise as speckle. Red, green, blue bytes by row, for pictures that `compare`
/// takes.
pub fn heat_map(a: &Picture, b: &Picture) -> Vec<u8> {
    let (n, _, sb) = sums(a, b);
    let floor = 9.0 * floor(sb, n.max(1.0));
    let mut bytes = [40, 160, 40].repeat(a.rgb.len());
    for (i, pa, pb) in finite_pairs(a, b) {
        let (ya, yb): (f64, f64) = (pa.iter().sum(), pb.iter().sum());
        let strength = (2.0 * relative(ya, yb, floor).sqrt()).min(1.0);
        let pale = (255.0 * (1.0 - strength)).round() as u8;
        let colour = if ya > yb {
            [255, pale, pale]
        } else {
            [pale, pale, 255]
        };
        bytes[3 * i..3 * i + 3].copy_from_slice(&colour);
    }
    bytes
}
