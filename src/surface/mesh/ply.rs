//! Stanford .ply, ascii and binary of either byte order, through ply-rs-bw.
//!
//! Elements `vertex` (`x y z`, optional `nx ny nz`, optional `u v` or `s t` or `texture_u
//! texture_v`) and `face` (`vertex_indices` or `vertex_index`) in any numeric type; everything else
//! is passed over. Values go straight into the two structs below, without a map per vertex.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Property, PropertyAccess, PropertyAccessResult};

use super::{Mesh, MeshError, malformed, open};

#[derive(Debug, Default)]
struct Vertex {
    position: DVec3,
    normal: DVec3,
    uv: Vec2,
}

#[derive(Debug, Default)]
struct Face {
    corners: Vec<u32>,
    /// A corner index below 0 or not whole.
    wrong: bool,
}

fn scalar(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Double(v) => v,
        Property::Int(v) => f64::from(v),
        Property::UInt(v) => f64::from(v),
        _ => f64::from(property.to_f32_lossy()?),
    })
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = scalar(&property) else {
            return PropertyAccessResult::Ignored;
        };
        match name {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value,
            "ny" => self.normal.y = value,
            "nz" => self.normal.z = value,
            "u" | "s" | "texture_u" => self.uv.x = value as f32,
            "v" | "t" | "texture_v" => self.uv.y = value as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        match property.to_u32_list() {
            Some(corners) => self.corners = corners,
            None => self.wrong = true,
        }
        PropertyAccessResult::Set
    }
}

pub(super) fn load(file: &Path) -> Result<Mesh, MeshError> {
    let opened = open(file)?;
    let length = opened.get_ref().metadata().map_or(u64::MAX, |m| m.len());
    let mut reader = Reader::new(opened);
    let header = Parser::<Vertex>::new()
        .read_header(&mut reader)
        .map_err(|e| malformed(file, e))?;
    let mut mesh = Mesh::default();
    for (_, element) in &header.elements {
        // Each takes a byte at least; what claims more is refused before it is allocated.
        if element.count as u64 > length || (element.properties.is_empty() && element.count > 0) {
            return Err(malformed(
                file,
                format!(
                    "{} of `{}` do not fit a file of {length} bytes",
                    element.count, element.name
                ),
            ));
        }
        let has = |name: &str| element.properties.contains_key(name);
        match element.name.as_str() {
            "vertex" => {
                if let Some(axis) = ["x", "y", "z"].into_iter().find(|axis| !has(axis)) {
                    return Err(malformed(file, format!("vertices have no `{axis}`")));
                }
                let vertices = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| malformed(file, e))?;
                mesh.positions = vertices.iter().map(|v| v.position).collect();
                if has("nx") && has("ny") && has("nz") {
                    mesh.normals = vertices
                        .iter()
                        .map(|v| v.normal.normalize_or_zero().as_vec3())
                        .collect();
                    // A vertex without a normal: the file has none worth using.
                    if mesh.normals.contains(&Vec3::ZERO) {
                        mesh.normals.clear();
                    }
                }
                if (has("u") && has("v"))
                    || (has("s") && has("t"))
                    || (has("texture_u") && has("texture_v"))
                {
                    mesh.uvs = vertices.iter().map(|v| v.uv).collect();
                }
            }
            "face" => {
                let faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| malformed(file, e))?;
                for (index, face) in faces.iter().enumerate() {
                    if face.wrong {
                        return Err(malformed(
                            file,
                            format!(
                                "face {index} has a vertex index that is not a whole number from 0"
                            ),
                        ));
                    }
                    let corners = &face.corners;
                    mesh.triangles.extend(
                        corners
                            .windows(2)
                            .skip(1)
                            .map(|pair| [corners[0], pair[0], pair[1]]),
                    );
                }
            }
            _ => {
                Parser::<DefaultElement>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| malformed(file, e))?;
            }
        }
    }
    Ok(mesh)
}
