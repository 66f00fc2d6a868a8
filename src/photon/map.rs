//! The photon map: photons under a bounding-volume hierarchy of their spheres.
//!
//! A ray's beam estimate needs every photon whose sphere the ray pierces. The hierarchy is an
//! obvhs `CwBvh` (8-wide, compressed: Ylitie et al. 2017) built on the spheres' boxes, not on
//! points, so a large sphere in a thin region inflates few ancestors; the walk visits all it
//! meets and reports no hit, so nothing ends it early. Used for rays of any origin; camera rays
//! from one point take the faster `estimate::tiles`.

use std::time::Duration;

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::Ray as BvhRay;

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
        let walk = BvhRay::new(ray.origin.into(), ray.direction.into(), 0.0, t1 * SLACK);
        self.bvh.ray_traverse_anyhit(walk, |_, index| {
            let photon = &self.photons[index];
            let to = photon.position - ray.origin;
            let t = to.dot(ray.direction);
            // By rejection: |to|^2 - t^2 would cancel far from the camera.
            let d2 = (to - ray.direction * t).length_squared();
            if d2 < photon.radius() * photon.radius() && t > t0 && t < t1 {
                visit(photon, t, d2);
            }
        });
    }
}
