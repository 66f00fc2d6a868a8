//! Free flight and transmittance by null collisions.
//!
//! ```text
//! free flight     steps -ln(1 - u) / sigma_maj, a real collision with probability sigma_t / sigma_maj
//! transmittance   T = prod_segments exp(-sigma_min dt) * prod_collisions (1 - (sigma_t - sigma_min) / (sigma_maj - sigma_min))
//! sigma_min <= sigma_t(x) <= sigma_maj   bounds of the segment that the walk is in  [1/m]
//! ```
//!
//! Delta tracking (Woodcock 1965) through local majorants: the optical thickness left of a step
//! carries over into the next segment. A collision below the minorant is real whatever the
//! density, and costs no look-up (decomposition tracking, Kutz et al. 2017). Transmittance is
//! residual ratio tracking (Novak et al. 2014) whose control is the minorant, so that the
//! residual is never negative and T never leaves [0, 1]; small T is ended by Russian roulette.
//! Homogeneous media use the closed forms. This page chooses among the estimators; callers do not.
//!
//! Colour. Coefficients of a medium have one density in common, so channels collide at rates that
//! differ by constant factors. A path follows one channel, its hero, and carries the ratio of
//! every channel's path density to the hero's; the balance heuristic over the channels
//! (single-sample, Miller et al. 2019) then bounds every weight by the number of channels.
//!
//! The field is read by one stochastic tap in place of eight: every use here is linear in it.

use glam::Vec3;

use crate::medium::{Field, GridField, Medium};
use crate::ray::Ray;
use crate::rng::Rng;
use crate::spectrum::Spectrum;

/// Transmittance below which Russian roulette begins. Higher: fewer steps, more variance.
const ROULETTE_BELOW: f32 = 0.05;

/// What was done, counted per unit of work and summed for the report.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Free flights sampled.
    pub free_flights: u64,
    /// Transmittances estimated.
    pub transmittance_rays: u64,
    /// Values of the field fetched.
    pub density_lookups: u64,
    /// Photons that a radiance estimate added.
    pub gathered_photons: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.free_flights += other.free_flights;
        self.transmittance_rays += other.transmittance_rays;
        self.density_lookups += other.density_lookups;
        self.gathered_photons += other.gathered_photons;
    }
}

/// A random stream and the counters of its work.
#[derive(Debug, Clone)]
pub struct Sampler {
    /// Random numbers.
    pub rng: Rng,
    /// Work done.
    pub counters: Counters,
}

impl Sampler {
    /// A sampler on a stream.
    #[must_use]
    pub fn new(rng: Rng) -> Self {
        Self {
            rng,
            counters: Counters::default(),
        }
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        self.rng.uniform()
    }

    /// Two uniforms.
    #[inline]
    pub fn uniform2(&mut self) -> [f32; 2] {
        [self.rng.uniform(), self.rng.uniform()]
    }
}

/// The channel that a path follows, and how likely each channel's path was beside it.
#[derive(Debug, Clone, Copy)]
pub struct Hero<S> {
    channel: usize,
    /// Path density of each channel over the hero's.
    ratio: S,
}

impl<S: Spectrum> Hero<S> {
    /// Chooses a channel.
    #[inline]
    #[must_use]
    pub fn choose(rng: &mut Rng) -> Self {
        let channel = if S::CHANNELS == 1 {
            0
        } else {
            rng.below(S::CHANNELS as u32) as usize
        };
        Self {
            channel,
            ratio: S::ONE,
        }
    }

    /// Weight of each channel by the balance heuristic; 1 of a grey path.
    #[inline]
    #[must_use]
    pub fn weight(&self) -> S {
        if S::CHANNELS == 1 {
            S::ONE
        } else {
            self.ratio * (1.0 / self.ratio.mean())
        }
    }

    /// Multiplies each channel's density by `density`, the hero's included.
    #[inline]
    fn update(&mut self, density: S) {
        // The hero's own density is 0 where it cannot be, and by rounding alone: no 0/0 then.
        let own = density.channel(self.channel);
        if S::CHANNELS > 1 && own > 0.0 {
            self.ratio = self.ratio * density * (1.0 / own);
        }
    }
}

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
/// The first collision of overlapping media is the first of their own first collisions.
pub fn sample_free_flight<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<Collision> {
    sampler.counters.free_flights += 1;
    if S::CHANNELS > 1 && media.len() > 1 {
        return chromatic_flight(media, ray, t_max, hero, sampler);
    }
    let mut end = t_max;
    let mut first = None;
    for (index, medium) in media.iter().enumerate() {
        if let Some(t) = flight_in(medium, ray, end, hero, sampler) {
            end = t;
            first = Some(Collision { t, medium: index });
        }
    }
    first
}

/// The same for several media with colour: null collisions beyond the first real one must not
/// count in the ratios, so a flight that turns out to have gone too far is replayed, with its own
/// random numbers, up to where the path really went.
fn chromatic_flight<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<Collision> {
    let mut end = t_max;
    let mut first = None;
    let mut flights = Vec::with_capacity(media.len());
    for (index, medium) in media.iter().enumerate() {
        let before = sampler.rng.clone();
        let mut own = Hero {
            channel: hero.channel,
            ratio: S::ONE,
        };
        let hit = flight_in(medium, ray, end, &mut own, sampler);
        let reached = hit.unwrap_or(end);
        if let Some(t) = hit {
            end = t;
            first = Some(Collision { t, medium: index });
        }
        flights.push((before, own, reached));
    }
    let after = sampler.rng.clone();
    for (medium, (before, mut own, reached)) in media.iter().zip(flights) {
        if reached > end {
            own.ratio = S::ONE;
            sampler.rng = before;
            // Shorter than the flight was: it cannot collide again.
            let _ = flight_in(medium, ray, end, &mut own, sampler);
        }
        hero.ratio *= own.ratio;
    }
    sampler.rng = after;
    first
}

/// The first collision with one medium.
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
            let (t0, t1) = bounds.map_or(Some((0.0, t_max)), |b| b.clip(ray, 0.0, t_max))?;
            let sigma = medium.sigma_t.channel(hero.channel);
            let t = t0 + sampler.rng.exponential() / sigma;
            if t < t1 {
                if S::CHANNELS > 1 {
                    hero.update(S::transmittance(medium.sigma_t * (t - t0)) * medium.sigma_t);
                }
                Some(t)
            } else {
                if S::CHANNELS > 1 && t1.is_finite() {
                    hero.update(S::transmittance(medium.sigma_t * (t1 - t0)));
                }
                None
            }
        }
        Field::Grid(field) => grid_flight(medium.sigma_t, field, ray, t_max, hero, sampler),
    }
}

/// Delta tracking through the local majorants of a grid.
fn grid_flight<S: Spectrum>(
    sigma_t: S,
    field: &GridField,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let local = field.local_ray(ray);
    let highest = sigma_t.max_channel();
    // Density, in units of the highest channel, that collides for the hero.
    let share = sigma_t.channel(hero.channel) / highest;
    let mut budget = sampler.rng.exponential();
    for segment in field.majorants.segments(&local, 0.0, t_max) {
        let sigma_maj = highest * segment.majorant;
        let mut t = segment.t_min;
        loop {
            let reach = (segment.t_max - t) * sigma_maj;
            if budget >= reach {
                budget -= reach;
                break;
            }
            t += budget / sigma_maj;
            budget = sampler.rng.exponential();
            let bar = sampler.uniform() * segment.majorant;
            if bar < share * segment.minorant {
                hero.update(sigma_t);
                return Some(t);
            }
            let density = one_tap(field, &local, t, sampler);
            if bar < share * density {
                hero.update(sigma_t);
                return Some(t);
            }
            if S::CHANNELS > 1 {
                // Not below 0: where the density is the majorant, rounding decides the sign.
                hero.update(sigma_t.map(|k| k.mul_add(-density, sigma_maj).max(0.0)));
            }
        }
    }
    None
}

/// One stochastic tap of the field.
#[inline]
fn one_tap(field: &GridField, local: &Ray, t: f32, sampler: &mut Sampler) -> f32 {
    sampler.counters.density_lookups += 1;
    let u = Vec3::new(sampler.uniform(), sampler.uniform(), sampler.uniform());
    field.grid.lookup_one_tap(local.at(t), u)
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
            Field::Constant { bounds } => bounds
                .map_or(Some((0.0, t_max)), |b| b.clip(ray, 0.0, t_max))
                .map_or(S::ONE, |(t0, t1)| {
                    medium
                        .sigma_t
                        .map(|k| if k > 0.0 { (k * (t0 - t1)).exp() } else { 1.0 })
                }),
            Field::Grid(field) => ratio_tracking(medium.sigma_t, field, ray, t_max, sampler),
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
    let local = field.local_ray(ray);
    let highest = sigma_t.max_channel();
    let mut tr = S::ONE;
    // Optical thickness of the control, applied once at the end.
    let mut control = 0.0;
    let mut budget = sampler.rng.exponential();
    for segment in field.majorants.segments(&local, 0.0, t_max) {
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
            budget = sampler.rng.exponential();
            let residual = one_tap(field, &local, t, sampler) - segment.minorant;
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
