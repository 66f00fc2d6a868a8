//! The photon map: photons under a bounding-volume hierarchy of their spheres.
//!
//! A ray's beam estimate needs every photon whose sphere the ray pierces. The hierarchy is an
//! obvhs `CwBvh` (8-wide, compressed: Ylitie et al. 2017) built on the spheres' boxes, not on
//! points, so a large sphere in a thin region inflates few ancestors; the walk visits all it
//! meets, in no order, and nothing ends it early. Used for rays of any origin; camera rays from one
//! point take the faster `estimate::tiles`.
//!
//! ```text
//! child's faces    p + q e        q of 8 bits, e a power of two for each axis of a node      [m]
//! met at           t = q (e / d) + (p - o) / d
//! ```
//!
//! The walk is ours. All eight children of a node are tested at a time; photons whose boxes are met
//! are put in a row, and so are those that are pierced, before any is visited: neither can be
//! guessed, and what the visitor does for one need not wait for that of another.

use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::safe_inverse;
use wide::f32x8;

use super::Photon;
use crate::ray::Ray;
use crate::spectrum::Spectrum;

/// Factor on a ray's end for the walk through the hierarchy: the pierced point lies in the photon's
/// box, and rounding must not put the box beyond. Larger: boxes are looked at in vain.
const SLACK: f32 = 1.001;

/// Photons under a hierarchy.
#[derive(Debug)]
pub struct PhotonMap<S: Spectrum, H> {
    photons: Vec<Photon<S, H>>,
    bvh: CwBvh,
}

impl<S: Spectrum, H: Copy> PhotonMap<S, H> {
    /// Builds the hierarchy; photons without radius (0) are never met.
    #[must_use]
    pub fn new(photons: Vec<Photon<S, H>>) -> Self {
        let boxes: Vec<Aabb> = photons
            .iter()
            .map(|photon| {
                let (p, r) = (Vec3A::from(photon.position), Vec3A::splat(photon.radius()));
                Aabb::new(p - r, p + r)
            })
            .collect();
        let mut build_time = Duration::ZERO;
        let bvh = build_cwbvh(&boxes, BvhBuildParams::very_fast_build(), &mut build_time);
        // Leaves name runs of the hierarchy's own order: stored in it, a photon is one fetch away.
        let photons = bvh
            .primitive_indices
            .iter()
            .map(|i| photons[*i as usize])
            .collect();
        Self { photons, bvh }
    }

    /// Bytes that photons and hierarchy take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.photons.capacity() * size_of::<Photon<S, H>>()
            + size_of_val(&self.bvh.nodes[..])
            + size_of_val(&self.bvh.primitive_indices[..])
    }

    /// Number of photons.
    #[must_use]
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// True without photons.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// Visits the photons whose discs [t0, t1] of the ray pierces, with the parameter t of the
    /// point nearest to the photon and their squared distance. \[m, m2\]
    #[inline]
    pub fn along(
        &self,
        ray: &Ray,
        t0: f32,
        t1: f32,
        mut visit: impl FnMut(&Photon<S, H>, f32, f32),
    ) {
        if self.photons.is_empty() {
            return;
        }
        let line = Line::new(ray, t1 * SLACK);
        let mut near = Near::default();
        let mut open = Vec::with_capacity(OPEN);
        open.push(0);
        while let Some(index) = open.pop() {
            let node = &self.bvh.nodes[index as usize];
            let hits = line.meets(node);
            let inner = u32::from(node.imask);
            let mut nodes = hits & inner;
            while nodes != 0 {
                // Children that are nodes follow each other.
                let before = inner & (nodes & nodes.wrapping_neg()).wrapping_sub(1);
                open.push(node.child_base_idx + before.count_ones());
                nodes &= nodes - 1;
            }
            let mut leaves = hits & !inner;
            while leaves != 0 {
                let leaf = u32::from(node.child_meta[leaves.trailing_zeros() as usize & 7]);
                near.add(
                    node.primitive_base_idx + (leaf & 31),
                    (leaf & !31).count_ones(),
                );
                leaves &= leaves - 1;
            }
            if near.count >= NEAR || open.is_empty() {
                self.pierced(ray, [t0, t1], &mut near, &mut visit);
            }
        }
    }

    /// Visits those of some photons that the ray pierces.
    #[inline]
    fn pierced(
        &self,
        ray: &Ray,
        [t0, t1]: [f32; 2],
        near: &mut Near,
        visit: &mut impl FnMut(&Photon<S, H>, f32, f32),
    ) {
        let mut pierced = [(0, 0.0, 0.0); MOST_NEAR];
        let mut count = 0;
        for index in &near.photons[..near.count] {
            let photon = &self.photons[*index as usize];
            let to = photon.position - ray.origin;
            let t = to.dot(ray.direction);
            // By rejection: |to|^2 - t^2 would cancel far from the camera.
            let d2 = (to - ray.direction * t).length_squared();
            pierced[count] = (*index, t, d2);
            let is = (d2 < photon.radius() * photon.radius()) & (t > t0) & (t < t1);
            count += usize::from(is);
        }
        near.count = 0;
        for (index, t, d2) in &pierced[..count] {
            visit(&self.photons[*index as usize], *t, *d2);
        }
    }
}

/// Nodes that a walk has room for from its start; of a million photons it needs no more.
const OPEN: usize = 128;
/// Photons in a row from which on they are looked at, and how many a node can make of fewer: eight
/// leaves of three. Fewer: loops too short to be guessed; more: rows that leave the first cache.
const NEAR: usize = 40;
const MOST_NEAR: usize = NEAR + 3 * 8;

/// Photons whose boxes a ray meets.
struct Near {
    photons: [u32; MOST_NEAR],
    count: usize,
}

impl Default for Near {
    fn default() -> Self {
        Self {
            photons: [0; MOST_NEAR],
            count: 0,
        }
    }
}

impl Near {
    /// Adds a leaf: up to three photons from `first` on.
    #[inline]
    fn add(&mut self, first: u32, count: u32) {
        // Three are written, whatever counts: no guess.
        let room = &mut self.photons[self.count..self.count + 3];
        room.copy_from_slice(&[first, first + 1, first + 2]);
        self.count += count as usize;
    }
}

/// A ray among boxes.
struct Line {
    origin: Vec3,
    /// One over its direction, which is not taken for less than 1.2e-7.
    inverse: Vec3,
    /// True for an axis along which it goes down.
    down: [bool; 3],
    /// Where it ends. \[m\]
    t_end: f32,
}

impl Line {
    #[inline]
    fn new(ray: &Ray, t_end: f32) -> Self {
        let inverse = ray.direction.to_array().map(safe_inverse);
        Self {
            origin: ray.origin,
            inverse: inverse.into(),
            down: inverse.map(|i| i < 0.0),
            t_end,
        }
    }

    /// The children of a node whose boxes the ray meets, bit by bit.
    #[inline]
    fn meets(&self, node: &CwBvhNode) -> u32 {
        let step = Vec3::from(node.compute_extent()) * self.inverse;
        let start = (node.p - self.origin) * self.inverse;
        let mut enter = f32x8::ZERO;
        let mut leave = f32x8::splat(self.t_end);
        let boxes = [
            [&node.child_min_x, &node.child_max_x],
            [&node.child_min_y, &node.child_max_y],
            [&node.child_min_z, &node.child_max_z],
        ];
        for (axis, [low, high]) in boxes.into_iter().enumerate() {
            let (near, far) = if self.down[axis] {
                (high, low)
            } else {
                (low, high)
            };
            let at = |faces: &[u8; 8]| {
                let faces = f32x8::from(faces.map(f32::from));
                faces.mul_add(f32x8::splat(step[axis]), f32x8::splat(start[axis]))
            };
            enter = enter.fast_max(at(near));
            leave = leave.fast_min(at(far));
        }
        enter.simd_le(leave).to_bitmask()
    }
}
