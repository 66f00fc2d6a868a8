//! Scene files: what they mean, and what is said when they mean nothing.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use vpm_vdb::scene::file::settings_text;
use vpm_vdb::scene::{
    Convert, Direct, Emission, Kernel, Light, March, Material, Method, Phase, Scene, Search, Shape,
};

/// A folder with a scene file and empty files for it to name.
fn folder(text: &str, files: &[&str]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("scratch folder");
    for file in files {
        fs::write(dir.path().join(file), "").expect("scratch file");
    }
    let scene = dir.path().join("a.toml");
    fs::write(&scene, text).expect("scratch file");
    (dir, scene)
}

fn load(text: &str, files: &[&str]) -> Scene {
    let (_dir, scene) = folder(text, files);
    Scene::load(&scene).expect("a scene without faults")
}

/// The whole message, with the scratch folder taken out of it.
fn faults(text: &str) -> String {
    let (dir, scene) = folder(text, &["smoke.vdb"]);
    let message = Scene::load(&scene)
        .expect_err("a scene with faults")
        .to_string();
    message.replace(&format!("{}/", dir.path().display()), "")
}

const CAMERA: &str = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\n";

/// The example of the manual, with every optional part of it.
const EXAMPLE: &str = r##"
[camera]
position = [0.0, 1.2, 4.0]
look_at = [0.0, 1.0, 0.0]
up = [0.0, 1.0, 0.0]
vertical_fov = 40.0
resolution = [640, 800]
lens = { radius = 0.02, focus_distance = 4.0 }

[render]
method = "beam"
max_bounces = 128
photons = 1_000_000
passes = 8
direct = "sampled"
march = "exact"
kernel = "biweight"
neighbours = 50
exposure = 0.0

[[volume]]
file = "rising_smoke.vdb"
density = "density"
extinction = 12.0
albedo = 0.8
phase = "isotropic"
emission = { blackbody = { temperature = "temperature", scale = 1500.0, radiance = 1.0 } }
transform = { translate = [1,2,3], rotate = [90,0,90], scale = 2.0 }

[[fog]]
box = { min = [-10, 0, -10], max = [10, 5, 10] }
extinction = 0.05
albedo = 0.9
phase = { henyey_greenstein = { g = 0.8 } }

[[light]]
sun = { direction = [0.0, -2.0, 0.0], irradiance = 3.0, angular_diameter = 0.53 }
[[light]]
sky = { radiance = [0.2, 0.25, 0.35] }
[[light]]
sky = { file = "sky.exr", scale = 2.0 }
[[light]]
point = { position = [0, 3, 0], power = 100.0 }
[[light]]
spot = { position = [1, 4, 1], look_at = [1, 0, 1], power = 100.0, cone_angle = 20.0, penumbra = 2.0 }
[[light]]
quad = { corner = [0, 3, 0], edge_u = [1, 0, 0], edge_v = [0, 0, 1], radiance = 10.0 }
[[light]]
sphere = { center = [0, 3, 0], radius = 0.1, radiance = 10.0 }

[[object]]
shape = { mesh = { file = "bust.ply" } }
material = { diffuse = { reflectance = 0.5 } }
interior = { extinction = [1, 2, 3], albedo = [0.9, 0.8, 0.7], phase = "rayleigh" }
"##;

#[test]
fn the_example_of_the_manual() {
    let scene = load(EXAMPLE, &["rising_smoke.vdb", "sky.exr", "bust.ply"]);
    assert_eq!(scene.name, "a");
    assert_eq!(scene.camera.position, DVec3::new(0.0, 1.2, 4.0));
    assert_eq!(scene.camera.resolution, [640, 800]);
    assert_eq!(scene.camera.lens.unwrap().focus_distance, 4.0);
    let s = &scene.settings;
    assert_eq!(
        (s.method, s.direct, s.march),
        (Method::Beam, Direct::Sampled, March::Exact)
    );
    assert_eq!((s.photons, s.passes, s.neighbours), (1_000_000, 8, 50));
    assert_eq!(
        (s.kernel, s.max_bounces, s.spp, s.seed),
        (Kernel::Biweight, 128, 1, 0)
    );

    let [volume] = scene.volumes.as_slice() else {
        panic!("one volume");
    };
    assert!(
        volume.file.ends_with("rising_smoke.vdb"),
        "{}",
        volume.file.display()
    );
    assert_eq!(volume.optics.extinction, Vec3::splat(12.0));
    assert_eq!((volume.convert, volume.strict), (Convert::None, false));
    let Some(Emission::Blackbody { scale, .. }) = &volume.emission else {
        panic!("emission");
    };
    assert_eq!(*scale, 1500.0);
    // x is scaled, kept by the turn about x, turned onto y by the one about z, and moved.
    let moved = volume.transform.transform_point3(DVec3::X);
    assert!(
        (moved - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-12,
        "{moved}"
    );
    // y goes to z about x, and stays there about z.
    let moved = volume.transform.transform_point3(DVec3::Y);
    assert!(
        (moved - DVec3::new(1.0, 2.0, 5.0)).length() < 1e-12,
        "{moved}"
    );

    let [fog] = scene.fogs.as_slice() else {
        panic!("one fog");
    };
    assert_eq!(fog.optics.phase, Phase::HenyeyGreenstein(0.8));
    assert_eq!(fog.bounds.unwrap()[1], DVec3::new(10.0, 5.0, 10.0));

    let kinds: Vec<_> = scene
        .lights
        .iter()
        .map(|l| {
            format!("{l:?}")
                .split([' ', '{'])
                .next()
                .unwrap()
                .to_owned()
        })
        .collect();
    assert_eq!(
        kinds,
        ["Sun", "Sky", "SkyImage", "Point", "Spot", "Quad", "Sphere"]
    );
    let Light::Sun { direction, .. } = &scene.lights[0] else {
        panic!("sun");
    };
    assert_eq!(*direction, DVec3::NEG_Y);
    let Light::Spot { direction, .. } = &scene.lights[4] else {
        panic!("spot");
    };
    assert_eq!(*direction, DVec3::NEG_Y);

    let [object] = scene.objects.as_slice() else {
        panic!("one object");
    };
    assert_eq!(object.name, "object 1");
    assert!(
        matches!(object.shape, Shape::Mesh { .. }),
        "{:?}",
        object.shape
    );
    assert_eq!(object.interior.unwrap().phase, Phase::Rayleigh);
}

#[test]
fn objects_in_every_shape_and_material() {
    let text = r#"
[[object]]
name = "ball"
shape = { sphere = { center = [0, 0, 0], radius = 1 } }
material = { glass = { ior = 1.33 } }
interior = { extinction = 1, albedo = 0 }
[[object]]
shape = { quad = { corner = [0, 0, 0], edge_u = [1, 0, 0], edge_v = [0, 1, 0] } }
material = { mirror = {} }
[[object]]
shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
material = "interface"
[[object]]
shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
material = { conductor = { metal = "gold", roughness = 0.1 } }
[[object]]
shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
material = { conductor = { eta = 0.2, k = [3, 2, 1] } }
[[object]]
shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
material = { emissive = { radiance = 2 } }
[[object]]
shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }
material = { diffuse = { texture = "wood.png" } }
"#;
    let scene = load(&format!("{CAMERA}{text}"), &["wood.png"]);
    assert_eq!(scene.objects[0].name, "ball");
    let materials: Vec<_> = scene.objects.iter().map(|o| &o.material).collect();
    assert!(
        matches!(
            materials.as_slice(),
            [
                Material::Glass { ior: 1.33, roughness: 0.0 },
                Material::Mirror { reflectance: Vec3::ONE },
                Material::Interface,
                Material::Conductor { roughness: 0.1, .. },
                Material::Conductor { k: Vec3 { x: 3.0, y: 2.0, z: 1.0 }, .. },
                Material::Emissive { radiance },
                Material::Diffuse { reflectance: Vec3::ONE, texture: Some(_) },
            ] if *radiance == Vec3::splat(2.0)
        ),
        "{materials:?}"
    );
}

#[test]
fn defaults() {
    let scene = load(CAMERA, &[]);
    assert_eq!(scene.camera.up, DVec3::Y);
    assert_eq!(scene.camera.vertical_fov, 40.0);
    assert_eq!(scene.camera.resolution, [640, 480]);
    assert_eq!(scene.settings.photons, 1_000_000);
    assert!(
        scene.volumes.is_empty() && scene.fogs.is_empty(),
        "nothing there"
    );
}

/// What a picture says of its making makes it again.
#[test]
fn settings_are_written_as_they_are_read() {
    let text = "[render]\nmethod = \"path\"\nspp = 7\nseed = 18446744073709551615\n\
                march = { step = 0.25 }\nkernel = \"constant\"\nexposure = -1.5\nphotons = 2e6\n\
                search = \"radius\"\n";
    let scene = load(&format!("{CAMERA}{text}"), &[]);
    assert_eq!(scene.settings.seed, u64::MAX);
    assert_eq!(scene.settings.photons, 2_000_000);
    let written = settings_text(&scene.settings);
    let again = load(&format!("{CAMERA}{written}"), &[]);
    assert_eq!(settings_text(&again.settings), written);
    assert_eq!(again.settings.march, March::Step(0.25));
    assert_eq!(again.settings.exposure, -1.5);
    assert_eq!(again.settings.search, Search::Radius);
}

#[test]
fn sequences_need_not_be_there() {
    let volume =
        |file: &str| format!("{CAMERA}[[volume]]\nfile = \"{file}\"\nextinction = 1\nalbedo = 1\n");
    for file in ["smoke.####.vdb", "smoke.%04d.vdb"] {
        assert!(
            load(&volume(file), &[]).volumes[0].file.ends_with(file),
            "{file}"
        );
    }
    assert_eq!(
        faults(&volume("smoke.0001.vdb")),
        r#"the scene a.toml has a fault

at a.toml, line 5, column 8
  |
5 | file = "smoke.0001.vdb"
  |        ^^^^^^^^^^^^^^^^
smoke.0001.vdb is not there"#
    );
}

#[test]
fn all_faults_at_once() {
    let text = r#"[camera]
position = [0, 0, 4]
look_at = [0, 0]
fov = 40

[render]
method = "beams"
photons = 0

[[volume]]
file = "smoke.vdb"
extinction = -12.0
albedo = [0.8, 1.2, "x"]
	phase = { henyey_greenstein = { g = 1.0 } }
albdeo = 0.5

[[light]]
sun = { direction = [0, 0, 0] }
"#;
    let expected = r#"the scene a.toml has 11 faults

at a.toml, line 3, column 11
  |
3 | look_at = [0, 0]
  |           ^^^^^^
`look_at` has 2 elements; it has to be [x, y, z]

at a.toml, line 4, column 1
  |
4 | fov = 40
  | ^^^
unknown key `fov`; did you mean `vertical_fov`?

at a.toml, line 7, column 10
  |
7 | method = "beams"
  |          ^^^^^^^
`beams` is no choice for `method`; did you mean `beam`?

at a.toml, line 8, column 11
  |
8 | photons = 0
  |           ^
`photons` is 0; it has to be a whole number from 1 to 10000000000

at a.toml, line 12, column 14
   |
12 | extinction = -12.0
   |              ^^^^^
`extinction` is -12; it has to be 0 or more

at a.toml, line 13, column 16
   |
13 | albedo = [0.8, 1.2, "x"]
   |                ^^^
`albedo` is 1.2; it has to be from 0 to 1

at a.toml, line 13, column 21
   |
13 | albedo = [0.8, 1.2, "x"]
   |                     ^^^
`albedo` is a string; it has to be a number

at a.toml, line 14, column 38
   |
14 | 	phase = { henyey_greenstein = { g = 1.0 } }
   | 	                                    ^^^
`g` is 1; it has to be above -1 and below 1

at a.toml, line 15, column 1
   |
15 | albdeo = 0.5
   | ^^^^^^
unknown key `albdeo`; did you mean `albedo`?

at a.toml, line 18, column 7
   |
18 | sun = { direction = [0, 0, 0] }
   |       ^^^^^^^^^^^^^^^^^^^^^^^^^
`irradiance` is missing in `sun`

at a.toml, line 18, column 21
   |
18 | sun = { direction = [0, 0, 0] }
   |                     ^^^^^^^^^
`direction` has no length, hence no direction"#;
    assert_eq!(faults(text), expected);
}

/// The last line of the message of a scene with one fault.
fn fault(text: &str) -> String {
    let all = faults(text);
    assert!(all.contains("has a fault\n"), "more than one: {all}");
    all.lines().last().unwrap_or_default().to_owned()
}

#[test]
fn one_fault_each() {
    let with = |text: &str| fault(&format!("{CAMERA}{text}"));
    for (text, message) in [
        (
            "lens = { radius = 0, focus_distance = 1 }",
            "`radius` is 0; it has to be above 0",
        ),
        (
            "up = [0, 0, 1]",
            "`up` is along the view; it has to point to a side of it",
        ),
        (
            "resolution = [640, 20000]",
            "`resolution` is 20000; it has to be a whole number from 1 to 16384",
        ),
        (
            "resolution = 640",
            "`resolution` is a whole number; it has to be [width, height]",
        ),
        (
            "vertical_fov = nan",
            "`vertical_fov` is NaN; it has to be finite",
        ),
        (
            "[render]\npasses = 2.5",
            "`passes` is 2.5; it has to be a whole number from 1 to 1000000",
        ),
        (
            "[render]\nmarch = \"step\"",
            "`step` needs values: march = { step = { .. } }",
        ),
        (
            "[render]\nmarch = { step = -1 }",
            "`step` is -1; it has to be above 0",
        ),
        (
            "[fog]\nextinction = 1",
            "`fog` is a table; it has to be a list: write [[fog]]",
        ),
        ("[[fogs]]", "unknown key `fogs`; did you mean `fog`?"),
        ("[[fog]]\nextinction = 1", "`albedo` is missing in `fog`"),
        (
            "[[fog]]\nextinction = 1e39\nalbedo = 1",
            "`extinction` is 1e39; that is too large",
        ),
        (
            "[[fog]]\nextinction = 1\nalbedo = 1\nbox = { min = [0, 0, 0], max = [1, 0, 1] }",
            "`max` has to lie above `min` along every axis",
        ),
        (
            "[[fog]]\nextinction = 1\nalbedo = 1\nphase = \"mie\"",
            "`mie` is no choice for `phase`; possible: isotropic, rayleigh, henyey_greenstein",
        ),
        (
            "[[light]]\nlamp = {}",
            "`lamp` is no choice for `light`; possible: sun, sky, point, spot, quad, disk, sphere",
        ),
        (
            "[[light]]\nsky = { radiance = 1 }\nsun = {}",
            "`light` takes exactly one of: sun, sky, point, spot, quad, disk, sphere; found: sky, sun",
        ),
        (
            "[[light]]\nquad = { corner = [0, 0, 0], edge_u = [1, 0, 0], edge_v = [-2, 0, 0], radiance = 1 }",
            "`edge_v` is parallel to `edge_u`; they have to span an area",
        ),
        (
            "[[light]]\nspot = { position = [0, 0, 0], look_at = [1, 0, 0], power = 1, cone_angle = 3, penumbra = 4 }",
            "`penumbra` is 4; it lies inside the cone, so it has to be from 0 to `cone_angle`, 3",
        ),
        (
            "[[light]]\nsky = { file = \"no.exr\" }",
            "no.exr is not there",
        ),
        (
            "[[volume]]\nfile = \"smoke.vdb\"\nextinction = 1\nalbedo = 1\ntransform = { scale = [1, 0, 1] }",
            "`scale` is 0; it has to be other than 0",
        ),
        (
            "[[object]]\nshape = { mesh = { file = \"smoke.vdb\" } }\nmaterial = \"interface\"",
            "a mesh has to be .obj, .ply, .gltf or .glb",
        ),
        (
            "[[object]]\nshape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }\nmaterial = { conductor = { metal = \"gold\", k = 1 } }",
            "a conductor takes either `metal` or `eta` and `k`, not `k` with it",
        ),
        ("x = {", "unclosed inline table, expected `}`"),
    ] {
        assert_eq!(with(text), message, "{text}");
    }
    assert_eq!(fault("\n\n"), "`camera` is missing in the scene");
}

/// What serde's internally tagged or flattened forms would lose: the place of a fault deep inside.
#[test]
fn faults_deep_inside_keep_their_place() {
    let text = format!("{CAMERA}[[light]]\n[light.spot]\nposition = [0, 1, 'é', 3]\n");
    let all = faults(&text);
    assert!(all.contains("at a.toml, line 6, column 12\n"), "{all}");
}

#[test]
fn a_missing_file_is_named() {
    let error = Scene::load(Path::new("no/such.toml")).unwrap_err();
    let chain = format!("{:#}", anyhow::Error::from(error));
    assert_eq!(
        chain,
        "cannot read the scene no/such.toml: No such file or directory (os error 2)"
    );
}
