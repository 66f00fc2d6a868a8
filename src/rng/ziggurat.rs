//! Exponential numbers, mostly without a logarithm.
//!
//! ```text
//! f(x) = exp(-x)      256 layers of equal area V under and around f, the lowest with the tail
//! x_0 = V / f(R)      x_1 = R      f(x_(i+1)) = f(x_i) + V / x_i      x_256 = 0
//! layer i:            x = u x_i, u uniform;  below x_(i+1): under f, and done
//! ```
//!
//! 98.9 % of numbers are done so. Else a point of the layer's edge is accepted if it is under f, and
//! beyond R the distribution is that from 0 on, moved. Exact but for the rounding of f64: u has 53
//! bits, and a number can be 0 or 1e-16 as well as 40.
//!
//! Source: Marsaglia & Tsang 2000, The ziggurat method for generating random variables.

/// Layers.
const LAYERS: usize = 256;
/// Where the tail begins: what makes the last layer end at f = 1.
const R: f64 = 7.697_117_470_131_05;
/// Area of a layer.
const V: f64 = 0.003_949_659_822_581_557;

/// Right ends of the layers, from the lowest on.
static ENDS: [f64; LAYERS + 1] = ends();

const fn ends() -> [f64; LAYERS + 1] {
    let mut ends = [0.0; LAYERS + 1];
    // V is R f(R) and the tail, f(R).
    let mut height = V / (R + 1.0);
    ends[0] = V / height;
    ends[1] = R;
    let mut i = 1;
    while i + 1 < LAYERS {
        height += V / ends[i];
        ends[i + 1] = -ln(height);
        i += 1;
    }
    ends
}

/// Logarithm of a number in (0, 1), while compiling.
const fn ln(mut x: f64) -> f64 {
    let mut halvings = 0;
    while x < 0.75 {
        x *= 2.0;
        halvings += 1;
    }
    // ln x = 2 artanh s, |s| < 1/7.
    let s = (x - 1.0) / (x + 1.0);
    let mut sum = 0.0;
    let mut power = s;
    let mut n = 1;
    while n < 25 {
        sum += power / n as f64;
        power *= s * s;
        n += 2;
    }
    2.0 * sum - halvings as f64 * std::f64::consts::LN_2
}

/// A number distributed as exp(-x), of random bits.
#[inline]
pub(super) fn exponential(mut bits: impl FnMut() -> u64) -> f64 {
    let mut from = 0.0;
    loop {
        let drawn = bits();
        // The layer by bits that u does not have.
        let layer = (drawn & (LAYERS as u64 - 1)) as usize;
        let x = unit(drawn) * ENDS[layer];
        if x < ENDS[layer + 1] {
            return from + x;
        }
        if layer == 0 {
            from += R;
        } else if under(layer, x, unit(bits())) {
            return from + x;
        }
    }
}

/// Uniform in [0, 1), 53 bits.
#[inline]
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// True if the point at x, at u of a layer's height, is under f.
#[cold]
fn under(layer: usize, x: f64, u: f64) -> bool {
    let (low, high) = ((-ENDS[layer]).exp(), (-ENDS[layer + 1]).exp());
    u.mul_add(high - low, low) < (-x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Layers have one area and reach the top, which R and V alone can be right for.
    #[test]
    fn layers_are_of_one_area() {
        for (i, ends) in ENDS.windows(2).enumerate().skip(1) {
            let area = ends[0] * ((-ends[1]).exp() - (-ends[0]).exp());
            assert!((area / V - 1.0).abs() < 1e-11, "layer {i}: {area}");
        }
        assert!(((R + 1.0) * (-R).exp() / V - 1.0).abs() < 1e-11);
    }

    /// Steps as long and as short as the 53 bits of a uniform allow.
    #[test]
    fn tail_and_zero_are_reached() {
        let draw = |bits: &[u64]| {
            let mut bits = bits.iter().copied();
            exponential(|| bits.next().expect("few draws"))
        };
        let tail = !0xff;
        assert_eq!(draw(&[0]), 0.0);
        assert!(draw(&[1 << 11 | 3]) < 1e-14);
        let far = draw(&[tail, tail, tail, 1 << 63]);
        assert!((3.0 * R..4.0 * R).contains(&far), "{far}");
    }
}
