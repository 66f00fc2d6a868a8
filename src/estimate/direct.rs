//! First-order scattering, sampled at points along a camera ray and joined to the lights.
//!
//! ```text
//! L_1 = integral of T(t) sigma_s(t) p E T_light dt  ~  1/n sum over samples   f(t_i) / pdf(t_i)
//! free flight     pdf(t) = sigma_t(t) T(t) / (1 - T(end))        inverted exactly on the profile
//! equiangular     pdf(t) = D / ((theta_b - theta_a) (D^2 + (t - t_0)^2))
//! ```
//!
//! Distances are stratified. Distant lights use free flight alone; local ones share the samples
//! between both densities by the balance heuristic: free flight finds the medium, equiangular
//! the surroundings of the light. Shadow rays are exact marches: their cost is like ratio
//! tracking's, and the grain of a picture is first of all that of its shadow rays. With many
//! lights each sample picks one in proportion to its power.
//!
//! A sky is not sampled here: its first order comes from photons, which are smooth where it is.
//!
//! Sources: Kulla & Fajardo 2012 (equiangular sampling, MIS); Veach & Guibas 1995.

use glam::Vec3;

use crate::light::Light;
use crate::march::{Profile, transmittance};
use crate::ray::Ray;
use crate::spectrum::Spectrum;
use crate::surface::Inside;
use crate::tracking::Sampler;
use crate::world::World;

/// Distances sampled on each ray for each light (or picked light).
pub const SAMPLES: u32 = 8;

/// Lights up to which every one is sampled; more are picked from.
const ALL_LIGHTS: usize = 3;

/// The lights that are sampled along camera rays, and how likely each is picked.
#[derive(Debug, Clone)]
pub struct DirectLights {
    /// Index in the world, probability, and upper end of its share of [0, 1).
    lights: Vec<(usize, f32, f32)>,
}

impl DirectLights {
    /// From a world; skies are left to the photons.
    #[must_use]
    pub fn new<S: Spectrum>(world: &World<S>) -> Self {
        let powers: Vec<(usize, f32)> = world
            .lights
            .iter()
            .enumerate()
            .filter(|(_, light)| !light.is_sky())
            .map(|(i, light)| (i, light.power_toward(&world.target)))
            .filter(|(_, power)| *power > 0.0)
            .collect();
        let total: f32 = powers.iter().map(|(_, p)| p).sum();
        let mut sum = 0.0;
        let lights = powers
            .into_iter()
            .map(|(i, p)| {
                sum += p / total;
                (i, p / total, sum)
            })
            .collect();
        Self { lights }
    }

    /// True where there is nothing to sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Visits the lights to be sampled at one point, each with 1 over its probability: all of
    /// them, or one that `u` picks of many.
    pub fn visit_picked(&self, u: f32, mut visit: impl FnMut(usize, f32)) {
        if self.lights.len() <= ALL_LIGHTS {
            self.lights
                .iter()
                .for_each(|(index, ..)| visit(*index, 1.0));
        } else {
            let chosen = self.lights.iter().find(|(_, _, upper)| u < *upper);
            if let Some((index, probability, _)) = chosen.or(self.lights.last()) {
                visit(*index, 1.0 / probability);
            }
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
        let mut sum = S::ZERO;
        let shift = sampler.uniform();
        let all = self.lights.len() <= ALL_LIGHTS;
        for i in 0..SAMPLES {
            let u = (i as f32 + sampler.uniform()) * (1.0 / SAMPLES as f32);
            if all {
                for (index, _, _) in &self.lights {
                    let light = &world.lights[*index];
                    sum += one_sample(world, light, (ray, inside), profile, u, sampler);
                }
            } else {
                // The pick is stratified too, in an order of its own.
                let pick = (shift + i as f32 * (1.0 / SAMPLES as f32)).fract();
                let chosen = self.lights.iter().find(|(_, _, upper)| pick < *upper);
                let Some((index, probability, _)) = chosen.or(self.lights.last()) else {
                    continue;
                };
                let l = one_sample(
                    world,
                    &world.lights[*index],
                    (ray, inside),
                    profile,
                    sampler.uniform(),
                    sampler,
                );
                sum += l * (1.0 / probability);
            }
        }
        sum * (1.0 / SAMPLES as f32)
    }
}

/// Density of free-flight distances, mean over the channels. \[1/m\]
fn flight_pdf<S: Spectrum>(profile: &Profile<S>, t: f32) -> f32 {
    let mut sigma = S::ZERO;
    profile.media_at(t, |_, s| sigma += s);
    let tr = profile.transmittance(t);
    let mut pdf = 0.0;
    for c in 0..S::CHANNELS {
        let opacity = -(-profile.optical_depth(profile.t_end).channel(c)).exp_m1();
        if opacity > 0.0 {
            pdf += sigma.channel(c) * tr.channel(c) / opacity;
        }
    }
    pdf / S::CHANNELS as f32
}

/// A distance by free flight in a channel chosen by the sample.
fn flight_distance<S: Spectrum>(profile: &Profile<S>, u: f32, sampler: &mut Sampler) -> f32 {
    let channel = if S::CHANNELS == 1 {
        0
    } else {
        sampler.rng.below(S::CHANNELS as u32) as usize
    };
    let opacity = -(-profile.optical_depth(profile.t_end).channel(channel)).exp_m1();
    profile.distance_at(-(-u * opacity).ln_1p(), channel)
}

/// The angles under which a local light sees the ends of a stretch of the ray.
struct Equiangular {
    /// Parameter of the ray's point nearest to the light. \[m\]
    t0: f32,
    /// Its distance to the light. \[m\]
    d: f32,
    theta: [f32; 2],
}

impl Equiangular {
    fn new(ray: &Ray, light: Vec3, (a, b): (f32, f32)) -> Option<Self> {
        let t0 = (light - ray.origin).dot(ray.direction);
        // By rejection, and never 0: a ray through the light would have no angle.
        let d = (light - ray.at(t0)).length().max(1e-6 * (b - a));
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

/// One distance for one light, by either density with even odds if the light is local.
fn one_sample<S: Spectrum>(
    world: &World<S>,
    light: &Light<S>,
    (ray, inside): (&Ray, &Inside),
    profile: &Profile<S>,
    u: f32,
    sampler: &mut Sampler,
) -> S {
    let extent = profile.extent();
    let equiangular = light
        .position()
        .and_then(|p| Equiangular::new(ray, p, extent));
    let (t, pdf) = match equiangular {
        None => {
            let t = flight_distance(profile, u, sampler);
            (t, flight_pdf(profile, t))
        }
        Some(angles) => {
            let t = if sampler.uniform() < 0.5 {
                angles.sample(u).clamp(extent.0, extent.1)
            } else {
                flight_distance(profile, u, sampler)
            };
            (t, 0.5 * (flight_pdf(profile, t) + angles.pdf(t)))
        }
    };
    if !(pdf > 0.0 && pdf.is_finite()) {
        return S::ZERO;
    }
    let position = ray.at(t);
    let Some(sample) = world.sample_light(light, position, sampler) else {
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
