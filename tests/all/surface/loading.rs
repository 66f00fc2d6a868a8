//! Meshes and textures from files: every format, every fault.

use std::path::PathBuf;

use glam::{DAffine3, DVec3, Vec3};
use rand::Rng;
use vpm_vdb::scene::{Material, Object, Optics, Phase, Rgb, Shape};
use vpm_vdb::surface::{Mesh, SurfaceError, SurfaceWarning, Surfaces};

use super::{WHITE, direction, generator, object, uniforms};

/// A tetrahedron that faces outwards.
const CORNERS: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a scratch folder"))
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let file = self.0.path().join(name);
        std::fs::write(&file, content).expect("the scratch folder is writable");
        file
    }

    fn error(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let file = self.write(name, content);
        let message = Mesh::load(&file)
            .expect_err("the file is faulty")
            .to_string();
        message.replace(&file.display().to_string(), name)
    }
}

fn obj() -> String {
    let vertices: String = CORNERS.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let faces = FACES.map(|f| f.map(|i| (i + 1).to_string()).join(" "));
    format!(
        "mtllib none.mtl\no thing\n{vertices}usemtl red\nf {}\n",
        faces.join("\nf ")
    )
}

fn ply_header(format: &str, count: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face 4\n\
         property list uchar {count} vertex_indices\nend_header\n"
    )
}

fn ply_ascii() -> String {
    let vertices = CORNERS.map(|[x, y, z]| format!("{x} {y} {z} 7\n")).concat();
    let faces = FACES.map(|[a, b, c]| format!("3 {a} {b} {c}\n")).concat();
    ply_header("ascii", "int") + &vertices + &faces
}

fn ply_binary(big: bool) -> Vec<u8> {
    let format = if big {
        "binary_big_endian"
    } else {
        "binary_little_endian"
    };
    let mut bytes = ply_header(format, "uint").into_bytes();
    for corner in CORNERS {
        for x in corner {
            bytes.extend(if big {
                x.to_be_bytes()
            } else {
                x.to_le_bytes()
            });
        }
        bytes.push(7);
    }
    for face in FACES {
        bytes.push(3);
        for i in face {
            bytes.extend(if big {
                i.to_be_bytes()
            } else {
                i.to_le_bytes()
            });
        }
    }
    bytes
}

fn gltf_buffer() -> Vec<u8> {
    let mut bytes: Vec<u8> = CORNERS
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    bytes.extend(
        FACES
            .as_flattened()
            .iter()
            .flat_map(|i| (*i as u16).to_le_bytes()),
    );
    bytes
}

/// The node doubles and mirrors in x, and its child moves up.
fn gltf(uri: &str, count: u32) -> String {
    let buffer = if uri.is_empty() {
        r#"{"byteLength":72}"#.to_owned()
    } else {
        format!(r#"{{"byteLength":72,"uri":"{uri}"}}"#)
    };
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"scale":[-2,2,2],"children":[1]}},{{"mesh":0,"translation":[0,0.5,0]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{buffer}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":24}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}},
        {{"bufferView":1,"componentType":5123,"count":{count},"type":"SCALAR"}}]}}"#
    )
}

fn glb() -> Vec<u8> {
    let mut json = gltf("", 12).into_bytes();
    while !json.len().is_multiple_of(4) {
        json.push(b' ');
    }
    let binary = gltf_buffer();
    let mut bytes = b"glTF".to_vec();
    let word = |n: usize| (n as u32).to_le_bytes();
    bytes.extend(word(2));
    bytes.extend(word(12 + 8 + json.len() + 8 + binary.len()));
    bytes.extend(word(json.len()));
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend(word(binary.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

#[test]
fn every_format_holds_the_same_tetrahedron() {
    let folder = Folder::new();
    let corners = CORNERS.map(|c| Vec3::from_array(c).as_dvec3());
    for (name, content) in [
        ("a.obj", obj().into_bytes()),
        ("b.ply", ply_ascii().into_bytes()),
        ("c.ply", ply_binary(false)),
        ("d.PLY", ply_binary(true)),
    ] {
        let mesh = Mesh::load(&folder.write(name, content)).expect(name);
        // .obj numbers vertices in the order of use.
        let placed = |f: &[u32; 3]| f.map(|i| mesh.positions[i as usize]);
        let expected = FACES.map(|f| f.map(|i| corners[i as usize]));
        assert_eq!(
            mesh.triangles.iter().map(placed).collect::<Vec<_>>(),
            expected,
            "{name}"
        );
        assert!(mesh.normals.is_empty() && mesh.uvs.is_empty());
    }
    folder.write("some data.bin", gltf_buffer());
    for (name, content) in [
        ("e.gltf", gltf("some%20data.bin", 12).into_bytes()),
        ("f.glb", glb()),
    ] {
        let mesh = Mesh::load(&folder.write(name, content)).expect(name);
        let moved = corners.map(|c| DVec3::new(-2.0 * c.x, 2.0 * c.y + 1.0, 2.0 * c.z));
        assert_eq!(mesh.positions, moved, "{name}");
        // Mirrored, so turned.
        assert_eq!(mesh.triangles, FACES.map(|[a, b, c]| [a, c, b]), "{name}");
    }
}

#[test]
fn normals_coordinates_and_polygons() {
    let folder = Folder::new();
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                vn 0 0.6 0.8\nf 1/1/1 2/2/1 3/3/1 4/4/1\n";
    let file = folder.write("square.obj", text);
    let mesh = Mesh::load(&file).expect("a square");
    assert_eq!(mesh.triangles.len(), 2, "a polygon becomes a fan");
    let shape = Shape::Mesh { file };
    let mut stretched = object(shape, WHITE);
    stretched.transform = DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
    let surfaces = Surfaces::build(&[stretched], DVec3::ZERO).expect("it is sound");
    let hit = surfaces
        .intersect(Vec3::new(0.25, 1.5, 1.0), Vec3::NEG_Z, 2.0)
        .expect("the square lies below");
    assert_eq!(hit.normal, Vec3::Z);
    // Normals go by the inverse transpose: (0, 0.6 / 2, 0.8).
    let expected = Vec3::new(0.0, 0.3, 0.8).normalize();
    assert!(
        hit.shading_normal.abs_diff_eq(expected, 1e-6),
        "{}",
        hit.shading_normal
    );
    assert!(
        hit.uv.abs_diff_eq(glam::Vec2::new(0.25, 0.75), 1e-6),
        "{}",
        hit.uv
    );
}

#[test]
fn faults_are_named() {
    let folder = Folder::new();
    let missing = Mesh::load(&folder.0.path().join("none.ply")).expect_err("no such file");
    let message = missing.to_string();
    assert!(message.contains("none.ply: No such file"), "{message}");
    assert_eq!(
        folder.error("a.stl", ""),
        "mesh a.stl: cannot read `.stl` files; .obj, .ply, .gltf and .glb can be read"
    );
    assert_eq!(
        folder.error("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        "mesh a.obj: has no triangles"
    );
    assert_eq!(
        folder.error("b.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n"),
        "mesh b.obj: position of vertex 2 (counted from 0) is [0, NaN, 0]"
    );
    assert_eq!(
        folder.error("c.ply", ply_ascii().replace("3 1 2 3", "3 1 2 9")),
        "mesh c.ply: triangle 3 uses vertex 9, but there are 4"
    );
    let what = folder.error("d.ply", ply_ascii().replace("3 1 2 3", "3 1 -2 3"));
    assert!(
        what.contains("face 3 has a vertex index that is not"),
        "{what}"
    );
    let what = folder.error("e.ply", ply_ascii().replace("float z", "float w"));
    assert_eq!(what, "mesh e.ply: vertices have no `z`");
    folder.write("short.bin", &gltf_buffer()[..60]);
    let what = folder.error("f.gltf", gltf("short.bin", 12));
    assert_eq!(what, "mesh f.gltf: buffer 0 has 60 bytes of 72");
    folder.write("data.bin", gltf_buffer());
    let what = folder.error("g.gltf", gltf("data.bin", 999));
    assert_eq!(what, "mesh g.gltf: accessor 1: reaches beyond its buffer");
    let vast = "ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n";
    let what = folder.error("v.ply", vast);
    assert_eq!(
        what,
        "mesh v.ply: 4000000000 of `vertex` do not fit a file of 58 bytes"
    );
    // Cut short anywhere, a file is an error and nothing worse.
    for (name, whole) in [("h.ply", ply_binary(false)), ("i.glb", glb())] {
        for cut in 0..whole.len() {
            folder.error(name, &whole[..cut]);
        }
    }
}

#[test]
fn no_byte_of_a_file_can_bring_the_reader_down() {
    let folder = Folder::new();
    folder.write("data.bin", gltf_buffer());
    let mut rng = generator(91);
    for (name, whole) in [
        ("a.obj", obj().into_bytes()),
        ("a.ply", ply_ascii().into_bytes()),
        ("b.ply", ply_binary(false)),
        ("a.gltf", gltf("data.bin", 12).into_bytes()),
        ("a.glb", glb()),
    ] {
        let mut sound = 0;
        for _ in 0..3000 {
            let mut bytes = whole.clone();
            for _ in 0..1 + rng.next_u32() % 3 {
                let at = rng.next_u32() as usize % bytes.len();
                bytes[at] = match rng.next_u32() % 3 {
                    0 => rng.next_u32() as u8,
                    1 => b'0' + (rng.next_u32() % 10) as u8,
                    _ => bytes[at] ^ (1 << (rng.next_u32() % 8)),
                };
            }
            sound += u32::from(Mesh::load(&folder.write(name, bytes)).is_ok());
        }
        assert!(sound > 0, "{name}: some changes are harmless");
    }
}

#[test]
fn degenerate_triangles_are_dropped_and_counted() {
    let folder = Folder::new();
    let file = folder.write("flat.obj", obj() + "f 1 1 2\nf 1 2 2\n");
    let thing = object(Shape::Mesh { file }, WHITE);
    let surfaces = Surfaces::build(&[thing], DVec3::ZERO).expect("the rest is sound");
    let [SurfaceWarning::DegenerateTriangles { count, .. }] = surfaces.warnings() else {
        panic!("{:?}", surfaces.warnings());
    };
    assert_eq!(*count, 2);
    let file = folder.write("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    let error = Surfaces::build(&[object(Shape::Mesh { file }, WHITE)], DVec3::ZERO);
    let error = error.expect_err("a line is no surface").to_string();
    assert_eq!(error, "object `thing`: none of its triangles has an area");
}

#[test]
fn closed_meshes_face_outwards() {
    let folder = Folder::new();
    let inside_out = FACES.map(|f| f.map(|i| (i + 1).to_string()).join(" "));
    let text = obj();
    let (head, _) = text.split_once("f ").expect("it has faces");
    let turned: String = inside_out
        .iter()
        .map(|f| format!("f {}\n", f.split(' ').rev().collect::<Vec<_>>().join(" ")))
        .collect();
    let file = folder.write("turned.obj", format!("{head}{turned}"));
    let mut thing = object(Shape::Mesh { file }, Material::Interface);
    thing.interior = Some(Optics {
        extinction: Rgb::ONE,
        albedo: Rgb::ZERO,
        phase: Phase::Isotropic,
    });
    let surfaces = Surfaces::build(&[thing], DVec3::ZERO).expect("it is closed");
    assert!(matches!(
        surfaces.warnings(),
        [SurfaceWarning::TurnedOutwards { .. }]
    ));
    assert!(surfaces.encloses(0));
    let hit = surfaces.intersect(Vec3::splat(2.0), -Vec3::ONE.normalize(), 10.0);
    assert!(hit.expect("it lies ahead").front);
    assert_eq!(surfaces.inside_at(Vec3::splat(0.1)).owner(), Some(0));
    assert_eq!(surfaces.inside_at(Vec3::splat(0.5)).owner(), None);
}

#[test]
fn textures_colour_what_they_cover() {
    let folder = Folder::new();
    let file = folder.0.path().join("colours.png");
    let out = std::fs::File::create(&file).expect("the scratch folder is writable");
    let mut encoder = png::Encoder::new(out, 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().expect("a small picture");
    writer
        .write_image_data(&[255, 0, 0, 0, 255, 0])
        .expect("two texels");
    drop(writer);
    let textured = |texture: PathBuf, shape: Shape| Object {
        material: Material::Diffuse {
            reflectance: Rgb::splat(0.5),
            texture: Some(texture),
        },
        ..object(shape, WHITE)
    };
    let quad = Shape::Quad {
        corner: DVec3::ZERO,
        edge_u: DVec3::X,
        edge_v: DVec3::Y,
    };
    let surfaces = Surfaces::build(&[textured(file.clone(), quad.clone())], DVec3::ZERO);
    let surfaces = surfaces.expect("a textured square");
    let albedo = |x: f32| {
        let hit = surfaces.intersect(Vec3::new(x, 0.5, 1.0), Vec3::NEG_Z, 2.0)?;
        let bsdf = surfaces.bsdf(&hit);
        let up = bsdf.gather(Vec3::NEG_Z, Vec3::Z) * std::f32::consts::PI;
        Some((up * 1000.0).round() / 1000.0)
    };
    assert_eq!(albedo(0.25), Some(Rgb::new(0.5, 0.0, 0.0)));
    assert_eq!(albedo(0.75), Some(Rgb::new(0.0, 0.5, 0.0)));
    // Missing picture, not a picture, nowhere to put it.
    let build = |object| match Surfaces::build(&[object], DVec3::ZERO) {
        Err(error) => error,
        Ok(_) => panic!("the object is faulty"),
    };
    let missing = build(textured("nowhere.png".into(), quad.clone()));
    assert!(matches!(missing, SurfaceError::Texture { .. }), "{missing}");
    let nonsense = build(textured(folder.write("n.png", "nonsense"), quad));
    assert!(
        matches!(nonsense, SurfaceError::Texture { .. }),
        "{nonsense}"
    );
    let bare = build(textured(
        file,
        Shape::Mesh {
            file: folder.write("bare.obj", obj()),
        },
    ));
    assert_eq!(
        bare.to_string(),
        "object `thing`: has a texture, but the mesh has no texture coordinates"
    );
}

#[test]
fn shapes_without_extent_are_refused() {
    let message = |shape| {
        let error = Surfaces::build(&[object(shape, WHITE)], DVec3::ZERO);
        error.expect_err("it has no extent").to_string()
    };
    let flat_box = Shape::Box {
        min: DVec3::ZERO,
        max: DVec3::new(1.0, 0.0, 1.0),
    };
    assert!(message(flat_box).contains("below its max"));
    let center = DVec3::ZERO;
    for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(message(Shape::Sphere { center, radius }).contains("radius"));
    }
    assert!(
        message(Shape::Sphere {
            center,
            radius: 1e20
        })
        .contains("beyond the 1e15 m")
    );
    let mut squashed = object(super::cube(1.0), WHITE);
    squashed.transform = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let error = Surfaces::build(&[squashed], DVec3::ZERO).expect_err("it is flat");
    assert!(
        matches!(error, SurfaceError::SingularTransform { .. }),
        "{error}"
    );
}

#[test]
fn the_meshes_of_the_example_scenes_are_closed() {
    // Each can hold a medium, needs no repair, and lets no ray out.
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes");
    let mut rng = generator(92);
    let mut meshes = 0;
    for entry in std::fs::read_dir(folder).expect("the folder is part of the repository") {
        let file = entry.expect("it can be listed").path();
        if file.extension().is_none_or(|e| e != "ply") {
            continue;
        }
        let name = file.display().to_string();
        let mut thing = object(Shape::Mesh { file }, Material::Interface);
        thing.interior = Some(Optics {
            extinction: Rgb::ONE,
            albedo: Rgb::ONE,
            phase: Phase::Isotropic,
        });
        let surfaces = Surfaces::build(&[thing], DVec3::ZERO).expect(&name);
        assert_eq!(surfaces.warnings(), [], "{name}");
        let (min, max) = surfaces.bounds().expect("it has triangles");
        let mut inside = 0;
        for _ in 0..200_000 {
            let p = min + Vec3::from_array(uniforms(&mut rng)) * (max - min);
            if inside < 2000 && surfaces.inside_at(p).owner().is_some() {
                inside += 1;
                let hit = surfaces.intersect(p, direction(&mut rng), f32::INFINITY);
                assert!(hit.is_some(), "{name}: leaks from {p}");
            }
            if inside == 2000 {
                break;
            }
        }
        assert!(inside > 100, "{name}: {inside} points inside");
        meshes += 1;
    }
    assert!(meshes >= 9, "only {meshes} meshes");
}
