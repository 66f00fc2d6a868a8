//! The point estimate: photons in a sphere at each step of a ray march.
//!
//! ```text
//! L_m = sum_j dt_j T(t_j) sigma_s(t_j) sum_i p(w_i . -d) P_i K(|x_j - x_i|, r)     [W/(m2 sr)]
//! t_j, x_j  place of step j on the ray, dt_j its length [m]
//! P_i       power of the photon over the rate of deposits where it is [W m]
//! K         3-D kernel over the sphere [1/m3]
//! r         nearest: distance from x_j to its (k + 1)-th nearest photon; radius: photon i's own [m]
//! ```
//!
//! Jensen & Christensen 1998, with [`Search::Nearest`]: the sphere grows around each step until it
//! is full. Of a Poisson process the k photons inside the distance of the next one are uniform in
//! the ball, and 1 / r^3 has the mean that makes k / V unbiased; with the k-th itself counted, as
//! the slides write it, the estimate is (k + 1) / k too bright. No sphere is wider than the rate of
//! deposits allows, and those count what they hold. [`Search::Radius`] is the fixed-radius form:
//! every photon's own radius, as in the beam estimate, is one sphere for all steps, so that the
//! estimate is linear in the photons.
//!
//! Passes shrink the spheres by the 3-D law (`photon::radius`): radii by its cube root, k by its
//! cube, down to one photon.
//!
//! The march. A fixed step (`march = { step }`, in voxels) is the knob of the method: cost falls
//! and noise rises with it. With `exact` a step is [`STEP`] radii of the pilot estimate long,
//! which is also what media without voxels take. All steps of a ray are shifted by one random
//! share of their length: every point of the ray is as likely as any other, so a long step is
//! noise and not bias. The optical depth is the ray's profile; in departure from the source, the
//! scattering coefficient is that of the ray, not of the photons (`photon::deposit` says why).
//!
//! Beyond optical depth 1 a step is taken with the probability q = T / e^-1, and counts 1 / q
//! (Russian roulette): the steps taken grow sparse as the light does. Which ones is systematic: q is
//! added up from a random start, and a step is taken whenever the sum passes a whole number.

use glam::Vec3;

use crate::estimate::kernel::Kernel;
use crate::march::Profile;
use crate::medium::Medium;
use crate::phase::ISOTROPIC;
use crate::photon::deposit::DepositRate;
use crate::photon::kdtree::{KdTree, Nearest, Query};
use crate::photon::radius::RadiusField;
use crate::photon::{Heading, Photon};
use crate::ray::Ray;
use crate::scene::{March, Search, Settings};
use crate::spectrum::Spectrum;
use crate::tracking::Sampler;

/// Steps of an exact march, in radii of the pilot estimate. Longer: noise, since the fluence of a
/// step is that of one sphere in it; shorter: the same photons again and again.
pub const STEP: f32 = 1.0;

/// Transmittance below which Russian roulette decides whether a step is taken.
const ROULETTE_BELOW: f32 = 0.367_879_44;

/// Most steps of an exact march: radii may be far smaller than the medium.
const MAX_STEPS: f32 = 16_384.0;

/// Photons of a pass, to be gathered in spheres.
#[derive(Debug)]
pub struct PointMap<'a, S: Spectrum, H> {
    /// Photons of the first order and of higher ones.
    trees: [KdTree<Photon<S, H>>; 2],
    spheres: Spheres,
    radii: &'a RadiusField,
    rate: &'a DepositRate,
    /// Factor on all radii.
    scale: f32,
    /// Factor on the steps of an exact march.
    steps: f32,
    kernel: Kernel,
    march: March,
}

/// How spheres are made.
#[derive(Debug)]
enum Spheres {
    /// Around the places of steps: photons kept, the one that ends the sphere included.
    Nearest(usize),
    /// Around photons: the largest radius below each node of each tree. \[m\]
    Own([Vec<f32>; 2]),
}

/// A photon in a sphere.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// 0 for the first order, 1 for higher ones.
    layer: usize,
    /// In the order of the layer's tree.
    index: usize,
    /// Kernel. \[1/m3\]
    kernel: f32,
}

/// Scratch of a thread.
#[derive(Debug, Default)]
pub struct Sphere {
    nearest: Nearest,
    found: Vec<Found>,
}

impl<'a, S: Spectrum, H: Heading> PointMap<'a, S, H> {
    /// Sorts the photons of a pass, of the first order and of higher ones, whose radii are those of
    /// `radii` within the reach of `rate`, times the first scale. The second one is that of steps
    /// and of the number of neighbours, by its cube.
    #[must_use]
    pub fn new(
        photons: [Vec<Photon<S, H>>; 2],
        (radii, rate): (&'a RadiusField, &'a DepositRate),
        [scale, steps]: [f32; 2],
        settings: &Settings,
    ) -> Self {
        let trees = photons.map(KdTree::new);
        let spheres = match settings.search {
            Search::Nearest => {
                let wanted = (settings.neighbours as f32 * steps.powi(3)).round();
                Spheres::Nearest(wanted.max(1.0) as usize + 1)
            }
            Search::Radius => Spheres::Own(trees.each_ref().map(|t| t.largest(Photon::radius))),
        };
        Self {
            trees,
            spheres,
            radii,
            rate,
            scale,
            steps,
            kernel: settings.kernel,
            march: settings.march,
        }
    }

    /// Bytes that photons and trees take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let trees: usize = self.trees.iter().map(KdTree::memory_bytes).sum();
        match &self.spheres {
            Spheres::Nearest(_) => trees,
            Spheres::Own(largest) => {
                trees + largest.iter().map(|l| size_of_val(&l[..])).sum::<usize>()
            }
        }
    }

    /// Largest radius of a sphere at a place. \[m\]
    fn reach(&self, p: Vec3) -> f32 {
        self.rate.reach(p) * self.scale
    }

    /// Radiance of the photons along the ray, of the first order and of higher ones.
    /// \[W/(m2 sr)\]
    pub fn radiance(
        &self,
        media: &[Medium<S>],
        compartment: u8,
        profile: &Profile<S>,
        ray: &Ray,
        sphere: &mut Sphere,
        sampler: &mut Sampler,
    ) -> [S; 2] {
        let mut sums = [S::ZERO; 2];
        let (start, end) = profile.extent();
        let mut due = sampler.uniform();
        let shift = sampler.uniform();
        let fixed = match self.march {
            March::Exact => None,
            March::Step(voxels) => profile
                .media()
                .filter_map(|m| media[m].voxel_size())
                .reduce(f32::min)
                .map(|voxel| voxels as f32 * voxel),
        };
        let shortest = f32::EPSILON * 4.0 * end;
        let exact_shortest = ((end - start) / MAX_STEPS).max(shortest);
        let mut t = start;
        // Place and radius of the sphere before: the next one is at most as far from full.
        let mut before: Option<(f32, f32)> = None;
        while t < end {
            let step = match fixed {
                Some(step) => step.max(shortest),
                None => {
                    let p = ray.at(t);
                    // Where nothing scatters nothing reaches, and nothing is gathered.
                    let reach = self.rate.reach(p);
                    let reach = if reach > 0.0 { reach } else { f32::INFINITY };
                    let radius = self.radii.at(p).min(reach);
                    (STEP * radius * self.steps).max(exact_shortest)
                }
            }
            .min(end - t);
            let at = step.mul_add(shift, t);
            t += step;
            let left = profile.transmittance(at);
            let chance = (left.max_channel() / ROULETTE_BELOW).min(1.0);
            due += chance;
            if due < 1.0 {
                continue;
            }
            due -= 1.0;
            let weight = left * (step / chance);
            let mut searched = false;
            profile.media_at(at, |index, sigma_t| {
                if !searched {
                    searched = true;
                    self.find(ray.at(at), at, compartment, sphere, &mut before);
                    sampler.counters.gathered_photons += sphere.found.len() as u64;
                }
                let medium = &media[index];
                let mut fluence = [S::ZERO; 2];
                for found in &sphere.found {
                    let photon = &self.trees[found.layer].points[found.index];
                    let phase = if H::KEPT {
                        medium.phase.p(photon.heading.direction(), -ray.direction)
                    } else {
                        ISOTROPIC
                    };
                    fluence[found.layer] += photon.power() * (found.kernel * phase);
                }
                let scattering = weight * sigma_t * medium.albedo;
                for (sum, fluence) in sums.iter_mut().zip(fluence) {
                    *sum += fluence * scattering;
                }
            });
        }
        sums
    }

    /// Finds the photons whose kernels count at `p`, t = `at` on the ray.
    fn find(
        &self,
        p: Vec3,
        at: f32,
        compartment: u8,
        sphere: &mut Sphere,
        before: &mut Option<(f32, f32)>,
    ) {
        sphere.found.clear();
        match &self.spheres {
            Spheres::Nearest(wanted) => {
                let reach = self.reach(p);
                // The sphere before fits into this one; a thousandth covers rounding.
                let within = before.map_or(reach, |(t, r)| reach.min((r + (at - t)) * 1.001));
                let nearest = &mut sphere.nearest;
                nearest.begin(*wanted, within);
                for (layer, tree) in self.trees.iter().enumerate() {
                    nearest.first = layer * self.trees[0].points.len();
                    tree.search(
                        p,
                        &mut Nearby {
                            nearest,
                            compartment,
                        },
                    );
                }
                let found = nearest.finish();
                let full = found.len() == *wanted;
                let r2 = if full {
                    found.iter().fold(0.0f32, |worst, f| worst.max(f.0))
                } else {
                    reach * reach
                };
                *before = full.then_some((at, r2.sqrt()));
                let height = self.kernel.ball() / (r2 * r2.sqrt());
                let first = self.trees[0].points.len();
                for (d2, index) in found.iter().filter(|f| f.0 < r2) {
                    let layer = usize::from(*index >= first);
                    sphere.found.push(Found {
                        layer,
                        index: index - layer * first,
                        kernel: height * self.kernel.shape(d2 / r2),
                    });
                }
            }
            Spheres::Own(largest) => {
                for (layer, (tree, largest)) in self.trees.iter().zip(largest).enumerate() {
                    tree.search(
                        p,
                        &mut Around {
                            largest,
                            layer,
                            kernel: self.kernel,
                            compartment,
                            found: &mut sphere.found,
                        },
                    );
                }
            }
        }
    }
}

/// True where a photon is in another compartment of the world.
#[inline]
fn apart<S: Spectrum, H: Heading>(photon: &Photon<S, H>, compartment: u8) -> bool {
    H::KEPT && photon.heading.compartment() != compartment
}

/// The nearest photons of a compartment.
struct Nearby<'a> {
    nearest: &'a mut Nearest,
    compartment: u8,
}

impl<S: Spectrum, H: Heading> Query<Photon<S, H>> for Nearby<'_> {
    #[inline]
    fn bound(&self, _node: usize) -> f32 {
        self.nearest.bound
    }
    #[inline]
    fn offer(&mut self, index: usize, photon: &Photon<S, H>, d2: f32) {
        if !apart(photon, self.compartment) {
            self.nearest.take(index, d2);
        }
    }
}

/// The photons of a compartment around whose places the sphere of their own radius holds a point.
struct Around<'a> {
    largest: &'a [f32],
    layer: usize,
    kernel: Kernel,
    compartment: u8,
    found: &'a mut Vec<Found>,
}

impl<S: Spectrum, H: Heading> Query<Photon<S, H>> for Around<'_> {
    #[inline]
    fn bound(&self, node: usize) -> f32 {
        self.largest[node] * self.largest[node]
    }
    #[inline]
    fn offer(&mut self, index: usize, photon: &Photon<S, H>, d2: f32) {
        let radius = photon.radius();
        let r2 = radius * radius;
        if d2 < r2 && !apart(photon, self.compartment) {
            self.found.push(Found {
                layer: self.layer,
                index,
                kernel: self.kernel.ball() / (r2 * radius) * self.kernel.shape(d2 / r2),
            });
        }
    }
}
