//! The beam radiance estimate, for one ray of any origin.
//!
//! ```text
//! L_m = sum_i T(t_i) albedo_i p(w_i . -d) Phi_i K(d_i, r_i)      [W/(m2 sr)]
//! t_i   parameter of the ray's point nearest to photon i [m], d_i their distance [m]
//! K     2-D kernel over the photon's disc [1/m2]
//! ```
//!
//! The density that a photon met is not smeared over its disc: its power counts with the ratio of
//! the density on the ray to the density at the photon,
//!
//! ```text
//! albedo_i Phi_i  <-  albedo_i Phi_i * min(density(t_i) / density(x_i), MAX_CONTRAST)
//! ```
//!
//! so that the kernel blurs the fluence alone, which varies on the scale of a mean free path, and
//! not sigma_t, which varies from voxel to voxel. Where the fluence is constant over the disc the
//! estimate is exact however rough the medium (a furnace shows it); nothing leaks from a cloud's
//! edge into clear air, and edges stay as sharp as the grid's. Here we depart from Jarosz et al.,
//! whose media are homogeneous; the ratio is then 1. Photons are rare where the density is low,
//! so large ratios are rare and noisy: [`MAX_CONTRAST`] bounds them, at the price of light
//! missing where the density within a disc varies by more.
//!
//! Every photon whose disc the ray pierces, once; no steps, hence no step size (Jarosz, Zwicker &
//! Jensen 2008). T comes from the ray's one profile: two photons a millimetre apart do not march
//! twice. Photons beyond the profile's end, which is where a surface ends the ray, do not count.

use crate::estimate::kernel::KernelShape;
use crate::march::Profile;
use crate::medium::Medium;
use crate::phase::ISOTROPIC;
use crate::photon::map::PhotonMap;
use crate::photon::{Heading, Photon};
use crate::ray::Ray;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

/// Largest ratio of densities that a photon bridges. Lower: rays through dense spots next to thin
/// ones lose light; higher: rare photons weigh that much more than their neighbours.
pub const MAX_CONTRAST: f32 = 64.0;

/// What one photon adds: T albedo p Phi K. \[W/(m2 sr)\]
#[inline]
pub fn contribution<S: Spectrum, H: Heading, K: KernelShape>(
    media: &[Medium<S>],
    profile: &Profile<S>,
    ray: &Ray,
    photon: &Photon<S, H>,
    t: f32,
    d2: f32,
) -> S {
    let inverse = 1.0 / (photon.radius * photon.radius);
    let kernel = K::DISC * inverse * K::shape(d2 * inverse);
    let medium = photon.heading.medium();
    let phase = if H::KEPT {
        media[medium]
            .phase
            .p(photon.heading.direction(), -ray.direction)
    } else {
        ISOTROPIC
    };
    let (tr, density) = profile.transmittance_and_density(t, medium);
    let contrast = (density / photon.density).min(MAX_CONTRAST);
    tr * photon.power * (kernel * phase * contrast)
}

/// Radiance of the map's photons along the ray.
pub fn radiance<S: Spectrum, H: Heading, K: KernelShape>(
    media: &[Medium<S>],
    map: &PhotonMap<S, H>,
    profile: &Profile<S>,
    ray: &Ray,
    counters: &mut Counters,
) -> S {
    let mut sum = S::ZERO;
    map.along(ray, 0.0, profile.t_end, |photon, t, d2| {
        counters.gathered_photons += 1;
        sum += contribution::<S, H, K>(media, profile, ray, photon, t, d2);
    });
    sum
}
