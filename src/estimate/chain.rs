//! A camera ray beyond its first stretch: what a surface sends back, and on through mirrors.
//!
//! ```text
//! L(hit) = L_e                                              emissive
//!        + sum over lights   f E T_light                    diffuse, glossy   (sampled)
//!        + f |cos| / pdf  L_sky T_sky                        diffuse           (sampled)
//!        + sum over surface photons   f Phi K                diffuse           (`photon::surface`)
//!        + f |cos| / pdf  L(next stretch)                    glossy, specular
//! L(stretch) = first order + emission + beam estimate + T(end) L(hit or background)
//! ```
//! All in W/(m2 sr). Each piece of light is counted once: straight light from a light or the sky
//! onto a diffuse hit is sampled here and not in the surface map; lights that are met count only
//! if no next event was joined to them (seen directly, or after a mirror or lens).
//!
//! A chain goes on through specular and glossy surfaces and through boundaries that bend nothing. At
//! smooth glass it follows the reflected ray as well as the refracted one as long as both bring
//! `SPLIT_ABOVE` to the camera; below that, and on what is rough, one direction is drawn. It ends
//! at a diffuse surface, where it leaves, by Russian roulette once its throughput is below
//! `ROULETTE_BELOW`, or after [`MAX_PREFIX`] events.

use crate::estimate::beam::Stretch;
use crate::estimate::direct::DirectLights;
use crate::estimate::emission;
use crate::estimate::gather::MediaPhotons;
use crate::estimate::point::Sphere;
use crate::estimate::spread::Spread;
use crate::estimate::wall::Wall;
use crate::film::Sample;
use crate::march::{Profile, transmittance};
use crate::photon::Heading;
use crate::photon::surface::SurfaceGather;
use crate::ray::Ray;
use crate::reference::MAX_PREFIX;
use crate::scene::{March, Rgb};
use crate::spectrum::Spectrum;
use crate::surface::{Bsdf, BsdfSample, Hit, Inside, SampleKind, Surfaces, Transport};
use crate::tracking::Sampler;
use crate::world::{World, passes};

/// Throughput below which Russian roulette begins. Higher: shorter chains, noisier.
const ROULETTE_BELOW: f32 = 0.02;

/// Throughput of the lesser of two rays from which on both are followed. Higher: one of them is drawn
/// more often, which is noise in what is seen through glass; lower: more rays.
const SPLIT_ABOVE: f32 = 0.01;

/// Rays that may wait until another is followed to its end. With more of them one is drawn.
const MOST_WAITING: usize = 8;

/// Transmittance below which what lies behind is not looked at; the profile's own end is e^-18.
const SPENT: f32 = 1e-7;

/// Directions toward the sky at a hit.
const SKY_SAMPLES: u32 = 2;

/// Stretches of a chain, boundaries passed included: an end to numerical loops.
const MAX_STRETCHES: u32 = 4096;

/// What is needed to follow camera rays beyond a surface.
#[derive(Debug)]
pub struct Chain<'a, S: Spectrum, H> {
    /// The world.
    pub world: &'a World<S>,
    /// Its surfaces.
    pub surfaces: &'a Surfaces,
    /// Lights that are sampled.
    pub lights: &'a DirectLights,
    /// Photons in media.
    pub media_photons: Option<&'a MediaPhotons<'a, S, H>>,
    /// Photons on surfaces.
    pub photons: Option<&'a SurfaceGather<'a, S>>,
    /// How stretches are marched.
    pub march: March,
    /// First order in media is sampled.
    pub direct: bool,
    /// Media emit.
    pub emission: bool,
}

/// Scratch of a thread.
#[derive(Debug)]
pub struct Scratch<S> {
    /// Of the stretch at hand.
    pub profile: Profile<S>,
    /// Of the step at hand.
    pub sphere: Sphere,
    /// Rays that are still to be followed.
    waiting: Vec<Link<S>>,
}

impl<S: Spectrum> Default for Scratch<S> {
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            sphere: Sphere::default(),
            waiting: Vec::new(),
        }
    }
}

/// A ray that has met a surface.
#[derive(Debug, Clone, Copy)]
pub struct Link<S> {
    /// The ray.
    ray: Ray,
    /// Where it met the surface.
    hit: Hit,
    /// The objects around the ray.
    inside: Inside,
    /// Share of the radiance at the hit that reaches the camera.
    throughput: S,
    /// Lights that are met count.
    lights_count: bool,
    /// Specular and glossy events before.
    events: u32,
}

impl<S: Spectrum> Link<S> {
    /// The end of the camera ray's first stretch.
    #[must_use]
    pub fn first(world: &World<S>, ray: &Ray, hit: Hit, transmittance: S) -> Self {
        Self {
            ray: *ray,
            hit,
            inside: world.camera_inside,
            throughput: transmittance,
            lights_count: true,
            events: 0,
        }
    }
}

/// Radiance by the number of times that it was scattered. \[W/(m2 sr)\]
#[derive(Debug, Clone, Copy)]
pub struct Layers<S> {
    emission: S,
    direct: S,
    indirect: S,
}

impl<S: Spectrum> Layers<S> {
    /// Adds itself to a pixel.
    pub fn add_to(&self, sample: &mut Sample) {
        sample.emission += self.emission.to_rgb();
        sample.direct += self.direct.to_rgb();
        sample.indirect += self.indirect.to_rgb();
    }
}

impl<S: Spectrum, H: Heading> Chain<'_, S, H> {
    /// What the camera sees beyond the first stretch.
    pub fn follow(
        &self,
        first: Link<S>,
        scratch: &mut Scratch<S>,
        sampler: &mut Sampler,
    ) -> Layers<S> {
        let mut sum = Layers {
            emission: S::ZERO,
            direct: S::ZERO,
            indirect: S::ZERO,
        };
        let mut link = first;
        let mut goes_on = self.turn(&mut link, &mut scratch.waiting, &mut sum, sampler);
        for _ in 0..MAX_STRETCHES {
            if !goes_on {
                let Some(next) = scratch.waiting.pop() else {
                    break;
                };
                link = next;
            }
            goes_on = link.throughput.max_channel() >= SPENT
                && self.stretch(&mut link, scratch, &mut sum, sampler)
                && self.turn(&mut link, &mut scratch.waiting, &mut sum, sampler);
        }
        scratch.waiting.clear();
        sum
    }

    /// What happens at the hit; false where the chain ends, else `link.ray` goes on, and another ray
    /// may wait.
    fn turn(
        &self,
        link: &mut Link<S>,
        waiting: &mut Vec<Link<S>>,
        sum: &mut Layers<S>,
        sampler: &mut Sampler,
    ) -> bool {
        let (surfaces, hit) = (self.surfaces, link.hit);
        let direction = link.ray.direction;
        if passes(surfaces, &hit, &link.inside) {
            surfaces.cross(&hit, direction, &mut link.inside);
            if surfaces.encloses(hit.object) {
                sampler.counters.effects.boundaries += 1;
            }
            link.ray.origin = hit.spawn_origin(direction);
            return true;
        }
        if link.lights_count {
            sum.emission += link.throughput * S::from_rgb(surfaces.emission(&hit));
        }
        let bsdf = surfaces.bsdf(&hit);
        if bsdf.is_black() {
            return false;
        }
        if !bsdf.is_specular() && self.world.max_bounces > 0 {
            sum.direct += link.throughput * self.joined(link, &bsdf, sampler);
        }
        if bsdf.is_diffuse() {
            if self.world.max_bounces > 0 {
                sum.direct += link.throughput * self.sky(link, &bsdf, sampler);
            }
            if let Some(photons) = self.photons {
                let turn = sampler.uniform();
                let (l, count) = photons.radiance((surfaces, &hit), &bsdf, -direction, turn);
                sampler.counters.gathered_photons += count;
                sum.indirect += link.throughput * l;
            }
            return false;
        }
        if link.events == MAX_PREFIX {
            return false;
        }
        link.events += 1;
        if waiting.len() < MOST_WAITING
            && let Some(both) = bsdf.split(direction, Transport::Radiance)
        {
            let [reflected, refracted] =
                both.map(|sample| (link.throughput * S::from_rgb(sample.weight)).max_channel());
            if reflected.min(refracted) >= SPLIT_ABOVE {
                let mut other = *link;
                if self.depart(&mut other, &both[1], sampler) {
                    waiting.push(other);
                }
                return self.depart(link, &both[0], sampler);
            }
        }
        let u = [sampler.uniform(), sampler.uniform(), sampler.uniform()];
        bsdf.sample(direction, u, Transport::Radiance)
            .is_some_and(|sample| self.depart(link, &sample, sampler))
    }

    /// Leaves a hit by a sampled direction; false where roulette ends the chain.
    fn depart(&self, link: &mut Link<S>, sample: &BsdfSample, sampler: &mut Sampler) -> bool {
        link.throughput *= S::from_rgb(sample.weight);
        link.lights_count = sample.kind == SampleKind::Specular;
        sampler.counters.effects.specular += u64::from(sample.kind != SampleKind::Diffuse);
        let most = link.throughput.max_channel();
        if most < ROULETTE_BELOW {
            if sampler.uniform() * ROULETTE_BELOW >= most {
                return false;
            }
            link.throughput *= ROULETTE_BELOW / most;
        }
        if sample.transmitted {
            self.surfaces
                .cross(&link.hit, sample.direction, &mut link.inside);
            if self.surfaces.encloses(link.hit.object) {
                sampler.counters.effects.boundaries += 1;
            }
        }
        link.ray = Ray {
            origin: link.hit.spawn_origin(sample.direction),
            direction: sample.direction,
        };
        true
    }

    /// The stretch up to the next surface; false where the ray leaves.
    fn stretch(
        &self,
        link: &mut Link<S>,
        Scratch {
            profile, sphere, ..
        }: &mut Scratch<S>,
        sum: &mut Layers<S>,
        sampler: &mut Sampler,
    ) -> bool {
        let (world, ray) = (self.world, link.ray);
        sampler.counters.effects.surface_rays += 1;
        let hit = self
            .surfaces
            .intersect(ray.origin, ray.direction, f32::INFINITY);
        let t_hit = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
        let light = if link.lights_count {
            world.seen_light(&ray, t_hit)
        } else {
            None
        };
        let t_max = light.map_or(t_hit, |(t, _)| t);
        profile.march(
            world.media_for(&link.inside),
            &ray,
            t_max,
            self.march,
            &mut sampler.counters,
        );
        if !profile.is_clear() {
            if self.emission {
                sum.emission += link.throughput
                    * emission::radiance(world, &ray, profile, &mut sampler.counters);
            }
            if self.direct {
                sum.direct += link.throughput
                    * self
                        .lights
                        .radiance(world, &ray, &link.inside, profile, sampler);
            }
            if let Some(photons) = self.media_photons {
                let end = hit.filter(|_| light.is_none());
                let stretch = Stretch {
                    ray: &ray,
                    profile,
                    compartment: world.compartment(&link.inside),
                    walls: [
                        Wall::new(&ray, &link.hit, 0.0),
                        end.map_or(Wall::NONE, |hit| Wall::new(&ray, &hit, hit.t)),
                    ],
                };
                let seen = (&stretch, link.throughput.max_channel());
                let [first, higher] = photons.radiance(world, seen, sphere, sampler);
                sum.direct += link.throughput * first;
                sum.indirect += link.throughput * higher;
            }
        }
        link.throughput *= profile.transmittance;
        match (light, hit) {
            (Some((_, l)), _) => {
                sum.emission += link.throughput * l;
                false
            }
            (None, Some(hit)) => {
                link.hit = hit;
                true
            }
            (None, None) => {
                let l = if link.lights_count {
                    world.background(ray.direction)
                } else {
                    world.sky(ray.direction)
                };
                sum.emission += link.throughput * l;
                false
            }
        }
    }

    /// Light straight from the lights, reflected (or let through) toward the camera.
    fn joined(&self, link: &Link<S>, bsdf: &Bsdf, sampler: &mut Sampler) -> S {
        let (world, hit) = (self.world, &link.hit);
        let mut sum = S::ZERO;
        let shift = sampler.uniform();
        let points = Spread::new(sampler);
        let count = self.lights.on_surface;
        for i in 0..count {
            let pick = (shift + i as f32 / count as f32).fract();
            self.lights
                .visit_picked(world, hit.position, pick, |light, weight| {
                    let counters = &mut sampler.counters;
                    let sample = world.sample_light_at(light, hit.position, points.at(i), counters);
                    let Some(sample) = sample else {
                        return;
                    };
                    let f = bsdf.eval(link.ray.direction, sample.direction, Transport::Radiance);
                    if f != Rgb::ZERO {
                        let tr = self.reach(link, sample.direction, sample.distance, sampler);
                        sum += S::from_rgb(f) * sample.value * tr * weight;
                    }
                });
        }
        sum * (1.0 / count as f32)
    }

    /// Light straight from the sky, reflected toward the camera.
    fn sky(&self, link: &Link<S>, bsdf: &Bsdf, sampler: &mut Sampler) -> S {
        let mut sum = S::ZERO;
        if !self.world.lights.iter().any(crate::light::Light::is_sky) {
            return sum;
        }
        for i in 0..SKY_SAMPLES {
            let stratum = (i as f32 + sampler.uniform()) / SKY_SAMPLES as f32;
            let u = [sampler.uniform(), stratum, sampler.uniform()];
            if let Some(sample) = bsdf.sample(link.ray.direction, u, Transport::Radiance) {
                sampler.counters.effects.sky += 1;
                let l = self.world.sky(sample.direction);
                let tr = self.reach(link, sample.direction, f32::INFINITY, sampler);
                sum += S::from_rgb(sample.weight) * l * tr;
            }
        }
        sum * (1.0 / SKY_SAMPLES as f32)
    }

    /// What is left of light along a straight line from the hit.
    fn reach(
        &self,
        link: &Link<S>,
        direction: glam::Vec3,
        distance: f32,
        sampler: &mut Sampler,
    ) -> S {
        let shadow = Ray {
            origin: link.hit.spawn_origin(direction),
            direction,
        };
        let inside = self.world.inside_beyond(&link.hit, direction, &link.inside);
        self.world
            .reach(&shadow, distance, &inside, sampler, transmittance)
    }
}
