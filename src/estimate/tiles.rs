//! The beam radiance estimate for 8 x 8 camera rays at a time.
//!
//! Each photon of a tile (`bands`) is tested against the tile's rays eight at a time,
//!
//! ```text
//! t = v . d      c = v - t d      pierced if |c|^2 < r^2 and 0 < t < t_end      v = photon - camera
//! ```
//!
//! one row of pixels per SIMD operation, only the rows that the sphere can reach. A photon is
//! fetched once for 64 rays; nothing is traversed. The sum is the one of `beam`, in an order that
//! photons and picture set: the result does not depend on how the work was split.
//!
//! Deep in a cloud a ray pierces many photons of which next to nothing is left. Each photon is of
//! a class j with probability 2^-(j+1) (a hash of its place), and counts only where the ray's
//! optical depth is below tau_j = DEEP + j ln 2; what it adds beyond tau_(k-1) is divided by the
//! chance 2^-k of being let through there. The expectation is the full sum; the photons looked at
//! fall off like the light they bring (Russian roulette; Arvo & Kirk 1990).

use glam::Vec3;
use wide::f32x8;

use crate::estimate::bands::TILE_RAYS;
use crate::estimate::beam::contribution;
use crate::estimate::kernel::Kernel;
use crate::estimate::wall::Wall;
use crate::march::{OnlyMedium, Profile};
use crate::math::exp8;
use crate::medium::Medium;
use crate::phase::{ISOTROPIC, PhaseFunction};
use crate::photon::kept::{chance_of, scattered};
use crate::photon::{Heading, Photon};
use crate::ray::Ray;
use crate::spectrum::{Compensated, Spectrum};
use crate::tracking::Counters;

/// Optical depth at which the roulette begins. Lower: noise from what is seen; higher: work on what
/// is not.
const DEEP: f32 = 1.0;
/// Classes of the roulette: enough to reach the depth at which profiles end.
const CLASSES: usize = 20;

/// Rounding of a squared distance. Smaller: photons are lost at the end of what is seen; larger: more
/// are looked at in vain.
const ROUNDING: f32 = 1e-6;

/// The class of a photon.
#[inline]
fn class(position: Vec3, salt: u32) -> usize {
    // Scattered once more: the same bits have rounded its power.
    let bits = scattered(chance_of(position) ^ salt);
    (bits.trailing_zeros() as usize).min(CLASSES - 1)
}

/// The rays of a tile, in rows of eight, and what their profiles hold.
#[derive(Debug)]
pub struct TileRays<S: Spectrum, H> {
    /// Rays; unused ones never meet anything.
    pub rays: Vec<Ray>,
    /// Profiles of the rays.
    pub profiles: Vec<Profile<S>>,
    /// What each ray ends on.
    pub walls: [Wall; TILE_RAYS],
    direction: [[f32x8; 8]; 3],
    /// Distance at which the first medium begins: photons before it light nothing.
    t_start: [f32x8; 8],
    /// Distance to which photons of each class count.
    t_end: [[f32x8; 8]; CLASSES],
    /// The same by ray.
    ends: Vec<[f32; CLASSES]>,
    /// The farthest of each class.
    last: [f32; CLASSES],
    /// Kernel of the estimate.
    pub kernel: Kernel,
    /// Shuffles the classes from pass to pass.
    pub salt: u32,
    /// Scratch: photons that some ray may count.
    near: Vec<Near<S, H>>,
    /// Scratch: photons that each ray pierces.
    hits: Vec<Vec<Pierced>>,
}

impl<S: Spectrum, H: Heading> Default for TileRays<S, H> {
    fn default() -> Self {
        Self {
            rays: vec![
                Ray {
                    origin: Vec3::ZERO,
                    direction: Vec3::Z
                };
                TILE_RAYS
            ],
            profiles: (0..TILE_RAYS).map(|_| Profile::default()).collect(),
            walls: [Wall::NONE; TILE_RAYS],
            direction: [[f32x8::ZERO; 8]; 3],
            t_start: [f32x8::ZERO; 8],
            t_end: [[f32x8::ZERO; 8]; CLASSES],
            ends: vec![[0.0; CLASSES]; TILE_RAYS],
            last: [0.0; CLASSES],
            kernel: Kernel::Biweight,
            salt: 0,
            near: Vec::new(),
            hits: vec![Vec::new(); TILE_RAYS],
        }
    }
}

impl<S: Spectrum, H: Heading> TileRays<S, H> {
    /// Takes rays and profiles into the registers' layout; `used` tells which rays there are.
    pub fn arrange(&mut self, used: &[bool; TILE_RAYS]) {
        for ((ends, profile), used) in self.ends.iter_mut().zip(&self.profiles).zip(used) {
            // A clear ray has nowhere for a photon to be.
            *ends = [0.0; CLASSES];
            if *used && !profile.is_clear() {
                let depths = std::array::from_fn(|j| DEEP + j as f32 * std::f32::consts::LN_2);
                *ends = profile.reaches(&depths);
                ends[CLASSES - 1] = profile.t_end;
            }
        }
        self.last = std::array::from_fn(|class| {
            let ends = self.ends.iter().map(|ends| ends[class]);
            ends.fold(0.0, f32::max)
        });
        for row in 0..8 {
            let lane = |f: &dyn Fn(usize) -> f32| {
                f32x8::from(std::array::from_fn::<f32, 8, _>(|i| f(8 * row + i)))
            };
            for axis in 0..3 {
                self.direction[axis][row] = lane(&|i| self.rays[i].direction[axis]);
            }
            self.t_start[row] = lane(&|i| self.profiles[i].extent().0);
            for class in 0..CLASSES {
                self.t_end[class][row] = lane(&|i| self.ends[i][class]);
            }
        }
    }

    /// Adds the radiance of a tile's photons to each ray's sum; each comes with the first and last
    /// row of rays that it can reach.
    pub fn gather<'a>(
        &mut self,
        media: &[Medium<S>],
        (camera, compartment): (Vec3, u8),
        tile: impl Iterator<Item = (&'a Photon<S, H>, [u8; 2])>,
        sums: &mut [S; TILE_RAYS],
        counters: &mut Counters,
    ) {
        self.fetch((camera, compartment), tile);
        self.find(camera);
        for (ray, sum) in sums.iter_mut().enumerate() {
            let (hits, near) = (&mut self.hits[ray], &self.near);
            let (profile, camera_ray) = (&self.profiles[ray], &self.rays[ray]);
            counters.gathered_photons += hits.len() as u64;
            if let Some(only) = profile.only() {
                let medium = &media[only.medium()];
                let mut fluence = Compensated::default();
                for eight in hits.chunks(8) {
                    let kernel = self.kernel;
                    fluence.add(eight_photons(
                        kernel,
                        &only,
                        &medium.phase,
                        camera_ray,
                        near,
                        eight,
                    ));
                }
                *sum += fluence.sum() * medium.sigma_t * medium.albedo;
            } else {
                let mut all = Compensated::default();
                for hit in hits.iter() {
                    let photon = &near[hit.near as usize].photon;
                    let l = contribution(
                        self.kernel,
                        media,
                        profile,
                        camera_ray,
                        photon,
                        hit.t,
                        hit.d2,
                    );
                    all.add(l * hit.weight);
                }
                *sum += all.sum();
            }
            hits.clear();
        }
    }

    /// Copies the photons that lie before the farthest end of their class: in a dense cloud a few
    /// of many. Side by side they fit the nearest caches.
    fn fetch<'a>(
        &mut self,
        (camera, compartment): (Vec3, u8),
        tile: impl Iterator<Item = (&'a Photon<S, H>, [u8; 2])>,
    ) {
        self.near.clear();
        for (photon, rows) in tile {
            if H::KEPT && photon.heading.compartment() != compartment {
                continue;
            }
            let class = class(photon.position, self.salt);
            // Where a ray pierces the sphere, t^2 = |v|^2 - d^2 > |v|^2 - r^2.
            let v2 = (photon.position - camera).length_squared();
            let last = self.last[class];
            let radius2 = photon.radius() * photon.radius();
            if v2 * (1.0 - ROUNDING) - radius2 < last * last {
                self.near.push(Near {
                    photon: *photon,
                    heading: photon.heading.direction(),
                    inverse: 1.0 / radius2,
                    class: class as u8,
                    rows,
                });
            }
        }
    }

    /// Lists for each ray the photons that it pierces. Kept apart from adding them up: so each
    /// ray's profile stays in the nearest cache while its photons read it.
    fn find(&mut self, camera: Vec3) {
        for (index, near) in self.near.iter().enumerate() {
            let v = near.photon.position - camera;
            let [x, y, z] = v.to_array().map(f32x8::splat);
            let radius = near.photon.radius();
            let r2 = f32x8::splat(radius * radius);
            let class = usize::from(near.class);
            let [first, last] = near.rows.map(|row| usize::from(row).min(7));
            for row in first..=last {
                let t_end = self.t_end[class][row];
                let [dx, dy, dz] = [
                    self.direction[0][row],
                    self.direction[1][row],
                    self.direction[2][row],
                ];
                let t = x.mul_add(dx, y.mul_add(dy, z * dz));
                let (cx, cy, cz) = (x - t * dx, y - t * dy, z - t * dz);
                let d2 = cx.mul_add(cx, cy.mul_add(cy, cz * cz));
                let pierced = d2.simd_lt(r2) & t.simd_ge(self.t_start[row]) & t.simd_lt(t_end);
                let mut lanes = pierced.to_bitmask();
                if lanes == 0 {
                    continue;
                }
                let (t, d2) = (t.to_array(), d2.to_array());
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize & 7;
                    lanes &= lanes - 1;
                    let ray = 8 * row + lane;
                    let position = near.photon.position;
                    let cut = self.walls[ray].weight(self.kernel, t[lane], radius, position);
                    if cut == 0.0 {
                        continue;
                    }
                    // Most are of the first class, and none of those beyond its end.
                    let passed = self.ends[ray][..class]
                        .iter()
                        .filter(|end| t[lane] >= **end)
                        .count();
                    self.hits[ray].push(Pierced {
                        near: index as u32,
                        t: t[lane],
                        d2: d2[lane],
                        weight: cut * f32::from_bits((127 + passed as u32) << 23),
                    });
                }
            }
        }
    }
}

/// What up to eight photons of a ray through one medium add, over its scattering coefficient where
/// the density is 1: [`contribution`], side by side.
#[inline]
fn eight_photons<S: Spectrum, H: Heading>(
    kernel: Kernel,
    only: &OnlyMedium<'_, S>,
    phase: &PhaseFunction,
    ray: &Ray,
    near: &[Near<S, H>],
    hits: &[Pierced],
) -> S {
    let [mut t, mut d2, mut inverse, mut share] = [[0.0f32; 8]; 4];
    let mut heading = [[0.0f32; 8]; 3];
    let mut power = [S::ZERO; 8];
    // Lanes without a photon read the profile where one is, and carry no power.
    let Some(last) = hits.last() else {
        return S::ZERO;
    };
    for lane in 0..8 {
        let hit = hits.get(lane).unwrap_or(last);
        let near = &near[hit.near as usize];
        t[lane] = hit.t;
        d2[lane] = hit.d2;
        inverse[lane] = near.inverse;
        share[lane] = hit.weight;
        if H::KEPT {
            for (row, part) in heading.iter_mut().zip(near.heading.to_array()) {
                row[lane] = part;
            }
        }
        if lane < hits.len() {
            power[lane] = near.photon.power();
        }
    }
    let phase = if H::KEPT {
        phase.p8(heading.map(f32x8::from), -ray.direction)
    } else {
        f32x8::splat(ISOTROPIC)
    };
    let (depth, on_ray) = only.read(t);
    let inverse = f32x8::from(inverse);
    let kernel = f32x8::splat(kernel.disc()) * inverse * kernel.shape8(f32x8::from(d2) * inverse);
    let weight = (kernel * phase * on_ray * f32x8::from(share)).to_array();
    let sigma_t = only.sigma_t();
    let first = exp8(-(depth * f32x8::splat(sigma_t.channel(0)))).to_array();
    let mut sum = S::ZERO;
    if sigma_t == S::splat(sigma_t.channel(0)) {
        for lane in 0..8 {
            sum += power[lane] * (weight[lane] * first[lane]);
        }
    } else {
        let depth = depth.to_array();
        for lane in 0..8 {
            sum += S::transmittance(sigma_t * depth[lane]) * power[lane] * weight[lane];
        }
    }
    sum
}

/// A photon of a tile that some ray may count.
#[derive(Debug, Clone, Copy)]
struct Near<S: Spectrum, H> {
    photon: Photon<S, H>,
    /// Its direction of travel, if it is kept.
    heading: Vec3,
    /// One over its squared radius. \[1/m2\]
    inverse: f32,
    class: u8,
    /// First and last row of the tile's pixels that its sphere reaches.
    rows: [u8; 2],
}

/// A photon that a ray pierces.
#[derive(Debug, Clone, Copy)]
struct Pierced {
    /// Place in the list of near ones.
    near: u32,
    /// Parameter of the ray's nearest point. \[m\]
    t: f32,
    /// Squared distance there. \[m2\]
    d2: f32,
    /// One over the chance of being let through: 2^k.
    weight: f32,
}
