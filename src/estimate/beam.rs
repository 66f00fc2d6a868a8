//! The beam radiance estimate, for one ray of any origin.
//!
//! ```text
//! L_m = sum_i T(t_i) sigma_s(t_i) p(w_i . -d) P_i K(d_i, r_i)      [W/(m2 sr)]
//! t_i   parameter of the ray's point nearest to photon i [m], d_i their distance [m]
//! P_i   power of the photon over the rate of deposits where it is [W m]
//! K     2-D kernel over the photon's disc [1/m2]
//! ```
//!
//! The scattering coefficient is that of the ray at t_i, where the grid has it sharp; the kernel
//! blurs the fluence alone, which varies on the scale of a mean free path, and not sigma_s, which
//! varies from voxel to voxel. Where the fluence is constant over the disc the estimate is exact
//! however rough the medium (a furnace shows it); nothing leaks from a cloud's edge into clear
//! air, nothing is missing inside it, and edges stay as sharp as the grid's. Here we depart from
//! Jarosz et al., whose media are homogeneous: with deposits at collisions P = Phi / sigma_t, the
//! sum is theirs. Photons lie within a kernel's reach outside the medium too
//! (`photon::deposit` says why), and count only in their own compartment of the world.
//!
//! Every photon whose disc the ray pierces, once; no steps, hence no step size (Jarosz, Zwicker &
//! Jensen 2008). T comes from the ray's one profile: two photons a millimetre apart do not march
//! twice. Photons beyond the profile's end, which is where a surface ends the ray, do not count, and
//! discs that reach over that surface are cut (`wall`).

use crate::estimate::kernel::Kernel;
use crate::estimate::wall::{self, Wall};
use crate::march::Profile;
use crate::medium::Medium;
use crate::phase::ISOTROPIC;
use crate::photon::map::PhotonMap;
use crate::photon::{Heading, Photon};
use crate::ray::Ray;
use crate::spectrum::{Compensated, Spectrum};
use crate::tracking::{Counters, Sampler};

/// What one photon adds: T sigma_s p P K. \[W/(m2 sr)\]
#[inline]
pub fn contribution<S: Spectrum, H: Heading>(
    kernel: Kernel,
    media: &[Medium<S>],
    profile: &Profile<S>,
    ray: &Ray,
    photon: &Photon<S, H>,
    t: f32,
    d2: f32,
) -> S {
    let inverse = 1.0 / (photon.radius() * photon.radius());
    let kernel = kernel.disc() * inverse * kernel.shape(d2 * inverse);
    let (tr, scattering) = profile.transmittance_and_sum(t, |medium, sigma_t| {
        let medium = &media[medium];
        let phase = if H::KEPT {
            let heading = photon.heading.direction();
            medium.phase.p(heading, -ray.direction)
        } else {
            ISOTROPIC
        };
        sigma_t * medium.albedo * phase
    });
    tr * scattering * photon.power() * kernel
}

/// A straight piece of a camera's path.
#[derive(Debug)]
pub struct Stretch<'a, S> {
    /// The ray.
    pub ray: &'a Ray,
    /// Its media.
    pub profile: &'a Profile<S>,
    /// The compartment that it lies in.
    pub compartment: u8,
    /// What it starts from and ends on.
    pub walls: [Wall; 2],
}

/// Optical depth at which the roulette of a ray alone begins. Lower: noise from what is seen; higher:
/// photons of which next to nothing is left.
const DEEP: f32 = 3.0;

/// How deep a ray looks.
///
/// ```text
/// end      tau_e = DEEP + x,  x distributed as exp(-x)
/// weight   1 / P(tau_e > tau) = exp(tau - DEEP)  beyond DEEP, 1 before       tau in one channel
/// ```
///
/// Russian roulette as in `tiles`, of the ray in place of its photons: what a hierarchy does not
/// visit costs nothing. The light beyond is e^-DEEP of all, hence its noise.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// \[m\]
    t_deep: f32,
    /// \[m\]
    t_end: f32,
    channel: usize,
}

impl Sight {
    /// Draws the end of a ray that passes dense media; others are seen to their own.
    #[must_use]
    pub fn new<S: Spectrum>(profile: &Profile<S>, sampler: &mut Sampler) -> Self {
        let whole = profile.optical_depth(profile.extent().1);
        let thinner = |a: &usize, b: &usize| whole.channel(*a).total_cmp(&whole.channel(*b));
        let channel = (0..S::CHANNELS).min_by(thinner).unwrap_or(0);
        let (mut t_deep, mut t_end) = (profile.t_end, profile.t_end);
        if whole.channel(channel) > DEEP {
            t_deep = profile.distance_at(DEEP, channel);
            let depth = DEEP + sampler.rng.exponential();
            if depth < whole.channel(channel) {
                t_end = profile.distance_at(depth, channel);
            }
        }
        Self {
            t_deep,
            t_end,
            channel,
        }
    }

    /// To the profile's own end.
    #[must_use]
    pub fn whole<S: Spectrum>(profile: &Profile<S>) -> Self {
        Self {
            t_deep: profile.t_end,
            t_end: profile.t_end,
            channel: 0,
        }
    }

    /// One over the chance that the ray looks as far as `t`.
    #[inline]
    fn weight<S: Spectrum>(&self, profile: &Profile<S>, t: f32) -> f32 {
        if t <= self.t_deep {
            return 1.0;
        }
        let depth = profile.optical_depth(t).channel(self.channel);
        (depth - DEEP).max(0.0).exp()
    }
}

/// Radiance of the map's photons along a stretch.
pub fn radiance<S: Spectrum, H: Heading>(
    kernel: Kernel,
    media: &[Medium<S>],
    map: &PhotonMap<S, H>,
    stretch: &Stretch<'_, S>,
    counters: &mut Counters,
) -> S {
    let sight = Sight::whole(stretch.profile);
    radiance_within(kernel, media, map, (stretch, &sight), counters)
}

/// The same as deep as the ray looks.
pub fn radiance_within<S: Spectrum, H: Heading>(
    kernel: Kernel,
    media: &[Medium<S>],
    map: &PhotonMap<S, H>,
    (stretch, sight): (&Stretch<'_, S>, &Sight),
    counters: &mut Counters,
) -> S {
    let Stretch {
        ray,
        profile,
        compartment,
        walls,
    } = stretch;
    let mut sum = Compensated::default();
    map.along(ray, 0.0, sight.t_end, |photon, t, d2| {
        if H::KEPT && photon.heading.compartment() != *compartment {
            return;
        }
        counters.gathered_photons += 1;
        let weight = wall::weight(walls, kernel, t, photon.radius(), photon.position);
        if weight > 0.0 {
            let weight = weight * sight.weight(profile, t);
            sum.add(contribution(kernel, media, profile, ray, photon, t, d2) * weight);
        }
    });
    sum.sum()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::rng::{Rng, Stage};
    use crate::scene::March;
    use crate::selftest::fields::scene;
    use crate::stats::{Welford, z_bound};
    use crate::world::World;

    /// However deep a ray looks, photons of every depth count once on average; beyond DEEP they are
    /// looked at as often as light comes from there.
    #[test]
    fn photons_of_every_depth_count_once() {
        let mut scene = scene(4.0, [8, 8]);
        let half = glam::DVec3::ONE;
        scene.fogs.push(crate::scene::Fog {
            bounds: Some([-half, half]),
            optics: crate::scene::Optics {
                extinction: crate::scene::Rgb::new(6.0, 9.0, 40.0),
                albedo: crate::scene::Rgb::ONE,
                phase: crate::scene::Phase::Isotropic,
            },
        });
        let world = World::<Vec3>::new(&scene, Vec::new()).expect("a world");
        let ray = Ray {
            origin: Vec3::new(0.0, 0.0, 4.0),
            direction: Vec3::NEG_Z,
        };
        let mut profile = Profile::default();
        let media = (0, &world.media[..]);
        let nothing = &mut Counters::default();
        profile.march(media, &ray, f32::INFINITY, March::Exact, nothing);
        let mut sampler = Sampler::new(Rng::stream(12, Stage::Check, 0, 0));
        let depths = [0.5f32, 2.9, 3.5, 5.0, 7.0, 9.0];
        let mut counts = depths.map(|_| Welford::default());
        let mut looked = depths.map(|_| Welford::default());
        for _ in 0..200_000 {
            let sight = Sight::new(&profile, &mut sampler);
            for ((depth, count), looked) in depths.iter().zip(&mut counts).zip(&mut looked) {
                let t = 3.0 + depth / 6.0;
                let seen = t < sight.t_end;
                looked.add(f64::from(u8::from(seen)));
                let weight = if seen { sight.weight(&profile, t) } else { 0.0 };
                count.add(f64::from(weight));
            }
        }
        for ((depth, count), looked) in depths.iter().zip(&counts).zip(looked) {
            let chance = f64::from((DEEP - depth).min(0.0).exp());
            for (found, expected) in [(count, 1.0), (&looked, chance)] {
                assert!(
                    found.z(expected, 1e-6).abs() < z_bound(2 * depths.len()),
                    "depth {depth}: {} +- {}, expected {expected}",
                    found.mean(),
                    found.standard_error()
                );
            }
        }
    }
}
