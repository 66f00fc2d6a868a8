//! What can be wrong with a surface, and what is worth saying though it renders.

use std::path::PathBuf;

use super::mesh::MeshError;
use super::texture::TextureError;

/// A surface that cannot be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The mesh file.
    #[error("object `{object}`")]
    Mesh {
        /// Name of the object.
        object: String,
        /// What is wrong with it.
        source: MeshError,
    },
    /// The texture file.
    #[error("object `{object}`")]
    Texture {
        /// Name of the object.
        object: String,
        /// What is wrong with it.
        source: TextureError,
    },
    /// A sphere, quad or box without extent.
    #[error("object `{object}`: {what}")]
    Degenerate {
        /// Name of the object.
        object: String,
        /// What was found, and what is possible.
        what: &'static str,
    },
    /// A transform that flattens space.
    #[error("object `{object}`: its transform has no inverse (determinant {determinant})")]
    SingularTransform {
        /// Name of the object.
        object: String,
        /// Determinant of the linear part.
        determinant: f64,
    },
    /// A coordinate that f32 cannot hold or square.
    #[error("object `{object}`: coordinate {value} m is beyond the 1e15 m that can be rendered")]
    OutOfRange {
        /// Name of the object.
        object: String,
        /// The coordinate. \[m\]
        value: f64,
    },
    /// An interior medium in an object that encloses nothing.
    #[error(
        "object `{object}`{}: has an interior medium but is not closed: {open_edges} edges have \
         not exactly two triangles that pass them in opposite directions; close the mesh or drop \
         `interior`", file.as_ref().map(|f| format!(" ({})", f.display())).unwrap_or_default()
    )]
    OpenInterior {
        /// Name of the object.
        object: String,
        /// The mesh file, if it is one.
        file: Option<PathBuf>,
        /// Edges that are not shared by two triangles, seen in opposite directions.
        open_edges: usize,
    },
    /// A texture on a mesh that says nowhere how to put it on.
    #[error("object `{object}`: has a texture, but the mesh has no texture coordinates")]
    NoTextureCoordinates {
        /// Name of the object.
        object: String,
    },
    /// More triangles than a 32-bit index counts.
    #[error("{count} primitives; 4294967295 can be rendered")]
    TooMany {
        /// How many there are.
        count: usize,
    },
}

/// Something that the renderer put right or leaves to the user's judgement.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum SurfaceWarning {
    /// Triangles without area were left out.
    DegenerateTriangles {
        /// Name of the object.
        object: String,
        /// How many.
        count: usize,
    },
    /// A closed mesh faced inwards; its triangles were turned.
    TurnedOutwards {
        /// Name of the object.
        object: String,
    },
    /// An interior medium that no light can reach.
    UnreachableInterior {
        /// Name of the object.
        object: String,
    },
    /// A dielectric or an interface that is not closed: it bends light but encloses nothing.
    OpenDielectric {
        /// Name of the object.
        object: String,
        /// Edges that are not shared by two triangles, seen in opposite directions.
        open_edges: usize,
    },
}

impl std::fmt::Display for SurfaceWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::DegenerateTriangles { object, count } => {
                write!(
                    f,
                    "object `{object}`: {count} triangles without area left out"
                )
            }
            Self::TurnedOutwards { object } => {
                write!(
                    f,
                    "object `{object}`: triangles faced inwards and were turned"
                )
            }
            Self::UnreachableInterior { object } => write!(
                f,
                "object `{object}`: no light passes its material, so its interior is never seen"
            ),
            Self::OpenDielectric { object, open_edges } => write!(
                f,
                "object `{object}`: not closed ({open_edges} open edges), so it has no inside"
            ),
        }
    }
}
