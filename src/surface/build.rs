//! From a scene's objects to [`Surfaces`]: loads, places, checks, and builds the hierarchy.
//!
//! A file that serves several objects is read once; every object gets triangles of its own.
//! Objects that have sides (glass, interfaces, emitters, interiors) are checked for being closed
//! and turned outwards; opaque ones need neither.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use super::ellipsoid::Ellipsoid;
use super::emitter::Emitter;
use super::error::{SurfaceError, SurfaceWarning};
use super::hierarchy::{Hierarchy, Primitive};
use super::mesh::{self, Mesh};
use super::shape::{self, Placed, Triangles};
use super::texture::Texture;
use super::{Leaf, Part, Surfaces};
use crate::scene::{Material, Object, Shape};

/// Collects objects before the hierarchy is built.
#[derive(Debug, Default)]
pub(super) struct Builder {
    primitives: Vec<Primitive>,
    leaves: Vec<Leaf>,
    ellipsoids: Vec<Ellipsoid>,
    parts: Vec<Part>,
    meshes: HashMap<PathBuf, Mesh>,
    textures: Vec<Texture>,
    texture_of: HashMap<PathBuf, usize>,
    warnings: Vec<SurfaceWarning>,
}

impl Builder {
    pub(super) fn add(&mut self, object: &Object, origin: DVec3) -> Result<(), SurfaceError> {
        let index = self.parts.len() as u32;
        let mesh = match &object.shape {
            Shape::Mesh { file } => Some(self.mesh(file, &object.name)?),
            _ => None,
        };
        let placed = shape::place(object, mesh, origin)?;
        let texture = match &object.material {
            Material::Diffuse {
                texture: Some(file),
                ..
            } => Some(self.texture(file, &object.name)?),
            _ => None,
        };
        let mut part = Part {
            material: object.material.clone(),
            texture,
            interior: object.interior,
            encloses: false,
            bounds: (Vec3::INFINITY, Vec3::NEG_INFINITY),
            normals: Vec::new(),
            uvs: Vec::new(),
        };
        let passes = matches!(
            object.material,
            Material::Glass { .. } | Material::Interface
        );
        if part.interior.is_some() && !passes {
            self.warnings.push(SurfaceWarning::UnreachableInterior {
                object: object.name.clone(),
            });
        }
        match placed {
            Placed::Ellipsoid(ellipsoid) => {
                part.encloses = passes;
                part.bounds = ellipsoid.bounds();
                self.primitives
                    .push(Primitive::Ellipsoid(self.ellipsoids.len() as u32));
                self.leaves.push(Leaf {
                    object: index,
                    corners: [0; 3],
                });
                self.ellipsoids.push(ellipsoid);
            }
            Placed::Triangles(mut triangles) => {
                part.encloses = self.close(object, &mut triangles)? && passes;
                if texture.is_some() && triangles.uvs.is_empty() {
                    return Err(SurfaceError::NoTextureCoordinates {
                        object: object.name.clone(),
                    });
                }
                self.primitives.extend(
                    triangles
                        .indices
                        .iter()
                        .map(|t| Primitive::Triangle(t.map(|i| triangles.positions[i as usize]))),
                );
                self.leaves.extend(triangles.indices.iter().map(|t| Leaf {
                    object: index,
                    corners: *t,
                }));
                part.bounds = triangles
                    .positions
                    .iter()
                    .fold(part.bounds, |(low, high), p| (low.min(*p), high.max(*p)));
                part.normals = triangles.normals;
                part.uvs = triangles.uvs;
            }
        }
        self.parts.push(part);
        Ok(())
    }

    /// Says whether triangles enclose a volume, turns them outwards, and reports what is amiss.
    fn close(&mut self, object: &Object, triangles: &mut Triangles) -> Result<bool, SurfaceError> {
        let name = || object.name.clone();
        let file = match &object.shape {
            Shape::Mesh { file } => Some(file.clone()),
            _ => None,
        };
        if !triangles.degenerate.is_empty() {
            if triangles.indices.is_empty() {
                return Err(SurfaceError::Degenerate {
                    object: name(),
                    what: "none of its triangles has an area",
                });
            }
            self.warnings.push(SurfaceWarning::DegenerateTriangles {
                object: name(),
                count: triangles.degenerate.len(),
            });
        }
        let has_sides = object.interior.is_some()
            || matches!(
                object.material,
                Material::Glass { .. } | Material::Interface | Material::Emissive { .. }
            );
        if !has_sides {
            return Ok(false);
        }
        let all = [triangles.indices.as_slice(), &triangles.degenerate].concat();
        let found = mesh::closure(&triangles.positions, &all);
        if found.open_edges > 0 {
            if object.interior.is_some() {
                return Err(SurfaceError::OpenInterior {
                    object: name(),
                    file,
                    open_edges: found.open_edges,
                });
            }
            if !matches!(object.material, Material::Emissive { .. }) {
                self.warnings.push(SurfaceWarning::OpenDielectric {
                    object: name(),
                    open_edges: found.open_edges,
                });
            }
            return Ok(false);
        }
        if found.volume < 0.0 {
            for [_, b, c] in &mut triangles.indices {
                std::mem::swap(b, c);
            }
            self.warnings
                .push(SurfaceWarning::TurnedOutwards { object: name() });
        }
        Ok(true)
    }

    fn mesh(&mut self, file: &Path, object: &str) -> Result<&Mesh, SurfaceError> {
        if !self.meshes.contains_key(file) {
            let mesh = Mesh::load(file).map_err(|source| SurfaceError::Mesh {
                object: object.into(),
                source,
            })?;
            self.meshes.insert(file.into(), mesh);
        }
        Ok(&self.meshes[file])
    }

    fn texture(&mut self, file: &Path, object: &str) -> Result<usize, SurfaceError> {
        if let Some(&index) = self.texture_of.get(file) {
            return Ok(index);
        }
        let texture = Texture::load(file).map_err(|source| SurfaceError::Texture {
            object: object.into(),
            source,
        })?;
        self.textures.push(texture);
        let index = self.textures.len() - 1;
        self.texture_of.insert(file.into(), index);
        Ok(index)
    }

    pub(super) fn finish(self, origin: DVec3) -> Result<Surfaces, SurfaceError> {
        if u32::try_from(self.primitives.len()).is_err() {
            return Err(SurfaceError::TooMany {
                count: self.primitives.len(),
            });
        }
        let (hierarchy, order) = Hierarchy::build(&self.primitives, self.ellipsoids);
        let leaves: Vec<Leaf> = order.iter().map(|&i| self.leaves[i as usize]).collect();
        let mut shining: Vec<Vec<u32>> = vec![Vec::new(); self.parts.len()];
        for (index, leaf) in (0_u32..).zip(&leaves) {
            shining[leaf.object as usize].push(index);
        }
        let emitters = (0_u32..)
            .zip(&self.parts)
            .zip(shining)
            .filter_map(|((object, part), primitives)| match part.material {
                Material::Emissive { radiance } => {
                    Some(Emitter::new(object, radiance, primitives, &hierarchy))
                }
                _ => None,
            })
            .collect();
        Ok(Surfaces {
            hierarchy,
            leaves,
            parts: self.parts,
            textures: self.textures,
            emitters,
            warnings: self.warnings,
            origin,
        })
    }
}
