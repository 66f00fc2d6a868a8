//! Segments too dense for null collisions, followed voxel cell by voxel cell.
//!
//! ```text
//! free flight     t with   sigma_t * integral from t_min to t of the density = -ln(1 - u)
//! transmittance   exp(-sigma_t * integral of the density)
//! ```
//!
//! Null collisions of a segment number sigma_maj times its length, whatever the density: a spike of
//! 1e38 among densities of 1 would take for ever, and steps shorter than f32 resolves never end.
//! Regular tracking takes two look-ups a cell, however thick; it is exact, so where it begins
//! changes no expectation.

use crate::grid::walk::{Piece, walk};
use crate::hermite::invert;
use crate::medium::GridField;
use crate::ray::Ray;
use crate::spectrum::Spectrum;

use super::hero::{Hero, Passed, coloured};

/// Mean free paths of the majorant across a voxel beyond which a segment is followed cell by cell.
/// Lower: media that null collisions cross in fewer look-ups; higher: loops that grow with what a
/// spike is over its surroundings.
pub(super) const DENSE: f32 = 64.0;

/// The majorant \[1/m\] above which a segment of a ray in voxels is dense.
#[inline]
pub(super) fn least_dense(local: &Ray) -> f32 {
    DENSE * local.direction.length()
}

/// A ray in a grid whose segments are dense.
pub(super) struct Dense<'a> {
    field: &'a GridField,
    ray: &'a Ray,
}

impl<'a> Dense<'a> {
    /// A world's ray.
    pub(super) fn new(field: &'a GridField, ray: &'a Ray) -> Self {
        Self { field, ray }
    }

    /// Visits the pieces of [t0, t1]; returns look-ups.
    fn pieces(&self, t0: f32, t1: f32, visit: impl FnMut(Piece) -> bool) -> u64 {
        let local = self.field.placement.exact_ray(self.ray);
        walk(
            &self.field.grid,
            &self.field.majorants,
            &local,
            t0,
            t1,
            visit,
        )
    }

    /// Integral of the density over [t0, t1] \[m\], and look-ups.
    #[cold]
    pub(super) fn depth(&self, t0: f32, t1: f32) -> (f64, u64) {
        let mut depth = 0.0;
        let lookups = self.pieces(t0, t1, |piece| {
            depth += piece.integral;
            true
        });
        (depth, lookups)
    }

    /// The first collision in [t0, t1]. `budget` is the optical thickness up to it: what is left of an
    /// exponential one is another, for real collisions as for null ones.
    #[cold]
    pub(super) fn flight<S: Spectrum>(
        &self,
        (t0, t1): (f32, f32),
        sigma_t: S,
        mut budget: f32,
        hero: &mut Hero<S>,
    ) -> Found {
        let mut t = None;
        let mut more = 0;
        let local = self.field.placement.local_ray(self.ray);
        let density = |t| {
            more += 1;
            self.field.grid.lookup(local.at(t))
        };
        let mut collide = Collide {
            sigma_t,
            budget: &mut budget,
            hero,
            density,
        };
        let lookups = self.pieces(t0, t1, |piece| {
            t = collide.within(&piece);
            t.is_none()
        });
        Found {
            t,
            left: budget,
            lookups: lookups + more,
        }
    }
}

/// What came of a flight through a dense segment.
#[derive(Debug)]
pub(super) struct Found {
    /// The collision.
    pub(super) t: Option<f32>,
    /// What is left of the budget if there is none.
    pub(super) left: f32,
    pub(super) lookups: u64,
}

/// Depth along a ray in one cell: a quartic, since the density is a cubic.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    t: f32,
    length: f32,
    /// Of s, s^2, s^3, s^4; s in [0, 1].
    coefficients: [f64; 4],
}

impl Cell {
    /// By the density at s = 0, 1/4, 1/2 and 1, in units of `unit`.
    fn new(piece: &Piece, quarter: f32, unit: f32) -> Self {
        let [a, c, d] = piece.density;
        let [a, b, c, d] = [a, quarter, c, d].map(|v| f64::from(v) / f64::from(unit));
        let length = piece.t_max - piece.t_min;
        // The cubic a + p s + q s^2 + r s^3 through the other three.
        let (b, c, d) = (4.0 * (b - a), 2.0 * (c - a), d - a);
        // b = p + q / 4 + r / 16     c = p + q / 2 + r / 4     d = p + q + r
        let (e, f) = (4.0 * (c - b), 2.0 * (d - c));
        // e = q + 3 r / 4     f = q + 3 r / 2
        let r = (f - e) / 0.75;
        let q = e - 0.75 * r;
        let p = d - q - r;
        Self {
            t: piece.t_min,
            length,
            coefficients: [a, p / 2.0, q / 3.0, r / 4.0].map(|v| v * f64::from(length)),
        }
    }

    /// Depth from the cell's begin to s, and its slope there.
    fn at(&self, s: f64) -> (f64, f64) {
        let [a, b, c, d] = self.coefficients;
        (
            s * (a + s * (b + s * (c + s * d))),
            a + s * (2.0 * b + s * (3.0 * c + s * 4.0 * d)),
        )
    }

    /// Depth from the cell's begin to t.
    pub(super) fn depth(&self, t: f32) -> f32 {
        let s = f64::from((t - self.t) / self.length).clamp(0.0, 1.0);
        self.at(s).0.max(0.0) as f32
    }

    /// Where the depth is reached.
    fn distance(&self, depth: f64) -> f32 {
        let tolerance = f64::from(f32::EPSILON) * depth;
        let s = invert(depth, depth / self.at(1.0).0, tolerance, |s| self.at(s));
        (s as f32).mul_add(self.length, self.t)
    }
}

/// A search for a collision, piece by piece.
pub(super) struct Collide<'a, S, D> {
    pub(super) sigma_t: S,
    /// Optical thickness up to the collision.
    pub(super) budget: &'a mut f32,
    pub(super) hero: &'a mut Hero<S>,
    /// The density at t.
    pub(super) density: D,
}

impl<S: Spectrum, D: FnMut(f32) -> f32> Collide<'_, S, D> {
    /// The collision in a piece, if the budget ends in it.
    pub(super) fn within(&mut self, piece: &Piece) -> Option<f32> {
        let sigma = f64::from(self.sigma_t.channel(self.hero.channel));
        let thickness = sigma * piece.integral;
        let ends = f64::from(*self.budget) < thickness;
        let coloured = coloured(self.sigma_t);
        let mut found = None;
        if ends || coloured {
            let [begin, middle, end] = piece.density;
            let quarter = (self.density)(0.25f32.mul_add(piece.t_max - piece.t_min, piece.t_min));
            // The products of large densities overflow.
            let unit = begin.max(middle).max(end).max(f32::MIN_POSITIVE);
            let cell = Cell::new(piece, quarter, unit);
            if ends {
                let depth = f64::from(*self.budget) / (sigma * f64::from(unit));
                found = Some(cell.distance(depth));
            }
            if coloured {
                let sigma_t = self.sigma_t * unit;
                self.hero.passed.push(Passed::Cell { cell, sigma_t });
            }
        }
        if !ends {
            *self.budget -= thickness as f32;
        }
        found
    }
}
