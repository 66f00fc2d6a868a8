//! Optical depth along a ray in f64, written for plainness: every voxel face that the ray meets,
//! sorted; between two of them the field is a cubic, which Gauss's two points integrate exactly.

use glam::DVec3;

use crate::grid::Grid;
use crate::ray::Ray;

use super::fields::{cell_value, corners};

/// Integral of a grid's density along a local ray.
#[derive(Debug)]
pub struct Depth<'a> {
    grid: &'a Grid,
    origin: DVec3,
    direction: DVec3,
    /// Crossings, from the first to the last in the support.
    t: Vec<f64>,
    /// Integral up to each.
    depth: Vec<f64>,
    /// Integral of the field's steepest slope up to each.
    rough: Vec<f64>,
}

impl<'a> Depth<'a> {
    /// Of [0, `t_max`] of the ray.
    #[must_use]
    pub fn new(grid: &'a Grid, ray: &Ray, t_max: f64) -> Self {
        Self::of(grid, ray.origin.as_dvec3(), ray.direction.as_dvec3(), t_max)
    }

    /// The same of a ray that f32 does not know.
    #[must_use]
    pub fn of(grid: &'a Grid, origin: DVec3, direction: DVec3, t_max: f64) -> Self {
        let (low, high) = (grid.support().min.as_dvec3(), grid.support().max.as_dvec3());
        let (mut enter, mut exit) = (0.0, t_max);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d == 0.0 {
                if o < low[axis] || o > high[axis] {
                    exit = enter;
                }
                continue;
            }
            let (a, b) = ((low[axis] - o) / d, (high[axis] - o) / d);
            enter = f64::max(enter, a.min(b));
            exit = f64::min(exit, a.max(b));
        }
        let mut t = vec![enter];
        if enter < exit {
            for axis in 0..3 {
                let (o, d) = (origin[axis], direction[axis]);
                if d == 0.0 {
                    continue;
                }
                let (a, b) = (o + enter * d, o + exit * d);
                for plane in a.min(b).floor() as i64..=a.max(b).ceil() as i64 {
                    let crossing = (plane as f64 - o) / d;
                    if crossing > enter && crossing < exit {
                        t.push(crossing);
                    }
                }
            }
            t.push(exit);
            t.sort_by(f64::total_cmp);
        }
        let mut this = Self {
            grid,
            origin,
            direction,
            depth: vec![0.0],
            rough: vec![0.0],
            t,
        };
        for i in 1..this.t.len() {
            let before = this.depth[i - 1];
            this.depth
                .push(before + this.piece(this.t[i - 1], this.t[i], this.t[i]));
            let (a, b) = (this.t[i - 1], this.t[i]);
            let v = this.cell(a, b);
            let steepest = |bit: usize| {
                (0..8)
                    .filter(|i| i >> bit & 1 == 0)
                    .fold(0.0f64, |s, i| s.max((v[i | 1 << bit] - v[i]).abs()))
            };
            let slope = steepest(0) + steepest(1) + steepest(2);
            this.rough.push(this.rough[i - 1] + slope * (b - a));
        }
        this
    }

    /// Integral from a to b, both in the piece that ends at `end`.
    fn piece(&self, a: f64, b: f64, end: f64) -> f64 {
        let at = |t: f64| self.origin + t * self.direction;
        let cell = at(0.5 * (a + end)).floor();
        let values = corners(self.grid, cell.as_ivec3());
        let half = 0.5 * (b - a);
        let gauss = half / 3f64.sqrt();
        let value = |t: f64| cell_value(&values, at(t) - cell);
        let middle = 0.5 * (a + b);
        half * (value(middle - gauss) + value(middle + gauss))
    }

    /// Corners of the cell that the piece from a to b is in.
    fn cell(&self, a: f64, b: f64) -> [f64; 8] {
        let middle = self.origin + 0.5 * (a + b) * self.direction;
        corners(self.grid, middle.floor().as_ivec3())
    }

    /// Integral of the steepest slope up to the end of t's piece.
    #[must_use]
    pub fn roughness(&self, t: f64) -> f64 {
        let i = self.t.partition_point(|x| *x <= t).min(self.t.len() - 1);
        self.rough[i]
    }

    /// Most that reading t's piece as a Hermite cubic misses of the depth, and of the density.
    #[must_use]
    pub fn cubic_reading_error(&self, t: f64) -> (f64, f64) {
        let i = self.t.partition_point(|x| *x <= t);
        if i == 0 || i == self.t.len() {
            return (0.0, 0.0);
        }
        let (a, b) = (self.t[i - 1], self.t[i]);
        let v = self.cell(a, b);
        let twist = v[7] - v[6] - v[5] - v[3] + v[4] + v[2] + v[1] - v[0];
        let c = (twist * self.direction.x * self.direction.y * self.direction.z).abs();
        let length = b - a;
        (c * length.powi(4) / 64.0, 0.0482 * c * length.powi(3))
    }

    /// Integral up to t.
    #[must_use]
    pub fn at(&self, t: f64) -> f64 {
        let i = self.t.partition_point(|x| *x <= t);
        if i == 0 {
            return 0.0;
        }
        if i == self.t.len() {
            return self.total();
        }
        self.depth[i - 1] + self.piece(self.t[i - 1], t, self.t[i])
    }

    /// Integral along the whole ray.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.depth[self.depth.len() - 1]
    }

    /// Density at t.
    #[must_use]
    pub fn density(&self, t: f64) -> f64 {
        super::fields::trilinear(self.grid, self.origin + t * self.direction)
    }

    /// First and last crossing.
    #[must_use]
    pub fn extent(&self) -> (f64, f64) {
        (self.t[0], self.t[self.t.len() - 1])
    }
}
