//! Wavefront .obj, through tobj.
//!
//! All objects and groups of a file become one mesh. Material libraries are not opened; `usemtl`
//! says nothing here. Coordinates are read as f64, so that geo-referenced models keep theirs.

use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use super::{Mesh, MeshError, malformed, open};

pub(super) fn load(file: &Path) -> Result<Mesh, MeshError> {
    let options = tobj::LoadOptions {
        triangulate: true,
        single_index: true,
        // Lines and points are no surface.
        ignore_lines: true,
        ignore_points: true,
    };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut open(file)?, &options, no_materials)
        .map_err(|e| malformed(file, e))?;
    let mut mesh = Mesh::default();
    for tobj::Model { mesh: part, .. } in models {
        let first = u32::try_from(mesh.positions.len())
            .map_err(|_| malformed(file, "more than 4294967295 vertices"))?;
        mesh.positions.extend(
            part.positions
                .as_chunks::<3>()
                .0
                .iter()
                .map(|p| DVec3::from_array(*p)),
        );
        mesh.normals.extend(
            part.normals
                .as_chunks::<3>()
                .0
                .iter()
                .map(|n| DVec3::from_array(*n).normalize_or_zero().as_vec3()),
        );
        mesh.uvs.extend(
            part.texcoords
                .as_chunks::<2>()
                .0
                .iter()
                .map(|t| Vec2::new(t[0] as f32, t[1] as f32)),
        );
        mesh.triangles.extend(
            part.indices
                .as_chunks::<3>()
                .0
                .iter()
                .map(|t| t.map(|i| i.saturating_add(first))),
        );
    }
    if mesh.normals.contains(&Vec3::ZERO) {
        mesh.normals.clear();
    }
    Ok(mesh)
}
