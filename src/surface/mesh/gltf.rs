//! glTF 2.0: .gltf with its buffers beside it or inside it, and .glb.
//!
//! Every triangle list, strip and fan of the default scene, moved by the transforms of its nodes,
//! becomes one mesh. Read is what geometry needs: nodes, meshes, accessors (float corners, normals
//! and texture coordinates; 8-, 16- and 32-bit indices), buffer views, buffers. Materials, skins,
//! morph targets and normalised integer coordinates are not; sparse accessors and required
//! extensions (compressed meshes) are refused by name.
//!
//! Source: Khronos glTF 2.0 specification, sections 3.5 to 3.7 and 4 (GLB). The `gltf` crate is not
//! used: version 1.4 indexes out of bounds while it validates broken files. Here every index and
//! every range is checked where it is used.

use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3, Vec2, Vec3};
use serde::Deserialize;

use super::{Mesh, MeshError, malformed};

const FLOAT: u32 = 5126;

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
struct Document {
    extensions_required: Vec<String>,
    scene: Option<usize>,
    scenes: Vec<Scene>,
    nodes: Vec<Node>,
    meshes: Vec<Parts>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<View>,
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Node {
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Parts {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    /// 4 list, 5 strip, 6 fan of triangles; below, points and lines.
    #[serde(default = "triangle_list")]
    mode: u32,
}

fn triangle_list() -> u32 {
    4
}

#[derive(Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
struct Attributes {
    position: Option<usize>,
    normal: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    uv: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    shape: String,
    sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    uri: Option<String>,
    byte_length: usize,
}

/// A document with its bytes.
struct Reader<'a> {
    file: &'a Path,
    document: Document,
    buffers: Vec<Vec<u8>>,
}

pub(super) fn load(file: &Path) -> Result<Mesh, MeshError> {
    let bytes = read(file)?;
    let (json, binary) = if bytes.starts_with(b"glTF") {
        chunks(&bytes).ok_or_else(|| malformed(file, "its chunks do not fit the file"))?
    } else {
        (bytes.as_slice(), None)
    };
    let document: Document =
        serde_json::from_slice(json).map_err(|e| malformed(file, format!("as glTF: {e}")))?;
    if let Some(extension) = document.extensions_required.first() {
        let what = format!("requires extension {extension}, which is not supported");
        return Err(malformed(file, what));
    }
    let buffers = buffers(file, &document, binary)?;
    Reader {
        file,
        document,
        buffers,
    }
    .mesh()
}

/// The JSON chunk of a .glb, and the binary one if there is one.
fn chunks(bytes: &[u8]) -> Option<(&[u8], Option<&[u8]>)> {
    let word = |at: usize| {
        let four = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes(four.try_into().ok()?) as usize)
    };
    let chunk = |at: usize, kind: &[u8]| {
        let end = (at + 8).checked_add(word(at)?)?;
        (bytes.get(at + 4..at + 8)? == kind).then_some((bytes.get(at + 8..end)?, end))
    };
    let (json, end) = chunk(12, b"JSON")?;
    let binary = (end < bytes.len()).then(|| chunk(end, b"BIN\0"));
    match binary {
        None => Some((json, None)),
        Some(found) => found.map(|(binary, _)| (json, Some(binary))),
    }
}

impl Reader<'_> {
    fn wrong(&self, what: impl ToString) -> MeshError {
        malformed(self.file, what)
    }

    fn mesh(&self) -> Result<Mesh, MeshError> {
        let scene = self
            .document
            .scenes
            .get(self.document.scene.unwrap_or(0))
            .ok_or_else(|| self.wrong("has no scene"))?;
        let mut mesh = Mesh::default();
        // A stack instead of recursion: the file may nest as deep as it likes. Nodes form a
        // forest, so more visits than nodes mean a cycle or a node with two parents.
        let mut visits = 0;
        let mut nodes: Vec<(usize, DMat4)> =
            scene.nodes.iter().map(|&n| (n, DMat4::IDENTITY)).collect();
        while let Some((index, parent)) = nodes.pop() {
            visits += 1;
            if visits > self.document.nodes.len() {
                return Err(self.wrong("a node is its own ancestor, or has two parents"));
            }
            let node = self
                .document
                .nodes
                .get(index)
                .ok_or_else(|| self.wrong(format!("node {index} is missing")))?;
            let world = parent * local(node);
            nodes.extend(node.children.iter().rev().map(|&child| (child, world)));
            let Some(index) = node.mesh else { continue };
            let parts = self
                .document
                .meshes
                .get(index)
                .ok_or_else(|| self.wrong(format!("mesh {index} is missing")))?;
            for primitive in &parts.primitives {
                self.append(&mut mesh, primitive, world)?;
            }
        }
        Ok(mesh)
    }

    fn append(
        &self,
        mesh: &mut Mesh,
        primitive: &Primitive,
        world: DMat4,
    ) -> Result<(), MeshError> {
        let Some(positions) = primitive.attributes.position else {
            return Ok(());
        };
        let first = u32::try_from(mesh.positions.len())
            .map_err(|_| self.wrong("more than 4294967295 vertices"))?;
        let positions = self.floats::<3>(positions, "VEC3")?;
        let count = positions.len();
        mesh.positions.extend(
            positions
                .into_iter()
                .map(|p| world.transform_point3(Vec3::from_array(p).as_dvec3())),
        );
        if let Some(normals) = primitive.attributes.normal {
            let turn = DMat3::from_mat4(world).inverse().transpose();
            mesh.normals
                .extend(self.floats::<3>(normals, "VEC3")?.into_iter().map(|n| {
                    let n = turn * Vec3::from_array(n).as_dvec3();
                    n.normalize_or_zero().as_vec3()
                }));
        }
        if let Some(uvs) = primitive.attributes.uv {
            // Normalised integers are left out; v points down in glTF.
            if self.document.accessors.get(uvs).map(|a| a.component_type) == Some(FLOAT) {
                let uvs = self.floats::<2>(uvs, "VEC2")?;
                mesh.uvs
                    .extend(uvs.into_iter().map(|[u, v]| Vec2::new(u, 1.0 - v)));
            }
        }
        let corners: Vec<u32> = match primitive.indices {
            Some(indices) => self.indices(indices)?,
            None => (0..count as u32).collect(),
        };
        if let Some(&beyond) = corners.iter().find(|&&i| i as usize >= count) {
            return Err(self.wrong(format!("index {beyond} of {count} vertices")));
        }
        let mirrored = DMat3::from_mat4(world).determinant() < 0.0;
        let mut push = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|i| i.saturating_add(first));
            mesh.triangles
                .push(if mirrored { [a, c, b] } else { [a, b, c] });
        };
        match primitive.mode {
            4 => corners.as_chunks::<3>().0.iter().for_each(|t| push(*t)),
            5 => {
                for (i, t) in corners.windows(3).enumerate() {
                    let turned = i % 2;
                    push([t[turned], t[1 - turned], t[2]]);
                }
            }
            6 => {
                for pair in corners.windows(2).skip(1) {
                    push([corners[0], pair[0], pair[1]]);
                }
            }
            // Points and lines are no surface.
            _ => {}
        }
        Ok(())
    }

    fn floats<const N: usize>(
        &self,
        index: usize,
        shape: &str,
    ) -> Result<Vec<[f32; N]>, MeshError> {
        let elements = self.elements(index, shape, FLOAT, 4 * N)?;
        let float = |b: &[u8; 4]| f32::from_le_bytes(*b);
        Ok(elements
            .map(|element| std::array::from_fn(|i| float(&element.as_chunks::<4>().0[i])))
            .collect())
    }

    fn indices(&self, index: usize) -> Result<Vec<u32>, MeshError> {
        let kind = self.document.accessors.get(index).map(|a| a.component_type);
        Ok(match kind {
            Some(kind @ 5121) => self
                .elements(index, "SCALAR", kind, 1)?
                .map(|e| u32::from(e[0]))
                .collect(),
            Some(kind @ 5123) => self
                .elements(index, "SCALAR", kind, 2)?
                .map(|e| u32::from(u16::from_le_bytes([e[0], e[1]])))
                .collect(),
            _ => self
                .elements(index, "SCALAR", 5125, 4)?
                .map(|e| u32::from_le_bytes([e[0], e[1], e[2], e[3]]))
                .collect(),
        })
    }

    /// The elements of an accessor, `size` bytes each, after every check.
    fn elements(
        &self,
        index: usize,
        shape: &str,
        component: u32,
        size: usize,
    ) -> Result<impl Iterator<Item = &[u8]>, MeshError> {
        let wrong = |what: String| self.wrong(format!("accessor {index}: {what}"));
        let accessor = self
            .document
            .accessors
            .get(index)
            .ok_or_else(|| wrong("is missing".into()))?;
        if accessor.sparse.is_some() {
            return Err(wrong("is sparse, which is not supported".into()));
        }
        if accessor.shape != shape || accessor.component_type != component {
            return Err(wrong(format!(
                "is {} of type {}, not {shape} of type {component}",
                accessor.shape, accessor.component_type
            )));
        }
        let bytes = || {
            let view = self.document.buffer_views.get(accessor.buffer_view?)?;
            let buffer = self.buffers.get(view.buffer)?;
            let end = view.byte_offset.checked_add(view.byte_length)?;
            let stride = view.byte_stride.unwrap_or(size);
            let bytes = buffer
                .get(view.byte_offset..end)?
                .get(accessor.byte_offset..)?;
            let needed = match accessor.count.checked_sub(1) {
                Some(steps) => steps.checked_mul(stride)?.checked_add(size)?,
                None => 0,
            };
            (needed <= bytes.len() && stride >= size).then(|| (&bytes[..needed], stride))
        };
        let (bytes, stride) = bytes().ok_or_else(|| wrong("reaches beyond its buffer".into()))?;
        Ok(bytes.chunks(stride).map(move |chunk| &chunk[..size]))
    }
}

fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix);
    }
    let rotation = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    DMat4::from_scale_rotation_translation(
        node.scale.map_or(DVec3::ONE, DVec3::from_array),
        rotation.normalize(),
        node.translation.map_or(DVec3::ZERO, DVec3::from_array),
    )
}

fn buffers(
    file: &Path,
    document: &Document,
    binary: Option<&[u8]>,
) -> Result<Vec<Vec<u8>>, MeshError> {
    let folder = file.parent().unwrap_or(Path::new(""));
    document
        .buffers
        .iter()
        .enumerate()
        .map(|(index, buffer)| {
            let data = match &buffer.uri {
                None => binary
                    .ok_or_else(|| malformed(file, "has no binary part"))?
                    .to_vec(),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => data
                        .split_once(";base64,")
                        .and_then(|(_, text)| base64(text))
                        .ok_or_else(|| malformed(file, "a data URI is not base64"))?,
                    None => read(&folder.join(percent_decoded(uri)))?,
                },
            };
            if data.len() < buffer.byte_length {
                let (found, asked) = (data.len(), buffer.byte_length);
                let what = format!("buffer {index} has {found} bytes of {asked}");
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
