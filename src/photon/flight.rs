//! A photon's way from its light to its end: flights, deposits, collisions and surfaces.
//!
//! ```text
//! at a collision    Phi <- albedo Phi / q      with probability q = max(albedo Phi) / max(Phi), else it ends
//! at a surface      Phi <- f |cos| / pdf Phi / q, likewise
//! ```
//!
//! Analogue: what is absorbed ends photons and does not dim them, so that photons of a grey scene
//! all carry the same power. See `photon` for what is deposited and kept.

use super::deposit::DepositRate;
use super::surface::SurfacePhoton;
use super::{Heading, Photon, Photons, TraceSettings};
use crate::ray::Ray;
use crate::spectrum::Spectrum;
use crate::surface::{Hit, Inside, SampleKind, Transport};
use crate::tracking::{Collision, Hero, Sampler, draw_distance, fly, sample_free_flight};
use crate::world::{World, passes};

/// Straight pieces of a photon's way in a row that scatter nothing, boundaries passed one by one:
/// an end to numerical loops.
const MAX_PIECES: u32 = 100_000;

/// A photon on its way.
pub(super) struct Flight<'a, S> {
    pub(super) world: &'a World<S>,
    pub(super) ray: Ray,
    /// Before the weight of its colours. \[W\]
    pub(super) power: S,
    pub(super) hero: Hero<S>,
    pub(super) inside: Inside,
    /// Scattering events so far.
    pub(super) order: u32,
    /// Kept where it meets a diffuse surface straight from its light.
    pub(super) straight: bool,
    /// Integral of the rate of deposits up to the next one.
    pub(super) left: f32,
}

impl<S: Spectrum> Flight<'_, S> {
    /// Follows the photon to its end.
    pub(super) fn follow<H: Heading>(
        &mut self,
        settings: &TraceSettings<'_>,
        keep_first: bool,
        sampler: &mut Sampler,
        out: &mut Photons<S, H>,
    ) {
        let world = self.world;
        let (mut pieces, mut order) = (0, self.order);
        while pieces < MAX_PIECES {
            sampler.counters.effects.surface_rays += u64::from(world.surfaces.is_some());
            let (first, media) = world.media_for(&self.inside);
            // In marble most flights end long before the surface, which need not be looked for.
            let drawn = draw_distance(media, &self.hero, sampler);
            let hit = world.surfaces.as_ref().and_then(|s| {
                let reach = drawn.unwrap_or(f32::INFINITY);
                s.intersect(self.ray.origin, self.ray.direction, reach)
            });
            let t_max = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
            let collision = match drawn {
                Some(distance) => fly(media, distance, t_max, &mut self.hero, sampler),
                None => sample_free_flight(media, &self.ray, t_max, &mut self.hero, sampler),
            };
            if self.order > 0 || keep_first {
                self.deposit(settings.rate, collision.map_or(t_max, |c| c.t), out);
            }
            let goes_on = match (collision, hit) {
                (Some(c), _) => self.collide(first, c, sampler, out),
                (None, Some(hit)) => self.meet(&hit, settings.surface_photons, sampler, out),
                (None, None) => {
                    out.energy.escaped += f64::from((self.power * self.hero.weight()).mean());
                    false
                }
            };
            if !goes_on {
                return;
            }
            pieces = if self.order == order { pieces + 1 } else { 0 };
            order = self.order;
        }
        out.energy.cut_off += f64::from((self.power * self.hero.weight()).mean());
    }

    /// Deposits on the straight piece [0, t_end] of the way.
    fn deposit<H: Heading>(&mut self, rate: &DepositRate, t_end: f32, out: &mut Photons<S, H>) {
        let (ray, hero, power) = (&self.ray, &self.hero, self.power);
        let heading = H::keep(ray.direction, self.world.compartment(&self.inside));
        let list = if self.order == 0 {
            &mut out.first
        } else {
            &mut out.higher
        };
        rate.along(ray, t_end, &mut self.left, |t, rate| {
            let power = power * hero.weight_at(t) * (1.0 / rate);
            list.push(Photon::new(ray.at(t), power, heading));
        });
    }

    /// A collision in a medium; false where the photon ends.
    #[inline]
    fn collide<H: Heading>(
        &mut self,
        first: usize,
        collision: Collision,
        sampler: &mut Sampler,
        out: &mut Photons<S, H>,
    ) -> bool {
        let world = self.world;
        let medium = &world.media[first + collision.medium];
        let position = self.ray.at(collision.t);
        sampler.counters.effects.absorbing += u64::from(medium.absorbs());
        let arriving = self.power * self.hero.weight();
        let scattered = arriving * medium.albedo;
        self.order += 1;
        if self.order == world.max_bounces {
            out.energy.absorbed += f64::from((arriving - scattered).mean());
            out.energy.cut_off += f64::from(scattered.mean());
            return false;
        }
        let survival = scattered.max_channel() / arriving.max_channel();
        // A draw only where it decides something: media of albedo 1 never absorb.
        if survival < 1.0 && sampler.uniform() >= survival {
            out.energy.absorbed += f64::from(arriving.mean());
            return false;
        }
        let goes_on = scattered * (1.0 / survival);
        out.energy.absorbed += f64::from((arriving - goes_on).mean());
        self.power = self.power * medium.albedo * (1.0 / survival);
        let counts = &mut sampler.counters.effects;
        counts.directions += u64::from(!medium.phase.is_isotropic());
        let direction = medium.phase.sample(self.ray.direction, sampler.uniform2());
        self.ray = Ray {
            origin: position,
            direction,
        };
        true
    }

    /// A surface; false where the photon ends.
    fn meet<H: Heading>(
        &mut self,
        hit: &Hit,
        keep: bool,
        sampler: &mut Sampler,
        out: &mut Photons<S, H>,
    ) -> bool {
        let world = self.world;
        let Some(surfaces) = &world.surfaces else {
            return false;
        };
        let direction = self.ray.direction;
        if passes(surfaces, hit, &self.inside) {
            surfaces.cross(hit, direction, &mut self.inside);
            if surfaces.encloses(hit.object) {
                sampler.counters.effects.boundaries += 1;
            }
            self.ray.origin = hit.spawn_origin(direction);
            return true;
        }
        let bsdf = surfaces.bsdf(hit);
        let arriving = self.power * self.hero.weight();
        let stays = f64::from(arriving.mean());
        if keep && (self.order > 0 || self.straight) && bsdf.is_diffuse() && !bsdf.is_black() {
            out.surface.push(SurfacePhoton {
                position: hit.position,
                normal: hit.facing(),
                direction,
                power: arriving,
            });
        }
        self.order += 1;
        if self.order == world.max_bounces {
            if bsdf.is_black() {
                out.energy.on_surfaces += stays;
            } else {
                out.energy.cut_off += stays;
            }
            return false;
        }
        let u = [sampler.uniform(), sampler.uniform(), sampler.uniform()];
        let Some(sample) = bsdf.sample(direction, u, Transport::Power) else {
            out.energy.on_surfaces += stays;
            return false;
        };
        sampler.counters.effects.specular += u64::from(sample.kind != SampleKind::Diffuse);
        let weight = S::from_rgb(sample.weight);
        let survival = ((arriving * weight).max_channel() / arriving.max_channel()).min(1.0);
        if survival < 1.0 && sampler.uniform() >= survival {
            out.energy.on_surfaces += stays;
            return false;
        }
        self.power = self.power * weight * (1.0 / survival);
        // Negative where interpolated normals add power.
        out.energy.on_surfaces += stays - f64::from((self.power * self.hero.weight()).mean());
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
}
