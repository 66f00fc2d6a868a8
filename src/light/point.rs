//! A point that shines everywhere alike.
//!
//! ```text
//! E = P / (4 pi d^2)      on a facing surface at distance d     [W/m2]
//! ```

use std::f32::consts::PI;

use glam::Vec3;

use super::directions::{in_cone, sphere_cone, toward};
use super::target::share_of_directions;
use super::{Emitted, LightSample};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Point<S> {
    /// \[m\]
    pub(super) position: Vec3,
    /// \[W\]
    pub(super) power: S,
}

impl<S: Spectrum> Point<S> {
    pub(super) fn sample(&self, p: Vec3) -> Option<LightSample<S>> {
        let (direction, distance) = toward(p, self.position)?;
        Some(LightSample {
            direction,
            distance,
            value: self.power * (1.0 / (4.0 * PI * distance * distance)),
        })
    }

    /// \[W/sr\]
    pub(super) fn intensity(&self) -> f32 {
        self.power.mean() * (0.25 / PI)
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        self.power.mean() * share_of_directions(target, self.position)
    }

    pub(super) fn emit(&self, target: &Bounds, aim: [f32; 2]) -> Emitted<S> {
        let (direction, share) = match sphere_cone(self.position, target.center(), target.radius())
        {
            Some((axis, spread)) => (in_cone(axis, spread, aim), 0.5 * spread),
            None => (in_cone(Vec3::Z, 2.0, aim), 1.0),
        };
        Emitted {
            ray: Ray {
                origin: self.position,
                direction,
            },
            power: self.power * share,
        }
    }
}
