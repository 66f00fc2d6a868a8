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
use crate::medium::Medium;
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
    pub(super) sampler: Sampler,
    pub(super) ray: Ray,
    /// Before the weight of its colours. \[W\]
    pub(super) power: S,
    pub(super) hero: Hero<S>,
    pub(super) inside: Inside,
    /// Scattering events so far.
    pub(super) order: u32,
    /// Deposited before the first of them.
    pub(super) keep_first: bool,
    /// Kept where it meets a diffuse surface straight from its light.
    pub(super) straight: bool,
    /// Integral of the rate of deposits up to the next one.
    pub(super) left: f32,
    /// Pieces since the last scattering event.
    pub(super) pieces: u32,
    /// The surface at the end of the piece.
    pub(super) hit: Option<Hit>,
}

/// What ends a piece of a photon's way.
pub(super) enum Piece<'a, S> {
    /// A collision, or the surface if there is one.
    Known(Option<Collision>),
    /// Whatever is first in these media, or else the surface at `t_max`.
    Flight { media: &'a [Medium<S>], t_max: f32 },
}

impl<'a, S: Spectrum> Flight<'a, S> {
    /// Follows the photon to its end.
    pub(super) fn follow<H: Heading>(
        &mut self,
        settings: &TraceSettings<'_>,
        out: &mut Photons<S, H>,
    ) {
        loop {
            let collision = match self.set_out() {
                Piece::Known(collision) => collision,
                Piece::Flight { media, t_max } => {
                    sample_free_flight(media, &self.ray, t_max, &mut self.hero, &mut self.sampler)
                }
            };
            if !self.arrive(collision, settings, out) {
                return;
            }
        }
    }

    /// Begins the next piece of its way.
    #[inline]
    pub(super) fn set_out(&mut self) -> Piece<'a, S> {
        let world = self.world;
        let sampler = &mut self.sampler;
        sampler.counters.effects.surface_rays += u64::from(world.surfaces.is_some());
        let (_, media) = world.media_for(&self.inside);
        // In marble most flights end long before the surface, which need not be looked for.
        let drawn = draw_distance(media, &self.hero, sampler);
        self.hit = world.surfaces.as_ref().and_then(|s| {
            let reach = drawn.unwrap_or(f32::INFINITY);
            s.intersect(self.ray.origin, self.ray.direction, reach)
        });
        let t_max = self.reach();
        match drawn {
            Some(distance) => {
                let (hero, sampler) = (&mut self.hero, &mut self.sampler);
                Piece::Known(fly(media, distance, t_max, hero, sampler))
            }
            None => Piece::Flight { media, t_max },
        }
    }

    /// How far the surface is.
    fn reach(&self) -> f32 {
        self.hit.as_ref().map_or(f32::INFINITY, |hit| hit.t)
    }

    /// At the end of a piece; false where the photon ends.
    #[inline]
    pub(super) fn arrive<H: Heading>(
        &mut self,
        collision: Option<Collision>,
        settings: &TraceSettings<'_>,
        out: &mut Photons<S, H>,
    ) -> bool {
        let order = self.order;
        if order > 0 || self.keep_first {
            self.deposit(settings.rate, collision.map_or(self.reach(), |c| c.t), out);
        }
        let goes_on = match (collision, self.hit.take()) {
            (Some(c), _) => self.collide(c, out),
            (None, Some(hit)) => self.meet(&hit, settings.surface_photons, out),
            (None, None) => {
                out.energy.escaped += f64::from((self.power * self.hero.weight()).mean());
                false
            }
        };
        if !goes_on {
            return false;
        }
        self.pieces = if self.order == order {
            self.pieces + 1
        } else {
            0
        };
        if self.pieces < MAX_PIECES {
            return true;
        }
        out.energy.cut_off += f64::from((self.power * self.hero.weight()).mean());
        false
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
    fn collide<H: Heading>(&mut self, collision: Collision, out: &mut Photons<S, H>) -> bool {
        let world = self.world;
        let sampler = &mut self.sampler;
        let (first, _) = world.media_for(&self.inside);
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
    fn meet<H: Heading>(&mut self, hit: &Hit, keep: bool, out: &mut Photons<S, H>) -> bool {
        let world = self.world;
        let sampler = &mut self.sampler;
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
