//! A free flight through a grid.
//!
//! ```text
//! t' = t + budget / sigma_maj      budget = -ln(1 - u), less the majorants' thickness up to t
//! ```
//!
//! What is left of a budget when a flight ends is that of the next: exponential numbers have no memory.
//! In three parts, which `octet.rs` does for eight flights at a time: a step to the next segment of the
//! bounds, a collision there, and a look-up if that is left open. The voxel of the tap is drawn first.
//! Whether a collision is real its block mostly tells, and the field is looked up only if it does not
//! (grid/squeeze.rs), or if the null collisions of a coloured flight, whose weights they change, need
//! the density.

use wide::{f32x4, i32x4};

use super::Sampler;
use super::dense::{Dense, least_dense};
use super::hero::{Hero, Passed, coloured};
use crate::grid::flights::FlightCell;
use crate::grid::segments::Segments;
use crate::grid::squeeze::Verdict;
use crate::grid::tap;
use crate::medium::GridField;
use crate::ray::Ray;
use crate::rng::Draw;
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
    let mut flight = Flight::new(sigma_t, field, ray, t_max, hero, sampler);
    while !flight.is_done() {
        let mut collides = match flight.step() {
            Step::Dense => match flight.cross(ray, hero, sampler) {
                None => continue,
                found => {
                    sampler.budget = sampler.exponential();
                    return found;
                }
            },
            Step::Collides => true,
            Step::On => false,
        };
        while collides {
            let real = match flight.collide(sampler) {
                Verdict::Real => true,
                Verdict::Null => false,
                Verdict::Open => flight.look_up(hero, sampler),
            };
            if real {
                sampler.budget = flight.next;
                return Some(flight.t);
            }
            collides = flight.go_on();
        }
    }
    sampler.budget = flight.budget;
    None
}

/// What is at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// A collision in the segment.
    Collides,
    /// Another segment, or none.
    On,
    /// A segment that has to be [crossed](Flight::cross).
    Dense,
}

/// A flight under way.
#[derive(Debug, Clone)]
struct Flight<'a, S> {
    field: &'a GridField,
    segments: Segments<'a, FlightCell>,
    sigma_t: S,
    highest: f32,
    /// Coefficient of the highest channel over the hero's.
    per_share: f32,
    /// Least majorant of a dense segment. \[1/m\]
    least_dense: f32,
    coloured: bool,
    /// The last collision, or where the segment begins.
    t: f32,
    /// Optical thickness of the majorants from there to the next collision.
    budget: f32,
    /// End of the segment, and its bounds.
    t_max: f32,
    majorant: f32,
    minorant: f32,
    /// The density that the last collision is real above, the voxel of its tap, and the budget after it.
    bar: f32,
    voxel: i32x4,
    next: f32,
}

impl<'a, S: Spectrum> Flight<'a, S> {
    /// The flight of a world's ray as far as `t_max`.
    #[inline(always)]
    fn new(
        sigma_t: S,
        field: &'a GridField,
        ray: &Ray,
        t_max: f32,
        hero: &Hero<S>,
        sampler: &Sampler,
    ) -> Self {
        let local = field.placement.local_ray(ray);
        let highest = sigma_t.max_channel();
        Self {
            field,
            segments: field.flights.segments(&local, 0.0, t_max),
            sigma_t,
            highest,
            per_share: if S::CHANNELS == 1 {
                1.0
            } else {
                highest / sigma_t.channel(hero.channel)
            },
            least_dense: least_dense(&local),
            coloured: coloured(sigma_t),
            t: 0.0,
            budget: sampler.budget,
            t_max: 0.0,
            majorant: 0.0,
            minorant: 0.0,
            bar: 0.0,
            voxel: i32x4::ZERO,
            next: 0.0,
        }
    }

    /// True where the flight is at its end.
    #[inline(always)]
    fn is_done(&self) -> bool {
        self.segments.is_done()
    }

    /// Steps into the next segment of a flight that is not done, and to a collision or across.
    #[inline(always)]
    fn step(&mut self) -> Step {
        let segment = self.segments.advance();
        (self.t, self.t_max) = (segment.t_min, segment.t_max);
        (self.minorant, self.majorant) = (segment.minorant, segment.majorant);
        if self.highest * self.majorant > self.least_dense {
            return Step::Dense;
        }
        if self.reaches() {
            Step::Collides
        } else {
            Step::On
        }
    }

    /// From t to a collision, or else across the segment.
    #[inline(always)]
    fn reaches(&mut self) -> bool {
        let sigma_maj = self.highest * self.majorant;
        let reach = (self.t_max - self.t) * sigma_maj;
        let collides = self.budget < reach;
        if collides {
            self.t = self.budget.mul_add(1.0 / sigma_maj, self.t);
        }
        self.budget -= reach;
        collides
    }

    /// Whether the collision at t is real.
    #[inline(always)]
    fn collide(&mut self, sampler: &mut Sampler) -> Verdict {
        let Draw {
            bar,
            tap: [x, y, z],
            tau,
        } = sampler.rng.collision();
        self.bar = bar * self.majorant * self.per_share;
        self.voxel = tap(self.segments.at(self.t), f32x4::new([x, y, z, 0.0]));
        self.next = tau;
        let squeeze = self.field.flights.squeeze(&self.segments);
        let verdict = squeeze.verdict(self.bar, self.voxel);
        if self.coloured && verdict == Verdict::Null {
            Verdict::Open
        } else {
            verdict
        }
    }

    /// Whether the collision is real that is open.
    #[inline(always)]
    fn look_up(&self, hero: &mut Hero<S>, sampler: &mut Sampler) -> bool {
        if self.bar < self.minorant {
            return true;
        }
        sampler.counters.density_lookups += 1;
        let density = self.field.grid.value(self.voxel);
        let real = self.bar < density;
        if self.coloured && !real {
            let sigma_maj = self.highest * self.majorant;
            // Not below 0: where the density is the majorant, rounding decides the sign.
            let density = self
                .sigma_t
                .map(|k| k.mul_add(-density, sigma_maj).max(0.0));
            hero.passed.push(Passed::Null { t: self.t, density });
        }
        real
    }

    /// From a null collision to another in the segment, or across.
    #[inline(always)]
    fn go_on(&mut self) -> bool {
        self.budget = self.next;
        self.reaches()
    }

    /// The collision in a dense segment, if there is one.
    #[inline(always)]
    fn cross(&mut self, ray: &Ray, hero: &mut Hero<S>, sampler: &mut Sampler) -> Option<f32> {
        let dense = Dense::new(self.field, ray);
        // By values: a flight whose address is known would be kept in memory all along.
        let range = (self.t, self.t_max);
        let found = dense.flight(range, self.sigma_t, self.budget, hero);
        sampler.counters.density_lookups += found.lookups;
        self.budget = found.left;
        found.t
    }
}
