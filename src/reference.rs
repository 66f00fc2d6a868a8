//! The path tracer: the reference that the photon estimates are measured against.
//!
//! ```text
//! L = sum over vertices x_k of a path from the camera    throughput * (f E T_light + L_e)
//! f = albedo p at a collision, the surface's f |cos| at a hit; E = light sampled there  [W/m2]
//! ```
//!
//! Delta-tracked free flights up to the nearest surface, next-event estimation with ratio-tracked
//! transmittance to one light at each collision and each diffuse or glossy hit, sky met by paths
//! that leave. Unbiased: nothing is clamped, and a path ends only where it leaves, is absorbed
//! (Russian roulette) or reaches the highest scattering order that the scene asks for.
//!
//! A light that is met counts where no next event could have been joined to it: seen by the camera
//! directly, or after a mirror or a lens. Lights without extent (points, spots, suns without a
//! disc) are never met, so their caustics are missing here, and only here: photons find them.
//!
//! Specular and glossy events between the camera and the first diffuse hit or collision are not
//! counted as scattering orders, so that `max_bounces = 1` shows single scattering through a
//! window too; at most [`MAX_PREFIX`] of them are followed. The photon estimates agree on that.

use crate::film::Sample;
use crate::light::Light;
use crate::ray::Ray;
use crate::scene::Rgb;
use crate::spectrum::Spectrum;
use crate::surface::{Bsdf, Hit, Inside, SampleKind, Transport};
use crate::tracking::{Collision, Hero, Sampler, sample_free_flight, transmittance};
use crate::world::{World, passes};

/// Throughput below which Russian roulette begins. Higher: shorter paths, noisier.
const ROULETTE_BELOW: f32 = 0.5;

/// Specular and glossy events followed between the camera and the first other event. Fewer: halls
/// of mirrors are cut short; the darkest of them lose less than f32 resolves.
pub const MAX_PREFIX: u32 = 256;

/// Straight pieces of a path in a row that scatter nothing, boundaries passed one by one: an end
/// to numerical loops. Fewer: what lies behind that many boundaries is dark.
const MAX_PIECES: u32 = 100_000;

/// One path from the camera.
pub fn trace_path<S: Spectrum>(world: &World<S>, camera_ray: Ray, sampler: &mut Sampler) -> Sample {
    let mut path = Path {
        world,
        radiance: Sample::NOTHING,
        ray: camera_ray,
        throughput: S::ONE,
        hero: Hero::choose(&mut sampler.rng),
        inside: world.camera_inside,
        order: 0,
        prefix: Some(0),
        lights_count: true,
        travelled: 0.0,
    };
    let (mut pieces, mut order) = (0, 0);
    while pieces < MAX_PIECES && path.piece(sampler) {
        pieces = if path.order == order { pieces + 1 } else { 0 };
        order = path.order;
    }
    path.radiance
}

/// A path on its way.
struct Path<'a, S> {
    world: &'a World<S>,
    radiance: Sample,
    ray: Ray,
    throughput: S,
    hero: Hero<S>,
    inside: Inside,
    /// Scattering events that count.
    order: u32,
    /// Events so far, while there were only specular and glossy ones.
    prefix: Option<u32>,
    /// Lights that are met count: no next event was joined to them.
    lights_count: bool,
    /// From the camera through boundaries that bend nothing, until something is met. \[m\]
    travelled: f32,
}

impl<S: Spectrum> Path<'_, S> {
    /// The next straight piece; false where the path ends.
    fn piece(&mut self, sampler: &mut Sampler) -> bool {
        let world = self.world;
        sampler.counters.effects.surface_rays += u64::from(world.surfaces.is_some());
        let hit = world
            .surfaces
            .as_ref()
            .and_then(|s| s.intersect(self.ray.origin, self.ray.direction, f32::INFINITY));
        let t_hit = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
        // To the eye a light has a body, to scattered light it has none.
        let light = if self.lights_count && self.prefix.is_some() {
            world.seen_light(&self.ray, t_hit)
        } else {
            None
        };
        if self.lights_count && self.prefix.is_none() {
            self.pass_lights(t_hit, sampler);
        }
        let t_max = light.map_or(t_hit, |(t, _)| t);
        let (first, media) = world.media_for(&self.inside);
        let collision = sample_free_flight(media, &self.ray, t_max, &mut self.hero, sampler);
        match (collision, light, hit) {
            (Some(Collision { t, medium }), _, _) => self.collide(first + medium, t, sampler),
            (None, Some((t, l)), _) => {
                self.see(t);
                self.add(0, l);
                false
            }
            (None, None, Some(hit)) => self.meet(&hit, sampler),
            (None, None, None) => {
                let l = if self.lights_count {
                    world.background(self.ray.direction)
                } else {
                    world.sky(self.ray.direction)
                };
                self.add(0, l);
                false
            }
        }
    }

    /// A collision in a medium.
    fn collide(&mut self, index: usize, t: f32, sampler: &mut Sampler) -> bool {
        let world = self.world;
        let medium = &world.media[index];
        let position = self.ray.at(t);
        self.see(t);
        let counts = &mut sampler.counters.effects;
        counts.absorbing += u64::from(medium.absorbs());
        if let Some(emission) = &medium.emission {
            counts.temperatures += 1;
            let l_e = S::from_rgb(emission.radiance_at(position));
            self.add(0, (S::ONE - medium.albedo) * l_e);
        }
        if self.order == world.max_bounces {
            return false;
        }
        self.throughput *= medium.albedo;
        if self.throughput.is_zero() {
            return false;
        }
        if self.order == 0 {
            counts.first_order += 1;
        } else {
            counts.higher_orders += 1;
        }
        counts.directions += u64::from(!medium.phase.is_isotropic());
        if let Some((light, probability)) = pick_light(world, sampler)
            && let Some(sample) = world.sample_light(light, position, sampler)
        {
            let shadow = Ray {
                origin: position,
                direction: sample.direction,
            };
            let phase = medium.phase.p(self.ray.direction, sample.direction);
            let tr = world.reach(
                &shadow,
                sample.distance,
                &self.inside,
                sampler,
                transmittance,
            );
            self.add(1, sample.value * tr * (phase / probability));
        }
        self.order += 1;
        self.prefix = None;
        self.lights_count = false;
        if !self.roulette(sampler) {
            return false;
        }
        let direction = medium.phase.sample(self.ray.direction, sampler.uniform2());
        self.ray = Ray {
            origin: position,
            direction,
        };
        true
    }

    /// A surface.
    fn meet(&mut self, hit: &Hit, sampler: &mut Sampler) -> bool {
        let world = self.world;
        let Some(surfaces) = &world.surfaces else {
            return false;
        };
        if passes(surfaces, hit, &self.inside) {
            surfaces.cross(hit, self.ray.direction, &mut self.inside);
            if surfaces.encloses(hit.object) {
                sampler.counters.effects.boundaries += 1;
            }
            self.travelled += hit.t;
            self.ray.origin = hit.spawn_origin(self.ray.direction);
            return true;
        }
        self.see(hit.t);
        let bsdf = surfaces.bsdf(hit);
        if self.lights_count {
            self.add(0, S::from_rgb(surfaces.emission(hit)));
        }
        let counted = self.prefix.is_none() || bsdf.is_diffuse();
        if bsdf.is_black() || (self.order == world.max_bounces && counted) {
            return false;
        }
        if !bsdf.is_specular() && self.order < world.max_bounces {
            self.join(hit, &bsdf, sampler);
        }
        let u = [sampler.uniform(), sampler.uniform(), sampler.uniform()];
        let Some(sample) = bsdf.sample(self.ray.direction, u, Transport::Radiance) else {
            return false;
        };
        if counted {
            self.order += 1;
            if sample.kind == SampleKind::Diffuse {
                self.prefix = None;
            }
        } else {
            self.prefix = self.prefix.map(|n| n + 1);
            if self.prefix > Some(MAX_PREFIX) {
                return false;
            }
        }
        self.throughput *= S::from_rgb(sample.weight);
        self.lights_count = sample.kind == SampleKind::Specular;
        sampler.counters.effects.specular += u64::from(sample.kind != SampleKind::Diffuse);
        // Refraction scales radiance by the index squared and takes it back on the way out.
        if !sample.transmitted && !self.roulette(sampler) {
            return false;
        }
        if sample.transmitted {
            surfaces.cross(hit, sample.direction, &mut self.inside);
            if surfaces.encloses(hit.object) {
                sampler.counters.effects.boundaries += 1;
            }
        }
        self.ray = Ray {
            origin: hit.spawn_origin(sample.direction),
            direction: sample.direction,
        };
        true
    }

    /// Next-event estimation at a surface.
    fn join(&mut self, hit: &Hit, bsdf: &Bsdf, sampler: &mut Sampler) {
        let world = self.world;
        let Some((light, probability)) = pick_light(world, sampler) else {
            return;
        };
        let Some(sample) = world.sample_light(light, hit.position, sampler) else {
            return;
        };
        let f = bsdf.eval(self.ray.direction, sample.direction, Transport::Radiance);
        if f == Rgb::ZERO {
            return;
        }
        let shadow = Ray {
            origin: hit.spawn_origin(sample.direction),
            direction: sample.direction,
        };
        let inside = world.inside_beyond(hit, sample.direction, &self.inside);
        let tr = world.reach(&shadow, sample.distance, &inside, sampler, transmittance);
        self.add(1, S::from_rgb(f) * sample.value * tr * (1.0 / probability));
    }

    /// Lights that a scattered path meets after a mirror or a lens, without ending there.
    fn pass_lights(&mut self, t_max: f32, sampler: &mut Sampler) {
        let world = self.world;
        for light in &world.lights {
            if let Some((t, l)) = light.intersect(&self.ray, t_max) {
                let (_, media) = world.media_for(&self.inside);
                let tr: S = transmittance(media, &self.ray, t, sampler);
                self.add(0, l * tr);
            }
        }
    }

    /// Russian roulette; false where the path ends.
    fn roulette(&mut self, sampler: &mut Sampler) -> bool {
        let most = (self.throughput * self.hero.weight()).max_channel();
        if most < ROULETTE_BELOW {
            if sampler.uniform() * ROULETTE_BELOW >= most {
                return false;
            }
            self.throughput *= ROULETTE_BELOW / most;
        }
        true
    }

    /// Notes the first thing that the camera ray meets.
    fn see(&mut self, t: f32) {
        if self.radiance.alpha == 0.0 {
            self.radiance.alpha = 1.0;
            self.radiance.depth = self.travelled + t;
        }
    }

    /// Adds radiance that `more` events beyond those so far have scattered.
    fn add(&mut self, more: u32, l: S) {
        let l: Rgb = (self.throughput * self.hero.weight() * l).to_rgb();
        match self.order + more {
            0 => self.radiance.emission += l,
            1 => self.radiance.direct += l,
            _ => self.radiance.indirect += l,
        }
    }
}

/// One of the lights that are sampled, each with the same probability.
fn pick_light<'a, S: Spectrum>(
    world: &'a World<S>,
    sampler: &mut Sampler,
) -> Option<(&'a Light<S>, f32)> {
    let count = world.lights.iter().filter(|l| l.is_sampled()).count() as u32;
    if count == 0 {
        return None;
    }
    let index = sampler.rng.below(count) as usize;
    world
        .lights
        .iter()
        .filter(|l| l.is_sampled())
        .nth(index)
        .map(|l| (l, 1.0 / count as f32))
}
