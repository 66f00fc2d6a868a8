//! Bad meshes, textures, skies and slides through the command: what it says, and that it stops.

use std::fs;
use std::path::Path;

use crate::cli::{run, stderr};

const SCENE: &str = "[camera]\nposition = [0, 0, 5]\nlook_at = [0, 0, 0]\nvertical_fov = 40\n\
    resolution = [8, 8]\n[render]\npasses = 1\nphotons = 100\n\
    [[light]]\npoint = { position = [0, 2, 2], power = 1 }\n";

/// An object called `thing`.
fn thing(shape: &str, material: &str) -> String {
    format!("[[object]]\nname = \"thing\"\nshape = {{ {shape} }}\nmaterial = {{ {material} }}\n")
}

fn mesh(file: &str, material: &str) -> String {
    thing(&format!("mesh = {{ file = \"{file}\" }}"), material)
}

/// Renders the scene with something added: exit code and what was said.
fn said(folder: &Path, more: &str) -> (i32, String) {
    fs::write(folder.join("s.toml"), format!("{SCENE}{more}")).expect("a scene");
    let out = run(folder, &["render", "s.toml", "-o", "o.exr"]);
    (out.status.code().expect("an exit code"), stderr(&out))
}

const GREY: &str = "diffuse = { reflectance = 0.5 }";
const GLASS: &str = "glass = { ior = 1.5 }";
const SQUARE: &str = "quad = { corner = [0, 0, 0], edge_u = [1, 0, 0], edge_v = [0, 1, 0] }";
const INTERIOR: &str = "interior = { extinction = 1, albedo = 0.5 }\n";

/// Meshes of all kinds of fault, text that calls itself a picture, and a picture.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("scratch folder");
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).expect(name);
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let three = format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\n");
    write("open.obj", &three);
    write("closed.obj", &format!("{three}f 1 4 3\n"));
    write("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n");
    write("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    write(
        "partly.obj",
        &format!("{corners}v 2 0 0\nf 1 2 5\nf 1 2 4\n"),
    );
    write("text.exr", "not a picture");
    write("text.png", "not a picture");
    vpm_vdb::image::write_rgb8(&dir.path().join("white.png"), 2, 2, &[255; 12]).expect("a PNG");
    dir
}

#[test]
fn bad_surfaces_are_refused_by_name() {
    let dir = folder();
    let interface = "[[object]]\nname = \"thing\"\nshape = { mesh = { file = \"open.obj\" } }\n\
        material = \"interface\"\n";
    for (more, message) in [
        (
            format!("{interface}{INTERIOR}"),
            "error: object `thing` (open.obj): has an interior medium but is not closed: 3 edges \
             have not exactly two triangles that pass them in opposite directions; close the mesh \
             or drop `interior`\n",
        ),
        (
            mesh("nan.obj", GREY),
            "error: object `thing`: mesh nan.obj: position of vertex 1 (counted from 0) is \
             [1, NaN, 0]\n",
        ),
        (
            mesh("flat.obj", GREY),
            "error: object `thing`: none of its triangles has an area\n",
        ),
        (
            mesh("none.obj", GREY),
            "error: the scene s.toml has a fault\n\nat s.toml, line 13, column 27\n   |\n\
             13 | shape = { mesh = { file = \"none.obj\" } }\n   |                           \
             ^^^^^^^^^^\nnone.obj is not there\n",
        ),
        (
            mesh("closed.obj", "diffuse = { texture = \"none.png\" }"),
            "error: the scene s.toml has a fault\n\nat s.toml, line 14, column 36\n   |\n\
             14 | material = { diffuse = { texture = \"none.png\" } }\n   |                        \
             \x20           ^^^^^^^^^^\nnone.png is not there\n",
        ),
        (
            thing(SQUARE, "diffuse = { texture = \"text.png\" }"),
            "error: object `thing`: texture text.png: Invalid PNG signature.; PNG files can be \
             read\n",
        ),
        (
            mesh("closed.obj", "diffuse = { texture = \"white.png\" }"),
            "error: object `thing`: has a texture, but the mesh has no texture coordinates\n",
        ),
    ] {
        assert_eq!(said(dir.path(), &more), (2, message.to_owned()), "{more}");
    }
}

#[test]
fn bad_pictures_of_lights_are_refused() {
    let dir = folder();
    let spot = |image: &str| {
        format!(
            "[[light]]\n[light.spot]\nposition = [0, 3, 0]\nlook_at = [0, 0, 0]\npower = 1\n\
             cone_angle = 20\nimage = \"{image}\"\n"
        )
    };
    for (more, message) in [
        (
            "[[light]]\nsky = { file = \"none.exr\" }\n".to_owned(),
            "error: the scene s.toml has a fault\n\nat s.toml, line 12, column 16\n   |\n\
             12 | sky = { file = \"none.exr\" }\n   |                ^^^^^^^^^^\n\
             none.exr is not there\n",
        ),
        (
            "[[light]]\nsky = { file = \"text.exr\" }\n".to_owned(),
            "error: sky light: cannot read text.exr as EXR: invalid: file identifier missing\n",
        ),
        (
            "[[light]]\nsky = { file = \"white.png\" }\n".to_owned(),
            "error: sky light: cannot read white.png as EXR: invalid: file identifier missing\n",
        ),
        (
            spot("none.png"),
            "error: the scene s.toml has a fault\n\nat s.toml, line 17, column 9\n   |\n\
             17 | image = \"none.png\"\n   |         ^^^^^^^^^^\nnone.png is not there\n",
        ),
        (
            spot("text.png"),
            "error: spot light: texture text.png: Invalid PNG signature.; PNG files can be read\n",
        ),
    ] {
        assert_eq!(said(dir.path(), &more), (2, message.to_owned()), "{more}");
    }
}

/// A fog whose mean free path positions do not resolve is rendered with a word; where it only
/// absorbs, or is a tenth as dense, there is nothing to say.
#[test]
fn unresolved_scattering_is_told() {
    let dir = folder();
    let said = |extinction: &str, albedo: &str| {
        let fog = format!(
            "[[fog]]\nextinction = {extinction}\nalbedo = {albedo}\n\
             box = {{ min = [-1, -1, -1], max = [1, 1, 1] }}\n"
        );
        said(dir.path(), &fog)
    };
    let warning = "warning: mean free path of 1.0e-5 m in a medium that reaches 1.732 m from the \
                   middle of the scene: positions resolve 1.7e-5 m there, and its scattered light \
                   comes out too dark\n";
    assert_eq!(said("1e5", "0.5"), (0, warning.to_owned()));
    assert_eq!(said("1e5", "0"), (0, String::new()));
    assert_eq!(said("1e4", "0.5"), (0, String::new()));
}

/// What can be rendered all the same is, with a word on what was done. Glass that overlaps glass
/// has a rule (the later object owns the place, `surface::interior`) and needs no word.
#[test]
fn doubtful_surfaces_render_with_a_warning() {
    let dir = folder();
    let ball = |x: i32, more: &str| {
        let shape = format!("sphere = {{ center = [{x}, 0, 0], radius = 1 }}");
        format!("{}{more}", thing(&shape, GLASS))
    };
    for (more, warning) in [
        (
            mesh("open.obj", GLASS),
            "warning: object `thing`: not closed (3 open edges), so it has no inside\n",
        ),
        (
            mesh("partly.obj", GREY),
            "warning: object `thing`: 1 triangles without area left out\n",
        ),
        (
            format!("{}{INTERIOR}", mesh("closed.obj", GREY)),
            "warning: object `thing`: no light passes its material, so its interior is never seen\n",
        ),
        (ball(0, INTERIOR) + &ball(1, ""), ""),
    ] {
        assert_eq!(said(dir.path(), &more), (0, warning.to_owned()), "{more}");
    }
}
