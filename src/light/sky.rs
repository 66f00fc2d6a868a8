//! The sky of one radiance from everywhere.
//!
//! ```text
//! flux into a convex body of surface A   = pi L A     [W]
//! ```
//!
//! Photons start on the target's whole surface with a cosine distribution about its inward normal:
//! each then carries that flux, exactly. Nobody samples this sky: rays that leave the scene meet
//! it.

use std::f32::consts::PI;

use super::Emitted;
use super::directions::cosine_hemisphere;
use super::target::{face_normal, on_faces, surface};
use crate::ray::{Bounds, Ray};
use crate::rng::Rng;
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Sky<S> {
    /// \[W/(m2 sr)\]
    pub(super) radiance: S,
}

impl<S: Spectrum> Sky<S> {
    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        self.radiance.mean() * PI * surface(target)
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
        rng: &mut Rng,
    ) -> Emitted<S> {
        let size = target.size();
        let half = [size.y * size.z, size.z * size.x, size.x * size.y];
        let surface = surface(target);
        let faces = [-half[0], -half[1], -half[2]];
        let mut origin = on_faces(target, &faces, 0.5 * surface, point, rng);
        // Half of the faces: mirrored through the middle with even odds.
        let mut inward = face_normal(target, origin);
        if rng.below(2) == 1 {
            origin = target.min + target.max - origin;
            inward = -inward;
        }
        let direction = cosine_hemisphere(inward, aim);
        Emitted {
            ray: Ray { origin, direction },
            power: self.radiance * (PI * surface),
        }
    }
}
