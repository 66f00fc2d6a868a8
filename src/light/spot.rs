//! A spot: a point that shines into a cone.
//!
//! ```text
//! I(w) = I_0                                        within the inner cone      [W/sr]
//!      = I_0 (c_0 - gap) / (c_0 - c_1)              in the penumbra            gap = 1 - cos
//! P    = I_0 pi (c_0 + c_1)                         c_0, c_1: gaps of the outer and inner cone
//! ```
//!
//! A ray is lit between the points where it crosses the cone, roots of
//! `((x - p) . a)^2 = cos^2 |x - p|^2`; they are found in f64, where narrow cones do not cancel.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::directions::{in_cone, sphere_cone, spread_of, toward};
use super::gobo::{Gobo, Slide};
use super::target::share_of_directions;
use super::{Emitted, LightSample};
use crate::ray::{Bounds, Ray};
use crate::scene::Rgb;
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Spot<S> {
    /// \[m\]
    pub(super) position: Vec3,
    /// Axis.
    direction: Vec3,
    /// On the axis. \[W/sr\]
    intensity: S,
    /// 1 - cosine at which the light has gone, and within which it is full.
    cone: [f32; 2],
    /// A picture that filters it.
    slide: Option<Slide>,
}

impl<S: Spectrum> Spot<S> {
    /// `aim` is the position and the axis; the cone's half angle and its penumbra in degrees.
    pub(super) fn new(
        aim: (Vec3, DVec3),
        power: Rgb,
        [cone_angle, penumbra]: [f64; 2],
        gobo: Option<Gobo>,
    ) -> Self {
        let cone = [
            spread_of(cone_angle),
            spread_of((cone_angle - penumbra).max(0.0)),
        ];
        // The falloff is linear in 1 - cos, so its integral is the mean of both cones.
        let solid_angle = std::f64::consts::PI * (cone[0] + cone[1]);
        let axis = aim.1.normalize();
        Self {
            position: aim.0,
            direction: axis.as_vec3(),
            intensity: S::from_rgb(power * (1.0 / solid_angle) as f32),
            cone: cone.map(|c| c as f32),
            slide: gobo.map(|gobo| gobo.before(axis, cone_angle)),
        }
    }

    /// Share of the intensity in a direction.
    #[inline]
    fn falloff(&self, direction: Vec3) -> f32 {
        let gap = 0.5 * (self.direction - direction).length_squared();
        if gap <= self.cone[1] {
            1.0
        } else if gap >= self.cone[0] {
            0.0
        } else {
            (self.cone[0] - gap) / (self.cone[0] - self.cone[1])
        }
    }

    /// Intensity in a direction; none where it is 0. \[W/sr\]
    fn toward(&self, direction: Vec3) -> Option<S> {
        let share = self.falloff(direction);
        if share <= 0.0 {
            return None;
        }
        let filter = self
            .slide
            .as_ref()
            .map_or(S::ONE, |s| S::from_rgb(s.filter(self.direction, direction)));
        (!filter.is_zero()).then(|| self.intensity * filter * share)
    }

    pub(super) fn sample(&self, p: Vec3) -> Option<LightSample<S>> {
        let (direction, distance) = toward(p, self.position)?;
        let intensity = self.toward(-direction)?;
        Some(LightSample {
            direction,
            distance,
            value: intensity * (1.0 / (distance * distance)),
        })
    }

    /// On the axis. \[W/sr\]
    pub(super) fn intensity(&self) -> f32 {
        self.intensity.mean()
    }

    /// True where the cone holds the point.
    pub(super) fn lights(&self, p: Vec3) -> bool {
        toward(p, self.position).is_some_and(|(to, _)| self.falloff(-to) > 0.0)
    }

    /// The part of the stretch (a, b) of a ray that lies in the cone.
    pub(super) fn shines_along(&self, ray: &Ray, (a, b): (f32, f32)) -> Option<(f32, f32)> {
        let cos = 1.0 - f64::from(self.cone[0]);
        if cos <= 0.0 {
            return Some((a, b));
        }
        let w = (ray.origin - self.position).as_dvec3();
        let (d, axis) = (ray.direction.as_dvec3(), self.direction.as_dvec3());
        let (da, wa, c2) = (d.dot(axis), w.dot(axis), cos * cos);
        // f(t) = qa t^2 + 2 qb t + qc is above 0 in the cone and in its mirror image.
        let qa = da * da - c2 * d.length_squared();
        let qb = wa * da - c2 * w.dot(d);
        let qc = wa * wa - c2 * w.length_squared();
        let root2 = qb * qb - qa * qc;
        if root2 <= 0.0 || qa == 0.0 {
            // Along the cone's side, or past it: nothing, but for rounding.
            return (qa == 0.0).then_some((a, b));
        }
        let q = -(qb + root2.sqrt().copysign(qb));
        let (r0, r1) = (q / qa, if q == 0.0 { 0.0 } else { qc / q });
        let (low, high) = (r0.min(r1), r0.max(r1));
        let (start, end) = if qa < 0.0 {
            // Both ends on one of the two cones.
            if wa + 0.5 * (low + high) * da <= 0.0 {
                return None;
            }
            (low, high)
        } else if da > 0.0 {
            (high, f64::INFINITY)
        } else {
            (f64::NEG_INFINITY, low)
        };
        let (start, end) = ((start as f32).max(a), (end as f32).min(b));
        (start < end).then_some((start, end))
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        let around = 4.0 * PI * share_of_directions(target, self.position);
        self.intensity.mean() * around.min(PI * (self.cone[0] + self.cone[1]))
    }

    pub(super) fn emit(&self, target: &Bounds, aim: [f32; 2]) -> Option<Emitted<S>> {
        let (axis, spread) = sphere_cone(self.position, target.center(), target.radius())
            .filter(|(_, s)| *s < self.cone[0])
            .unwrap_or((self.direction, self.cone[0]));
        let direction = in_cone(axis, spread, aim);
        let intensity = self.toward(direction)?;
        Some(Emitted {
            ray: Ray {
                origin: self.position,
                direction,
            },
            power: intensity * (2.0 * PI * spread),
        })
    }
}
