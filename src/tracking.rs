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

use crate::medium::{Field, GridField, Medium, PlateauField};
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
    /// What only one effect calls for.
    pub effects: EffectCounts,
}

/// How often what only one effect calls for was done: 0 where the effect is pruned.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EffectCounts {
    /// Collisions with media that absorb.
    pub absorbing: u64,
    /// Points of a ray joined to a light, and photons kept of the first order.
    pub first_order: u64,
    /// Photons kept of higher orders in media, and collisions of paths beyond the first.
    pub higher_orders: u64,
    /// Phase functions evaluated or sampled that depend on the direction.
    pub directions: u64,
    /// Temperatures fetched.
    pub temperatures: u64,
    /// Rays and photons of three channels.
    pub coloured: u64,
    /// Rays through the hierarchy of surfaces.
    pub surface_rays: u64,
    /// Reflections and refractions that are not diffuse.
    pub specular: u64,
    /// Photons kept on surfaces.
    pub surface_photons: u64,
    /// Straight lines followed from boundary to boundary, and boundaries passed.
    pub boundaries: u64,
    /// Points drawn on lights.
    pub light_points: u64,
    /// Photons from skies, and rays toward them from surfaces.
    pub sky: u64,
    /// Points drawn on the lens.
    pub lens_points: u64,
}

/// Counts of [`EffectCounts`].
pub const EFFECTS: usize = 13;

impl EffectCounts {
    /// All of them, in the order of their declaration.
    #[must_use]
    pub fn to_array(&self) -> [u64; EFFECTS] {
        [
            self.absorbing,
            self.first_order,
            self.higher_orders,
            self.directions,
            self.temperatures,
            self.coloured,
            self.surface_rays,
            self.specular,
            self.surface_photons,
            self.boundaries,
            self.light_points,
            self.sky,
            self.lens_points,
        ]
    }

    /// From [`to_array`](Self::to_array).
    #[must_use]
    pub fn from_array(counts: [u64; EFFECTS]) -> Self {
        let [
            absorbing,
            first_order,
            higher_orders,
            directions,
            temperatures,
            coloured,
            surface_rays,
            specular,
            surface_photons,
            boundaries,
            light_points,
            sky,
            lens_points,
        ] = counts;
        Self {
            absorbing,
            first_order,
            higher_orders,
            directions,
            temperatures,
            coloured,
            surface_rays,
            specular,
            surface_photons,
            boundaries,
            light_points,
            sky,
            lens_points,
        }
    }
}

impl std::ops::AddAssign for EffectCounts {
    fn add_assign(&mut self, other: Self) {
        let (a, b) = (self.to_array(), other.to_array());
        *self = Self::from_array(std::array::from_fn(|i| a[i] + b[i]));
    }
}

impl Counters {
    /// How often what only one effect calls for was done, in the fixed order of the effects.
    #[must_use]
    pub fn by_effect(&self) -> [u64; 14] {
        let counts = &self.effects;
        [
            counts.absorbing,
            counts.first_order,
            counts.higher_orders,
            counts.directions,
            counts.temperatures,
            counts.coloured,
            self.density_lookups,
            counts.surface_rays,
            counts.specular,
            counts.surface_photons,
            counts.boundaries,
            counts.light_points,
            counts.sky,
            counts.lens_points,
        ]
    }
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.free_flights += other.free_flights;
        self.transmittance_rays += other.transmittance_rays;
        self.density_lookups += other.density_lookups;
        self.gathered_photons += other.gathered_photons;
        self.effects += other.effects;
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
#[derive(Debug, Clone)]
pub struct Hero<S> {
    channel: usize,
    /// Path density of each channel over the hero's, up to the end of the last flight.
    ratio: S,
    /// The same up to its start.
    start: S,
    /// What the last flight met on its way, in media whose channels differ.
    passed: Vec<Passed<S>>,
}

/// What a flight passes without colliding: events that are not equally likely for all channels.
#[derive(Debug, Clone, Copy)]
enum Passed<S> {
    /// A null collision at t, of this density by channel.
    Null { t: f32, density: S },
    /// A stretch of a homogeneous medium.
    Stretch { t0: f32, t1: f32, sigma_t: S },
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
            start: S::ONE,
            passed: Vec::new(),
        }
    }

    /// Weight of each channel by the balance heuristic; 1 of a grey path.
    #[inline]
    #[must_use]
    pub fn weight(&self) -> S {
        Self::balance(self.ratio)
    }

    /// The same of the path that ends at `t` of the last flight, before its collision.
    #[inline]
    #[must_use]
    pub fn weight_at(&self, t: f32) -> S {
        Self::balance(self.ratio_at(t))
    }

    #[inline]
    fn balance(ratio: S) -> S {
        if S::CHANNELS == 1 {
            S::ONE
        } else {
            ratio * (1.0 / ratio.mean())
        }
    }

    /// Ratios at `t` of the last flight.
    #[inline]
    fn ratio_at(&self, t: f32) -> S {
        let mut ratio = self.start;
        for passed in &self.passed {
            let density = match *passed {
                Passed::Null { t: at, density } if at < t => density,
                Passed::Null { .. } => continue,
                Passed::Stretch { t0, t1, sigma_t } => {
                    S::transmittance(sigma_t * (t.min(t1) - t0).max(0.0))
                }
            };
            ratio *= self.over_own(density);
        }
        ratio
    }

    /// Each channel's density over the hero's.
    #[inline]
    fn over_own(&self, density: S) -> S {
        // The hero's own density is 0 where it cannot be, and by rounding alone: no 0/0 then.
        let own = density.channel(self.channel);
        if own > 0.0 {
            density * (1.0 / own)
        } else {
            S::ONE
        }
    }
}

/// True where the channels of a coefficient differ.
#[inline]
fn coloured<S: Spectrum>(sigma_t: S) -> bool {
    S::CHANNELS > 1 && sigma_t != S::splat(sigma_t.channel(0))
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
/// The first collision of overlapping media is the first of their own first collisions. Null
/// collisions beyond it were never met: they do not count in the ratios.
pub fn sample_free_flight<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<Collision> {
    sampler.counters.free_flights += 1;
    hero.start = hero.ratio;
    hero.passed.clear();
    let mut end = t_max;
    let mut first = None;
    for (index, medium) in media.iter().enumerate() {
        if let Some(t) = flight_in(medium, ray, end, hero, sampler) {
            end = t;
            first = Some(Collision { t, medium: index });
        }
    }
    if S::CHANNELS > 1 {
        hero.ratio = hero.ratio_at(end);
        if let Some(collision) = first {
            hero.ratio *= hero.over_own(media[collision.medium].sigma_t);
        }
    }
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
            if coloured(medium.sigma_t) {
                hero.passed.push(Passed::Stretch {
                    t0,
                    t1: t.min(t1),
                    sigma_t: medium.sigma_t,
                });
            }
            (t < t1).then_some(t)
        }
        Field::Grid(field) => grid_flight(medium.sigma_t, field, ray, t_max, hero, sampler),
        Field::Plateau(field) => plateau_flight(medium.sigma_t, field, ray, t_max, hero, sampler),
    }
}

/// Delta tracking over a plateau, whose one majorant is its value: in its core every collision of a
/// grey medium is real, so that the first one is the closed form.
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
    loop {
        t += sampler.rng.exponential() / sigma_maj;
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

/// Delta tracking through the local majorants of a grid.
fn grid_flight<S: Spectrum>(
    sigma_t: S,
    field: &GridField,
    ray: &Ray,
    t_max: f32,
    hero: &mut Hero<S>,
    sampler: &mut Sampler,
) -> Option<f32> {
    let local = field.placement.local_ray(ray);
    let highest = sigma_t.max_channel();
    // Density, in units of the highest channel, that collides for the hero.
    let share = sigma_t.channel(hero.channel) / highest;
    let coloured = coloured(sigma_t);
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
                return Some(t);
            }
            let density = one_tap(field, &local, t, sampler);
            if bar < share * density {
                return Some(t);
            }
            if coloured {
                // Not below 0: where the density is the majorant, rounding decides the sign.
                let density = sigma_t.map(|k| k.mul_add(-density, sigma_maj).max(0.0));
                hero.passed.push(Passed::Null { t, density });
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
            Field::Plateau(field) => {
                let mut depth = 0.0;
                field
                    .plateau
                    .pieces(&field.placement.exact_ray(ray), 0.0, t_max, |piece| {
                        depth += piece.integral;
                        true
                    });
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
