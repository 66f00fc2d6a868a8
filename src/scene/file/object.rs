//! `[[object]]` of the scene file: surfaces.
//!
//! | key | default | what |
//! |---|---|---|
//! | `name` | "object 1", and so on | for messages |
//! | `shape` | needed | see `shape` |
//! | `material` | needed | see `material` |
//! | `interior` | none | medium inside a closed surface: see `optics` |
//! | `transform` | none | see `transform` |

use super::{ball, corners, optics, quad, transform};
use crate::scene::item::{ABOVE_0, FROM_0, Item, SHARE};
use crate::scene::keys::Keys;
use crate::scene::{Material, Object, Rgb, Shape};

/// Reads one object.
pub(super) fn object(t: &Keys<'_>, index: usize) -> Option<Object> {
    let name = t.may("name", Item::string).map(str::to_owned);
    let shape = t.need("shape", shape);
    let material = t.need("material", material);
    let interior = t.may("interior", |v| v.table(optics));
    let transform = t.may("transform", |v| v.table(transform));
    if interior.is_some() && matches!(shape, Some(Shape::Quad { .. })) {
        let message = "a quad has no inside; `interior` needs a closed shape";
        t.faults.note(t.span_of("interior"), message);
    }
    Some(Object {
        name: name.unwrap_or_else(|| format!("object {}", index + 1)),
        shape: shape?,
        transform: transform.unwrap_or_default(),
        material: material?,
        interior,
    })
}

/// `shape = { .. }`: one of
///
/// | kind | keys |
/// |---|---|
/// | `mesh` | `file`: .obj, .ply, .gltf, .glb |
/// | `sphere` | `center`, `radius` \[m\] |
/// | `quad` | `corner`, `edge_u`, `edge_v` \[m\]; its front is `edge_u` x `edge_v` |
/// | `box` | `min`, `max` \[m\] |
fn shape(v: &Item<'_>) -> Option<Shape> {
    v.tagged(&["mesh", "sphere", "quad", "box"], |kind, v| {
        v.table(|t| match kind {
            "mesh" => t.need("file", |v| {
                let file = v.file()?;
                let extension = file.extension().map(|e| e.to_ascii_lowercase());
                match extension.as_ref().and_then(|e| e.to_str()) {
                    Some("obj" | "ply" | "gltf" | "glb") => Some(Shape::Mesh { file }),
                    _ => v.fault("a mesh has to be .obj, .ply, .gltf or .glb"),
                }
            }),
            "sphere" => ball(t).map(|(center, radius)| Shape::Sphere { center, radius }),
            "quad" => quad(t).map(|[corner, edge_u, edge_v]| Shape::Quad {
                corner,
                edge_u,
                edge_v,
            }),
            _ => corners(t).map(|[min, max]| Shape::Box { min, max }),
        })
    })
}

/// `material = "interface"` (an index-matched boundary of a medium), or `{ .. }` with one of
///
/// | kind | keys |
/// |---|---|
/// | `diffuse` | `reflectance` colour 0 to 1, default 0.5, 1 with a `texture`; `texture` picture file multiplied onto it |
/// | `mirror` | `reflectance` colour 0 to 1, default 1 |
/// | `glass` | `ior` inside over outside, above 0, default 1.5; `roughness` GGX alpha 0 to 1, default 0 |
/// | `conductor` | `metal`: `"gold"`, `"silver"`, `"copper"`, `"aluminium"`; or `eta`, `k` colours; `roughness` as glass |
/// | `emissive` | `radiance` colour \[W/(m2 sr)\] |
fn material(v: &Item<'_>) -> Option<Material> {
    let kinds = ["diffuse", "mirror", "glass", "conductor", "emissive"];
    v.choice(&[("interface", Material::Interface)], &kinds, |kind, v| {
        v.table(|t| match kind {
            "diffuse" => {
                let texture = t.may("texture", Item::file);
                let default = if t.has("texture") { 1.0 } else { 0.5 };
                let reflectance = t.may("reflectance", |v| v.colour(SHARE));
                Some(Material::Diffuse {
                    reflectance: reflectance.unwrap_or(Rgb::splat(default)),
                    texture,
                })
            }
            "mirror" => {
                let reflectance = t.may("reflectance", |v| v.colour(SHARE));
                Some(Material::Mirror {
                    reflectance: reflectance.unwrap_or(Rgb::ONE),
                })
            }
            "glass" => Some(Material::Glass {
                ior: t.may("ior", |v| v.number(ABOVE_0)).unwrap_or(1.5),
                roughness: roughness(t),
            }),
            "conductor" => conductor(t),
            _ => t
                .need("radiance", |v| v.colour(FROM_0))
                .map(|radiance| Material::Emissive { radiance }),
        })
    })
}

/// GGX alpha; smooth without it.
fn roughness(t: &Keys<'_>) -> f64 {
    t.may("roughness", |v| v.number(SHARE)).unwrap_or(0.0)
}

/// Index of refraction of a metal in linear Rec. 709: real part, imaginary part. Measurements of
/// Johnson and Christy (1972; Au, Ag, Cu) and Rakic (1995; Al), as renderers commonly tabulate them.
type Metal = ([f32; 3], [f32; 3]);

const METALS: [(&str, Metal); 4] = [
    ("gold", ([0.1431, 0.3749, 1.4424], [3.9831, 2.3857, 1.6032])),
    (
        "silver",
        ([0.1552, 0.1167, 0.1383], [4.8283, 3.1222, 2.1469]),
    ),
    (
        "copper",
        ([0.2004, 0.9240, 1.1022], [3.9129, 2.4528, 2.1421]),
    ),
    (
        "aluminium",
        ([1.6574, 0.8803, 0.5212], [9.2238, 6.2695, 4.8370]),
    ),
];

fn conductor(t: &Keys<'_>) -> Option<Material> {
    let roughness = roughness(t);
    let metal = t.may("metal", |v| v.word(&METALS));
    if t.has("metal") {
        for key in ["eta", "k"] {
            if t.has(key) {
                let message = format!(
                    "a conductor takes either `metal` or `eta` and `k`, not `{key}` with it"
                );
                t.faults.note(t.span_of(key), message);
            }
        }
        let (eta, k) = metal?;
        return Some(Material::Conductor {
            eta: Rgb::from_array(eta),
            k: Rgb::from_array(k),
            roughness,
        });
    }
    let eta = t.need("eta", |v| v.colour(ABOVE_0));
    let k = t.need("k", |v| v.colour(FROM_0));
    Some(Material::Conductor {
        eta: eta?,
        k: k?,
        roughness,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reflectance at normal incidence, a property of the metals that is easy to look up.
    #[test]
    fn metals_have_their_colours() {
        let expected = [
            ("gold", [0.97, 0.80, 0.32]),
            ("silver", [0.97, 0.96, 0.91]),
            ("copper", [0.96, 0.62, 0.51]),
            ("aluminium", [0.93, 0.92, 0.92]),
        ];
        for ((name, (eta, k)), (same, colour)) in METALS.iter().zip(expected) {
            assert_eq!(*name, same);
            for c in 0..3 {
                let (n, k) = (eta[c], k[c]);
                let r = ((n - 1.0).powi(2) + k * k) / ((n + 1.0).powi(2) + k * k);
                assert!((r - colour[c]).abs() < 0.015, "{name} channel {c}: {r}");
            }
        }
    }
}
