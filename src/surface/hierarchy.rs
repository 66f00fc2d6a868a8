//! The hierarchy over every primitive of a scene: nearest hit, any hit, all hits.
//!
//! A compressed wide tree (Ylitie, Karras, Laine 2017) built by obvhs: eight children per node,
//! their boxes quantised to 8 bits along each axis, `b = p + q e`, e a power of two \[m\].
//! A ray meets the slab of axis k at `t = (q e_k + p_k - o_k) / d_k`.
//!
//! Where we depart from obvhs: its box test drops whatever lies closer than 1e-4 m, replaces
//! directions below 1.2e-7 by that value, and rounds both ways, so that rays leak along box
//! edges and small scenes vanish (`the_stock_test_loses_near_hits` below). Ours widens every slab
//! by the rounding error of the formula above,
//! `|dt| <= BOX_ERROR (|p - o| + 255 e) / |d|`,
//! (the idea of Ize 2013, for an absolute instead of a relative error: the terms of the quantised
//! form cancel), so that a box is never missed when its primitive is hit. The traversal order and
//! the tree are obvhs's own.

use std::ops::ControlFlow;
use std::time::Duration;

use glam::{DVec3, UVec2, Vec3, Vec3A};
use obvhs::cwbvh::node::{CwBvhNode, extract_byte64};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::{BvhBuildParams, aabb::Aabb, traverse};

use super::ellipsoid::Ellipsoid;
use super::triangle::Shear;

/// Bound on the relative rounding error of a slab distance. The arithmetic needs about 6 x 2^-24,
/// the exponent that obvhs rounds through `log2` up to 22 x 2^-24. Smaller leaks, much larger
/// visits boxes in vain; pinned by `closed_meshes_do_not_leak`.
const BOX_ERROR: f32 = 1.0 / 262_144.0; // 2^-18

/// Directions closer to zero than this meet a slab at plus or minus "never" instead of at NaN.
const SMALLEST_DIRECTION: f32 = 1e-30;

/// What a leaf holds.
#[derive(Debug, Clone, Copy)]
pub(super) enum Primitive {
    /// Corners, counter-clockwise seen from the front. \[m\]
    Triangle([Vec3; 3]),
    /// Index into the list of ellipsoids.
    Ellipsoid(u32),
}

/// A ray with everything that depends on it alone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    /// \[m\]
    pub(super) origin: Vec3,
    /// Unit length.
    pub(super) direction: Vec3,
    /// Shear of the watertight triangle test.
    pub(super) shear: Shear,
    inverse: Vec3,
}

impl Ray {
    pub(super) fn new(origin: Vec3, direction: Vec3) -> Self {
        let inverse = |d: f32| {
            if d.abs() < SMALLEST_DIRECTION {
                (1.0 / SMALLEST_DIRECTION).copysign(d)
            } else {
                1.0 / d
            }
        };
        Self {
            origin,
            direction,
            shear: Shear::new(direction),
            inverse: Vec3::new(
                inverse(direction.x),
                inverse(direction.y),
                inverse(direction.z),
            ),
        }
    }
}

/// Primitives in the order of the leaves, and the tree above them.
#[derive(Debug)]
pub(super) struct Hierarchy {
    tree: CwBvh,
    primitives: Vec<Primitive>,
    ellipsoids: Vec<Ellipsoid>,
    bounds: Option<(Vec3, Vec3)>,
}

impl Hierarchy {
    /// Builds the tree; the second value says where each primitive came from:
    /// `order[i]` is the index in `primitives` of the i-th leaf.
    pub(super) fn build(primitives: &[Primitive], ellipsoids: Vec<Ellipsoid>) -> (Self, Vec<u32>) {
        if primitives.is_empty() {
            let empty = Self {
                tree: CwBvh::default(),
                primitives: Vec::new(),
                ellipsoids,
                bounds: None,
            };
            return (empty, Vec::new());
        }
        let boxes: Vec<Aabb> = primitives
            .iter()
            .map(|primitive| match *primitive {
                Primitive::Triangle([a, b, c]) => {
                    Aabb::new(a.min(b).min(c).into(), a.max(b).max(c).into())
                }
                Primitive::Ellipsoid(index) => {
                    let (min, max) = ellipsoids[index as usize].bounds();
                    Aabb::new(min.into(), max.into())
                }
            })
            .collect();
        let mut params = BvhBuildParams::slow_build();
        params.pre_split = false;
        let tree = build_cwbvh(&boxes, params, &mut Duration::default());
        let order = tree.primitive_indices.clone();
        let all = boxes.iter().fold(Aabb::INVALID, |all, b| all.union(b));
        let hierarchy = Self {
            tree,
            primitives: order.iter().map(|&i| primitives[i as usize]).collect(),
            ellipsoids,
            bounds: Some((all.min.into(), all.max.into())),
        };
        (hierarchy, order)
    }

    /// Bytes that tree and primitives take in memory.
    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..])
            + size_of_val(&self.tree.primitive_indices[..])
            + size_of_val(&self.primitives[..])
            + size_of_val(&self.ellipsoids[..])
    }

    pub(super) fn is_empty(&self) -> bool {
        self.primitives.is_empty()
    }

    pub(super) fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.bounds
    }

    pub(super) fn primitive(&self, index: u32) -> Primitive {
        self.primitives[index as usize]
    }

    pub(super) fn ellipsoid(&self, index: u32) -> &Ellipsoid {
        &self.ellipsoids[index as usize]
    }

    /// Nearest hit with t in (0, `t_max`): leaf index and distance.
    pub(super) fn nearest(&self, ray: &Ray, t_max: f32) -> Option<(u32, f32)> {
        let mut found = None;
        self.walk(ray, t_max, |index, limit| {
            match self.distance(ray, index, limit) {
                Some(t) => {
                    found = Some((index, t));
                    ControlFlow::Continue(t)
                }
                None => ControlFlow::Continue(limit),
            }
        });
        found
    }

    /// True when a primitive that `blocks` lies in (0, `t_max`).
    pub(super) fn any(&self, ray: &Ray, t_max: f32, blocks: impl Fn(u32) -> bool) -> bool {
        let mut blocked = false;
        self.walk(ray, t_max, |index, limit| {
            if blocks(index) && self.distance(ray, index, limit).is_some() {
                blocked = true;
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(limit)
            }
        });
        blocked
    }

    /// Visits every hit with t in (0, `t_max`), in no order, until `visit` breaks: leaf index,
    /// distance, and whether the ray goes in there (against the outward normal).
    pub(super) fn all(
        &self,
        ray: &Ray,
        t_max: f32,
        mut visit: impl FnMut(u32, f32, bool) -> ControlFlow<()>,
    ) {
        self.walk(ray, t_max, |index, limit| {
            match self.primitives[index as usize] {
                Primitive::Triangle(corners) => {
                    if let Some(t) = ray
                        .shear
                        .intersect(ray.origin, &corners)
                        .and_then(|hit| within(hit.t, limit))
                    {
                        let inwards = normal(&corners).dot(ray.direction.as_dvec3()) < 0.0;
                        visit(index, t, inwards)?;
                    }
                }
                Primitive::Ellipsoid(e) => {
                    let roots = self.ellipsoids[e as usize].roots(ray.origin, ray.direction);
                    for (t, inwards) in roots.into_iter().flatten().zip([true, false]) {
                        if let Some(t) = within(t, limit) {
                            visit(index, t, inwards)?;
                        }
                    }
                }
            }
            ControlFlow::Continue(limit)
        });
    }

    /// Where a ray meets a leaf, before `limit`.
    #[inline]
    pub(super) fn distance(&self, ray: &Ray, index: u32, limit: f32) -> Option<f32> {
        match self.primitives[index as usize] {
            Primitive::Triangle(corners) => ray
                .shear
                .intersect(ray.origin, &corners)
                .and_then(|hit| within(hit.t, limit)),
            Primitive::Ellipsoid(e) => self.ellipsoids[e as usize]
                .roots(ray.origin, ray.direction)?
                .into_iter()
                .find_map(|t| within(t, limit)),
        }
    }

    /// Visits the leaves along a ray; `visit` returns the new end of the ray.
    #[inline]
    fn walk(
        &self,
        ray: &Ray,
        mut t_max: f32,
        mut visit: impl FnMut(u32, f32) -> ControlFlow<(), f32>,
    ) {
        let mut state = self.tree.new_traversal(Vec3A::from(ray.direction));
        let mut node;
        traverse!(
            self.tree,
            node,
            state,
            intersect_node(node, ray, t_max, state.oct_inv4),
            match visit(state.primitive_id, t_max) {
                ControlFlow::Continue(limit) => t_max = limit,
                ControlFlow::Break(()) => return,
            }
        );
    }
}

/// Outward normal of a triangle, as long as twice its area. \[m2\]
#[inline]
pub(super) fn normal([a, b, c]: &[Vec3; 3]) -> DVec3 {
    let [a, b, c] = [a, b, c].map(|v| v.as_dvec3());
    (b - a).cross(c - a)
}

#[inline]
fn within(t: f64, limit: f32) -> Option<f32> {
    let rounded = t as f32;
    (t > 0.0 && rounded < limit).then_some(rounded)
}

/// Which children of a node the ray may meet, in obvhs's bit layout. Conservative: see the top.
#[inline]
fn intersect_node(node: &CwBvhNode, ray: &Ray, t_max: f32, oct_inv4: u32) -> u32 {
    let extent = Vec3::from(node.compute_extent());
    let offset = node.p - ray.origin;
    let step = extent * ray.inverse;
    let start = offset * ray.inverse;
    let error = (offset.abs() + 255.0 * extent) * ray.inverse.abs() * BOX_ERROR;
    let (low, high) = (start - error, start + error);

    let pick = |negative: bool, min: &[u8; 8], max: &[u8; 8]| {
        let (near, far) = if negative { (*max, *min) } else { (*min, *max) };
        (near.map(f32::from), far.map(f32::from))
    };
    // By the inverse, whose sign also tells -0 from 0.
    let negative = ray.inverse.cmplt(Vec3::ZERO);
    let (near_x, far_x) = pick(negative.test(0), &node.child_min_x, &node.child_max_x);
    let (near_y, far_y) = pick(negative.test(1), &node.child_min_y, &node.child_max_y);
    let (near_z, far_z) = pick(negative.test(2), &node.child_min_z, &node.child_max_z);

    let mut enter = [0.0_f32; 8];
    let mut leave = [0.0_f32; 8];
    for i in 0..8 {
        let near = max(
            max(near_x[i] * step.x + low.x, near_y[i] * step.y + low.y),
            near_z[i] * step.z + low.z,
        );
        let far = min(
            min(far_x[i] * step.x + high.x, far_y[i] * step.y + high.y),
            far_z[i] * step.z + high.z,
        );
        enter[i] = max(near, 0.0);
        leave[i] = min(far, t_max);
    }
    let (child_bits8, bit_index8) = node.get_child_and_index_bits(oct_inv4);
    let mut hits = 0;
    for i in 0..8 {
        if enter[i] <= leave[i] {
            hits |= extract_byte64(child_bits8, i) << extract_byte64(bit_index8, i);
        }
    }
    hits
}

// One instruction each, where `f32::max` must also look for NaN. No operand here can be NaN:
// the inverse is finite, and so are the boxes.
#[inline]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use obvhs::ray::RayHit;

    use super::*;

    fn one(corners: [Vec3; 3]) -> Hierarchy {
        Hierarchy::build(&[Primitive::Triangle(corners)], Vec::new()).0
    }

    #[test]
    fn the_stock_test_loses_near_hits() {
        // 5e-5 m in front of a triangle: obvhs's own box test clips at 1e-4 m.
        let corners = [
            Vec3::new(-1.0, -1.0, 0.0),
            Vec3::new(1.0, -1.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
        ];
        let hierarchy = one(corners);
        let (origin, direction) = (Vec3::new(0.0, 0.0, 5e-5), Vec3::NEG_Z);
        let ray = Ray::new(origin, direction);
        let stock = obvhs::ray::Ray::new(origin.into(), direction.into(), 0.0, f32::INFINITY);
        let found = hierarchy
            .tree
            .ray_traverse(stock, &mut RayHit::none(), |_, _| 5e-5);
        assert!(!found, "obvhs has mended its box test; ours may go");
        assert_eq!(hierarchy.nearest(&ray, f32::INFINITY), Some((0, 5e-5)));
    }

    #[test]
    fn a_ray_in_the_plane_of_a_box_face_is_kept() {
        // The direction has exact zeros and the origin lies on the box's own boundary.
        let hierarchy = one([
            Vec3::ZERO,
            Vec3::new(-1.0, 0.0, 0.0),
            Vec3::new(0.0, -1.0, 0.0),
        ]);
        let ray = Ray::new(Vec3::new(0.0, -0.5, 3.0), Vec3::NEG_Z);
        assert_eq!(hierarchy.nearest(&ray, f32::INFINITY), Some((0, 3.0)));
    }

    #[test]
    fn an_empty_scene_is_never_hit() {
        let (hierarchy, order) = Hierarchy::build(&[], Vec::new());
        let ray = Ray::new(Vec3::ZERO, Vec3::X);
        assert!(order.is_empty() && hierarchy.nearest(&ray, f32::INFINITY).is_none());
        assert!(!hierarchy.any(&ray, f32::INFINITY, |_| true));
    }
}
