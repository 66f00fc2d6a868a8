//! Photons in media along a ray of any origin: by the beam estimate or by the point estimate.
//!
//! ```text
//! L  ~  FEW sum over one in FEW of the photons       where at most FEW_BELOW of L reaches the camera
//! ```
//!
//! Reflections in water and glass are mostly faint. Their noise is that of fewer photons, times a
//! throughput w that makes it small beside that of what is in front: (FEW - 1) w^2 times as much.

use crate::estimate::beam::{self, Sight, Stretch};
use crate::estimate::kernel::Kernel;
use crate::estimate::point::{PointMap, Sphere};
use crate::photon::map::PhotonMap;
use crate::photon::{Heading, Photon};
use crate::rng::Rng;
use crate::spectrum::Spectrum;
use crate::tracking::Sampler;
use crate::world::World;

/// Photons for each that is kept for faint stretches.
const FEW: usize = 8;

/// Throughput below which a stretch is faint. Higher: noise in reflections; lower: time for what is
/// hardly seen.
const FEW_BELOW: f32 = 0.3;

/// The photons of a pass, those of first order and those of higher ones.
#[derive(Debug)]
pub enum MediaPhotons<'a, S: Spectrum, H> {
    /// Under hierarchies of their discs.
    Beam {
        /// All of them.
        all: [PhotonMap<S, H>; 2],
        /// One in [`FEW`], where rays go on beyond mirrors and lenses.
        few: Option<[PhotonMap<S, H>; 2]>,
        /// The kernel of the discs.
        kernel: Kernel,
    },
    /// In trees.
    Point(PointMap<'a, S, H>),
}

impl<S: Spectrum, H: Heading> MediaPhotons<'_, S, H> {
    /// Photons for beams; `draws` choose those for faint stretches.
    #[must_use]
    pub fn beam(photons: [Vec<Photon<S, H>>; 2], kernel: Kernel, draws: Option<Rng>) -> Self {
        let few = draws.map(|mut draws| {
            photons.each_ref().map(|photons| {
                // One of each run: neighbours in the list are often of one flight.
                let chosen = photons
                    .chunks(FEW)
                    .filter_map(|run| run.get(draws.below(FEW as u32) as usize).copied());
                PhotonMap::new(chosen.collect())
            })
        });
        Self::Beam {
            all: photons.map(PhotonMap::new),
            few,
            kernel,
        }
    }

    /// Bytes that photons and what sorts them take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        match self {
            Self::Beam { all, few, .. } => {
                let maps = all.iter().chain(few.iter().flatten());
                maps.map(PhotonMap::memory_bytes).sum()
            }
            Self::Point(map) => map.memory_bytes(),
        }
    }

    /// Radiance along a stretch of which `throughput` reaches the camera: of first order, and of
    /// higher ones. \[W/(m2 sr)\]
    pub fn radiance(
        &self,
        world: &World<S>,
        (stretch, throughput): (&Stretch<'_, S>, f32),
        sphere: &mut Sphere,
        sampler: &mut Sampler,
    ) -> [S; 2] {
        // A clear ray has nowhere for a photon to be.
        if stretch.profile.is_clear() {
            return [S::ZERO; 2];
        }
        match self {
            Self::Beam { all, few, kernel } => {
                let sight = Sight::new(stretch.profile, sampler);
                let (maps, weight) = match few {
                    Some(few) if throughput < FEW_BELOW => (few, FEW as f32),
                    _ => (all, 1.0),
                };
                maps.each_ref().map(|map| {
                    let (along, counters) = ((stretch, &sight), &mut sampler.counters);
                    beam::radiance_within(*kernel, &world.media, map, along, counters) * weight
                })
            }
            Self::Point(map) => map.radiance(
                &world.media,
                stretch.compartment,
                stretch.profile,
                stretch.ray,
                sphere,
                sampler,
            ),
        }
    }
}
