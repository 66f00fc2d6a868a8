//! glTF 2.0, .gltf with its buffers beside it or inside it, and .glb, through gltf.
//!
//! Every triangle list, strip and fan of the default scene, moved by the transforms of its nodes,
//! becomes one mesh. Materials, skins, morph targets, sparse accessors and compressed buffers are
//! not read; a file that requires them is refused. Every accessor is checked against its buffer
//! before it is read, since the crate's iterators index without asking.

use std::path::Path;

use glam::{DMat4, DVec3, Vec2, Vec3};
use gltf::mesh::Mode;

use super::{Mesh, MeshError, malformed};

pub(super) fn load(file: &Path) -> Result<Mesh, MeshError> {
    let bytes = read(file)?;
    let gltf::Gltf { document, blob } =
        gltf::Gltf::from_slice(&bytes).map_err(|e| malformed(file, e))?;
    let buffers = buffers(file, &document, blob)?;
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next())
        .ok_or_else(|| malformed(file, "has no scene"))?;
    let mut mesh = Mesh::default();
    // A stack instead of recursion: the file may nest as deep as it likes. The format forbids
    // cycles; a bound on the visits catches one.
    let mut visits = 0;
    let mut nodes: Vec<(gltf::Node<'_>, DMat4)> =
        scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((node, parent)) = nodes.pop() {
        visits += 1;
        if visits > document.nodes().len() {
            return Err(malformed(
                file,
                "a node is its own ancestor, or has two parents",
            ));
        }
        let local = node
            .transform()
            .matrix()
            .map(|column| column.map(f64::from));
        let world = parent * DMat4::from_cols_array_2d(&local);
        nodes.extend(node.children().map(|child| (child, world)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            append(&mut mesh, file, &primitive, &buffers, world)?;
        }
    }
    Ok(mesh)
}

fn append(
    mesh: &mut Mesh,
    file: &Path,
    primitive: &gltf::Primitive<'_>,
    buffers: &[Vec<u8>],
    world: DMat4,
) -> Result<(), MeshError> {
    let indices = primitive.indices();
    for accessor in primitive.attributes().map(|(_, a)| a).chain(indices) {
        check(file, &accessor, buffers)?;
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
    let Some(positions) = reader.read_positions() else {
        return Ok(());
    };
    let first = u32::try_from(mesh.positions.len())
        .map_err(|_| malformed(file, "more than 4294967295 vertices"))?;
    let before = mesh.positions.len();
    mesh.positions
        .extend(positions.map(|p| world.transform_point3(Vec3::from_array(p).as_dvec3())));
    let count = mesh.positions.len() - before;
    if let Some(normals) = reader.read_normals() {
        let turn = glam::DMat3::from_mat4(world).inverse().transpose();
        mesh.normals.extend(normals.map(|n| {
            (turn * Vec3::from_array(n).as_dvec3())
                .normalize_or_zero()
                .as_vec3()
        }));
    }
    if let Some(uvs) = reader.read_tex_coords(0) {
        mesh.uvs.extend(uvs.into_f32().map(Vec2::from_array));
    }
    let corners: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..count as u32).collect(),
    };
    let mirrored = DVec3::dot(
        world.x_axis.truncate().cross(world.y_axis.truncate()),
        world.z_axis.truncate(),
    ) < 0.0;
    let mut push = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|i| i.saturating_add(first));
        mesh.triangles
            .push(if mirrored { [a, c, b] } else { [a, b, c] });
    };
    match primitive.mode() {
        Mode::Triangles => corners.as_chunks::<3>().0.iter().for_each(|t| push(*t)),
        Mode::TriangleStrip => {
            for (i, t) in corners.windows(3).enumerate() {
                push(if i % 2 == 0 {
                    [t[0], t[1], t[2]]
                } else {
                    [t[1], t[0], t[2]]
                });
            }
        }
        Mode::TriangleFan => {
            for pair in corners.windows(2).skip(1) {
                push([corners[0], pair[0], pair[1]]);
            }
        }
        // Points and lines are no surface.
        _ => {}
    }
    Ok(())
}

/// An accessor must lie within its view, and the view within its buffer.
fn check(file: &Path, accessor: &gltf::Accessor<'_>, buffers: &[Vec<u8>]) -> Result<(), MeshError> {
    let wrong = |what: &str| malformed(file, format!("accessor {}: {what}", accessor.index()));
    if accessor.sparse().is_some() {
        return Err(wrong("is sparse, which is not supported"));
    }
    let view = accessor.view().ok_or_else(|| wrong("has no buffer view"))?;
    let size = accessor.size();
    let stride = view.stride().unwrap_or(size);
    let inside = || {
        let last = accessor.count().checked_sub(1)?.checked_mul(stride)?;
        let end = accessor.offset().checked_add(last)?.checked_add(size)?;
        let view_end = view.offset().checked_add(view.length())?;
        let buffer = buffers.get(view.buffer().index())?;
        (end <= view.length() && view_end <= buffer.len()).then_some(())
    };
    inside().ok_or_else(|| wrong("reaches beyond its buffer"))
}

fn buffers(
    file: &Path,
    document: &gltf::Document,
    mut blob: Option<Vec<u8>>,
) -> Result<Vec<Vec<u8>>, MeshError> {
    let folder = file.parent().unwrap_or(Path::new(""));
    document
        .buffers()
        .map(|buffer| {
            let data = match buffer.source() {
                gltf::buffer::Source::Bin => blob
                    .take()
                    .ok_or_else(|| malformed(file, "has no binary part"))?,
                gltf::buffer::Source::Uri(uri) => match uri.strip_prefix("data:") {
                    Some(data) => data
                        .split_once(";base64,")
                        .and_then(|(_, text)| base64(text))
                        .ok_or_else(|| malformed(file, "a data URI is not base64"))?,
                    None => read(&folder.join(percent_decoded(uri)))?,
                },
            };
            if data.len() < buffer.length() {
                let what = format!(
                    "buffer {} has {} bytes of {}",
                    buffer.index(),
                    data.len(),
                    buffer.length()
                );
                return Err(malformed(file, what));
            }
            Ok(data)
        })
        .collect()
}

fn read(file: &Path) -> Result<Vec<u8>, MeshError> {
    std::fs::read(file).map_err(|source| MeshError::Io {
        file: file.into(),
        source,
    })
}

/// RFC 4648, standard alphabet, padding optional.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0_u32, 0);
    for c in text.trim_end_matches('=').bytes() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let hex = tail
            .get(..2)
            .and_then(|h| std::str::from_utf8(h).ok())
            .and_then(|h| u8::from_str_radix(h, 16).ok());
        match (first, hex) {
            (b'%', Some(byte)) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            _ => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent_signs() {
        assert_eq!(base64("TWFu"), Some(b"Man".to_vec()));
        assert_eq!(base64("TWE="), Some(b"Ma".to_vec()));
        assert_eq!(base64("T!"), None);
        assert_eq!(percent_decoded("a%20b%"), "a b%");
    }
}
