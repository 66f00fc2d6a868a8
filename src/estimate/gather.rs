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
    /// For beams.
    Beam(Box<BeamPhotons<S, H>>),
    /// In trees.
    Point(PointMap<'a, S, H>),
}

impl<S: Spectrum, H: Heading> MediaPhotons<'_, S, H> {
    /// Bytes that photons and what sorts them take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        match self {
            Self::Beam(photons) => photons.memory_bytes(),
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
            Self::Beam(photons) => photons.radiance(world, (stretch, throughput), sampler),
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

/// Photons under hierarchies of their discs.
#[derive(Debug)]
pub struct BeamPhotons<S: Spectrum, H> {
    /// All of them.
    all: [PhotonMap<S, H>; 2],
    /// One in [`FEW`], where rays go on beyond mirrors and lenses.
    few: Option<[PhotonMap<S, H>; 2]>,
    kernel: Kernel,
}

impl<S: Spectrum, H: Heading> BeamPhotons<S, H> {
    /// Sorts photons; `draws` choose those for faint stretches.
    #[must_use]
    pub fn new(photons: [Vec<Photon<S, H>>; 2], kernel: Kernel, draws: Option<Rng>) -> Self {
        let few = draws.map(|mut draws| {
            photons.each_ref().map(|photons| {
                // One of each run: neighbours in the list are often of one flight.
                let chosen = photons
                    .chunks(FEW)
                    .filter_map(|run| run.get(draws.below(FEW as u32) as usize).copied());
                PhotonMap::new(chosen.collect())
            })
        });
        Self {
            all: photons.map(PhotonMap::new),
            few,
            kernel,
        }
    }

    fn memory_bytes(&self) -> usize {
        let maps = self.all.iter().chain(self.few.iter().flatten());
        maps.map(PhotonMap::memory_bytes).sum()
    }

    fn radiance(
        &self,
        world: &World<S>,
        (stretch, throughput): (&Stretch<'_, S>, f32),
        sampler: &mut Sampler,
    ) -> [S; 2] {
        let sight = Sight::new(stretch.profile, sampler);
        let (maps, weight) = match &self.few {
            Some(few) if throughput < FEW_BELOW => (few, FEW as f32),
            _ => (&self.all, 1.0),
        };
        maps.each_ref().map(|map| {
            let (along, counters) = ((stretch, &sight), &mut sampler.counters);
            beam::radiance_within(self.kernel, &world.media, map, along, counters) * weight
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::estimate::wall::Wall;
    use crate::march::Profile;
    use crate::ray::Ray;
    use crate::rng::Stage;
    use crate::scene::{Fog, March, Optics, Phase, Rgb};
    use crate::selftest::fields::scene;
    use crate::stats::{Welford, z_bound};
    use crate::tracking::Counters;

    /// What a faint stretch gathers is on average what any other does, whichever photons are chosen,
    /// and it meets an eighth of them.
    #[test]
    fn few_photons_stand_for_all() {
        let mut scene = scene(4.0, [8, 8]);
        scene.fogs.push(Fog {
            bounds: Some([-DVec3::ONE, DVec3::ONE]),
            optics: Optics {
                extinction: Rgb::splat(0.5),
                albedo: Rgb::ONE,
                phase: Phase::Isotropic,
            },
        });
        let world = World::<f32>::new(&scene, Vec::new()).expect("a world");
        let ray = Ray {
            origin: Vec3::new(0.1, -0.2, 4.0),
            direction: Vec3::NEG_Z,
        };
        let mut profile = Profile::default();
        let (media, nothing) = ((0, &world.media[..]), &mut Counters::default());
        profile.march(media, &ray, f32::INFINITY, March::Exact, nothing);
        let stretch = Stretch {
            ray: &ray,
            profile: &profile,
            compartment: 0,
            walls: [Wall::NONE; 2],
        };
        let mut random = Rng::stream(9, Stage::Check, 0, 0);
        let photons = [0; 2].map(|_| {
            // Not a whole number of runs.
            let photon = |_| {
                let place = 2.0 * Vec3::from_array(random.uniform3()) - 1.0;
                let mut photon = Photon::new(place, 1.0 + random.uniform(), ());
                photon.set_radius(0.5);
                photon
            };
            (0..203).map(photon).collect::<Vec<_>>()
        });
        let mut sampler = Sampler::new(Rng::stream(9, Stage::Check, 1, 0));
        let mut gather = |draw: u64, throughput: f32| {
            let draws = Rng::stream(9, Stage::Few, draw, 0);
            let photons = BeamPhotons::new(photons.clone(), Kernel::Biweight, Some(draws));
            let before = sampler.counters.gathered_photons;
            let found = photons.radiance(&world, (&stretch, throughput), &mut sampler);
            (found, sampler.counters.gathered_photons - before)
        };
        let (all, met) = gather(0, FEW_BELOW);
        let mut means = [Welford::default(), Welford::default(), Welford::default()];
        for draw in 0..4000 {
            let (found, met) = gather(draw, 0.9 * FEW_BELOW);
            let values = [found[0].into(), found[1].into(), met as f64];
            means.iter_mut().zip(values).for_each(|(m, v)| m.add(v));
        }
        let expected = [all[0].into(), all[1].into(), met as f64 / FEW as f64];
        for (mean, expected) in means.iter().zip(expected) {
            assert!(
                expected > 0.0 && mean.z(expected, 1e-6).abs() < z_bound(3),
                "{} +- {}, expected {expected}",
                mean.mean(),
                mean.standard_error()
            );
        }
    }
}
