//! From a scene's shapes to primitives: transformed in f64, relative to the scene's origin.
//!
//! A point x of a shape goes to `T x - origin` \[m\], rounded to f32 once; spheres stay f64.
//! Flat shapes become triangles that share bitwise equal corners, so that the watertight test
//! covers them all. A transform that mirrors (negative determinant) turns triangles around, so
//! that outsides stay outside and the front of a quad is mirrored with it.

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};

use super::ellipsoid::Ellipsoid;
use super::error::SurfaceError;
use super::mesh::Mesh;
use crate::scene::{Object, Shape};

/// Beyond this the products of three coordinates would leave f32. \[m\]
const FARTHEST: f64 = 1e15;

/// One object, in the coordinates of the hierarchy.
#[derive(Debug)]
pub(super) enum Placed {
    /// A triangle mesh.
    Triangles(Triangles),
    /// A sphere, or what the transform made of it.
    Ellipsoid(Ellipsoid),
}

/// A placed mesh.
#[derive(Debug, Default)]
pub(super) struct Triangles {
    /// Corners. \[m\]
    pub(super) positions: Vec<Vec3>,
    /// Unit normals at the corners; none for a faceted surface.
    pub(super) normals: Vec<Vec3>,
    /// Texture coordinates at the corners; none without a parametrisation.
    pub(super) uvs: Vec<Vec2>,
    /// Corner indices, counter-clockwise from outside.
    pub(super) indices: Vec<[u32; 3]>,
    /// Triangles without area, left out of `indices`; they still join their neighbours.
    pub(super) degenerate: Vec<[u32; 3]>,
}

/// Places a shape. Meshes come loaded, since one file may serve many objects.
pub(super) fn place(
    object: &Object,
    mesh: Option<&Mesh>,
    origin: DVec3,
) -> Result<Placed, SurfaceError> {
    let name = || object.name.clone();
    let degenerate = |what| SurfaceError::Degenerate {
        object: name(),
        what,
    };
    let transform = object.transform;
    let determinant = transform.matrix3.determinant();
    if !determinant.is_normal() || !transform.translation.is_finite() {
        return Err(SurfaceError::SingularTransform {
            object: name(),
            determinant,
        });
    }
    let placed = match &object.shape {
        Shape::Sphere { center, radius } => {
            if !(*radius > 0.0 && radius.is_finite()) {
                return Err(degenerate("a sphere's radius must be finite and above 0"));
            }
            Placed::Ellipsoid(Ellipsoid::new(
                transform.transform_point3(*center) - origin,
                transform.matrix3 * DMat3::from_diagonal(DVec3::splat(*radius)),
            ))
        }
        Shape::Quad {
            corner,
            edge_u,
            edge_v,
        } => {
            if !edge_u.cross(*edge_v).length().is_normal() {
                return Err(degenerate("the edges of a quad must span an area"));
            }
            let corners = [
                *corner,
                corner + edge_u,
                corner + edge_u + edge_v,
                corner + edge_v,
            ];
            Placed::Triangles(Triangles {
                uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
                ..triangles(&corners, &[[0, 1, 2], [0, 2, 3]], &transform, origin)
            })
        }
        Shape::Box { min, max } => {
            if !min.cmplt(*max).all() {
                return Err(degenerate(
                    "a box's min must lie below its max on every axis",
                ));
            }
            Placed::Triangles(box_triangles(*min, *max, &transform, origin))
        }
        Shape::Mesh { .. } => {
            let Some(mesh) = mesh else {
                return Err(degenerate("its mesh was not loaded"));
            };
            let mut placed = triangles(&mesh.positions, &mesh.triangles, &transform, origin);
            let normal_transform = transform.matrix3.inverse().transpose();
            placed.normals = mesh
                .normals
                .iter()
                .map(|n| {
                    (normal_transform * n.as_dvec3())
                        .normalize_or_zero()
                        .as_vec3()
                })
                .collect();
            placed.uvs.clone_from(&mesh.uvs);
            Placed::Triangles(placed)
        }
    };
    check_range(&placed, object)?;
    Ok(placed)
}

/// Transforms, rounds, drops what has no area, and turns the rest if the transform mirrors.
fn triangles(
    points: &[DVec3],
    indices: &[[u32; 3]],
    transform: &DAffine3,
    origin: DVec3,
) -> Triangles {
    let mirrored = transform.matrix3.determinant() < 0.0;
    let positions: Vec<Vec3> = points
        .iter()
        .map(|p| (transform.transform_point3(*p) - origin).as_vec3())
        .collect();
    let (indices, degenerate) = indices
        .iter()
        .map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] })
        .partition(|&corners| {
            let [a, b, c] = corners.map(|i| positions[i as usize].as_dvec3());
            (b - a).cross(c - a) != DVec3::ZERO
        });
    Triangles {
        degenerate,
        indices,
        positions,
        ..Triangles::default()
    }
}

/// Twelve triangles over eight shared corners; each face has its own texture square.
fn box_triangles(min: DVec3, max: DVec3, transform: &DAffine3, origin: DVec3) -> Triangles {
    // Corner i has max on the axes whose bit is set; each face counter-clockwise from outside.
    const FACES: [[usize; 4]; 6] = [
        [0, 4, 6, 2], // -x
        [1, 3, 7, 5], // +x
        [0, 1, 5, 4], // -y
        [2, 6, 7, 3], // +y
        [0, 2, 3, 1], // -z
        [4, 5, 7, 6], // +z
    ];
    let corner = |i: usize| {
        DVec3::new(
            if i & 1 == 0 { min.x } else { max.x },
            if i & 2 == 0 { min.y } else { max.y },
            if i & 4 == 0 { min.z } else { max.z },
        )
    };
    let mut points = Vec::with_capacity(24);
    let mut uvs = Vec::with_capacity(24);
    let mut indices = Vec::with_capacity(12);
    for (face, corners) in (0_u32..).zip(FACES) {
        points.extend(corners.map(corner));
        uvs.extend([Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
        let first = 4 * face;
        indices.push([first, first + 1, first + 2]);
        indices.push([first, first + 2, first + 3]);
    }
    Triangles {
        uvs,
        ..triangles(&points, &indices, transform, origin)
    }
}

fn check_range(placed: &Placed, object: &Object) -> Result<(), SurfaceError> {
    let worst = match placed {
        Placed::Ellipsoid(ellipsoid) => {
            let (min, max) = ellipsoid.bounds();
            f64::from(min.abs().max(max.abs()).max_element())
        }
        Placed::Triangles(triangles) => triangles
            .positions
            .iter()
            .map(|p| f64::from(p.abs().max_element()))
            .fold(0.0, f64::max),
    };
    if worst < FARTHEST {
        Ok(())
    } else {
        Err(SurfaceError::OutOfRange {
            object: object.name.clone(),
            value: worst,
        })
    }
}
