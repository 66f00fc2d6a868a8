//! A medium that shines: fire as a light.
//!
//! ```text
//! dP/dV = 4 pi (1 - albedo) sigma_t(x) L_e(x)      [W/m3]
//! pdf(x) = ((1 - FLAT) w_b / sum of w + FLAT / blocks) / V_b                                  [1/m3]
//! Phi   = dP/dV(y) / d(y)  1/M sum_j d(x_j) / pdf(x_j),     d = mean of the channels of dP/dV  [W]
//! ```
//!
//! Blocks of BLOCK^3 voxels are drawn by the mean w_b of the power density at a few of their
//! points, a point in a block uniformly: M candidates x_j, of which y is drawn by d(x_j) / pdf(x_j)
//! (resampled importance sampling, Talbot, Cline & Egbert 2005), and a direction uniformly. Every
//! place has a density above 0, so what the few points missed costs noise and no bias; the
//! candidates make photons of one fire about equally heavy, since a heavy one is a bright blot. Nobody samples this light: camera rays
//! see it where they go, and what it sheds on media and surfaces comes from photons, the first
//! order included. A point in an object that owns its inside emits nothing: the medium is not
//! there.

use std::f32::consts::PI;

use glam::{Affine3A, Vec3};

use super::Emitted;
use super::directions::in_cone;
use crate::medium::{Field, Medium};
use crate::ray::Ray;
use crate::rng::{Rng, Stage};
use crate::spectrum::Spectrum;
use crate::surface::Inside;
use crate::world::World;

/// Voxels of a block along an edge. More: blocks whose power varies much inside; fewer: memory.
const BLOCK: f32 = 4.0;

/// Points of a block that its power is taken from.
const POINTS: u32 = 8;

/// Share of the photons that goes to all blocks alike: a photon weighs at most 1 / FLAT of one that
/// was drawn from the right power.
const FLAT: f32 = 0.1;

/// Share of a mean block's power below which a block is not worth a second look.
const DIM: f32 = 0.1;

/// Candidates for the place of a photon, M. Fewer: blots where a heavy photon falls; more: look-ups.
const CANDIDATES: u32 = 8;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Glow<S> {
    /// Index in the world's media.
    medium: usize,
    /// Blocks' corner in local voxels, and how many there are along each axis.
    low: Vec3,
    count: [usize; 3],
    local_to_world: Affine3A,
    /// Of a block. \[m3\]
    volume: f32,
    /// Upper ends of the blocks' shares of [0, 1), and the shares.
    upper: Vec<f32>,
    share: Vec<f32>,
    /// Of the whole medium, about. \[W\]
    pub(super) power: S,
}

/// Power density at a point. \[W/m3\]
fn density_of<S: Spectrum>(medium: &Medium<S>, p: Vec3) -> S {
    let Some(emission) = &medium.emission else {
        return S::ZERO;
    };
    let density = medium.density(p);
    if density <= 0.0 {
        return S::ZERO;
    }
    let l = S::from_rgb(emission.radiance_at(p));
    (S::ONE - medium.albedo) * medium.sigma_t * l * (4.0 * PI * density)
}

impl<S: Spectrum> Glow<S> {
    /// Of the medium with that index; none if it does not shine.
    #[must_use]
    pub(crate) fn new(media: &[Medium<S>], index: usize) -> Option<Self> {
        let medium = &media[index];
        medium.emission.as_ref()?;
        let (support, placement) = match &medium.field {
            Field::Grid(field) => (field.grid.support(), &field.placement),
            Field::Plateau(field) => (field.plateau.support(), &field.placement),
            Field::Constant { .. } => return None,
        };
        let size = (support.max - support.min) / BLOCK;
        let count = size.to_array().map(|n| (n.ceil() as usize).max(1));
        let local_to_world = placement.to_world();
        let volume = local_to_world.matrix3.determinant().abs() * BLOCK.powi(3);
        let mut glow = Self {
            medium: index,
            low: support.min,
            count,
            local_to_world,
            volume,
            upper: Vec::new(),
            share: Vec::new(),
            power: S::ZERO,
        };
        let blocks = count.iter().product::<usize>();
        let mut rng = Rng::stream(0, Stage::Check, 1, index as u64);
        let mut weights = Vec::with_capacity(blocks);
        let mut total = 0.0f64;
        for block in 0..blocks {
            let mut sum = S::ZERO;
            for _ in 0..POINTS {
                let u = [rng.uniform(), rng.uniform(), rng.uniform()];
                sum += density_of(medium, glow.place(block, u));
            }
            let power = sum * (volume / POINTS as f32);
            glow.power += power;
            weights.push(power.mean());
            total += f64::from(power.mean());
        }
        if total <= 0.0 {
            return None;
        }
        let flat = FLAT / blocks as f32;
        let mut sum = 0.0f64;
        for weight in weights {
            let share = (1.0 - FLAT) * (f64::from(weight) / total) as f32 + flat;
            sum += f64::from(share);
            glow.share.push(share);
            glow.upper.push(sum as f32);
        }
        Some(glow)
    }

    /// A point of a block.
    fn place(&self, block: usize, u: [f32; 3]) -> Vec3 {
        let [nx, ny, _] = self.count;
        let corner = [block % nx, block / nx % ny, block / (nx * ny)].map(|i| i as f32);
        let local = self.low + (Vec3::from(corner) + Vec3::from(u)) * BLOCK;
        self.local_to_world.transform_point3(local)
    }

    /// Middle and half diagonal of the spheres around the blocks with more than `DIM` of the power of
    /// the mean block. \[m\]
    pub(crate) fn bright_blocks(&self) -> impl Iterator<Item = (Vec3, f32)> + '_ {
        let mean = 1.0 / self.share.len() as f32;
        let least = ((1.0 - FLAT) * DIM + FLAT) * mean;
        let axes = self.local_to_world.matrix3;
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(Vec3::from);
        let corners = [x + y + z, x + y - z, x - y + z, y + z - x];
        let longest = corners.iter().map(|c| c.length()).fold(0.0, f32::max);
        let shares = self.share.iter().enumerate();
        shares
            .filter(move |(_, share)| **share > least)
            .map(move |(block, _)| (self.place(block, [0.5; 3]), 0.5 * BLOCK * longest))
    }

    /// A photon from a point of the medium; see [`Light::emit`](super::Light::emit).
    #[must_use]
    pub fn emit(&self, world: &World<S>, u: [f32; 4], rng: &mut Rng) -> Option<Emitted<S>> {
        let medium = &world.media[self.medium];
        let mut sum = 0.0;
        let mut chosen = None;
        let mut u = u;
        for _ in 0..CANDIDATES {
            let block = self.upper.partition_point(|end| *end <= u[0]);
            let block = block.min(self.share.len() - 1);
            let position = self.place(block, [u[1], u[2], u[3]]);
            let density = density_of(medium, position);
            let mean = density.mean();
            let weight = mean * self.volume / self.share[block];
            if weight > 0.0 {
                sum += weight;
                if rng.uniform() * sum < weight {
                    chosen = Some((position, density * (1.0 / mean)));
                }
            }
            u = [0; 4].map(|_| rng.uniform());
        }
        let (position, colour) = chosen?;
        if let Some(surfaces) = &world.surfaces
            && surfaces.inside_at(position) != Inside::NOTHING
        {
            return None;
        }
        let direction = in_cone(Vec3::Z, 2.0, [rng.uniform(), rng.uniform()]);
        Some(Emitted {
            ray: Ray {
                origin: position,
                direction,
            },
            power: colour * (sum / CANDIDATES as f32),
        })
    }
}
