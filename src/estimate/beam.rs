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
use crate::tracking::Counters;

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

/// Radiance of the map's photons along a stretch.
pub fn radiance<S: Spectrum, H: Heading>(
    kernel: Kernel,
    media: &[Medium<S>],
    map: &PhotonMap<S, H>,
    stretch: &Stretch<'_, S>,
    counters: &mut Counters,
) -> S {
    let Stretch {
        ray,
        profile,
        compartment,
        walls,
    } = stretch;
    let mut sum = Compensated::default();
    map.along(ray, 0.0, profile.t_end, |photon, t, d2| {
        if H::KEPT && photon.heading.compartment() != *compartment {
            return;
        }
        counters.gathered_photons += 1;
        let weight = wall::weight(walls, kernel, t, photon.radius(), photon.position);
        if weight > 0.0 {
            sum.add(contribution(kernel, media, profile, ray, photon, t, d2) * weight);
        }
    });
    sum.sum()
}
