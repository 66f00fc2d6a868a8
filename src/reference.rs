//! The path tracer: the reference that the photon estimates are measured against.
//!
//! ```text
//! L = sum over collisions x_k of a path from the camera    throughput * (albedo p E T_light + (1 - albedo) L_e)
//! ```
//!
//! Delta-tracked free flights, next-event estimation with ratio-tracked transmittance to one light
//! at each collision, sky met by paths that leave the media. Unbiased: nothing is clamped, and a
//! path ends only where it leaves, is absorbed (Russian roulette) or reaches the highest
//! scattering order that the scene asks for.

use crate::film::Sample;
use crate::light::Light;
use crate::ray::Ray;
use crate::scene::Rgb;
use crate::spectrum::Spectrum;
use crate::tracking::{Hero, Sampler, sample_free_flight, transmittance};
use crate::world::World;

/// Throughput below which Russian roulette begins. Higher: shorter paths, noisier.
const ROULETTE_BELOW: f32 = 0.5;

/// One path from the camera.
pub fn trace_path<S: Spectrum>(world: &World<S>, camera_ray: Ray, sampler: &mut Sampler) -> Sample {
    let mut radiance = Sample::NOTHING;
    let mut ray = camera_ray;
    let mut throughput = S::ONE;
    let mut hero = Hero::choose(&mut sampler.rng);
    for order in 0..=world.max_bounces {
        let light = if order == 0 {
            world.seen_light(&ray, f32::INFINITY)
        } else {
            None
        };
        let t_max = light.map_or(f32::INFINITY, |(t, _)| t);
        let Some(collision) = sample_free_flight(&world.media, &ray, t_max, &mut hero, sampler)
        else {
            // Lights are sampled at collisions; scattered paths meet the sky alone.
            let met = match (light, order) {
                (Some((t, l)), _) => {
                    radiance.depth = t;
                    radiance.alpha = 1.0;
                    l
                }
                (None, 0) => world.background(ray.direction),
                (None, _) => world.sky(ray.direction),
            };
            add(&mut radiance, order, throughput * hero.weight() * met);
            break;
        };
        let medium = &world.media[collision.medium];
        let position = ray.at(collision.t);
        if order == 0 {
            radiance.alpha = 1.0;
            radiance.depth = collision.t;
        }
        if let Some(emission) = &medium.emission {
            let l_e = S::from_rgb(emission.radiance_at(position));
            add(
                &mut radiance,
                order,
                throughput * hero.weight() * (S::ONE - medium.albedo) * l_e,
            );
        }
        if order == world.max_bounces {
            break;
        }
        throughput *= medium.albedo;
        if throughput.is_zero() {
            break;
        }
        if let Some((light, probability)) = pick_light(world, sampler)
            && let Some(sample) = light.sample(position, sampler.uniform2())
        {
            let shadow = Ray {
                origin: position,
                direction: sample.direction,
            };
            let phase = medium.phase.p(ray.direction, sample.direction);
            let tr: S = transmittance(&world.media, &shadow, sample.distance, sampler);
            let l = throughput * hero.weight() * sample.value * tr * (phase / probability);
            add(&mut radiance, order + 1, l);
        }
        let most = (throughput * hero.weight()).max_channel();
        if most < ROULETTE_BELOW {
            if sampler.uniform() * ROULETTE_BELOW >= most {
                break;
            }
            throughput *= ROULETTE_BELOW / most;
        }
        let direction = medium.phase.sample(ray.direction, sampler.uniform2());
        ray = Ray {
            origin: position,
            direction,
        };
    }
    radiance
}

/// Adds radiance scattered `order` times.
fn add<S: Spectrum>(sample: &mut Sample, order: u32, l: S) {
    let l: Rgb = l.to_rgb();
    match order {
        0 => sample.emission += l,
        1 => sample.direct += l,
        _ => sample.indirect += l,
    }
}

/// One of the lights that are sampled, each with the same probability.
fn pick_light<'a, S: Spectrum>(
    world: &'a World<S>,
    sampler: &mut Sampler,
) -> Option<(&'a Light<S>, f32)> {
    let count = world.lights.iter().filter(|l| !l.is_sky()).count() as u32;
    if count == 0 {
        return None;
    }
    let index = sampler.rng.below(count) as usize;
    world
        .lights
        .iter()
        .filter(|l| !l.is_sky())
        .nth(index)
        .map(|l| (l, 1.0 / count as f32))
}
