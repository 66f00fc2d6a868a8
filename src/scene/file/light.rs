//! `[[light]]` of the scene file: one kind each. Directions are directions of travel.
//!
//! | kind | keys |
//! |---|---|
//! | `sun` | `direction`; `irradiance` colour on a facing surface \[W/m2\]; `angular_diameter` \[degrees\] 0 to 180, default 0.53, 0 is a delta direction |
//! | `sky` | `radiance` colour \[W/(m2 sr)\]; or `file` lat-long .exr (middle toward -z, top toward +y) and `scale`, default 1 |
//! | `point` | `position` \[m\]; `power` colour \[W\] |
//! | `spot` | `position`, `look_at` \[m\]; `power` colour \[W\]; `cone_angle` half angle \[degrees\] above 0 to 180; `penumbra` soft edge inside the cone \[degrees\], default 0; `image` .png that filters its light, a square around the cone |
//! | `quad` | `corner`, `edge_u`, `edge_v` \[m\]; `radiance` colour \[W/(m2 sr)\]; emits along `edge_u` x `edge_v` |
//! | `disk` | `center` \[m\]; `normal`; `radius` \[m\] above 0; `radiance` colour \[W/(m2 sr)\]; emits along `normal` |
//! | `sphere` | `center` \[m\]; `radius` \[m\] above 0; `radiance` colour \[W/(m2 sr)\] |

use super::{ball, quad};
use crate::scene::Light;
use crate::scene::item::{FROM_0, Item, Limits};
use crate::scene::keys::Keys;

/// Reads one light.
pub(super) fn light(v: &Item<'_>) -> Option<Light> {
    let kinds = ["sun", "sky", "point", "spot", "quad", "disk", "sphere"];
    v.tagged(&kinds, |kind, v| {
        v.table(|t| match kind {
            "sun" => sun(t),
            "sky" => sky(t),
            "point" => {
                let position = t.need("position", Item::point);
                let power = t.need("power", |v| v.colour(FROM_0));
                Some(Light::Point {
                    position: position?,
                    power: power?,
                })
            }
            "spot" => spot(t),
            "quad" => {
                let quad = quad(t);
                let radiance = t.need("radiance", |v| v.colour(FROM_0));
                let [corner, edge_u, edge_v] = quad?;
                Some(Light::Quad {
                    corner,
                    edge_u,
                    edge_v,
                    radiance: radiance?,
                })
            }
            "disk" => {
                let ball = ball(t);
                let normal = t.need("normal", Item::direction);
                let radiance = t.need("radiance", |v| v.colour(FROM_0));
                let (center, radius) = ball?;
                Some(Light::Disk {
                    center,
                    normal: normal?.normalize(),
                    radius,
                    radiance: radiance?,
                })
            }
            _ => {
                let ball = ball(t);
                let radiance = t.need("radiance", |v| v.colour(FROM_0));
                let (center, radius) = ball?;
                Some(Light::Sphere {
                    center,
                    radius,
                    radiance: radiance?,
                })
            }
        })
    })
}

fn sun(t: &Keys<'_>) -> Option<Light> {
    let direction = t.need("direction", Item::direction);
    let irradiance = t.need("irradiance", |v| v.colour(FROM_0));
    let wide = Limits(|v| (0.0..=180.0).contains(&v), "from 0 to 180");
    let angular_diameter = t.may("angular_diameter", |v| v.number(wide));
    Some(Light::Sun {
        direction: direction?.normalize(),
        irradiance: irradiance?,
        angular_diameter: angular_diameter.unwrap_or(0.53),
    })
}

fn sky(t: &Keys<'_>) -> Option<Light> {
    let file = t.may("file", Item::file);
    let scale = t.may("scale", |v| v.number(FROM_0)).unwrap_or(1.0);
    if t.has("file") {
        if t.has("radiance") {
            let message = "a sky takes either `radiance` or `file`";
            t.faults.note(t.span_of("radiance"), message);
        }
        return Some(Light::SkyImage { file: file?, scale });
    }
    let radiance = t.need("radiance", |v| v.colour(FROM_0));
    if t.has("scale") {
        let message = "`scale` goes with `file`; change `radiance` instead";
        t.faults.note(t.span_of("scale"), message);
    }
    Some(Light::Sky {
        radiance: radiance?,
    })
}

fn spot(t: &Keys<'_>) -> Option<Light> {
    let position = t.need("position", Item::point);
    let look_at = t.need("look_at", Item::point);
    let power = t.need("power", |v| v.colour(FROM_0));
    let angle = Limits(|v| v > 0.0 && v <= 180.0, "above 0, to 180");
    let cone_angle = t.need("cone_angle", |v| v.number(angle));
    let penumbra = t.may("penumbra", |v| v.number(FROM_0)).unwrap_or(0.0);
    let image = t.may("image", Item::file);
    let (position, cone_angle) = (position?, cone_angle?);
    let axis = look_at? - position;
    if !axis.length_squared().is_normal() {
        let message = "`look_at` is where the light stands; it has to be somewhere else";
        t.faults.note(t.span_of("look_at"), message);
    }
    if penumbra > cone_angle {
        let message = format!(
            "`penumbra` is {penumbra}; it lies inside the cone, so it has to be from 0 to \
             `cone_angle`, {cone_angle}"
        );
        t.faults.note(t.span_of("penumbra"), message);
    }
    Some(Light::Spot {
        position,
        direction: axis.normalize_or_zero(),
        power: power?,
        cone_angle,
        penumbra,
        image,
    })
}
