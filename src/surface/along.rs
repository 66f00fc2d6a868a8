//! What lies along a ray besides its nearest hit: blockers, boundaries, and the objects around a point.

use std::ops::ControlFlow;

use glam::Vec3;

use super::hierarchy::{Primitive, Ray, normal};
use super::{Hit, Inside, Surfaces};
use crate::scene::Material;

/// Where a ray passes the boundary of an enclosing object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Distance along the ray. \[m\]
    pub t: f32,
    /// Index in the scene's list of objects.
    pub object: u32,
    /// From outside to inside.
    pub inwards: bool,
}

/// A surface that a ray meets and light does not pass.
#[derive(Debug, Clone, Copy)]
pub struct Met {
    /// Distance along the ray. \[m\]
    pub t: f32,
    /// Index in the scene's list of objects.
    pub object: u32,
    /// Geometric unit normal: outwards.
    pub normal: Vec3,
    /// The ray goes against the normal.
    pub inwards: bool,
}

impl Surfaces {
    /// Passes the boundary at `hit` along `direction`: `inside` is then what holds beyond it.
    /// Boundaries of other objects in the same place (two media side by side) are passed with it,
    /// since the ray that goes on starts behind them all.
    pub fn cross(&self, hit: &Hit, direction: Vec3, inside: &mut Inside) {
        if self.encloses(hit.object) {
            inside.cross(hit.object, hit.front);
        }
        if self.parts.len() == 1 {
            return;
        }
        let mut others = Vec::new();
        self.visit_beside(hit, direction, |index, inwards| {
            let other = (self.leaves[index as usize].object, inwards);
            // An edge between two triangles may report one crossing twice.
            if other.0 != hit.object && self.encloses(other.0) && !others.contains(&other) {
                others.push(other);
            }
        });
        for (object, inwards) in others {
            inside.cross(object, inwards);
        }
    }

    /// Visits the leaves between the two starts of rays that leave a hit along `direction` and
    /// against it, and whether that way goes into them: what lies within its rounding.
    pub(super) fn visit_beside(
        &self,
        hit: &Hit,
        direction: Vec3,
        mut visit: impl FnMut(u32, bool),
    ) {
        let from = hit.spawn_origin(-direction);
        let way = hit.spawn_origin(direction) - from;
        let length = way.length();
        if length > 0.0 {
            let ray = Ray::new(from, way / length);
            self.hierarchy.all(&ray, length, |index, _, inwards| {
                visit(index, inwards);
                ControlFlow::Continue(())
            });
        }
    }

    /// True when anything but an interface lies in (0, `t_max`).
    #[must_use]
    pub fn occluded(&self, origin: Vec3, direction: Vec3, t_max: f32) -> bool {
        let ray = Ray::new(origin, direction);
        self.hierarchy.any(&ray, t_max, |index| {
            self.parts[self.leaves[index as usize].object as usize].blocks()
        })
    }

    /// Visits every surface in (0, `t_max`) but glass and interfaces, in no order.
    pub fn opaque_along(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        mut visit: impl FnMut(Met),
    ) {
        let ray = Ray::new(origin, direction);
        self.hierarchy.all(&ray, t_max, |index, t, inwards| {
            let object = self.leaves[index as usize].object;
            if !matches!(
                self.parts[object as usize].material,
                Material::Glass { .. } | Material::Interface
            ) {
                let normal = match self.hierarchy.primitive(index) {
                    Primitive::Triangle(corners) => normal(&corners).normalize().as_vec3(),
                    Primitive::Ellipsoid(e) => {
                        let ellipsoid = self.hierarchy.ellipsoid(e);
                        let unit = ellipsoid.unit_point(origin, direction, f64::from(t));
                        ellipsoid.normal(unit).as_vec3()
                    }
                };
                visit(Met {
                    t,
                    object,
                    normal,
                    inwards,
                });
            }
            ControlFlow::Continue(())
        });
    }

    /// As [`occluded`](Self::occluded); when nothing blocks, `crossings` holds the boundaries of
    /// interface objects on the way, nearest first, for the media between them.
    #[must_use]
    pub fn blocked(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        crossings: &mut Vec<Crossing>,
    ) -> bool {
        crossings.clear();
        let mut blocked = false;
        let ray = Ray::new(origin, direction);
        self.hierarchy.all(&ray, t_max, |index, t, inwards| {
            let object = self.leaves[index as usize].object;
            let part = &self.parts[object as usize];
            if part.blocks() {
                blocked = true;
                return ControlFlow::Break(());
            }
            if part.encloses {
                crossings.push(Crossing { t, object, inwards });
            }
            ControlFlow::Continue(())
        });
        crossings.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.object.cmp(&b.object)));
        // An edge between two triangles may report one crossing twice.
        crossings.dedup();
        blocked
    }

    /// The objects that contain a point, by counting crossings.
    ///
    /// A ray that leaves a closed surface once more than it enters started inside (winding number;
    /// for surfaces that do not cut themselves, the parity of crossings). Three directions vote,
    /// since a ray through an edge counts it twice.
    #[must_use]
    pub fn inside_at(&self, point: Vec3) -> Inside {
        const DIRECTIONS: [Vec3; 3] = [
            Vec3::new(0.364_842_2, 0.871_235_1, 0.328_465_7),
            Vec3::new(-0.842_317_4, 0.234_571_9, -0.485_237_6),
            Vec3::new(0.473_125_8, -0.512_374_1, -0.716_682_4),
        ];
        let mut inside = Inside::NOTHING;
        if !self.any_encloses() {
            return inside;
        }
        let mut counts = vec![[0_i32; 3]; self.parts.len()];
        for (i, direction) in DIRECTIONS.into_iter().enumerate() {
            let ray = Ray::new(point, direction.normalize());
            self.hierarchy
                .all(&ray, f32::INFINITY, |index, _, inwards| {
                    let object = self.leaves[index as usize].object as usize;
                    counts[object][i] += if inwards { -1 } else { 1 };
                    ControlFlow::Continue(())
                });
        }
        for (object, mut votes) in (0_u32..).zip(counts) {
            votes.sort_unstable();
            if self.encloses(object) {
                for _ in 0..votes[1] {
                    inside.cross(object, true);
                }
            }
        }
        inside
    }
}
