//! The scene as the renderer sees it: valid, resolved, with units; nothing left to default.
//!
//! `file` mirrors the TOML text, `check` turns it into this and gathers every fault on the way,
//! `bare` makes a scene around a lone .vdb. World units are metres; directions of light are
//! directions of travel; colours are linear RGB.

pub mod bare;
pub mod check;
pub mod file;
mod item;
mod keys;

use std::path::PathBuf;

use glam::{DAffine3, DVec3, Vec3};

pub use crate::estimate::kernel::Kernel;

/// Linear RGB: a colour, a coefficient per channel, or a power per channel.
pub type Rgb = Vec3;

/// A scene: what is there, and how it is to be rendered.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name for reports and metadata: the scene file's stem.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// What changes the image.
    pub settings: Settings,
    /// Media from .vdb files.
    pub volumes: Vec<Volume>,
    /// Homogeneous media.
    pub fogs: Vec<Fog>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Surfaces.
    pub objects: Vec<Object>,
}

/// A pinhole or thin-lens camera.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Where it stands. \[m\]
    pub position: DVec3,
    /// The point in the middle of the picture. \[m\]
    pub look_at: DVec3,
    /// Up in the picture.
    pub up: DVec3,
    /// Full angle across the picture's height. \[degrees\]
    pub vertical_fov: f64,
    /// Width and height. \[px\]
    pub resolution: [u32; 2],
    /// Thin lens; a pinhole without one.
    pub lens: Option<Lens>,
}

/// A thin lens.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    /// Radius of the aperture. \[m\]
    pub radius: f64,
    /// Distance of the plane in focus, along the view direction. \[m\]
    pub focus_distance: f64,
}

/// How radiance is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Beam radiance estimate (Jarosz et al. 2008).
    Beam,
    /// Sphere estimate at the steps of a ray march (Jensen & Christensen 1998).
    Point,
    /// Path tracing: the reference.
    Path,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Beam, Self::Point, Self::Path];

    /// Its name in scene files, on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Beam => "beam",
            Self::Point => "point",
            Self::Path => "path",
        }
    }
}

/// Where first-order scattering comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direct {
    /// Points along the camera ray, joined to the lights.
    Sampled,
    /// The photon map, like all other orders.
    Photons,
}

/// How the optical depth of a camera ray is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum March {
    /// Exactly, cell by cell.
    Exact,
    /// In fixed steps. \[voxels\]
    Step(f64),
}

/// Which photons the point estimate counts at a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Search {
    /// The `neighbours` nearest ones.
    Nearest,
    /// Those within their own radius.
    Radius,
}

/// What changes the image; execution (threads, progress) is elsewhere.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Estimator.
    pub method: Method,
    /// Highest scattering order; 1 is single scattering.
    pub max_bounces: u32,
    /// Photons emitted in a pass.
    pub photons: u64,
    /// Passes of fresh photons (beam, point).
    pub passes: u32,
    /// Camera rays of a pixel: in each pass (beam, point), in all (path).
    pub spp: u32,
    /// First order.
    pub direct: Direct,
    /// Optical depth.
    pub march: March,
    /// Kernel.
    pub kernel: Kernel,
    /// Photons within the radius of a photon; in the sphere of a step.
    pub neighbours: u32,
    /// Spheres of the point estimate.
    pub search: Search,
    /// PNG exposure. \[stops\]
    pub exposure: f64,
    /// Seed of every random stream.
    pub seed: u64,
    /// Pixels to render: x0, y0, x1, y1 (exclusive); all without it.
    pub crop: Option<[u32; 4]>,
    /// Simulate only the effects that the scene calls for.
    pub pruning: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Beam,
            max_bounces: 128,
            photons: 1_000_000,
            passes: 8,
            spp: 1,
            direct: Direct::Sampled,
            march: March::Exact,
            kernel: Kernel::Biweight,
            neighbours: 50,
            search: Search::Nearest,
            exposure: 0.0,
            seed: 0,
            crop: None,
            pruning: true,
        }
    }
}

/// Optical properties of a medium where its density is 1.
#[derive(Debug, Clone, Copy)]
pub struct Optics {
    /// Extinction coefficient. \[1/m\]
    pub extinction: Rgb,
    /// Single-scattering albedo, 0 to 1.
    pub albedo: Rgb,
    /// Phase function.
    pub phase: Phase,
}

/// Phase function of a medium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// 1 / 4 pi in every direction.
    Isotropic,
    /// Henyey-Greenstein with mean cosine g, forward above 0.
    HenyeyGreenstein(f32),
    /// Rayleigh.
    Rayleigh,
}

/// What to do with a level set asked for as density.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convert {
    /// Take the values as they are; a level set is an error.
    None,
    /// Fill the interior of the level set with fog.
    LevelSet,
}

/// A medium from a .vdb file.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The file, resolved against the scene file's folder; `####` or `%04d` stand for the frame.
    pub file: PathBuf,
    /// Grid name as asked for, or the default choice.
    pub density: Option<String>,
    /// Coefficients where the density is 1.
    pub optics: Optics,
    /// Emission.
    pub emission: Option<Emission>,
    /// Applied after the file's own transform.
    pub transform: DAffine3,
    /// Level sets.
    pub convert: Convert,
    /// Refuse, rather than clean, values that are negative or not finite.
    pub strict: bool,
}

/// Emission of a volume.
#[derive(Debug, Clone)]
pub enum Emission {
    /// Planck's law from a temperature grid.
    Blackbody {
        /// Grid name.
        temperature: String,
        /// Kelvin where the grid is 1. \[K\]
        scale: f64,
        /// Factor on the radiance.
        radiance: f64,
    },
}

/// A homogeneous medium.
#[derive(Debug, Clone)]
pub struct Fog {
    /// Box it fills, min and max \[m\]; the whole scene without one.
    pub bounds: Option<[DVec3; 2]>,
    /// Coefficients.
    pub optics: Optics,
}

/// A light. Directions are directions of travel.
#[derive(Debug, Clone)]
pub enum Light {
    /// A distant disc.
    Sun {
        /// Direction of travel, unit length.
        direction: DVec3,
        /// On a facing surface. \[W/m2\]
        irradiance: Rgb,
        /// Apparent diameter; 0 is a delta direction. \[degrees\]
        angular_diameter: f64,
    },
    /// Uniform radiance from everywhere. \[W/(m2 sr)\]
    Sky {
        /// Radiance.
        radiance: Rgb,
    },
    /// Lat-long picture from everywhere: its middle toward -z, its top toward +y.
    SkyImage {
        /// EXR file.
        file: PathBuf,
        /// Factor on its radiance.
        scale: f64,
    },
    /// A point that shines in every direction.
    Point {
        /// \[m\]
        position: DVec3,
        /// \[W\]
        power: Rgb,
    },
    /// A point that shines into a cone.
    Spot {
        /// \[m\]
        position: DVec3,
        /// Axis, unit length.
        direction: DVec3,
        /// Into the cone. \[W\]
        power: Rgb,
        /// Half angle at which the light has gone. \[degrees\]
        cone_angle: f64,
        /// Width of the soft edge inside the cone. \[degrees\]
        penumbra: f64,
        /// PNG that filters its light.
        image: Option<PathBuf>,
    },
    /// A one-sided parallelogram; emits along `edge_u` x `edge_v`.
    Quad {
        /// \[m\]
        corner: DVec3,
        /// \[m\]
        edge_u: DVec3,
        /// \[m\]
        edge_v: DVec3,
        /// \[W/(m2 sr)\]
        radiance: Rgb,
    },
    /// A one-sided disk.
    Disk {
        /// \[m\]
        center: DVec3,
        /// Of the side that emits.
        normal: DVec3,
        /// \[m\]
        radius: f64,
        /// \[W/(m2 sr)\]
        radiance: Rgb,
    },
    /// A sphere.
    Sphere {
        /// \[m\]
        center: DVec3,
        /// \[m\]
        radius: f64,
        /// \[W/(m2 sr)\]
        radiance: Rgb,
    },
}

/// A surface.
#[derive(Debug, Clone)]
pub struct Object {
    /// Name for messages.
    pub name: String,
    /// Form.
    pub shape: Shape,
    /// Placed in the world by.
    pub transform: DAffine3,
    /// Scattering at the surface.
    pub material: Material,
    /// Medium inside a closed surface.
    pub interior: Option<Optics>,
}

/// The form of a surface.
#[derive(Debug, Clone)]
pub enum Shape {
    /// .obj, .ply, .gltf, .glb
    Mesh {
        /// The file.
        file: PathBuf,
    },
    /// A sphere.
    Sphere {
        /// \[m\]
        center: DVec3,
        /// \[m\]
        radius: f64,
    },
    /// A parallelogram; its front is `edge_u` x `edge_v`.
    Quad {
        /// \[m\]
        corner: DVec3,
        /// \[m\]
        edge_u: DVec3,
        /// \[m\]
        edge_v: DVec3,
    },
    /// An axis-aligned box.
    Box {
        /// \[m\]
        min: DVec3,
        /// \[m\]
        max: DVec3,
    },
}

/// Scattering at a surface.
#[derive(Debug, Clone)]
pub enum Material {
    /// Lambertian.
    Diffuse {
        /// 0 to 1.
        reflectance: Rgb,
        /// Image multiplied onto the reflectance.
        texture: Option<PathBuf>,
    },
    /// Perfect mirror.
    Mirror {
        /// 0 to 1.
        reflectance: Rgb,
    },
    /// Dielectric.
    Glass {
        /// Index of refraction inside over outside.
        ior: f64,
        /// GGX roughness alpha; 0 is smooth.
        roughness: f64,
    },
    /// Metal.
    Conductor {
        /// Real part of the index of refraction.
        eta: Rgb,
        /// Imaginary part.
        k: Rgb,
        /// GGX roughness alpha.
        roughness: f64,
    },
    /// Lambertian emitter, both sides black.
    Emissive {
        /// \[W/(m2 sr)\]
        radiance: Rgb,
    },
    /// Index-matched boundary of a medium: bends nothing, uses up no bounce.
    Interface,
}
