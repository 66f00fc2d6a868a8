//! Surfaces that shine, and uniform points on them.
//!
//! An emissive object radiates `L_e` \[W/(m2 sr)\] from its front (outwards from a closed surface),
//! the same in every direction, so its power is `pi L_e A` \[W\] with A its area \[m2\]. A point is
//! drawn with density `1 / A` \[1/m2\]: first a triangle by the distribution of areas, then
//! `x = (1 - sqrt(u)) a + sqrt(u) (1 - v) b + sqrt(u) v c` in it (Turk 1990). On an ellipsoid that
//! a transform has stretched the density differs from place to place; it is returned with the
//! point and by [`Surfaces::emission_pdf`](super::Surfaces::emission_pdf), so weights stay exact.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use super::hierarchy::{Hierarchy, Primitive, normal};
use super::hit;
use crate::scene::Rgb;

/// One emissive object.
#[derive(Debug)]
pub struct Emitter {
    /// Index in the scene's list of objects.
    pub object: u32,
    /// \[W/(m2 sr)\]
    pub radiance: Rgb,
    /// \[m2\]
    pub area: f32,
    /// Leaves of the hierarchy, and the running sum of their areas up to and including each.
    primitives: Vec<u32>,
    cumulative: Vec<f64>,
}

/// A point on an emissive surface.
#[derive(Debug, Clone, Copy)]
pub struct EmitterPoint {
    /// \[m\]
    pub position: Vec3,
    /// Bound on the distance to the true surface, per axis. \[m\]
    pub error: Vec3,
    /// Unit normal of the side that shines.
    pub normal: Vec3,
    /// \[W/(m2 sr)\]
    pub radiance: Rgb,
    /// Density by area. \[1/m2\]
    pub pdf: f32,
}

impl EmitterPoint {
    /// Where a ray along `direction` starts when it leaves this point. \[m\]
    #[must_use]
    pub fn spawn_origin(&self, direction: Vec3) -> Vec3 {
        hit::offset(self.position, self.error, self.normal, direction)
    }
}

impl Emitter {
    pub(super) fn new(
        object: u32,
        radiance: Rgb,
        primitives: Vec<u32>,
        hierarchy: &Hierarchy,
    ) -> Self {
        let mut sum = 0.0;
        let cumulative = primitives
            .iter()
            .map(|&index| {
                sum += area(hierarchy, index);
                sum
            })
            .collect();
        Self {
            object,
            radiance,
            area: sum as f32,
            primitives,
            cumulative,
        }
    }

    /// Emitted by the whole surface. \[W\]
    #[must_use]
    pub fn power(&self) -> Rgb {
        PI * self.area * self.radiance
    }

    /// A point from three uniforms in [0, 1).
    pub(super) fn sample(&self, hierarchy: &Hierarchy, u: [f32; 3]) -> Option<EmitterPoint> {
        let total = *self.cumulative.last()?;
        let target = f64::from(u[0]) * total;
        let at = self
            .cumulative
            .partition_point(|&sum| sum <= target)
            .min(self.primitives.len() - 1);
        let index = self.primitives[at];
        let share = (self.cumulative[at]
            - if at == 0 {
                0.0
            } else {
                self.cumulative[at - 1]
            })
            / total;
        let (position, normal, pdf, scale) = match hierarchy.primitive(index) {
            Primitive::Triangle(corners) => {
                let r = f64::from(u[1]).sqrt();
                let weights = [1.0 - r, r * (1.0 - f64::from(u[2])), r * f64::from(u[2])];
                let position: DVec3 = corners
                    .iter()
                    .zip(weights)
                    .map(|(corner, weight)| weight * corner.as_dvec3())
                    .sum();
                let scale = corners
                    .iter()
                    .fold(0.0, |s: f32, c| s.max(c.abs().max_element()));
                (position, normal(&corners).normalize(), 1.0 / total, scale)
            }
            Primitive::Ellipsoid(e) => {
                let ellipsoid = hierarchy.ellipsoid(e);
                let z = 1.0 - 2.0 * f64::from(u[1]);
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (sin, cos) = (std::f64::consts::TAU * f64::from(u[2])).sin_cos();
                let unit = DVec3::new(r * cos, r * sin, z);
                let (min, max) = ellipsoid.bounds();
                (
                    ellipsoid.position(unit),
                    ellipsoid.normal(unit),
                    share * ellipsoid.pdf_area(unit),
                    min.abs().max(max.abs()).max_element(),
                )
            }
        };
        let (position, error) = hit::round(position, scale);
        Some(EmitterPoint {
            position,
            error,
            normal: normal.as_vec3(),
            radiance: self.radiance,
            pdf: pdf as f32,
        })
    }

    /// Density of `sample` at a point of leaf `index`. \[1/m2\]
    pub(super) fn pdf(&self, hierarchy: &Hierarchy, index: u32, position: Vec3) -> f32 {
        match hierarchy.primitive(index) {
            Primitive::Triangle(_) => 1.0 / self.area,
            // An object is one ellipsoid or many triangles, never both.
            Primitive::Ellipsoid(e) => {
                let ellipsoid = hierarchy.ellipsoid(e);
                ellipsoid.pdf_area(ellipsoid.unit_of(position.as_dvec3())) as f32
            }
        }
    }
}

fn area(hierarchy: &Hierarchy, index: u32) -> f64 {
    match hierarchy.primitive(index) {
        Primitive::Triangle(corners) => 0.5 * normal(&corners).length(),
        Primitive::Ellipsoid(e) => hierarchy.ellipsoid(e).area(),
    }
}
