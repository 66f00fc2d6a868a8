//! The transmittance of a shadow ray: marched exactly where it is seen, by roulette beyond.
//!
//! ```text
//! T = exp(-tau)                       tau <= 3
//! T ~ e^-3 with probability q = exp(3 - tau), else 0             E = T
//! ```

use super::thinnest_channel;
use crate::grid::walk::integral;
use crate::medium::{Field, Medium};
use crate::ray::{Bounds, Ray};
use crate::spectrum::Spectrum;
use crate::tracking::Sampler;

/// Optical depth, in the thinnest channel, at which the roulette of shadow rays begins. Lower:
/// noise where light is seen to fade; higher: marches through what is dark anyway.
const ROULETTE_DEPTH: f32 = 3.0;

/// The transmittance of [0, t_max], exact down to e^-3: for shadow rays whose noise would be seen.
/// Its cost is the voxels crossed, where ratio tracking's is the optical thickness; the path
/// tracer takes the latter.
///
/// What is less plays Russian roulette. A ray goes on to depth tau with probability
/// q = exp(3 - tau) and counts T / q, the same e^-3 however far it comes in the thinnest channel:
/// the expectation is T, and a march is a mean free path longer than depth 3, not all the way.
pub fn transmittance<S: Spectrum>(
    media: &[Medium<S>],
    ray: &Ray,
    t_max: f32,
    sampler: &mut Sampler,
) -> S {
    sampler.counters.transmittance_rays += 1;
    let mut tau = S::ZERO;
    let mut left_out = 0.0;
    for medium in media {
        let per_depth = thinnest_channel(medium.sigma_t);
        // Drawn from (0, 1].
        let end = ROULETTE_DEPTH - (1.0 - sampler.uniform()).ln();
        let spent = end / per_depth;
        let depth = match &medium.field {
            Field::Constant { bounds } => Bounds::clip_if(bounds.as_ref(), ray, t_max)
                .map_or(0.0, |(t0, t1)| f64::from((t1 - t0).min(spent))),
            Field::Plateau(field) => {
                let local = field.placement.exact_ray(ray);
                field.plateau.integral(&local, t_max, spent.into())
            }
            Field::Grid(field) => {
                let local = field.placement.exact_ray(ray);
                let (depth, lookups) = integral(
                    &field.grid,
                    &field.majorants,
                    &local,
                    [0.0, t_max],
                    spent.into(),
                );
                sampler.counters.density_lookups += lookups;
                depth
            }
        };
        if depth >= f64::from(spent) {
            return S::ZERO;
        }
        left_out += (per_depth * depth as f32 - ROULETTE_DEPTH).max(0.0);
        tau += medium.sigma_t * depth as f32;
    }
    S::transmittance(tau - S::splat(left_out))
}
