//! The eight values around a voxel cell, and the field between them.
//!
//! ```text
//! f = sum over corners c   v(c) w_x w_y w_z      w = 1 - u at the lower corner, u at the upper
//! ```
//!
//! Values are kept as they are fetched, pairs of neighbours in z: x is interpolated first, for all
//! four (y, z) at a time, and nothing has to be moved before.

use glam::{DVec3, Vec3};
use wide::{f32x4, f64x4};

/// The eight values around a cell, as they are fetched.
#[derive(Debug, Clone, Copy)]
pub struct Corners {
    /// At x: (y, z), (y, z + 1), (y + 1, z), (y + 1, z + 1).
    pub(super) low: f32x4,
    /// At x + 1.
    pub(super) high: f32x4,
}

impl Corners {
    /// The value at one of them, 0 or 1 along each axis.
    #[inline]
    pub(super) fn get(&self, [x, y, z]: [i32; 3]) -> f32 {
        let side = if x == 0 { self.low } else { self.high };
        side.to_array()[(2 * y + z) as usize]
    }

    /// Trilinear at `f` in \[0, 1\]^3.
    #[inline]
    #[must_use]
    pub fn at(&self, f: Vec3) -> f32 {
        let along_x = (self.high - self.low).mul_add(f32x4::splat(f.x), self.low);
        let [a, b, c, d] = along_x.to_array();
        let low = (c - a).mul_add(f.y, a);
        let high = (d - b).mul_add(f.y, b);
        (high - low).mul_add(f.z, low)
    }

    /// The same in f64: a ray that only touches the field reads little of it.
    #[inline]
    pub(super) fn at_exactly(&self, f: f64x4) -> f64 {
        let [x, y, z, _] = f.to_array();
        let (low, high) = (wide4(self.low), wide4(self.high));
        let along_x = (high - low).mul_add(f64x4::splat(x), low);
        let [a, b, c, d] = along_x.to_array();
        let low = (c - a).mul_add(y, a);
        let high = (d - b).mul_add(y, b);
        (high - low).mul_add(z, low)
    }

    /// Mean of the field over a chord of the cell, as a sum over lanes, by the chord's middle in
    /// \[0, 1\]^3 and the square of its length: see `walk`.
    #[inline(always)]
    pub(super) fn mean_along(&self, middle: f64x4, square: f64, bends: &Bends) -> f64x4 {
        let [x, y, z, _] = middle.to_array();
        let square = f64x4::splat(square);
        let low = wide4(self.low);
        let slope = wide4(self.high) - low;
        // Of the four corners (y, z): their weights, and those slopes in y and z.
        let weight_y = Bends::Y.mul_add(f64x4::splat(y), f64x4::new([1.0, 1.0, 0.0, 0.0]));
        let weight_z = Bends::Z.mul_add(f64x4::splat(z), f64x4::new([1.0, 0.0, 1.0, 0.0]));
        let value = slope.mul_add(f64x4::splat(x), low);
        let of_value = bends.yz.mul_add(square, weight_y * weight_z);
        let of_slope = bends.xy.mul_add(weight_z, bends.xz * weight_y) * square;
        value.mul_add(of_value, slope * of_slope)
    }
}

/// What the field bends along a ray of direction u: products u_a u_b / 12, in the lanes of a
/// cell's four corners (y, z), with the signs of their slopes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bends {
    xy: f64x4,
    xz: f64x4,
    yz: f64x4,
}

impl Bends {
    /// Slopes of the corners' weights in y.
    const Y: f64x4 = f64x4::new([-1.0, -1.0, 1.0, 1.0]);
    /// The same in z.
    const Z: f64x4 = f64x4::new([-1.0, 1.0, -1.0, 1.0]);

    #[inline]
    pub(super) fn new(u: DVec3) -> Self {
        let twelfth = |product: f64| f64x4::splat(product * (1.0 / 12.0));
        Self {
            xy: twelfth(u.x * u.y) * Self::Y,
            xz: twelfth(u.x * u.z) * Self::Z,
            yz: twelfth(u.y * u.z) * Self::Y * Self::Z,
        }
    }
}

/// Four floats as doubles.
#[inline]
fn wide4(v: f32x4) -> f64x4 {
    f64x4::new(v.to_array().map(f64::from))
}
