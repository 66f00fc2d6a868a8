//! Surfaces: where rays meet them and how they scatter there.
//!
//! ```text
//! scene::Object --shape, mesh--> triangles and ellipsoids --hierarchy--> Hit --bsdf--> direction
//! ```
//! All geometry of a scene stands in one hierarchy, in f32 relative to an origin that the caller
//! keeps in f64, so that a scene far from the world's origin is as exact as one around it. Flat
//! shapes are triangles under a watertight test (`triangle`), spheres stay exact (`ellipsoid`).
//! Directions are directions of travel everywhere; a ray is an origin \[m\] and a unit direction.
//!
//! A path through surfaces reads
//! ```text
//! hit = surfaces.intersect(origin, direction, t_max)?
//! bsdf = surfaces.bsdf(&hit)
//! s = bsdf.sample(direction, [u0, u1, u2], transport)?        // throughput *= s.weight
//! if s.transmitted && surfaces.encloses(hit.object) { inside.cross(hit.object, hit.front) }
//! (origin, direction) = (hit.spawn_origin(s.direction), s.direction)
//! ```
//! Invariants, each with a test: no ray passes between the triangles of a closed mesh; no spawned
//! ray meets again the surface it leaves, from 1e-3 m to 1e6 m; sides are decided by the geometric
//! normal. This module knows no light, no medium and no random generator.

mod along;
mod bsdf;
mod build;
mod ellipsoid;
mod emitter;
mod error;
mod fresnel;
mod ggx;
mod hierarchy;
mod hit;
mod interior;
mod mesh;
mod shape;
mod solid;
mod texture;
mod triangle;

use glam::{DVec3, Vec2, Vec3};

pub use along::{Crossing, Met};
pub use bsdf::{Bsdf, BsdfSample, SampleKind, Transport};
pub use emitter::{Emitter, EmitterPoint};
pub use error::{SurfaceError, SurfaceWarning};
pub use hit::Hit;
pub use interior::Inside;
pub use mesh::{Mesh, MeshError};
pub(crate) use texture::Texture;
pub use texture::TextureError;

use bsdf::Lobe;
use build::Builder;
use ggx::Ggx;
use hierarchy::{Hierarchy, Primitive, Ray, normal};

use crate::scene::{Material, Object, Optics, Rgb};

/// Least difference of the indices on both sides at which rough facets bend light. Smaller: the
/// half vector of what they refract is lost in rounding; larger: glass without its gloss.
const BENDS: f64 = 1e-4;

/// Every surface of a scene.
#[derive(Debug)]
pub struct Surfaces {
    hierarchy: Hierarchy,
    /// By leaf.
    leaves: Vec<Leaf>,
    /// By object.
    parts: Vec<Part>,
    textures: Vec<Texture>,
    emitters: Vec<Emitter>,
    warnings: Vec<SurfaceWarning>,
    origin: DVec3,
}

/// What a leaf of the hierarchy belongs to.
#[derive(Debug, Clone, Copy)]
struct Leaf {
    object: u32,
    /// Corner indices into the part's normals and texture coordinates.
    corners: [u32; 3],
}

/// What an object is made of.
#[derive(Debug)]
struct Part {
    material: Material,
    texture: Option<usize>,
    interior: Option<Optics>,
    encloses: bool,
    bounds: (Vec3, Vec3),
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
}

impl Part {
    fn blocks(&self) -> bool {
        !matches!(self.material, Material::Interface)
    }
}

impl Surfaces {
    /// Loads and places every object; positions are relative to `origin` \[m\].
    ///
    /// # Errors
    /// [`SurfaceError`]: the first object that cannot be rendered, by name.
    pub fn build(objects: &[Object], origin: DVec3) -> Result<Self, SurfaceError> {
        let mut builder = Builder::default();
        for object in objects {
            builder.add(object, origin)?;
        }
        builder.finish(origin)
    }

    /// Bytes that hierarchy, primitives and textures take in memory.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let shading = self
            .parts
            .iter()
            .map(|part| size_of_val(&part.normals[..]) + size_of_val(&part.uvs[..]));
        self.hierarchy.memory_bytes()
            + size_of_val(&self.leaves[..])
            + shading.sum::<usize>()
            + self
                .textures
                .iter()
                .map(Texture::memory_bytes)
                .sum::<usize>()
    }

    /// True without any surface.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.hierarchy.is_empty()
    }

    /// Smallest box around all surfaces, min and max; none without surfaces. \[m\]
    #[must_use]
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        self.hierarchy.bounds()
    }

    /// The point of the world that is zero here. \[m\]
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// What was put right while loading.
    #[must_use]
    pub fn warnings(&self) -> &[SurfaceWarning] {
        &self.warnings
    }

    /// Nearest hit with t in (0, `t_max`) along a unit `direction`. Of a boundary that lets light
    /// pass and a wall in the same place, the wall: who passes the one starts behind the other.
    #[must_use]
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Option<Hit> {
        let ray = Ray::new(origin, direction);
        let (index, t) = self.hierarchy.nearest(&ray, t_max)?;
        let hit = self.hit(&ray, index, t)?;
        if self.parts.len() == 1 || self.parts[hit.object as usize].blocks() {
            return Some(hit);
        }
        let mut wall = None;
        self.visit_beside(&hit, direction, |index, _| {
            if self.parts[self.leaves[index as usize].object as usize].blocks() {
                wall = Some(index);
            }
        });
        wall.and_then(|index| {
            let t = self.hierarchy.distance(&ray, index, t_max)?;
            self.hit(&ray, index, t)
        })
        .or(Some(hit))
    }

    /// Scattering at a hit.
    #[must_use]
    pub fn bsdf(&self, hit: &Hit) -> Bsdf {
        let part = &self.parts[hit.object as usize];
        let rough = |alpha: f64| {
            let alpha = alpha as f32;
            (alpha >= ggx::SMOOTH).then_some(Ggx { alpha })
        };
        let lobe = match part.material {
            Material::Diffuse { reflectance, .. } => Lobe::Diffuse {
                reflectance: match part.texture {
                    Some(index) => reflectance * self.textures[index].at(hit.uv),
                    None => reflectance,
                },
            },
            Material::Mirror { reflectance } => Lobe::Mirror { reflectance },
            Material::Glass { ior, roughness } => Lobe::Glass {
                ior: ior as f32,
                // Facets of the same index on both sides bend nothing.
                ggx: rough(roughness).filter(|_| (ior - 1.0).abs() > BENDS),
            },
            Material::Conductor { eta, k, roughness } => Lobe::Conductor {
                eta,
                k,
                ggx: rough(roughness),
            },
            Material::Emissive { .. } => Lobe::Black,
            Material::Interface => Lobe::Interface,
        };
        Bsdf::new(lobe, hit)
    }

    /// The material of the object that was hit.
    #[must_use]
    pub fn material(&self, hit: &Hit) -> &Material {
        &self.parts[hit.object as usize].material
    }

    /// Radiance that the surface itself sends back along the ray that hit it. \[W/(m2 sr)\]
    #[must_use]
    pub fn emission(&self, hit: &Hit) -> Rgb {
        match self.parts[hit.object as usize].material {
            Material::Emissive { radiance } if hit.front => radiance,
            _ => Rgb::ZERO,
        }
    }

    /// The medium inside an object; `None` inside means empty.
    #[must_use]
    pub fn interior(&self, object: u32) -> Option<&Optics> {
        self.parts[object as usize].interior.as_ref()
    }

    /// True for closed objects of glass or interface: passing their boundary goes in or out.
    #[must_use]
    pub fn encloses(&self, object: u32) -> bool {
        self.parts[object as usize].encloses
    }

    /// Box around an object. \[m\]
    #[must_use]
    pub fn object_bounds(&self, object: u32) -> (Vec3, Vec3) {
        self.parts[object as usize].bounds
    }

    /// True for closed objects of glass, whose boundary bends light.
    #[must_use]
    pub fn refracts(&self, object: u32) -> bool {
        let part = &self.parts[object as usize];
        part.encloses && part.blocks()
    }

    /// True when light can pass into any object.
    #[must_use]
    pub fn any_encloses(&self) -> bool {
        self.parts.iter().any(|part| part.encloses)
    }

    /// The emissive objects.
    #[must_use]
    pub fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }

    /// A uniform point on one of [`emitters`](Self::emitters), from three uniforms in [0, 1).
    #[must_use]
    pub fn sample_emitter(&self, emitter: &Emitter, u: [f32; 3]) -> Option<EmitterPoint> {
        emitter.sample(&self.hierarchy, u)
    }

    /// Density by area with which `sample_emitter` would have drawn this hit on `emitter`'s own
    /// object. \[1/m2\]
    #[must_use]
    pub fn emission_pdf(&self, emitter: &Emitter, hit: &Hit) -> f32 {
        emitter.pdf(&self.hierarchy, hit.primitive, hit.position)
    }

    /// Fills in what the nearest intersection needs.
    fn hit(&self, ray: &Ray, index: u32, t: f32) -> Option<Hit> {
        let leaf = self.leaves[index as usize];
        let part = &self.parts[leaf.object as usize];
        match self.hierarchy.primitive(index) {
            Primitive::Triangle(corners) => {
                let weights = ray.shear.intersect(ray.origin, &corners)?.weights;
                let scale = corners
                    .iter()
                    .fold(0.0, |s: f32, c| s.max(c.abs().max_element()));
                let at = |weights: [f64; 3]| {
                    let position: DVec3 = corners
                        .iter()
                        .zip(weights)
                        .map(|(corner, weight)| weight * corner.as_dvec3())
                        .sum();
                    hit::round(position, scale)
                };
                let weights = hit::inset(weights, &corners, at(weights).1);
                let (position, error) = at(weights);
                let geometric = normal(&corners).normalize().as_vec3();
                let w = weights.map(|w| w as f32);
                let [a, b, c] = leaf.corners.map(|i| i as usize);
                let uv = if part.uvs.is_empty() {
                    Vec2::new(w[1], w[2])
                } else {
                    w[0] * part.uvs[a] + w[1] * part.uvs[b] + w[2] * part.uvs[c]
                };
                let shading_normal = if part.normals.is_empty() {
                    geometric
                } else {
                    let n = &part.normals;
                    let smooth = (w[0] * n[a] + w[1] * n[b] + w[2] * n[c]).normalize_or(geometric);
                    if smooth.dot(geometric) < 0.0 {
                        -smooth
                    } else {
                        smooth
                    }
                };
                Some(Hit {
                    t,
                    position,
                    error,
                    normal: geometric,
                    shading_normal,
                    uv,
                    object: leaf.object,
                    front: ray.direction.dot(geometric) < 0.0,
                    primitive: index,
                })
            }
            Primitive::Ellipsoid(e) => {
                let ellipsoid = self.hierarchy.ellipsoid(e);
                let unit = ellipsoid.unit_point(ray.origin, ray.direction, f64::from(t));
                let (min, max) = ellipsoid.bounds();
                let scale = min.abs().max(max.abs()).max_element();
                let (position, error) = hit::round(ellipsoid.position(unit), scale);
                let geometric = ellipsoid.normal(unit).as_vec3();
                // Longitude and latitude around y.
                let longitude = (-unit.z).atan2(unit.x) / std::f64::consts::TAU;
                let latitude = unit.y.clamp(-1.0, 1.0).asin() / std::f64::consts::PI;
                Some(Hit {
                    t,
                    position,
                    error,
                    normal: geometric,
                    shading_normal: geometric,
                    uv: Vec2::new(longitude.rem_euclid(1.0) as f32, latitude as f32 + 0.5),
                    object: leaf.object,
                    front: ray.direction.dot(geometric) < 0.0,
                    primitive: index,
                })
            }
        }
    }
}
