//! Free flight and transmittance by null collisions.
//!
//! ```text
//! free flight     steps -ln(1 - u) / sigma_maj, a real collision with probability sigma_t / sigma_maj
//! transmittance   T = prod_segments exp(-sigma_min dt) * prod_collisions (1 - (sigma_t - sigma_min) / (sigma_maj - sigma_min))
//! sigma_min <= sigma_t(x) <= sigma_maj   bounds of the segment that the walk is in  [1/m]
//! ```
//!
//! Delta tracking (Woodcock 1965) through local majorants: the optical thickness left of a step
//! carries over into the next segment. A collision below all values around it, or above them, is real
//! or null whatever the density, and costs no look-up (`grid/squeeze.rs`). Transmittance is
//! residual ratio tracking (Novak et al. 2014) whose control is the minorant, so that the
//! residual is never negative and T never leaves [0, 1]; small T is ended by Russian roulette.
//! Homogeneous media use the closed forms. This page chooses among the estimators; callers do not.
//!
//! Where a voxel is many mean free paths of the majorant wide, null collisions would be without
//! number (a spike of 1e38 beside densities of 1) and shorter than f32 resolves: such segments are
//! followed cell by cell (`dense.rs`). Colour: see `hero.rs`.
//!
//! The field is read by one stochastic tap in place of eight: every use here is linear in it.

mod counters;
mod dense;
mod flight;
mod hero;
mod many;
mod octet;

pub use counters::{Counters, EFFECTS, EffectCounts, Sampler};
pub use hero::Hero;
pub use many::{Ended, Flights, lanes_of};

use glam::Vec3;
use wide::f32x4;

use dense::{Collide, Dense, least_dense};
use flight::grid_flight;
use hero::{Passed, coloured};

use crate::lanes::four;
use crate::medium::{Field, GridField, Medium, PlateauField};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;

/// Transmittance below which Russian roulette begins. Higher: fewer steps, more variance.
const ROULETTE_BELOW: f32 = 0.05;

/// A real collision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collision {
    /// Distance along the ray. \[m\]
    pub t: f32,
    /// Index of the medium.
    pub medium: usize,
}

/// The first collision before `t_max` with any of the media; none where the ray gets there.
///
/// The first collision of overlapping media is the first of their own first collisions. Null
/// collisions beyond it were never met: they do not count in the ratios.
pub fn sample_free_flight<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<Collision> {
    hero.set_out(sampler);
    let mut end = t_max;
    let mut first = None;
    for (index, medium) in media.iter().enumerate() {
        if let Some(t) = flight_in(medium, ray, end, hero, sampler) {
            end = t;
            first = Some(Collision { t, medium: index });
        }
    }
    hero.arrive(end, first.map(|c| media[c.medium].sigma_t));
    first
}

/// The distance to the next collision where it can be drawn before anyone knows where the ray ends:
/// in one homogeneous medium without a box. Whoever draws it need look for surfaces only that far,
/// and goes on with [`fly`]; the draw is that of [`sample_free_flight`]. \[m\]
#[inline]
pub fn draw_distance<S: Spectrum>(
    media: &[Medium<S>],
    hero: &Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let [medium] = media else {
        return None;
    };
    let sigma = medium.sigma_t.channel(hero.channel);
    if sigma > 0.0 && matches!(medium.field, Field::Constant { bounds: None }) {
        Some(sampler.exponential() / sigma)
    } else {
        None
    }
}

/// The flight over a drawn distance; no collision where the ray ends before.
#[inline]
pub fn fly<S: Spectrum>(
    media: &[Medium<S>],
    distance: f32,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<Collision> {
    hero.set_out(sampler);
    let sigma_t = media[0].sigma_t;
    let t = constant_flight(sigma_t, distance, (0.0, t_max), hero);
    hero.arrive(t.unwrap_or(t_max), t.map(|_| sigma_t));
    t.map(|t| Collision { t, medium: 0 })
}

/// The collision after a drawn distance in a stretch of a homogeneous medium.
#[inline]
fn constant_flight<S: Spectrum>(
    sigma_t: S,
    distance: f32,
    (t0, t1): (f32, f32),
    hero: &mut Hero<S>,
) -> Option<f32> {
    let t = t0 + distance;
    if coloured(sigma_t) {
        let t1 = t.min(t1);
        hero.passed.push(Passed::Stretch { t0, t1, sigma_t });
    }
    (t < t1).then_some(t)
}

/// The first collision with a homogeneous medium.
#[inline(never)]
fn box_flight<S: Spectrum>(
    sigma_t: S,
    bounds: Option<&Bounds>,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let span = Bounds::clip_if(bounds, ray, t_max)?;
    let distance = sampler.exponential() / sigma_t.channel(hero.channel);
    constant_flight(sigma_t, distance, span, hero)
}

/// The first collision with one medium.
///
/// By functions of their own: what one kind of field makes of a ray would be computed for all.
#[inline]
fn flight_in<S: Spectrum>(
    medium: &Medium<S>,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    match &medium.field {
        Field::Constant { bounds } => {
            box_flight(medium.sigma_t, bounds.as_ref(), ray, t_max, hero, sampler)
        }
        Field::Grid(field) => grid_flight(medium.sigma_t, field, ray, t_max, hero, sampler),
        Field::Plateau(field) => plateau_flight(medium.sigma_t, field, ray, t_max, hero, sampler),
    }
}

/// Delta tracking over a plateau, whose one majorant is its value: in its core every collision of a
/// grey medium is real, so that the first one is the closed form.
#[inline(never)]
fn plateau_flight<S: Spectrum>(
    sigma_t: S,
    field: &PlateauField,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let local = field.placement.local_ray(ray);
    let (mut t, end) = field.plateau.support().clip(&local, 0.0, t_max)?;
    let highest = sigma_t.max_channel();
    let share = sigma_t.channel(hero.channel) / highest;
    let coloured = coloured(sigma_t);
    let value = field.plateau.value;
    let sigma_maj = highest * value;
    if sigma_maj > least_dense(&local) {
        let mut budget = sampler.exponential();
        let mut found = None;
        let exact = field.placement.exact_ray(ray);
        let mut collide = Collide {
            sigma_t,
            budget: &mut budget,
            hero,
            density: |t| field.plateau.at(local.at(t)),
        };
        field.plateau.pieces(&exact, 0.0, t_max, |piece| {
            found = collide.within(&piece);
            found.is_none()
        });
        return found;
    }
    loop {
        t += sampler.exponential() / sigma_maj;
        // NaN in a clear medium is beyond the end too.
        if t >= end || t.is_nan() {
            return None;
        }
        let density = field.plateau.at(local.at(t));
        if density == value && share == 1.0 || sampler.uniform() * value < share * density {
            return Some(t);
        }
        if coloured {
            let density = sigma_t.map(|k| k.mul_add(-density, sigma_maj).max(0.0));
            hero.passed.push(Passed::Null { t, density });
        }
    }
}

/// One stochastic tap of the field at a local point.
#[inline]
fn one_tap(field: &GridField, p: f32x4, sampler: &mut Sampler) -> f32 {
    sampler.counters.density_lookups += 1;
    let [x, y, z, _] = p.to_array();
    let u = Vec3::from(sampler.rng.uniform3());
    field.grid.lookup_one_tap(Vec3::new(x, y, z), u)
}

/// An unbiased estimate of the transmittance of [0, t_max], within [0, 1] in every channel.
pub fn transmittance<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    sampler: &mut Sampler,
) -> S {
    sampler.counters.transmittance_rays += 1;
    let mut tr = S::ONE;
    for medium in media {
        tr *= match &medium.field {
            Field::Constant { bounds } => {
                Bounds::clip_if(bounds.as_ref(), ray, t_max).map_or(S::ONE, |(t0, t1)| {
                    medium
                        .sigma_t
                        .map(|k| if k > 0.0 { (k * (t0 - t1)).exp() } else { 1.0 })
                })
            }
            Field::Grid(field) => ratio_tracking(medium.sigma_t, field, ray, t_max, sampler),
            Field::Plateau(field) => {
                let local = field.placement.exact_ray(ray);
                let depth = field.plateau.integral(&local, t_max, f64::INFINITY);
                medium.sigma_t.map(|k| (-k * depth as f32).exp())
            }
        };
        if tr.is_zero() {
            break;
        }
    }
    tr
}

/// Residual ratio tracking through the local bounds of a grid.
fn ratio_tracking<S: Spectrum>(
    sigma_t: S,
    field: &GridField,
    ray: &Ray,
    t_max: f32,
    sampler: &mut Sampler,
) -> S {
    let local = field.placement.local_ray(ray);
    let highest = sigma_t.max_channel();
    let mut tr = S::ONE;
    // Depth of the control, applied once at the end. [m]
    let mut control = 0.0;
    let mut budget = sampler.exponential();
    let least_dense = least_dense(&local);
    for segment in field.majorants.segments(&local, 0.0, t_max) {
        if highest * segment.majorant > least_dense {
            let (depth, lookups) = Dense::new(field, ray).depth(segment.t_min, segment.t_max);
            sampler.counters.density_lookups += lookups;
            // Finite, lest a channel that is clear be 0 times infinity.
            control += (depth as f32).min(f32::MAX);
            continue;
        }
        control += segment.minorant * (segment.t_max - segment.t_min);
        let range = segment.majorant - segment.minorant;
        let sigma_maj = highest * range;
        let mut t = segment.t_min;
        loop {
            let reach = (segment.t_max - t) * sigma_maj;
            if budget >= reach {
                budget -= reach;
                break;
            }
            t += budget / sigma_maj;
            budget = sampler.exponential();
            let residual = one_tap(field, four(local.at(t)), sampler) - segment.minorant;
            tr *= sigma_t.map(|k| (k / highest).mul_add(-(residual / range), 1.0).max(0.0));
            let most = (tr * sigma_t.map(|k| (-k * control).exp())).max_channel();
            if most < ROULETTE_BELOW {
                if sampler.uniform() * ROULETTE_BELOW >= most {
                    return S::ZERO;
                }
                tr *= ROULETTE_BELOW / most;
            }
        }
    }
    tr * sigma_t.map(|k| (-k * control).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phase::PhaseFunction;
    use crate::rng::{Rng, Stage};

    /// A distance that is drawn before the end of the ray is known makes the same flight: grey and
    /// coloured, short of the end and beyond it, with the same weights all along.
    #[test]
    fn a_distance_drawn_ahead_is_the_same_flight() {
        for sigma_t in [Vec3::splat(2.0), Vec3::new(3.0, 1.0, 0.5)] {
            let media = [Medium {
                sigma_t,
                albedo: Vec3::ONE,
                phase: PhaseFunction::Isotropic,
                field: Field::Constant { bounds: None },
                emission: None,
            }];
            let ray = Ray {
                origin: Vec3::ZERO,
                direction: Vec3::Z,
            };
            let mut collisions = 0;
            for i in 0..1000 {
                let mut sampler = Sampler::new(Rng::stream(11, Stage::Check, 0, i));
                let mut hero = Hero::choose(&mut sampler.rng);
                let (mut ahead, mut same) = (sampler.clone(), hero.clone());
                // Two flights, as weights go on from one to the next.
                for t_max in [0.3, 0.6] {
                    let usual = sample_free_flight(&media, &ray, t_max, &mut hero, &mut sampler);
                    let distance = draw_distance(&media, &same, &mut ahead).expect("closed form");
                    let other = fly(&media, distance, t_max, &mut same, &mut ahead);
                    assert_eq!(usual, other, "flight {i}");
                    let end = usual.map_or(t_max, |c| c.t);
                    for t in [0.5 * end, end] {
                        assert_eq!(hero.weight_at(t), same.weight_at(t), "weight at {t}");
                    }
                    assert_eq!(hero.weight(), same.weight(), "weight of flight {i}");
                    collisions += u32::from(usual.is_some());
                }
                assert_eq!(sampler.uniform(), ahead.uniform(), "streams go on alike");
            }
            assert!((200..1800).contains(&collisions), "{collisions} collisions");
        }
    }
}
