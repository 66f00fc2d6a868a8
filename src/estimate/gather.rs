//! Photons in media along a ray of any origin: by the beam estimate or by the point estimate.

use crate::estimate::beam::{self, Sight, Stretch};
use crate::estimate::kernel::Kernel;
use crate::estimate::point::{PointMap, Sphere};
use crate::photon::Heading;
use crate::photon::map::PhotonMap;
use crate::spectrum::Spectrum;
use crate::tracking::Sampler;
use crate::world::World;

/// The photons of a pass, those of first order and those of higher ones.
#[derive(Debug)]
pub enum MediaPhotons<'a, S: Spectrum, H> {
    /// Under hierarchies of their discs.
    Beam([PhotonMap<S, H>; 2], Kernel),
    /// In trees.
    Point(PointMap<'a, S, H>),
}

impl<S: Spectrum, H: Heading> MediaPhotons<'_, S, H> {
    /// Bytes that photons and what sorts them take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        match self {
            Self::Beam(maps, _) => maps.iter().map(PhotonMap::memory_bytes).sum(),
            Self::Point(map) => map.memory_bytes(),
        }
    }

    /// Radiance along a stretch: of first order, and of higher ones. \[W/(m2 sr)\]
    pub fn radiance(
        &self,
        world: &World<S>,
        stretch: &Stretch<'_, S>,
        sphere: &mut Sphere,
        sampler: &mut Sampler,
    ) -> [S; 2] {
        // A clear ray has nowhere for a photon to be.
        if stretch.profile.is_clear() {
            return [S::ZERO; 2];
        }
        match self {
            Self::Beam(maps, kernel) => {
                let sight = Sight::new(stretch.profile, sampler);
                maps.each_ref().map(|map| {
                    let along = (stretch, &sight);
                    beam::radiance_within(*kernel, &world.media, map, along, &mut sampler.counters)
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
