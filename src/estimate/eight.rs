//! What the photons that one ray pierces add, eight at a time.
//!
//! ```text
//! sum over photons   T(t) P K(d, r) sum over media   sigma_s(t) p(w . -d)        [W/(m2 sr)]
//! ```
//!
//! The terms of [`contribution`](super::beam::contribution), a photon in each lane. What a photon
//! is and what a profile is between two knots lie in rows of eight numbers: eight rows are loaded
//! and transposed, so nothing is gathered number by number. Lanes keep sums of their own, which
//! carry along what rounding drops (Kahan 1965): a million terms are summed as exactly as ten.

use glam::Vec3;
use wide::f32x8;

use crate::estimate::kernel::Kernel;
use crate::march::Profile;
use crate::math::exp8;
use crate::medium::Medium;
use crate::phase::ISOTROPIC;
use crate::photon::{Heading, Photon};
use crate::spectrum::Spectrum;

/// What a photon brings wherever it is met: direction of travel, one over its squared radius
/// \[1/m2\], and its power over the rate of deposits, by channel \[W m\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Lit(f32x8);

impl Lit {
    #[inline]
    pub(super) fn new<S: Spectrum, H: Heading>(photon: &Photon<S, H>) -> Self {
        let [x, y, z] = photon.heading.direction().to_array();
        let inverse = 1.0 / (photon.radius() * photon.radius());
        let [r, g, b] = photon.power().to_rgb().to_array();
        Self(f32x8::from([x, y, z, inverse, r, g, b, 0.0]))
    }
}

/// A photon that a ray pierces.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pierced {
    /// Place in the list of photons.
    pub(super) photon: u32,
    /// Parameter of the ray's nearest point. \[m\]
    pub(super) t: f32,
    /// Squared distance there. \[m2\]
    pub(super) d2: f32,
    /// What it counts for: over the chance of being let through, and over its share of the disc.
    pub(super) weight: f32,
}

/// Radiance of the photons `hits` of a list along a ray; the hits are filled up to whole eights.
#[inline]
pub(super) fn radiance<S: Spectrum, H: Heading>(
    kernel: Kernel,
    media: &[Medium<S>],
    (direction, profile): (Vec3, &Profile<S>),
    list: &[Lit],
    hits: &mut Vec<Pierced>,
) -> S {
    let Some(last) = hits.last().copied() else {
        return S::ZERO;
    };
    let whole = hits.len().next_multiple_of(8);
    hits.resize(
        whole,
        Pierced {
            weight: 0.0,
            ..last
        },
    );
    let grey = S::CHANNELS == 1 || profile.is_grey();
    let mut sums = [Sum::default(); 3];
    for hits in hits.chunks_exact(8) {
        let lane = |of: fn(&Pierced) -> f32| {
            f32x8::from(std::array::from_fn::<f32, 8, _>(|i| of(&hits[i])))
        };
        let (t, d2, weight) = (lane(|h| h.t), lane(|h| h.d2), lane(|h| h.weight));
        let rows = std::array::from_fn(|i| list[hits[i].photon as usize].0);
        let [x, y, z, inverse, r, g, b, _] = f32x8::transpose(rows);
        let shape = kernel.shape8(d2 * inverse) * f32x8::splat(kernel.disc());
        let disc = shape * inverse * weight;
        let (mut tau, mut scattering) = ([f32x8::ZERO; 3], [f32x8::ZERO; 3]);
        profile.visit_eight(t, |index, sigma_t, [depth, density]| {
            let medium = &media[index];
            let phase = if H::KEPT {
                medium.phase.p8([x, y, z], -direction)
            } else {
                f32x8::splat(ISOTROPIC)
            };
            let there = density * phase;
            let sigma_s = sigma_t * medium.albedo;
            for c in 0..S::CHANNELS {
                tau[c] = depth.mul_add(f32x8::splat(sigma_t.channel(c)), tau[c]);
                scattering[c] = there.mul_add(f32x8::splat(sigma_s.channel(c)), scattering[c]);
            }
        });
        let first = exp8(-tau[0]);
        for (c, power) in [r, g, b].into_iter().enumerate().take(S::CHANNELS) {
            let tr = if grey || c == 0 { first } else { exp8(-tau[c]) };
            sums[c].add(tr * scattering[c] * power * disc);
        }
    }
    S::from_rgb(Vec3::from(sums.map(|sum| sum.value.reduce_add())))
}

/// Sums of eight lanes.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    value: f32x8,
    excess: f32x8,
}

impl Sum {
    #[inline]
    fn add(&mut self, term: f32x8) {
        let term = term - self.excess;
        let value = self.value + term;
        self.excess = (value - self.value) - term;
        self.value = value;
    }
}
