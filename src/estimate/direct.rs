//! First-order scattering, sampled at points along a camera ray and joined to the lights.
//!
//! ```text
//! L_1 = integral of T(t) sigma_s(t) p E T_light dt  ~  1/n sum over samples   f(t_i) / pdf(t_i)
//! free flight     pdf(t) = sigma_t(t) T(t) / (1 - T(end))        inverted exactly on the profile
//! equiangular     pdf(t) = D / ((theta_b - theta_a) (D^2 + (t - t_0)^2))
//! ```
//!
//! Distances are stratified, and the points on an area light that a ray's samples are joined to
//! are spread over it (`spread`). How many samples a ray gets depends on the photons of a pass.
//! Distant lights use free flight alone; local ones share the samples between both densities by the
//! balance heuristic: free flight finds the medium, equiangular the surroundings of the light. Both keep to the part of the ray that the light can be seen
//! from: inside a spot's cone, before a quad. Shadow rays are exact marches: their cost is like
//! ratio tracking's, and the grain of a picture is first of all that of its shadow rays. With many
//! lights the samples are shared out in proportion to brightness times the integral of 1 / d^2
//! along that part.
//!
//! A plain sky and a medium that shines are not sampled here: their first order comes from photons,
//! which are smooth where it is.
//!
//! Sources: Kulla & Fajardo 2012 (equiangular sampling, MIS); Veach & Guibas 1995.

use glam::Vec3;

use crate::estimate::spread::Spread;
use crate::light::Light;
use crate::march::{Profile, transmittance};
use crate::ray::Ray;
use crate::spectrum::Spectrum;
use crate::surface::Inside;
use crate::tracking::Sampler;
use crate::world::World;

/// Most distances sampled on each ray for each light (or picked light), and fewest; even, since two
/// densities share them.
const MOST_SAMPLES: u32 = 8;
const FEWEST_SAMPLES: u32 = 2;

/// Samples for each photon of a pass, times the square root of the rays of a pass. More: shadow
/// rays that take the time of photons which would lessen the noise more; fewer: the reverse.
/// Measured on `cloud` and `rising_smoke` (docs/photon-estimates.md): 0.005 and 0.007.
const SAMPLES_PER_PHOTON: f64 = 0.006;

/// Points on lights joined to a point of a surface, where lights are wide or picked from.
const SURFACE_SAMPLES: u32 = 8;

/// Distances sampled on each of `rays` camera rays of a pass, beside as many photons.
///
/// The variance of the first order falls as 1 / samples at a cost of samples times rays, that of
/// photons as 1 / photons at a cost of photons: their sum is least, for the time that both take,
/// where samples ~ photons / sqrt(rays).
#[must_use]
pub fn samples_beside(photons: u64, rays: u64) -> u32 {
    let best = SAMPLES_PER_PHOTON * photons as f64 / (rays.max(1) as f64).sqrt();
    2 * ((0.5 * best).round() as u32).clamp(FEWEST_SAMPLES / 2, MOST_SAMPLES / 2)
}

/// Lights up to which every one is sampled; more are picked from.
const ALL_LIGHTS: usize = 3;

/// Share of the picks that goes to all lights that reach a ray alike. Without it a light that is
/// taken for weak, since it is far and the medium near, would be picked rarely and weigh much.
const ALIKE: f32 = 0.1;

/// The lights that are sampled along camera rays.
#[derive(Debug, Clone)]
pub struct DirectLights {
    /// Indices in the world.
    lights: Vec<usize>,
    /// Distances sampled on each ray for each light, or picked light.
    samples: u32,
    /// Points on lights joined to a point of a surface.
    pub(super) on_surface: u32,
}

/// What makes a light likely to be picked: shares of `total`, spread over `count` lights.
#[derive(Debug, Clone, Copy, Default)]
struct Pick {
    total: f32,
    count: u32,
}

impl Pick {
    fn add(&mut self, weight: f32) {
        if weight > 0.0 {
            self.total += weight;
            self.count += 1;
        }
    }

    /// Probability of a light of that weight.
    fn share(&self, weight: f32) -> f32 {
        if weight > 0.0 {
            (1.0 - ALIKE) * weight / self.total + ALIKE / self.count as f32
        } else {
            0.0
        }
    }
}

impl DirectLights {
    /// From a world, for `photons` beside `rays` camera rays in a pass; plain skies and media that
    /// shine are left to the photons.
    #[must_use]
    pub fn new<S: Spectrum>(world: &World<S>, photons: Option<u64>, rays: u64) -> Self {
        let lights = world.lights.iter().enumerate();
        let lights: Vec<usize> = lights
            .filter(|(_, light)| light.is_sampled() && light.brightness() > 0.0)
            .map(|(i, _)| i)
            .collect();
        // A few lights that are points to a point send the same however often they are asked.
        let drawn = lights.len() > ALL_LIGHTS || lights.iter().any(|i| world.lights[*i].is_wide());
        Self {
            samples: photons.map_or(MOST_SAMPLES, |photons| samples_beside(photons, rays)),
            on_surface: if drawn { SURFACE_SAMPLES } else { 1 },
            lights,
        }
    }

    /// True where there is nothing to sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Visits the lights to be sampled at `p`, each with 1 over its probability: all of them, or
    /// one that `u` picks of many, by what it would send there if nothing were in between.
    pub fn visit_picked<S: Spectrum>(
        &self,
        world: &World<S>,
        p: Vec3,
        u: f32,
        mut visit: impl FnMut(&Light<S>, f32),
    ) {
        let lights = self.lights.iter().map(|i| &world.lights[*i]);
        if self.lights.len() <= ALL_LIGHTS {
            lights.for_each(|light| visit(light, 1.0));
            return;
        }
        let weight = |light: &Light<S>| {
            if !light.shines_on(p) {
                return 0.0;
            }
            let near = light.position().map_or(1.0, |q| q.distance_squared(p));
            light.brightness() / near.max(f32::MIN_POSITIVE)
        };
        let mut pick = Pick::default();
        lights.clone().for_each(|light| pick.add(weight(light)));
        let mut upper = 0.0;
        let mut chosen = None;
        for light in lights {
            let share = pick.share(weight(light));
            upper += share;
            if share > 0.0 {
                chosen = Some((light, share));
                if u < upper {
                    break;
                }
            }
        }
        if let Some((light, share)) = chosen {
            visit(light, 1.0 / share);
        }
    }

    /// First-order radiance along a ray, inside the objects `inside`, whose media `profile` holds.
    /// \[W/(m2 sr)\]
    pub fn radiance<S: Spectrum>(
        &self,
        world: &World<S>,
        ray: &Ray,
        inside: &Inside,
        profile: &Profile<S>,
        sampler: &mut Sampler,
    ) -> S {
        if profile.is_clear() || self.lights.is_empty() {
            return S::ZERO;
        }
        let extent = profile.extent();
        let lights = self.lights.iter().map(|i| &world.lights[*i]);
        let mut sum = S::ZERO;
        let points = Spread::new(sampler);
        if self.lights.len() <= ALL_LIGHTS {
            for light in lights {
                let Some(reach) = Reach::new(light, ray, extent) else {
                    continue;
                };
                for i in 0..self.samples {
                    // Of two densities each gets every stratum of its own half of the samples.
                    let per_stratum = if reach.angles.is_some() { 2 } else { 1 };
                    let stratum = (i / per_stratum) as f32 + sampler.uniform();
                    let draw = Draw {
                        distance: stratum * (per_stratum as f32 / self.samples as f32),
                        by_angle: i % 2 == 0,
                        point: points.at(i),
                    };
                    sum += one_sample(world, &reach, (ray, inside), profile, draw, sampler);
                }
            }
            return sum * (1.0 / self.samples as f32);
        }
        let weight = |light| Reach::new(light, ray, extent).map_or(0.0, |reach| reach.weight());
        let mut pick = Pick::default();
        lights.clone().for_each(|light| pick.add(weight(light)));
        // Evenly spaced picks with one shift; where a pick falls in a light's share is the light's
        // own stratum.
        let mut next = sampler.uniform();
        let (mut lower, mut picks) = (0.0, 0);
        for light in lights {
            let Some(reach) = Reach::new(light, ray, extent) else {
                continue;
            };
            let share = pick.share(reach.weight()) * self.samples as f32;
            while next < lower + share {
                let draw = Draw {
                    distance: ((next - lower) / share).clamp(0.0, 1.0 - f32::EPSILON),
                    by_angle: sampler.uniform() < 0.5,
                    point: points.at(picks),
                };
                let l = one_sample(world, &reach, (ray, inside), profile, draw, sampler);
                sum += l * (1.0 / share);
                next += 1.0;
                picks += 1;
            }
            lower += share;
        }
        sum
    }
}

/// The stretch of a ray that a light can be seen from.
struct Reach<'a, S> {
    light: &'a Light<S>,
    /// \[m\]
    extent: (f32, f32),
    /// Of a local light.
    angles: Option<Equiangular>,
}

impl<'a, S: Spectrum> Reach<'a, S> {
    fn new(light: &'a Light<S>, ray: &Ray, extent: (f32, f32)) -> Option<Self> {
        let extent = light.shines_along(ray, extent)?;
        let angles = light
            .position()
            .and_then(|p| Equiangular::new(ray, p, extent));
        Some(Self {
            light,
            extent,
            angles,
        })
    }

    /// Integral over the stretch of what the light sends there if nothing is in between, about.
    fn weight(&self) -> f32 {
        let (a, b) = self.extent;
        let length = self.angles.as_ref().map_or(b - a, |angles| {
            // A light on the ray is not all that matters.
            (angles.theta[1] - angles.theta[0]) / angles.d.max(NEAREST * (b - a))
        });
        self.light.brightness() * length
    }
}

/// Distance of a light from the ray, as a share of the stretch, below which it is no more likely
/// to be picked.
const NEAREST: f32 = 0.01;

/// Density of free-flight distances that end within `extent`, mean over the channels. \[1/m\]
fn flight_pdf<S: Spectrum>(profile: &Profile<S>, extent: (f32, f32), t: f32) -> f32 {
    let mut sigma = S::ZERO;
    profile.media_at(t, |_, s| sigma += s);
    let start = profile.optical_depth(extent.0);
    let depth = profile.optical_depth(extent.1) - start;
    let tr = profile.optical_depth(t) - start;
    let mut pdf = 0.0;
    for c in 0..S::CHANNELS {
        let opacity = -(-depth.channel(c)).exp_m1();
        if opacity > 0.0 {
            pdf += sigma.channel(c) * (-tr.channel(c)).exp() / opacity;
        }
    }
    pdf / S::CHANNELS as f32
}

/// A distance within `extent` by free flight in a channel chosen by the sample.
fn flight_distance<S: Spectrum>(
    profile: &Profile<S>,
    extent: (f32, f32),
    u: f32,
    sampler: &mut Sampler,
) -> f32 {
    let channel = if S::CHANNELS == 1 {
        0
    } else {
        sampler.rng.below(S::CHANNELS as u32) as usize
    };
    let start = profile.optical_depth(extent.0).channel(channel);
    let depth = profile.optical_depth(extent.1).channel(channel) - start;
    let opacity = -(-depth).exp_m1();
    let t = profile.distance_at(start - (-u * opacity).ln_1p(), channel);
    t.clamp(extent.0, extent.1)
}

/// The angles under which a local light sees the ends of a stretch of the ray.
struct Equiangular {
    /// Parameter of the ray's point nearest to the light. \[m\]
    t0: f32,
    /// Its distance to the light. \[m\]
    d: f32,
    theta: [f32; 2],
}

/// Least distance of a light from the ray, a share of the ray's length. Smaller: the angles round to
/// none; larger: samples miss the light's own neighbourhood.
const LEAST_DISTANCE: f32 = 1e-6;

impl Equiangular {
    fn new(ray: &Ray, light: Vec3, (a, b): (f32, f32)) -> Option<Self> {
        let t0 = (light - ray.origin).dot(ray.direction);
        // By rejection, and never 0: a ray through the light would have no angle.
        let d = (light - ray.at(t0)).length().max(LEAST_DISTANCE * (b - a));
        let theta = [((a - t0) / d).atan(), ((b - t0) / d).atan()];
        (theta[1] > theta[0]).then_some(Self { t0, d, theta })
    }

    fn sample(&self, u: f32) -> f32 {
        self.d.mul_add(
            ((self.theta[1] - self.theta[0]) * u + self.theta[0]).tan(),
            self.t0,
        )
    }

    fn pdf(&self, t: f32) -> f32 {
        let x = t - self.t0;
        self.d / ((self.theta[1] - self.theta[0]) * self.d.mul_add(self.d, x * x))
    }
}

/// What is drawn for a sample.
#[derive(Debug, Clone, Copy)]
struct Draw {
    /// Of the distance, in [0, 1).
    distance: f32,
    /// The distance is drawn by angle.
    by_angle: bool,
    /// Of the point on the light, in [0, 1).
    point: [f32; 3],
}

/// One distance for one light, by angle or by free flight; each gets half of the samples if the
/// light is local.
fn one_sample<S: Spectrum>(
    world: &World<S>,
    reach: &Reach<'_, S>,
    (ray, inside): (&Ray, &Inside),
    profile: &Profile<S>,
    draw: Draw,
    sampler: &mut Sampler,
) -> S {
    let (light, extent) = (reach.light, reach.extent);
    let (t, pdf) = match &reach.angles {
        None => {
            let t = flight_distance(profile, extent, draw.distance, sampler);
            (t, flight_pdf(profile, extent, t))
        }
        Some(angles) => {
            let t = if draw.by_angle {
                angles.sample(draw.distance).clamp(extent.0, extent.1)
            } else {
                flight_distance(profile, extent, draw.distance, sampler)
            };
            (t, 0.5 * (flight_pdf(profile, extent, t) + angles.pdf(t)))
        }
    };
    if !(pdf > 0.0 && pdf.is_finite()) {
        return S::ZERO;
    }
    let position = ray.at(t);
    let counters = &mut sampler.counters;
    let Some(sample) = world.sample_light_at(light, position, draw.point, counters) else {
        return S::ZERO;
    };
    // Scattering coefficient times phase function, summed over the media there.
    let mut scattering = S::ZERO;
    profile.media_at(t, |medium, sigma_t| {
        let medium = &world.media[medium];
        let counts = &mut sampler.counters.effects;
        counts.directions += u64::from(!medium.phase.is_isotropic());
        scattering += sigma_t * medium.albedo * medium.phase.p(-sample.direction, -ray.direction);
    });
    if scattering.is_zero() {
        return S::ZERO;
    }
    sampler.counters.effects.first_order += 1;
    let shadow = Ray {
        origin: position,
        direction: sample.direction,
    };
    let tr = world.reach(&shadow, sample.distance, inside, sampler, transmittance);
    profile.transmittance(t) * scattering * sample.value * tr * (1.0 / pdf)
}

#[cfg(test)]
mod tests {
    use super::samples_beside;

    /// Even, within bounds, and as photons over the square root of the rays between.
    #[test]
    fn samples_follow_photons_and_rays() {
        for (photons, rays, expected) in [
            (0, 0, 2),
            (50_000, 320 * 200, 2),
            (200_000, 200 * 200, 6),
            (600_000, 640 * 400, 8),
            (u64::MAX, 1, 8),
        ] {
            assert_eq!(
                samples_beside(photons, rays),
                expected,
                "{photons} beside {rays}"
            );
        }
    }
}
