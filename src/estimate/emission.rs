//! Light that media emit along a camera ray.
//!
//! ```text
//! L = integral of T(t) sigma_a(t) L_e(t) dt     L_e = radiance * blackbody(scale * temperature)
//! ```
//!
//! Each stretch between knots takes the temperature in its middle; for one medium the weight of
//! a stretch is exact (T(a) - T(b) is the integral of T sigma_t).

use crate::march::Profile;
use crate::ray::Ray;
use crate::scene::Rgb;
use crate::spectrum::Spectrum;
use crate::tracking::Counters;
use crate::world::World;

/// Emitted radiance along a ray whose media `profile` holds. \[W/(m2 sr)\]
pub fn radiance<S: Spectrum>(
    world: &World<S>,
    ray: &Ray,
    profile: &Profile<S>,
    counters: &mut Counters,
) -> S {
    let mut sum = S::ZERO;
    let alone = profile.media().count() == 1;
    for (index, medium) in world.media.iter().enumerate() {
        let Some(emission) = &medium.emission else {
            continue;
        };
        let absorbed = S::ONE - medium.albedo;
        profile.stretches(index, |a, b| {
            let middle = 0.5 * (a + b);
            counters.effects.temperatures += 1;
            let l_e = emission.radiance_at(ray.at(middle));
            if l_e == Rgb::ZERO {
                return;
            }
            let weight = if alone {
                profile.transmittance(a) - profile.transmittance(b)
            } else {
                let mut sigma = S::ZERO;
                profile.media_at(middle, |m, s| {
                    if m == index {
                        sigma = s;
                    }
                });
                profile.transmittance(middle) * sigma * (b - a)
            };
            sum += weight * absorbed * S::from_rgb(l_e);
        });
    }
    sum
}
