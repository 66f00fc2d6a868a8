//! Triangle meshes from .obj, .ply, .gltf and .glb files.
//!
//! A mesh is corners \[m\], optional unit normals and texture coordinates at the corners, and
//! triangles that index them, counter-clockwise from outside. Whatever the format, the same checks
//! follow: at least one triangle, finite corners, indices that exist. Polygons with more corners
//! become a fan. Materials in the file are not read: the scene says what an object is made of.

mod closed;
mod gltf;
mod obj;
mod ply;

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};

pub(super) use closed::closure;

/// A mesh as the file has it.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Corners. \[m\]
    pub positions: Vec<DVec3>,
    /// Unit normals, one per corner or none at all.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per corner or none at all.
    pub uvs: Vec<Vec2>,
    /// Corner indices.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file cannot be opened or read.
    #[error("mesh {}: {source}", file.display())]
    Io {
        /// The mesh.
        file: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The ending is unknown.
    #[error("mesh {}: cannot read `.{found}` files; .obj, .ply, .gltf and .glb can be read", file.display())]
    Format {
        /// The mesh.
        file: PathBuf,
        /// Its ending.
        found: String,
    },
    /// The text or the bytes are not what the format asks for.
    #[error("mesh {}: {what}", file.display())]
    Malformed {
        /// The mesh.
        file: PathBuf,
        /// What was found.
        what: String,
    },
    /// No triangle in it.
    #[error("mesh {}: has no triangles", file.display())]
    Empty {
        /// The mesh.
        file: PathBuf,
    },
    /// A corner, normal or texture coordinate that is not a number.
    #[error("mesh {}: {what} of vertex {index} (counted from 0) is {value}", file.display())]
    NotFinite {
        /// The mesh.
        file: PathBuf,
        /// `position`, `normal` or `texture coordinate`.
        what: &'static str,
        /// Which corner.
        index: usize,
        /// What it is.
        value: String,
    },
    /// A triangle that names a corner that is not there.
    #[error("mesh {}: triangle {triangle} uses vertex {index}, but there are {vertices}", file.display())]
    Index {
        /// The mesh.
        file: PathBuf,
        /// Which triangle.
        triangle: usize,
        /// Which corner.
        index: u32,
        /// How many corners there are.
        vertices: usize,
    },
}

impl Mesh {
    /// Reads a mesh; the file's ending says how.
    ///
    /// # Errors
    /// [`MeshError`], naming the file and what was found.
    pub fn load(file: &Path) -> Result<Self, MeshError> {
        let ending = file
            .extension()
            .map(|e| e.to_string_lossy().to_ascii_lowercase())
            .unwrap_or_default();
        let mesh = match ending.as_str() {
            "obj" => obj::load(file)?,
            "ply" => ply::load(file)?,
            "gltf" | "glb" => gltf::load(file)?,
            _ => {
                return Err(MeshError::Format {
                    file: file.into(),
                    found: ending,
                });
            }
        };
        mesh.checked(file)
    }

    fn checked(mut self, file: &Path) -> Result<Self, MeshError> {
        if self.triangles.is_empty() {
            return Err(MeshError::Empty { file: file.into() });
        }
        let not_finite = |what, index, value: &dyn std::fmt::Display| MeshError::NotFinite {
            file: file.into(),
            what,
            index,
            value: value.to_string(),
        };
        if let Some((i, p)) = find(&self.positions, |p| !p.is_finite()) {
            return Err(not_finite("position", i, p));
        }
        if let Some((i, n)) = find(&self.normals, |n| !n.is_finite()) {
            return Err(not_finite("normal", i, n));
        }
        if let Some((i, t)) = find(&self.uvs, |t| !t.is_finite()) {
            return Err(not_finite("texture coordinate", i, t));
        }
        let vertices = self.positions.len();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::Index {
                    file: file.into(),
                    triangle,
                    index,
                    vertices,
                });
            }
        }
        // A part without them leaves the lists short: then none has them.
        if self.normals.len() != vertices {
            self.normals.clear();
        }
        if self.uvs.len() != vertices {
            self.uvs.clear();
        }
        Ok(self)
    }
}

fn find<T>(values: &[T], wrong: impl Fn(&T) -> bool) -> Option<(usize, &T)> {
    values.iter().enumerate().find(|(_, value)| wrong(value))
}

/// Opens a file or says which one could not be.
fn open(file: &Path) -> Result<std::io::BufReader<std::fs::File>, MeshError> {
    std::fs::File::open(file)
        .map(std::io::BufReader::new)
        .map_err(|source| MeshError::Io {
            file: file.into(),
            source,
        })
}

fn malformed(file: &Path, what: impl ToString) -> MeshError {
    MeshError::Malformed {
        file: file.into(),
        what: what.to_string(),
    }
}
