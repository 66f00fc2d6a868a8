//! Media too dense for positions to resolve their scattering.
//!
//! ```text
//! l = 1 / max sigma_t                 the shortest mean free path of a medium   [m]
//! l < RESOLVED * |corner|             corner: its farthest from the origin      [m]
//! ```
//!
//! Positions are f32, from an origin in the middle of the volumes, so they are rounded to 6e-8 of
//! their distance from there. Scattering needs a hundred such steps in a mean free path:
//! `docs/stability.md` has what a fog reflects below that, and a user is to know. Transmittance, in
//! f64, has no such limit.

use crate::medium::{Field, Medium};
use crate::spectrum::Spectrum;
use crate::world::World;

/// Shortest mean free path that is resolved, over the distance from the origin. Smaller: fog comes
/// out too dark without a word (at 1e-5 by 0.2 %, at 1e-6 by 12 %); larger: a word about nothing.
const RESOLVED: f32 = 1e-5;

/// Largest density of a medium.
fn densest<S: Spectrum>(medium: &Medium<S>) -> f32 {
    match &medium.field {
        Field::Constant { .. } => 1.0,
        Field::Grid(field) => field.majorants.highest(),
        Field::Plateau(field) => field.plateau.value,
    }
}

/// What to tell a user: a line for each medium whose scattering is not resolved.
#[must_use]
pub fn warnings<S: Spectrum>(world: &World<S>) -> Vec<String> {
    let media = world.media.iter().zip(&world.parts);
    let media = media.filter(|(medium, _)| world.max_bounces > 0 && !medium.albedo.is_zero());
    media
        .filter_map(|(medium, part)| {
            let corner = part.bounds.min.abs().max(part.bounds.max.abs());
            let far = corner.length();
            let free = 1.0 / (medium.sigma_t.max_channel() * densest(medium));
            (free < RESOLVED * far).then(|| {
                format!(
                    "mean free path of {free:.1e} m in a medium that reaches {far:.3} m from the \
                     middle of the scene: positions resolve {:.1e} m there, and its scattered \
                     light comes out too dark",
                    RESOLVED * far
                )
            })
        })
        .collect()
}
