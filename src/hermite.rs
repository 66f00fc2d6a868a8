//! Optical depth between two points of a ray, by its values and slopes there.
//!
//! ```text
//! D(s) = D0 + s d0 + s^2 (3 dD - 2 d0 - d1) + s^3 (d0 + d1 - 2 dD)     s = (t - t0) / (t1 - t0)
//! d = density * (t1 - t0), dD = D1 - D0
//! ```
//!
//! The slope of the depth *is* the density, which the knots hold.

/// A point of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Distance. \[m\]
    pub t: f32,
    /// Integral of the density up to here. \[m\]
    pub depth: f32,
    /// Density here; its one-sided limit where two knots share t.
    pub density: f32,
}

/// Cubic Hermite interpolation of the depth between two knots. Kept between theirs: the cubic may
/// swing out where the field bends sharply inside a cell, which the exact depth cannot.
#[inline]
#[must_use]
pub fn hermite(a: Knot, b: Knot, s: f32) -> f32 {
    let length = b.t - a.t;
    let rise = b.depth - a.depth;
    let (start, end) = (a.density * length, b.density * length);
    // depth = a + s start + s^2 (3 rise - 2 start - end) + s^3 (start + end - 2 rise)
    let cubic = start + end - 2.0 * rise;
    let square = rise - start - cubic;
    s.mul_add(s.mul_add(s.mul_add(cubic, square), start), a.depth)
        .clamp(a.depth, b.depth.max(a.depth))
}

/// Slope of [`hermite`]: the density. 0 between knots that share t.
#[inline]
#[must_use]
pub fn slope(a: Knot, b: Knot, s: f32) -> f32 {
    let length = b.t - a.t;
    if length <= 0.0 {
        return 0.0;
    }
    let mean = (b.depth - a.depth) / length;
    let bump = 6.0 * s * (1.0 - s) * (mean - 0.5 * (a.density + b.density));
    ((b.density - a.density).mul_add(s, a.density) + bump).max(0.0)
}

/// Where between two knots the depth is reached, to the rounding of the depth itself.
#[must_use]
pub fn distance(a: Knot, b: Knot, depth: f32) -> f32 {
    if b.depth <= a.depth {
        return if depth <= a.depth { a.t } else { b.t };
    }
    let (target, rise) = (depth - a.depth, b.depth - a.depth);
    let begin = Knot { depth: 0.0, ..a };
    let end = Knot { depth: rise, ..b };
    let length = b.t - a.t;
    let s = invert(
        target.into(),
        f64::from(target) / f64::from(rise),
        2.0 * f64::from(f32::EPSILON) * f64::from(depth),
        |s| {
            let s = s as f32;
            (
                hermite(begin, end, s).into(),
                (slope(begin, end, s) * length).into(),
            )
        },
    );
    (s as f32).mul_add(length, a.t)
}

/// The argument in [0, 1] at which a rising function is within `tolerance` of `target`, from a
/// guess. `at` gives its value and slope.
///
/// Newton's method, kept inside a bracket that every fourth step halves: where the density nearly
/// vanishes inside a cell, Newton alone creeps.
pub(crate) fn invert(
    target: f64,
    guess: f64,
    tolerance: f64,
    at: impl Fn(f64) -> (f64, f64),
) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    let mut s = guess.clamp(0.0, 1.0);
    for step in 1..=MOST_STEPS {
        let (value, slope) = at(s);
        let error = value - target;
        if error.abs() <= tolerance {
            break;
        }
        if error > 0.0 {
            high = s;
        } else {
            low = s;
        }
        let next = s - error / slope;
        s = if step % 4 != 0 && next > low && next < high {
            next
        } else {
            0.5 * (low + high)
        };
    }
    s
}

/// Steps of an inversion. Fewer: the first mean free path of a cell of a million is missed by more
/// than f32 resolves; more: time where rounding keeps the tolerance from being met.
const MOST_STEPS: u32 = 96;
