//! A free flight through a grid.
//!
//! ```text
//! t' = t + budget / sigma_maj      budget = -ln(1 - u), less the majorants' thickness up to t
//! ```
//!
//! The voxel of the tap is drawn first. Whether a collision is real its block mostly tells, and the
//! field is looked up only if it does not (grid/squeeze.rs), or if the null collisions of a coloured
//! flight, whose weights they change, need the density.

use wide::f32x4;

use super::Sampler;
use super::dense::Dense;
use super::hero::{Hero, Passed, coloured};
use crate::grid::segments::four;
use crate::grid::squeeze::Squeeze;
use crate::grid::tap;
use crate::medium::GridField;
use crate::ray::Ray;
use crate::spectrum::Spectrum;

/// Delta tracking through the local majorants of a grid.
#[inline(never)]
pub(super) fn grid_flight<S: Spectrum>(
    sigma_t: S,
    field: &GridField,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let local = field.placement.local_ray(ray);
    let flight = Flight::new(sigma_t, field, &local, hero, sampler);
    flight.fly(ray, &local, t_max, hero, sampler)
}

/// A flight under way.
struct Flight<'a, S> {
    field: &'a GridField,
    origin: f32x4,
    direction: f32x4,
    sigma_t: S,
    highest: f32,
    /// Coefficient of the highest channel over the hero's.
    per_share: f32,
    coloured: bool,
    /// The last null collision, or where the segment begins.
    t: f32,
    /// Optical thickness of the majorants from there to the next collision.
    budget: f32,
}

impl<'a, S: Spectrum> Flight<'a, S> {
    #[inline]
    fn new(
        sigma_t: S,
        field: &'a GridField,
        local: &Ray,
        hero: &Hero<S>,
        sampler: &mut Sampler,
    ) -> Self {
        let highest = sigma_t.max_channel();
        Self {
            field,
            origin: four(local.origin),
            direction: four(local.direction),
            sigma_t,
            highest,
            per_share: if S::CHANNELS == 1 {
                1.0
            } else {
                highest / sigma_t.channel(hero.channel)
            },
            coloured: coloured(sigma_t),
            t: 0.0,
            budget: sampler.exponential(),
        }
    }

    /// The point at t. \[local voxels\]
    #[inline]
    fn at(&self, t: f32) -> f32x4 {
        self.direction.mul_add(f32x4::splat(t), self.origin)
    }

    /// The flight to its end.
    #[inline(always)]
    fn fly(
        mut self,
        ray: &Ray,
        local: &Ray,
        t_max: f32,
        hero: &mut Hero<S>,
        sampler: &mut Sampler,
    ) -> Option<f32> {
        let field = self.field;
        let dense = Dense::new(field, ray, local);
        let mut segments = field.flights.segments(local, 0.0, t_max);
        while let Some(segment) = segments.next() {
            let sigma_maj = self.highest * segment.majorant;
            if dense.is(sigma_maj) {
                // What is left of an exponential budget is one, for real collisions as for null ones.
                let range = (segment.t_min, segment.t_max);
                // A budget of its own: one whose address is known would be kept in memory all along.
                let mut budget = self.budget;
                let (found, lookups) = dense.flight(range, self.sigma_t, &mut budget, hero);
                self.budget = budget;
                sampler.counters.density_lookups += lookups;
                if found.is_some() {
                    return found;
                }
                continue;
            }
            let free_path = 1.0 / sigma_maj;
            self.t = segment.t_min;
            let mut reach = (segment.t_max - self.t) * sigma_maj;
            while self.budget < reach {
                let t = self.budget.mul_add(free_path, self.t);
                let bounds = [segment.minorant, segment.majorant];
                let squeeze = field.flights.squeeze(&segments);
                if self.collides((t, self.at(t)), bounds, &squeeze, hero, sampler) {
                    return Some(t);
                }
                reach = (segment.t_max - t) * sigma_maj;
            }
            self.budget -= reach;
        }
        None
    }

    /// True if the collision at t, the point p, is real; else the flight goes on from there.
    #[inline(always)]
    fn collides(
        &mut self,
        (t, p): (f32, f32x4),
        [minorant, majorant]: [f32; 2],
        squeeze: &Squeeze<'_>,
        hero: &mut Hero<S>,
        sampler: &mut Sampler,
    ) -> bool {
        // The density that the collision is real above.
        let bar = sampler.uniform() * majorant * self.per_share;
        let voxel = tap(p, sampler.uniform4());
        let squeezed = squeeze.is_below(bar, voxel);
        if squeezed == Some(true) {
            return true;
        }
        if squeezed.is_none() || self.coloured {
            if bar < minorant {
                return true;
            }
            sampler.counters.density_lookups += 1;
            let density = self.field.grid.value(voxel);
            if bar < density {
                return true;
            }
            if self.coloured {
                let sigma_maj = self.highest * majorant;
                // Not below 0: where the density is the majorant, rounding decides the sign.
                let density = self
                    .sigma_t
                    .map(|k| k.mul_add(-density, sigma_maj).max(0.0));
                hero.passed.push(Passed::Null { t, density });
            }
        }
        self.t = t;
        self.budget = sampler.exponential();
        false
    }
}
