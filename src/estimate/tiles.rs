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

use std::marker::PhantomData;

use glam::Vec3;
use wide::f32x8;

use crate::estimate::bands::{TILE_RAYS, TilePhotons};
use crate::estimate::eight::{Lit, Pierced, radiance};
use crate::estimate::kernel::Kernel;
use crate::estimate::wall::Wall;
use crate::march::Profile;
use crate::medium::Medium;
use crate::photon::Heading;
use crate::photon::kept::{chance_of, scattered};
use crate::ray::Ray;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

/// Optical depth at which the roulette begins. Lower: noise from what is seen; higher: work on what
/// is not.
const DEEP: f32 = 1.0;
/// Classes of the roulette: enough to reach the depth at which profiles end.
const CLASSES: usize = 20;

/// The class of a photon.
#[inline]
pub(super) fn class(position: Vec3, salt: u32) -> usize {
    // Scattered once more: the same bits have rounded its power.
    let bits = scattered(chance_of(position) ^ salt);
    (bits.trailing_zeros() as usize).min(CLASSES - 1)
}

/// The rays of a tile, in rows of eight, and what their profiles hold; of photons with headings `H`.
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
    /// True where a ray ends on something.
    walled: bool,
    /// Kernel of the estimate.
    pub kernel: Kernel,
    /// Scratch: photons that some ray may count, and what they bring.
    near: Vec<Near>,
    lit: Vec<Lit>,
    /// Scratch: photons that each ray of a row pierces.
    hits: [Vec<Pierced>; 8],
    headings: PhantomData<H>,
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
            walled: false,
            kernel: Kernel::Biweight,
            near: Vec::new(),
            lit: Vec::new(),
            hits: [const { Vec::new() }; 8],
            headings: PhantomData,
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
        self.walled = self.walls.iter().any(Wall::is_there);
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

    /// Adds the radiance of a tile's photons to each ray's sum.
    pub fn gather(
        &mut self,
        media: &[Medium<S>],
        (camera, compartment): (Vec3, u8),
        tile: TilePhotons<'_>,
        sums: &mut [S; TILE_RAYS],
        counters: &mut Counters,
    ) {
        self.fetch(compartment, tile);
        for row in 0..8 {
            self.find(camera, row);
            for (lane, hits) in self.hits.iter_mut().enumerate() {
                let ray = 8 * row + lane;
                counters.gathered_photons += hits.len() as u64;
                let along = (self.rays[ray].direction, &self.profiles[ray]);
                sums[ray] += radiance::<S, H>(self.kernel, media, along, &self.lit, hits);
                hits.clear();
            }
        }
    }

    /// Copies the photons that lie before the farthest end of their class: in a dense cloud a few
    /// of many. Side by side they fit the nearest caches.
    fn fetch(&mut self, compartment: u8, tile: TilePhotons<'_>) {
        self.near.clear();
        self.lit.clear();
        for (photon, lit, rows) in tile.each() {
            if photon.compartment != compartment && H::KEPT {
                continue;
            }
            let last = self.last[usize::from(photon.class)];
            if photon.nearest2 < last * last {
                self.near.push(Near {
                    to: photon.to,
                    radius: photon.radius,
                    class: photon.class,
                    rows,
                });
                self.lit.push(*lit);
            }
        }
    }

    /// Lists for each ray of a row the photons that it pierces. Kept apart from adding them up, and
    /// row by row: profiles stay in the nearest cache while photons read them, and lists in the next.
    fn find(&mut self, camera: Vec3, row: usize) {
        let direction = [0, 1, 2].map(|axis| self.direction[axis][row]);
        let [dx, dy, dz] = direction;
        let t_start = self.t_start[row];
        let ends = self.t_end.each_ref().map(|ends| ends[row]);
        for (index, near) in (0u32..).zip(&self.near) {
            let [first, last] = near.rows.map(usize::from);
            if row < first || row > last {
                continue;
            }
            let [x, y, z] = near.to.to_array().map(f32x8::splat);
            let class = usize::from(near.class).min(CLASSES - 1);
            let t = x.mul_add(dx, y.mul_add(dy, z * dz));
            let (cx, cy, cz) = (x - t * dx, y - t * dy, z - t * dz);
            let d2 = cx.mul_add(cx, cy.mul_add(cy, cz * cz));
            let pierced = d2.simd_lt(f32x8::splat(near.radius * near.radius))
                & t.simd_ge(t_start)
                & t.simd_lt(ends[class]);
            let mut lanes = pierced.to_bitmask();
            if lanes == 0 {
                continue;
            }
            // Doubled behind the end of each class before its own.
            let mut weight = f32x8::ONE;
            for end in &ends[..class] {
                weight = t.simd_ge(*end).select(weight + weight, weight);
            }
            let (t, d2, weight) = (t.to_array(), d2.to_array(), weight.to_array());
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize & 7;
                lanes &= lanes - 1;
                let mut weight = weight[lane];
                if self.walled {
                    let (wall, position) = (&self.walls[8 * row + lane], camera + near.to);
                    weight *= wall.weight(self.kernel, t[lane], near.radius, position);
                    if weight == 0.0 {
                        continue;
                    }
                }
                self.hits[lane].push(Pierced {
                    photon: index,
                    t: t[lane],
                    d2: d2[lane],
                    weight,
                });
            }
        }
    }
}

/// A photon of a tile that some ray may count.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// From the camera. \[m\]
    to: Vec3,
    /// \[m\]
    radius: f32,
    class: u8,
    /// First and last row of the tile's pixels that its sphere reaches.
    rows: [u8; 2],
}
