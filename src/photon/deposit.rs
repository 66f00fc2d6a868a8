//! Where photons are deposited: a rate along their way.
//!
//! ```text
//! deposits     at s = u, u + 1, u + 2, ...       s(x) = integral of lambda along the photon's way
//! power        P = Phi / lambda                  [W m]; lambda rate of deposits [1/m], Phi [W]
//! fluence      E(x) ~ sum of P over a volume, per volume                        [W/m2]
//! ```
//!
//! Jensen & Christensen 1998 deposit at collisions: lambda = sigma_t there, and no photon where
//! there is no medium. Nothing but the power depends on that choice. A rate of its own, positive
//! a kernel's radius beyond the medium's outline too, makes the photons' density that of the
//! *fluence*, which is continuous through the outline of a cloud and through its holes: a kernel
//! that reaches over the outline finds on the far side what it finds on this one. Deposits at
//! collisions miss the far side; the estimate is then too dark over a radius along every outline.
//! The scattering coefficient comes from the ray that gathers (`estimate::beam`), where the grid
//! has it sharp. The rate also says how many deposits a path leaves: in a dense cloud every
//! second or third collision's worth, since neighbours on one path tell little new.
//!
//! The points are spaced evenly in s, from a random start: systematic sampling, whose expected
//! density is lambda at every point, with less variance than a Poisson process.
//!
//! Of each medium,
//!
//! ```text
//! lambda_m(x) = scale sqrt(highest density near x / highest density) / extent
//! ```
//!
//! with "near" within the largest radius that a kernel may have there, and the largest over the
//! media. The square root takes photons from dense places to thin ones, and lets radii, which
//! follow the cube root of the density of photons, change slowly.
//!
//! Sources: Jensen 2001; the idea of points sampled along photon beams from Krivanek et al. 2014.

use std::hint::select_unpredictable;

use glam::{UVec3, Vec3};

use super::lattice::Lattice;
pub use super::part::Part;
use super::part::grown;

use crate::medium::{Field, Medium};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;

/// Cells along the longest edge. More: rates and radii follow outlines more closely, and walks
/// take more steps.
const CELLS: f32 = 96.0;

/// Deposits of a straight way through a medium's whole extent before the rate is known better.
const FIRST_SCALE: f32 = 8.0;

/// Bits of a float that a rate's level leaves out: steps of 6 % or less over 16 octaves.
const LEFT_OUT: u32 = 19;

/// Largest scale: deposits of a straight way through a medium's extent.
const MAX_SCALE: f32 = 256.0;

/// Deposits wanted of a path of up to `SHORT_PATH` flights. More: photons that tell the same twice;
/// fewer: paths traced in vain.
const DEPOSITS_PER_PATH: f64 = 2.0;

/// Flights of a path above which more deposits are wanted. Lower: maps that cost more than tracing;
/// higher: paths traced in vain.
const SHORT_PATH: f64 = 6.0;

/// The rate of deposits, and the largest radius of a kernel, at every point of the world.
#[derive(Debug, Clone)]
pub struct DepositRate {
    cells: Lattice,
    /// Of each cell, as a [level](Self::rate): a walk goes anywhere, and a byte of each is in the cache.
    rates: Vec<u8>,
    /// What a level counts from.
    base: u32,
    /// Largest radius in each cell. \[m\]
    reaches: Vec<f32>,
    /// Rate where a cell has 1. \[1\]
    scale: f32,
}

impl DepositRate {
    /// Rates for media and the parts they take.
    #[must_use]
    pub fn new<S: Spectrum>(media: &[Medium<S>], parts: &[Part]) -> Self {
        let bounds = parts
            .iter()
            .filter(|part| part.reach > 0.0)
            .fold(Bounds::EMPTY, |all, part| all.union(&part.reached()));
        let longest = bounds.size().max_element();
        if !(longest > 0.0 && longest.is_finite()) {
            return Self {
                cells: Lattice::new(Bounds::EMPTY, 1.0),
                rates: Vec::new(),
                base: 0,
                reaches: Vec::new(),
                scale: FIRST_SCALE,
            };
        }
        let edge = longest / CELLS;
        // A medium smaller than a cell must not fill the cell with deposits.
        let per_extent = |part: &Part| 1.0 / (2.0 * part.bounds.radius()).max(edge);
        let gathered = || parts.iter().filter(|part| part.reach > 0.0);
        let highest = gathered().map(per_extent).fold(0.0, f32::max);
        let cells = Lattice::new(bounds, edge);
        let mut this = Self {
            rates: vec![0; cells.len()],
            reaches: vec![0.0; cells.len()],
            cells,
            base: (highest.to_bits() >> LEFT_OUT).saturating_sub(u32::from(u8::MAX)),
            scale: FIRST_SCALE,
        };
        for (medium, part) in media.iter().zip(parts).filter(|(_, p)| p.reach > 0.0) {
            let per_extent = per_extent(part);
            match &medium.field {
                Field::Constant { .. } if !part.filled.is_empty() => {
                    for filled in &part.filled {
                        this.raise(filled, part.reach, per_extent);
                    }
                }
                Field::Constant { .. } | Field::Plateau(_) => {
                    this.raise(&part.bounds, part.reach, per_extent);
                }
                Field::Grid(field) => {
                    let to_world = field.placement.to_world();
                    let highest = field.majorants.highest();
                    field.majorants.visit_cells(|low, high, majorant| {
                        let corners = (0..8).map(|i| {
                            let pick = Vec3::new(
                                if i & 1 == 0 { low.x } else { high.x },
                                if i & 2 == 0 { low.y } else { high.y },
                                if i & 4 == 0 { low.z } else { high.z },
                            );
                            to_world.transform_point3(pick)
                        });
                        let cube = corners.fold(Bounds::EMPTY, |b, p| b.including(p));
                        let rate = (majorant / highest).sqrt() * per_extent;
                        this.raise(&cube, part.reach, rate);
                    });
                }
            }
        }
        this
    }

    /// Raises the rate to at least `rate`, and lowers radii to at most `reach`, within `reach` of
    /// a box.
    fn raise(&mut self, around: &Bounds, reach: f32, rate: f32) {
        let level = (rate.to_bits() >> LEFT_OUT).saturating_sub(self.base);
        let level = level.clamp(1, u32::from(u8::MAX)) as u8;
        let around = grown(around, reach);
        let [first, end] = [around.min, around.max].map(|p| self.cells.cell_of(p));
        for x in first.x..=end.x {
            for y in first.y..=end.y {
                for z in first.z..=end.z {
                    let at = self.cells.index(UVec3::new(x, y, z));
                    self.reaches[at] = if self.rates[at] > 0 {
                        self.reaches[at].min(reach)
                    } else {
                        reach
                    };
                    self.rates[at] = self.rates[at].max(level);
                }
            }
        }
    }

    /// Sets the scale, given how many deposits a path left on average so far, and how many flights
    /// it had.
    ///
    /// Of N paths with n deposits each the variance is (a + b / n) / N, the time N (F t + n s) for F
    /// flights: their product is least at n ~ sqrt F.
    pub fn settle(&mut self, per_path: f64, flights: f64) {
        if per_path > 0.0 {
            let wanted = DEPOSITS_PER_PATH * (flights / SHORT_PATH).max(1.0).sqrt();
            let scale = f64::from(self.scale) * wanted / per_path;
            self.scale = (scale as f32).min(MAX_SCALE);
        }
    }

    /// The rate in a cell \[1/m\]; nothing is deposited where it is 0.
    ///
    /// By its level: the exponent and four bits of the fraction, counted from 255 for the highest rate of
    /// all. A rate may be any that is known when power is divided by it.
    #[inline(always)]
    fn rate(&self, at: usize) -> f32 {
        let level = u32::from(self.rates[at]);
        let rate = f32::from_bits((level + self.base) << LEFT_OUT) * self.scale;
        select_unpredictable(level == 0, 0.0, rate)
    }

    /// The largest radius of a kernel at a point. \[m\]
    #[inline]
    #[must_use]
    pub fn reach(&self, p: Vec3) -> f32 {
        if self.rates.is_empty() {
            return 0.0;
        }
        self.reaches[self.cells.index(self.cells.cell_of(p))]
    }

    /// Visits the deposits on [0, t_max] of a ray with their rate \[1/m\]. `left` is the integral of
    /// the rate up to the next one, and is kept from one straight piece of a way to the next.
    pub fn along(&self, ray: &Ray, t_max: f32, left: &mut f32, mut visit: impl FnMut(f32, f32)) {
        if self.rates.is_empty() {
            return;
        }
        self.cells.along(ray, t_max, |at, end, length| {
            let rate = self.rate(at);
            count_down(length * rate, left, |rest| visit(end - rest / rate, rate));
        });
    }
}

/// Visits the deposits on a stretch over which the rate's integral is `whole`, each with what is
/// left of it behind them. Counted down from the end: steps too small for a distance to show still
/// come to an end.
#[inline]
fn count_down(whole: f32, left: &mut f32, mut visit: impl FnMut(f32)) {
    let mut rest = whole;
    while *left < rest {
        rest -= *left;
        *left = 1.0;
        visit(rest);
    }
    *left -= rest;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phase::PhaseFunction;

    fn fog(low: Vec3, high: Vec3) -> Medium<f32> {
        Medium {
            sigma_t: 1.0,
            albedo: 1.0,
            phase: PhaseFunction::Isotropic,
            field: Field::Constant {
                bounds: Some(Bounds {
                    min: low,
                    max: high,
                }),
            },
            emission: None,
        }
    }

    fn rates() -> DepositRate {
        let media = [
            fog(Vec3::ZERO, Vec3::new(10.0, 4.0, 2.0)),
            fog(Vec3::splat(-3.0), Vec3::splat(-2.0)),
        ];
        let parts: Vec<Part> = media.iter().map(|m| Part::new(m, Bounds::EMPTY)).collect();
        DepositRate::new(&media, &parts)
    }

    /// The number of deposits is the integral of the rate, by a sum of small steps over the cells.
    #[test]
    fn deposits_follow_the_rate() {
        let rates = rates();
        let bounds = rates.cells.bounds;
        for (origin, direction) in [
            (Vec3::new(-5.0, 1.0, 1.0), Vec3::X),
            (Vec3::new(12.0, 5.0, 3.0), Vec3::new(-14.0, -7.5, -5.5)),
            (Vec3::new(1.0, 1.0, 1.0), Vec3::new(0.0, 0.3, -1.0)),
        ] {
            let ray = Ray {
                origin,
                direction: direction.normalize(),
            };
            let (mut integral, step) = (0.0f64, 1e-3f32);
            for i in 0..30_000 {
                let p = ray.at((i as f32 + 0.5) * step);
                if bounds.contains(p) {
                    let rate = rates.rate(rates.cells.index(rates.cells.cell_of(p)));
                    integral += f64::from(rate * step);
                }
            }
            let (mut count, mut inverse) = (0, 0.0f64);
            let starts = 1000;
            for i in 0..starts {
                let mut left = (i as f32 + 0.5) / starts as f32;
                rates.along(&ray, f32::INFINITY, &mut left, |t, rate| {
                    assert!(bounds.contains(ray.at(t)), "deposit outside at {t}");
                    count += 1;
                    inverse += 1.0 / f64::from(rate);
                });
            }
            let mean = f64::from(count) / f64::from(starts);
            assert!(
                (mean - integral).abs() < 0.01,
                "{mean} deposits, {integral}"
            );
            assert!(inverse > 0.0, "some deposits on {ray:?}");
        }
    }

    /// Split into pieces, a way has the same deposits.
    #[test]
    fn pieces_of_a_way_have_the_deposits_of_the_whole() {
        let rates = rates();
        let ray = Ray {
            origin: Vec3::new(-1.0, 0.5, 0.5),
            direction: Vec3::new(3.0, 0.7, 0.2).normalize(),
        };
        let (mut whole, mut pieces) = (Vec::new(), Vec::new());
        rates.along(&ray, 9.0, &mut 0.3, |t, _| whole.push(t));
        let mut left = 0.3;
        for i in 0..9 {
            let piece = Ray {
                origin: ray.at(i as f32),
                ..ray
            };
            rates.along(&piece, 1.0, &mut left, |t, _| pieces.push(i as f32 + t));
        }
        assert_eq!(whole.len(), pieces.len(), "{whole:?} {pieces:?}");
        assert!(whole.len() > 3, "{whole:?}");
        for (a, b) in whole.iter().zip(&pieces) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }

    /// Twice the deposits that are wanted halve the scale; four times as many flights as a short path
    /// has double it.
    #[test]
    fn scales_settle_by_deposits_and_flights() {
        for (per_path, flights, share) in [
            (2.0, 1.0, 1.0),
            (2.0, SHORT_PATH, 1.0),
            (4.0, SHORT_PATH, 0.5),
            (2.0, 4.0 * SHORT_PATH, 2.0),
            (0.0, 1.0, 1.0),
        ] {
            let mut rates = rates();
            rates.settle(per_path, flights);
            let expected = FIRST_SCALE * share;
            assert!(
                (rates.scale / expected - 1.0).abs() < 1e-6,
                "{per_path} deposits, {flights} flights: {}",
                rates.scale
            );
        }
    }

    /// A bead in a wide fog: the cell around it is not filled with deposits at the bead's scale.
    #[test]
    fn a_medium_far_smaller_than_a_cell_leaves_few_deposits() {
        let media = [
            fog(Vec3::splat(-1e6), Vec3::splat(1e6)),
            fog(Vec3::ZERO, Vec3::splat(1e-3)),
        ];
        let parts = media.each_ref().map(|m| Part::new(m, Bounds::EMPTY));
        let mut rates = DepositRate::new(&media, &parts);
        rates.settle(1e-9, 1.0);
        let ray = Ray {
            origin: Vec3::splat(-2e6),
            direction: Vec3::ONE.normalize(),
        };
        let mut count = 0;
        rates.along(&ray, f32::INFINITY, &mut 0.5, |_, _| count += 1);
        // The fog's extent gives 256; the bead's cells, some three of them, 256 sqrt 3 each.
        assert!((200..2000).contains(&count), "{count} deposits");
    }

    #[test]
    fn radii_shrink_to_the_smallest_part() {
        let rates = rates();
        let large = 0.05 * Vec3::new(10.0, 4.0, 2.0).length();
        assert!(
            (rates.reach(Vec3::new(5.0, 2.0, 1.0)) - large).abs() < 1e-5,
            "in the large box"
        );
        let small = 0.05 * 3f32.sqrt();
        assert!(
            (rates.reach(Vec3::splat(-2.5)) - small).abs() < 1e-5,
            "in the small box"
        );
    }
}
