//! A free flight through a grid.
//!
//! ```text
//! t' = t + budget / sigma_maj      budget = -ln(1 - u), less the majorants' thickness up to t
//! ```
//!
//! Most flights in a dense medium end in the cell they begin in. There nothing need be known of
//! its faces but that they are not between two points inside: the flight goes from collision to
//! collision, and only when one would be outside does it set out to walk from cell to cell, from the last
//! one inside and with the same budget.

use wide::f32x4;

use super::dense::{self, Dense};
use super::hero::{Hero, Passed, coloured};
use super::{Sampler, one_tap};
use crate::grid::segments::{Room, four};
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
    let room = field.majorants.room(four(local.origin));
    let flight = Flight::new(sigma_t, field, &local, hero, sampler);
    flight.fly(ray, &local, room, t_max, hero, sampler)
}

/// A flight under way.
struct Flight<'a, S> {
    field: &'a GridField,
    origin: f32x4,
    direction: f32x4,
    sigma_t: S,
    highest: f32,
    /// Density, in units of the highest channel, that collides for the hero.
    share: f32,
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
            share: if S::CHANNELS == 1 {
                1.0
            } else {
                sigma_t.channel(hero.channel) / highest
            },
            coloured: coloured(sigma_t),
            t: 0.0,
            budget: sampler.rng.exponential(),
        }
    }

    /// The point at t. \[local voxels\]
    #[inline]
    fn at(&self, t: f32) -> f32x4 {
        self.direction.mul_add(f32x4::splat(t), self.origin)
    }

    /// The flight to its end, from a point in a room or where there is none.
    #[inline(always)]
    fn fly(
        mut self,
        ray: &Ray,
        local: &Ray,
        room: Option<Room>,
        t_max: f32,
        hero: &mut Hero<S>,
        sampler: &mut Sampler,
    ) -> Option<f32> {
        let field = self.field;
        let lodging = room.map(|room| room.lodging);
        if let Some(room) = room {
            let bounds = room.bounds();
            let sigma_maj = self.highest * bounds[1];
            if !dense::is_dense(sigma_maj, local) {
                let free_path = 1.0 / sigma_maj;
                loop {
                    let t = self.budget.mul_add(free_path, self.t);
                    let p = self.at(t);
                    // Not so either of what is not a number, in an empty cell.
                    let inside = t < t_max && room.holds(p);
                    if !inside {
                        break;
                    }
                    if self.collides(t, p, bounds, hero, sampler) {
                        return Some(t);
                    }
                }
            }
        }
        let dense = Dense::new(field, ray, local);
        for segment in field.majorants.flight(local, lodging, [self.t, t_max]) {
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
            self.t = segment.t_min;
            let mut reach = (segment.t_max - self.t) * sigma_maj;
            while self.budget < reach {
                let t = self.t + self.budget / sigma_maj;
                let bounds = [segment.minorant, segment.majorant];
                if self.collides(t, self.at(t), bounds, hero, sampler) {
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
        t: f32,
        p: f32x4,
        [minorant, majorant]: [f32; 2],
        hero: &mut Hero<S>,
        sampler: &mut Sampler,
    ) -> bool {
        let bar = sampler.uniform() * majorant;
        if bar < self.share * minorant {
            return true;
        }
        let density = one_tap(self.field, p, sampler);
        if bar < self.share * density {
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
        self.t = t;
        self.budget = sampler.rng.exponential();
        false
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3, IVec3, Vec3};

    use super::*;
    use crate::grid::Grid;
    use crate::medium::Placement;
    use crate::rng::{Rng, Stage};

    /// Waves that leave holes: empty bricks, boxed ones, merged ones, minorants above 0.
    fn waves(extinction: f32) -> GridField {
        let value = |c: IVec3| {
            let [x, y, z] = (c.as_vec3() * 0.11).to_array();
            let wave = x.sin() * y.sin() + z.cos();
            if c.x > 70 { 1.5 } else { wave.max(0.0) }
        };
        let grid = Grid::from_fn(IVec3::ZERO, IVec3::splat(100), DAffine3::IDENTITY, value);
        let grid = grid.expect("a grid of waves");
        let mut field = GridField::new(grid, &DAffine3::IDENTITY, DVec3::ZERO, extinction);
        field.placement = Placement::IDENTITY;
        field
    }

    /// A flight that begins in a room is that of the walk alone, draw by draw: from anywhere, from
    /// faces, along axes, grey and coloured.
    fn same_flights<S: Spectrum>(sigma_t: S) {
        let field = waves(sigma_t.max_channel());
        let support = field.grid.support();
        let (mut collisions, mut rooms) = (0, 0);
        let count = 40_000;
        for i in 0..count {
            let mut random = Rng::stream(3, Stage::Check, 0, i);
            let mut three = |scale: f32| Vec3::from_array(random.uniform3()) * scale;
            let mut origin = support.min - 4.0 + three(1.0) * (support.size() + 8.0);
            let mut direction = three(2.0) - 1.0;
            if i % 4 == 1 {
                origin = (origin / 8.0).round() * 8.0;
            }
            if i % 5 == 1 {
                direction[i as usize % 3] = 0.0;
            }
            let ray = Ray { origin, direction };
            let local = field.placement.local_ray(&ray);
            let room = field.majorants.room(four(local.origin));
            let fly = |room: Option<Room>| {
                let mut sampler = Sampler::new(Rng::stream(3, Stage::Check, 1, i));
                let mut hero = Hero::choose(&mut sampler.rng);
                hero.set_out(&mut sampler);
                let flight = Flight::new(sigma_t, &field, &local, &hero, &mut sampler);
                let found = flight.fly(&ray, &local, room, 90.0, &mut hero, &mut sampler);
                (found, hero.ratio_at(90.0).channel(1 % S::CHANNELS), sampler)
            };
            let ((a, p, s), (b, q, t)) = (fly(room), fly(None));
            rooms += u32::from(room.is_some());
            collisions += u32::from(a.is_some());
            let (x, y) = (a.unwrap_or(90.0), b.unwrap_or(90.0));
            assert_eq!(
                a.is_some(),
                b.is_some(),
                "flight {i}: {a:?}, {b:?}, {ray:?}"
            );
            assert!((x - y).abs() <= 1e-5 * (1.0 + y), "flight {i}: {x}, {y}");
            assert!((p - q).abs() <= 1e-4 * q, "flight {i}: weights {p}, {q}");
            assert_eq!(s.counters, t.counters, "flight {i}");
        }
        assert!(rooms > 10_000 && collisions > 4000, "{rooms}, {collisions}");
    }

    #[test]
    fn a_flight_from_a_room_is_that_of_the_walk() {
        for scale in [0.01, 0.1, 1.0] {
            same_flights(scale);
            same_flights(Vec3::new(1.0, 0.4, 0.7) * scale);
        }
    }
}
