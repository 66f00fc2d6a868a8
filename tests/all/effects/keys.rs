//! One key of a scene is edited: the plan changes exactly where it should.

use std::path::Path;

use vpm_vdb::effects::EffectPlan;
use vpm_vdb::grid::load::load_volumes;
use vpm_vdb::scene::Scene;

/// Its active effects: absorption, single_scattering, multiple_scattering, heterogeneous.
const BASE: &str = r#"
[camera]
position = [0.0, 0.5, 2.3]
look_at = [0.0, 0.48, 0.0]
resolution = [16, 16]
[render]
max_bounces = 8
[[volume]]
file = "fire.vdb"
extinction = 10.0
albedo = 0.5
phase = "isotropic"
[[light]]
point = { position = [0.0, 3.0, 0.0], power = 10.0 }
"#;

const LIGHT: &str = "point = { position = [0.0, 3.0, 0.0], power = 10.0 }";
const BALL: &str = "shape = { sphere = { center = [0.0, 0.5, 0.0], radius = 0.1 } }";

/// What is replaced, by what, and the effects that change.
type Edit = (&'static str, String, &'static str);

fn active(folder: &Path, text: &str) -> Vec<(String, bool)> {
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).expect("the folder can be written");
    let scene = Scene::load(&file).unwrap_or_else(|e| panic!("{text}\n{e}"));
    let volumes = load_volumes(&scene, &|_| {}).expect("the volume can be read");
    let plan = EffectPlan::new(&scene, &volumes);
    plan.effects
        .into_iter()
        .map(|e| (e.name, e.active))
        .collect()
}

fn edits() -> Vec<Edit> {
    let emission = |scale: f64, radiance: f64| {
        format!(
            "phase = \"isotropic\"\nemission = {{ blackbody = {{ temperature = \"temperature\", \
             scale = {scale:?}, radiance = {radiance:?} }} }}"
        )
    };
    let phase = |p: &str| format!("phase = {p}");
    let object = |material: &str| format!("{LIGHT}\n[[object]]\n{BALL}\nmaterial = {material}");
    let interior = "interior = { extinction = 5.0, albedo = 0.5 }";
    let s = str::to_owned;
    vec![
        (
            "albedo = 0.5",
            s("albedo = 0.0"),
            "single_scattering multiple_scattering",
        ),
        ("albedo = 0.5", s("albedo = 1.0"), "absorption"),
        ("albedo = 0.5", s("albedo = 0.4"), ""),
        ("albedo = 0.5", s("albedo = [0.5, 0.5, 0.6]"), "chromatic"),
        (
            "extinction = 10.0",
            s("extinction = 0.0"),
            "absorption single_scattering multiple_scattering heterogeneous",
        ),
        (
            "extinction = 10.0",
            s("extinction = [10, 10, 12]"),
            "chromatic",
        ),
        (
            "phase = \"isotropic\"",
            phase("{ henyey_greenstein = { g = 0.3 } }"),
            "anisotropic_phase",
        ),
        (
            "phase = \"isotropic\"",
            phase("{ henyey_greenstein = { g = 0.0 } }"),
            "",
        ),
        (
            "phase = \"isotropic\"",
            phase("\"rayleigh\""),
            "anisotropic_phase",
        ),
        (
            "phase = \"isotropic\"",
            emission(1500.0, 1.0),
            "emission chromatic",
        ),
        ("phase = \"isotropic\"", emission(100.0, 1.0), ""),
        ("phase = \"isotropic\"", emission(1500.0, 0.0), ""),
        (
            "max_bounces = 8",
            s("max_bounces = 1"),
            "multiple_scattering",
        ),
        ("max_bounces = 8", s("max_bounces = 2"), ""),
        ("max_bounces = 8", s("method = \"path\""), ""),
        ("max_bounces = 8", s("direct = \"photons\""), ""),
        (
            "resolution = [16, 16]",
            s("resolution = [16, 16]\nlens = { radius = 0.01, focus_distance = 2.0 }"),
            "depth_of_field",
        ),
        // The volume is behind the camera, and nothing else is there.
        (
            "look_at = [0.0, 0.48, 0.0]",
            s("look_at = [0.0, 0.5, 9.0]"),
            "absorption single_scattering multiple_scattering heterogeneous",
        ),
        (
            "power = 10.0",
            s("power = 0.0"),
            "single_scattering multiple_scattering",
        ),
        ("power = 10.0", s("power = [10, 10, 9]"), "chromatic"),
        (
            LIGHT,
            s("sun = { direction = [0, -1, 0], irradiance = 1, angular_diameter = 0 }"),
            "",
        ),
        (
            LIGHT,
            s("sun = { direction = [0, -1, 0], irradiance = 1, angular_diameter = 0.5 }"),
            "area_lights",
        ),
        (LIGHT, s("sky = { radiance = 1.0 }"), "environment"),
        (
            LIGHT,
            s("sky = { radiance = 0.0 }"),
            "single_scattering multiple_scattering",
        ),
        (
            LIGHT,
            s("sky = { radiance = [0.5, 0.6, 0.7] }"),
            "environment chromatic",
        ),
        (
            LIGHT,
            s("spot = { position = [0, 3, 0], look_at = [0, 0, 0], power = 1, cone_angle = 20 }"),
            "",
        ),
        (
            LIGHT,
            s(
                "quad = { corner = [0, 3, 0], edge_u = [1, 0, 0], edge_v = [0, 0, 1], radiance = 1 }",
            ),
            "area_lights",
        ),
        (
            LIGHT,
            s("sphere = { center = [0, 3, 0], radius = 0.1, radiance = 1 }"),
            "area_lights",
        ),
        (
            LIGHT,
            object("{ diffuse = { reflectance = 0.5 } }"),
            "surfaces surface_photons",
        ),
        (
            LIGHT,
            object("{ diffuse = { reflectance = 0.0 } }"),
            "surfaces",
        ),
        (
            LIGHT,
            object("{ diffuse = { reflectance = [0.5, 0.4, 0.3] } }"),
            "surfaces surface_photons chromatic",
        ),
        (
            LIGHT,
            object("{ mirror = { reflectance = 0.9 } }"),
            "surfaces specular_surfaces",
        ),
        (
            LIGHT,
            object("{ glass = { ior = 1.5 } }"),
            "surfaces specular_surfaces medium_boundaries",
        ),
        (
            LIGHT,
            format!("{}\n{interior}", object("\"interface\"")),
            "surfaces medium_boundaries",
        ),
        (
            LIGHT,
            format!("{}\n{interior}", object("\"interface\""))
                .replace("albedo = 0.5 }", "albedo = [0.5, 0.5, 0.4] }"),
            "surfaces medium_boundaries chromatic",
        ),
        (
            LIGHT,
            object("{ emissive = { radiance = 1.0 } }"),
            "surfaces area_lights",
        ),
        (
            LIGHT,
            object("{ emissive = { radiance = 0.0 } }"),
            "surfaces",
        ),
        (
            LIGHT,
            format!(
                "{LIGHT}\n[[fog]]\nbox = {{ min = [-1, -1, -1], max = [1, 1, 1] }}\n\
                 extinction = 1\nalbedo = 0.5"
            ),
            "",
        ),
        (
            LIGHT,
            format!(
                "{LIGHT}\n[[fog]]\nbox = {{ min = [-1, -1, -1], max = [1, 1, 1] }}\n\
                 extinction = 1\nalbedo = [0.5, 0.4, 0.5]"
            ),
            "chromatic",
        ),
    ]
}

#[test]
fn one_key_changes_the_plan_where_it_should() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let fire = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes/fire.vdb");
    std::fs::copy(fire, folder.path().join("fire.vdb")).expect("the volume is there");
    let base = active(folder.path(), BASE);
    let mut switched = std::collections::BTreeSet::new();
    for (from, to, expected) in edits() {
        assert_eq!(BASE.matches(from).count(), 1, "{from} once in the scene");
        let edited = active(folder.path(), &BASE.replace(from, &to));
        let changed: Vec<&str> = (base.iter().zip(&edited))
            .filter(|(a, b)| a != b)
            .map(|(a, _)| a.0.as_str())
            .collect();
        let mut wanted: Vec<&str> = expected.split_whitespace().collect();
        let place = |name: &&str| base.iter().position(|e| e.0 == **name);
        wanted.sort_by_key(place);
        assert_eq!(changed, wanted, "{from} -> {to}");
        switched.extend(wanted);
    }
    assert_eq!(
        switched.len(),
        base.len(),
        "every effect is switched by some key: {switched:?}"
    );
}

/// Reasons name the scene's fact with its number.
#[test]
fn reasons_carry_numbers() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let fire = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes/fire.vdb");
    std::fs::copy(fire, folder.path().join("fire.vdb")).expect("the volume is there");
    let file = folder.path().join("scene.toml");
    std::fs::write(&file, BASE).expect("the folder can be written");
    let scene = Scene::load(&file).expect("the scene is valid");
    let volumes = load_volumes(&scene, &|_| {}).expect("the volume can be read");
    for effect in EffectPlan::new(&scene, &volumes).effects {
        if !matches!(effect.name.as_str(), "emission") {
            let number = effect.reason.chars().any(|c| c.is_ascii_digit());
            assert!(number, "{}: {}", effect.name, effect.reason);
        }
    }
}
