//! Optical depth between two points of a ray, by its values and slopes there.
//!
//! ```text
//! D(s) = D0 + s d0 + s^2 (3 dD - 2 d0 - d1) + s^3 (d0 + d1 - 2 dD)     s = (t - t0) / (t1 - t0)
//! d = density * (t1 - t0), dD = D1 - D0
//! ```
//!
//! The slope of the depth *is* the density, which the knots hold.

use wide::f32x8;

/// A point of a profile.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Knot {
    /// Distance. \[m\]
    pub t: f32,
    /// Integral of the density up to here. \[m\]
    pub depth: f32,
    /// Density here; its one-sided limit where two knots share t.
    pub density: f32,
}

/// The depth between two knots. Eight numbers in a row: one load brings all of them.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct Cubic {
    /// Where it begins. \[m\]
    pub t: f32,
    /// One over its length; 0 between knots that share t, or all but do. \[1/m\]
    per_length: f32,
    /// Depth at its begin. \[m\]
    depth: f32,
    /// Of s, s^2, s^3. \[m\]
    start: f32,
    square: f32,
    cubic: f32,
    /// Depth at its end. \[m\]
    pub end_depth: f32,
    /// Where it ends. \[m\]
    pub end: f32,
}

impl Cubic {
    /// Behind the last one: no t is beyond its begin.
    pub const END: Self = Self {
        t: f32::NAN,
        per_length: 0.0,
        depth: 0.0,
        start: 0.0,
        square: 0.0,
        cubic: 0.0,
        end_depth: 0.0,
        end: 0.0,
    };

    /// True where the depth rises.
    #[inline]
    #[must_use]
    pub fn rises(&self) -> bool {
        self.end_depth > self.depth
    }

    /// Between two knots.
    #[inline(always)]
    #[must_use]
    pub fn between(a: Knot, b: Knot) -> Self {
        let length = b.t - a.t;
        let rise = b.depth - a.depth;
        let (start, end) = (a.density * length, b.density * length);
        let cubic = start + end - 2.0 * rise;
        Self {
            t: a.t,
            per_length: if length > f32::MIN_POSITIVE {
                1.0 / length
            } else {
                0.0
            },
            depth: a.depth,
            start,
            square: rise - start - cubic,
            cubic,
            end_depth: b.depth.max(a.depth),
            end: b.t,
        }
    }

    /// Share of the way from begin to end at t, which may be infinite.
    #[inline]
    fn share(&self, t: f32) -> f32 {
        ((t.min(self.end) - self.t) * self.per_length).clamp(0.0, 1.0)
    }

    /// Depth at a share of the way from the begin's on. Kept between 0 and that of the end: the
    /// cubic may swing out where the field bends sharply inside a cell, which the exact depth cannot.
    #[inline]
    fn rise_of(&self, s: f32) -> f32 {
        let rise = s * s.mul_add(s.mul_add(self.cubic, self.square), self.start);
        rise.clamp(0.0, self.end_depth - self.depth)
    }

    /// Its slope there: the density times the length.
    #[inline]
    fn slope_of(&self, s: f32) -> f32 {
        let slope = s.mul_add(s.mul_add(3.0 * self.cubic, 2.0 * self.square), self.start);
        slope.max(0.0)
    }

    /// Integral of the density up to t; that of the nearer end beyond them. \[m\]
    #[inline]
    #[must_use]
    pub fn depth(&self, t: f32) -> f32 {
        let s = self.share(t);
        let along = s.mul_add(s.mul_add(self.cubic, self.square), self.start);
        s.mul_add(along, self.depth)
            .clamp(self.depth, self.end_depth)
    }

    /// Density at t; 0 beyond the ends.
    #[inline]
    #[must_use]
    pub fn density(&self, t: f32) -> f32 {
        if (self.t..=self.end).contains(&t) {
            self.slope_of(self.share(t)) * self.per_length
        } else {
            0.0
        }
    }

    /// Where the depth is reached, to its own rounding; the nearer end if it is not.
    #[must_use]
    pub fn distance(&self, depth: f32) -> f32 {
        if !self.rises() {
            return if depth <= self.depth {
                self.t
            } else {
                self.end
            };
        }
        let target = depth - self.depth;
        let s = invert(
            target.into(),
            f64::from(target) / f64::from(self.end_depth - self.depth),
            2.0 * f64::from(f32::EPSILON) * f64::from(depth),
            |s| {
                let s = s as f32;
                (self.rise_of(s).into(), self.slope_of(s).into())
            },
        );
        (s as f32).mul_add(self.end - self.t, self.t)
    }

    /// [`Self::depth`] and [`Self::density`] of eight, each at its own finite t.
    #[inline]
    #[must_use]
    pub fn read(cubics: [&Self; 8], t: f32x8) -> [f32x8; 2] {
        let rows = cubics.map(|c| {
            let row = [
                c.t,
                c.per_length,
                c.depth,
                c.start,
                c.square,
                c.cubic,
                c.end_depth,
                c.end,
            ];
            f32x8::from(row)
        });
        let [
            begin,
            per_length,
            depth,
            start,
            square,
            cubic,
            end_depth,
            end,
        ] = f32x8::transpose(rows);
        let (zero, one, two) = (f32x8::ZERO, f32x8::ONE, f32x8::splat(2.0));
        let s = ((t - begin) * per_length).fast_max(zero).fast_min(one);
        let twice = s.mul_add(cubic, square);
        let along = s.mul_add(s.mul_add(twice, start), depth);
        // 3 c s + 2 q = 2 (c s + q) + c s
        let slope = s.mul_add(s.mul_add(cubic, two * twice), start);
        let inside = t.simd_ge(begin) & t.simd_le(end);
        [
            along.fast_max(depth).fast_min(end_depth),
            inside.select((slope * per_length).fast_max(zero), zero),
        ]
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Of any length down to none, at places inside, at the ends and infinitely far: depths between
    /// those of the knots, densities that are finite and 0 beyond, and eight at a time the same.
    #[test]
    fn readings_are_within_the_knots() {
        for length in [0.0, 1e-40, 1e-38, 1e-6, 1.0, 1e30] {
            for begin in [0.0, 1.0] {
                let a = Knot {
                    t: begin,
                    depth: 2.0,
                    density: 3.0,
                };
                let b = Knot {
                    t: begin + length,
                    depth: 2.0 + length,
                    density: 0.5,
                };
                let cubic = Cubic::between(a, b);
                let middle = 0.5 * length + begin;
                for t in [0.0, begin, middle, b.t, 5.0, f32::MAX, f32::INFINITY] {
                    let (depth, density) = (cubic.depth(t), cubic.density(t));
                    assert!(
                        (a.depth..=b.depth).contains(&depth) && density.is_finite(),
                        "{a:?} {b:?} at {t}: {depth}, {density}"
                    );
                    let beyond = t < a.t || t > b.t;
                    assert!(!beyond || density == 0.0, "{density} beyond {b:?}");
                    if t.is_finite() {
                        let [depths, densities] = Cubic::read([&cubic; 8], f32x8::splat(t));
                        let [d8, rho8] = [depths, densities].map(|v| v.to_array()[7]);
                        assert!((d8 - depth).abs() <= 1e-6 * depth, "{d8} for {depth}");
                        assert!(
                            (rho8 - density).abs() <= 1e-5 * a.density,
                            "{rho8} for {density}"
                        );
                    }
                }
            }
        }
    }
}
