//! The sun: a distant disc.
//!
//! ```text
//! L = E / (pi sin^2 a) within the half angle a of its direction, 0 elsewhere     [W/(m2 sr)]
//! ```
//!
//! E is the irradiance on a facing surface \[W/m2\]; directions are sampled uniformly in solid
//! angle, whose weight differs from the cosine's by a^2 / 2 at the most.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::directions::{in_cone, spread_of};
use super::target::{on_faces, projected_faces};
use super::{Emitted, LightSample};
use crate::ray::{Bounds, Ray};
use crate::rng::Rng;
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Sun<S> {
    /// Of travel.
    direction: Vec3,
    /// On a facing surface. \[W/m2\]
    irradiance: S,
    /// 1 - cosine of half the apparent diameter; 0 is a delta direction.
    spread: f32,
}

impl<S: Spectrum> Sun<S> {
    pub(super) fn new(direction: DVec3, irradiance: S, angular_diameter: f64) -> Self {
        Self {
            direction: direction.normalize().as_vec3(),
            irradiance,
            spread: spread_of(0.5 * angular_diameter) as f32,
        }
    }

    pub(super) fn is_disc(&self) -> bool {
        self.spread > 0.0
    }

    /// A direction of the disc around `axis`.
    fn aim(&self, axis: Vec3, u: [f32; 2]) -> Vec3 {
        if self.spread > 0.0 {
            in_cone(axis, self.spread, u)
        } else {
            axis
        }
    }

    pub(super) fn sample(&self, u: [f32; 2]) -> LightSample<S> {
        LightSample {
            direction: self.aim(-self.direction, u),
            distance: f32::INFINITY,
            value: self.irradiance,
        }
    }

    pub(super) fn irradiance(&self) -> f32 {
        self.irradiance.mean()
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        self.irradiance.mean() * projected_faces(target, self.direction).1
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
        rng: &mut Rng,
    ) -> Emitted<S> {
        let direction = self.aim(self.direction, aim);
        let (faces, area) = projected_faces(target, direction);
        let origin = on_faces(target, &faces, area, point, rng);
        Emitted {
            ray: Ray { origin, direction },
            power: self.irradiance * area,
        }
    }

    pub(super) fn background(&self, view: Vec3) -> S {
        let gap = 0.5 * (view + self.direction).length_squared();
        // The disc's projected solid angle is pi sin^2 = pi spread (2 - spread).
        if self.spread > 0.0 && gap <= self.spread {
            self.irradiance * (1.0 / (PI * self.spread * (2.0 - self.spread)))
        } else {
            S::ZERO
        }
    }
}
