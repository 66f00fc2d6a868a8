//! The rule of each effect: when it is active, the fact that decides, the form that simulates it.

use super::Needs;
use super::facts::Facts;
use crate::blackbody::COOLEST;
use crate::report::Effect;
use crate::scene::{Method, Scene};

/// The table of effects, in their fixed order.
pub(super) fn effects(scene: &Scene, facts: &Facts, needs: Needs) -> Vec<Effect> {
    vec![
        absorption(facts),
        single_scattering(scene, facts, needs),
        multiple_scattering(scene, facts, needs),
        anisotropic_phase(facts, needs),
        emission(facts),
        chromatic(facts, needs),
        heterogeneous(facts),
        surfaces(facts),
        specular_surfaces(facts),
        surface_photons(scene, facts, needs),
        medium_boundaries(facts),
        area_lights(facts),
        environment(facts),
        depth_of_field(scene),
    ]
}

fn effect(name: &str, active: bool, reason: impl Into<String>, form: &str) -> Effect {
    Effect {
        name: name.to_owned(),
        active,
        reason: reason.into(),
        form: if active { form } else { "" }.to_owned(),
        count: None,
    }
}

/// "1 light", "3 lights".
fn number(n: usize, what: &str) -> String {
    if n == 1 {
        format!("1 {what}")
    } else if let Some(stem) = what.strip_suffix('y') {
        format!("{n} {stem}ies")
    } else if what == "medium" {
        format!("{n} media")
    } else {
        format!("{n} {what}s")
    }
}

fn absorption(facts: &Facts) -> Effect {
    let media = &facts.media;
    let form = if media.scattering > 0 {
        "Russian roulette at collisions, attenuation along rays"
    } else {
        "attenuation along rays; no photons"
    };
    let reason = if media.count() == 0 {
        "there is no medium".to_owned()
    } else if media.absorbing == 0 {
        format!("albedo is 1 in {}", number(media.count(), "medium"))
    } else {
        format!(
            "lowest albedo is {} in {}",
            media.lowest_albedo,
            number(media.count(), "medium")
        )
    };
    effect("absorption", media.absorbing > 0, reason, form)
}

/// Why nothing scatters, or what does most.
fn scattering_fact(scene: &Scene, facts: &Facts) -> String {
    let media = &facts.media;
    if media.count() == 0 {
        "there is no medium".to_owned()
    } else if media.scattering == 0 {
        format!(
            "albedo is 0 in every one of {}",
            number(media.count(), "medium")
        )
    } else if scene.settings.max_bounces == 0 {
        "max_bounces is 0".to_owned()
    } else if facts.shining() == 0 {
        "0 lights shine".to_owned()
    } else {
        format!("highest albedo is {}", media.highest_albedo)
    }
}

fn single_scattering(scene: &Scene, facts: &Facts, needs: Needs) -> Effect {
    let form = if scene.settings.method == Method::Path {
        "paths"
    } else if !needs.direct {
        "photons"
    } else if facts.lights.skies > 0 {
        "sampled along camera rays; plain skies from photons"
    } else {
        "sampled along camera rays"
    };
    effect(
        "single_scattering",
        needs.scattering,
        scattering_fact(scene, facts),
        form,
    )
}

fn multiple_scattering(scene: &Scene, facts: &Facts, needs: Needs) -> Effect {
    let bounces = scene.settings.max_bounces;
    let reason = if needs.scattering {
        format!(
            "max_bounces is {bounces} and the highest albedo {}",
            facts.media.highest_albedo
        )
    } else {
        scattering_fact(scene, facts)
    };
    let form = match scene.settings.method {
        Method::Path => "paths",
        Method::Beam | Method::Point => "photons",
    };
    effect("multiple_scattering", needs.multiple, reason, form)
}

fn anisotropic_phase(facts: &Facts, needs: Needs) -> Effect {
    let media = &facts.media;
    let active = needs.scattering && media.anisotropic > 0;
    let reason = if media.scattering == 0 {
        "no medium scatters".to_owned()
    } else if media.anisotropic == 0 {
        format!(
            "g = 0 in {} that scatter",
            number(media.scattering, "medium")
        )
    } else if media.anisotropic == media.rayleigh {
        format!("{} of Rayleigh's", number(media.rayleigh, "medium"))
    } else {
        format!("largest |g| is {}", media.largest_g)
    };
    effect(
        "anisotropic_phase",
        active,
        reason,
        "photons keep their direction",
    )
}

fn emission(facts: &Facts) -> Effect {
    let (active, reason) = match &facts.heat {
        None => (false, "no volume has an emission".to_owned()),
        Some(heat) => {
            let (grid, hottest) = (&heat.grid, heat.hottest);
            let reason = if hottest < COOLEST as f32 {
                format!(
                    "temperature grid '{grid}' has 0 voxels above {COOLEST} K, its highest is \
                     {hottest} K"
                )
            } else if heat.emits {
                format!("temperature grid '{grid}' reaches {hottest} K")
            } else {
                format!(
                    "temperature grid '{grid}' reaches {hottest} K, but its radiance or what its \
                     volume absorbs is 0"
                )
            };
            (heat.emits, reason)
        }
    };
    effect("emission", active, reason, "summed along camera rays")
}

fn chromatic(facts: &Facts, needs: Needs) -> Effect {
    let counts = [
        (facts.media.coloured, "medium"),
        (facts.lights.coloured, "light"),
        (facts.materials.coloured, "surface"),
    ];
    let mut what: Vec<String> = counts
        .into_iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| number(n, what))
        .collect();
    if needs.emission {
        what.push("emission".to_owned());
    }
    let reason = if what.is_empty() {
        "0 media, lights and surfaces have colour".to_owned()
    } else {
        format!("colour in {}", what.join(", "))
    };
    effect("chromatic", needs.chromatic, reason, "three channels")
}

fn heterogeneous(facts: &Facts) -> Effect {
    let media = &facts.media;
    let reason = format!(
        "{} varies, {} of one value, {} without a grid",
        number(media.sparse, "grid"),
        number(media.plateaus, "grid"),
        number(media.homogeneous, "medium")
    );
    let form = "delta tracking with local majorants, exact march";
    effect("heterogeneous", media.sparse > 0, reason, form)
}

fn surfaces(facts: &Facts) -> Effect {
    effect(
        "surfaces",
        facts.materials.objects > 0,
        number(facts.materials.objects, "object"),
        "one hierarchy; lights sampled at hits, shadows in the media",
    )
}

fn specular_surfaces(facts: &Facts) -> Effect {
    let specular = facts.materials.specular;
    effect(
        "specular_surfaces",
        specular > 0,
        format!("{} of mirror, glass or metal", number(specular, "object")),
        "camera rays and photons go on; photons under a hierarchy for rays from anywhere",
    )
}

fn surface_photons(scene: &Scene, facts: &Facts, needs: Needs) -> Effect {
    let materials = &facts.materials;
    let reason = if materials.diffuse == 0 {
        "0 objects are diffuse and not black".to_owned()
    } else if facts.shining() == 0 && !needs.emission {
        "0 lights shine".to_owned()
    } else if scene.settings.max_bounces < 2 && !needs.surface_photons {
        format!("max_bounces is {}", scene.settings.max_bounces)
    } else if scene.settings.method == Method::Path {
        "paths are traced, not photons".to_owned()
    } else if needs.surface_photons {
        format!(
            "{} that light can reach indirectly",
            number(materials.diffuse, "diffuse object")
        )
    } else {
        format!(
            "no photon can reach surface '{}' but straight from a light: it is flat, and nothing \
             else scatters",
            materials.first_diffuse
        )
    };
    effect(
        "surface_photons",
        needs.surface_photons,
        reason,
        "a photon map of their own, gathered at hits",
    )
}

fn medium_boundaries(facts: &Facts) -> Effect {
    let materials = &facts.materials;
    effect(
        "medium_boundaries",
        materials.interfaces + materials.glass > 0,
        format!(
            "{} with an inside: {} of glass, {} bound a medium alone",
            number(materials.interfaces + materials.glass, "object"),
            materials.glass,
            materials.interfaces
        ),
        "each stretch of a ray meets the media of its place",
    )
}

fn area_lights(facts: &Facts) -> Effect {
    let areas = facts.lights.areas + facts.materials.emissive;
    let discs = facts.lights.discs;
    effect(
        "area_lights",
        areas + discs > 0,
        format!(
            "{} with an area, {} with a disc",
            number(areas, "light"),
            number(discs, "sun")
        ),
        "points sampled on the light",
    )
}

fn environment(facts: &Facts) -> Effect {
    effect(
        "environment",
        facts.lights.skies + facts.lights.pictures > 0,
        number(facts.lights.skies + facts.lights.pictures, "sky"),
        "photons through the media's box, background",
    )
}

fn depth_of_field(scene: &Scene) -> Effect {
    let reason = match scene.camera.lens {
        Some(lens) => format!("the lens has a radius of {} m", lens.radius),
        None => "the camera is a pinhole, radius 0".to_owned(),
    };
    effect(
        "depth_of_field",
        scene.camera.lens.is_some(),
        reason,
        "points sampled on the lens; photons gathered per ray",
    )
}
