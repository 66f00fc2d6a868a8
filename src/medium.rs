//! Media: a density field and the coefficients it scales.
//!
//! ```text
//! sigma_t(x) = extinction * density(x)     sigma_s = albedo * sigma_t     [1/m]
//! ```
//!
//! Media that overlap sum their coefficients. Nothing here sums them explicitly: collisions of
//! independent media are independent Poisson processes, so the first collision of the sum is the
//! first of the media's own first collisions, and the transmittance of the sum is the product.
//! Each medium keeps its own grid, transform and bounds.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DVec3, IVec3, Vec3};

use crate::blackbody::Blackbody;
use crate::grid::Grid;
use crate::grid::build::BuildError;
use crate::grid::flights::FlightGrid;
use crate::grid::majorant::MajorantGrid;
use crate::grid::merge::{Bricks, Merging};
use crate::grid::plateau::Plateau;
use crate::phase::PhaseFunction;
use crate::ray::{Bounds, ExactRay, Ray};
use crate::scene::Rgb;
use crate::spectrum::Spectrum;

/// Where a grid's local voxels are in the world, relative to the scene's origin.
///
/// Single points and free flights are mapped in f32. Integrals along rays are exact to 1e-6 only if
/// the ray is mapped in f64: rounded, it is 1e-5 of a voxel off.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    rounded: Affine3A,
    exact: DAffine3,
}

impl Placement {
    /// The world is the local voxels.
    pub const IDENTITY: Self = Self {
        rounded: Affine3A::IDENTITY,
        exact: DAffine3::IDENTITY,
    };

    /// Of a transform from local voxels to the world.
    #[must_use]
    pub fn new(local_to_world: &DAffine3) -> Self {
        let exact = local_to_world.inverse();
        Self {
            rounded: Affine3A::from_mat3_translation(
                exact.matrix3.as_mat3(),
                exact.translation.as_vec3(),
            ),
            exact,
        }
    }

    /// A world point in local voxels.
    #[inline]
    #[must_use]
    pub fn local(&self, p: Vec3) -> Vec3 {
        self.rounded.transform_point3(p)
    }

    /// The ray in local voxels; its parameter stays in metres of the world's ray.
    #[inline]
    #[must_use]
    pub fn local_ray(&self, ray: &Ray) -> Ray {
        Ray {
            origin: self.rounded.transform_point3(ray.origin),
            direction: self.rounded.transform_vector3(ray.direction),
        }
    }

    /// The ray of [`local_ray`](Self::local_ray) in f64.
    #[inline]
    #[must_use]
    pub fn exact_ray(&self, ray: &Ray) -> ExactRay {
        ExactRay {
            origin: self.exact.transform_point3(ray.origin.as_dvec3()),
            direction: self.exact.transform_vector3(ray.direction.as_dvec3()),
        }
    }

    /// Local voxels to the world.
    #[must_use]
    pub fn to_world(&self) -> Affine3A {
        self.rounded.inverse()
    }
}

/// Greatest extinction of a grid \[1/m\]. Lower: light would be seen to get into voxels of less than
/// a thousandth of that; higher: products with lengths overflow.
const MOST_EXTINCTION: f32 = 1e30;

/// A grid placed in the world.
#[derive(Debug, Clone)]
pub struct GridField {
    /// The field, shared by all renders of a study.
    pub grid: Arc<Grid>,
    /// Its bounds, merged for the medium's extinction.
    pub majorants: MajorantGrid,
    /// Those of its free flights.
    pub flights: FlightGrid,
    /// Where it is.
    pub placement: Placement,
    /// Longest voxel edge. \[m\]
    pub voxel_size: f32,
    /// Box around the support in the world.
    pub bounds: Bounds,
}

impl GridField {
    /// Places `grid`, whose index space maps to the world by its own transform and then `after`,
    /// in a world whose origin is at `origin` \[m\]. `extinction` \[1/m\] sets the merging of bounds.
    #[must_use]
    pub fn new(
        grid: impl Into<Arc<Grid>>,
        after: &DAffine3,
        origin: DVec3,
        extinction: f32,
    ) -> Self {
        let grid: Arc<Grid> = grid.into();
        let local_to_world = DAffine3::from_translation(-origin) * *after * grid.local_to_world();
        let voxel_size = local_to_world
            .matrix3
            .x_axis
            .length()
            .max(local_to_world.matrix3.y_axis.length())
            .max(local_to_world.matrix3.z_axis.length()) as f32;
        let mut bounds = Bounds::EMPTY;
        let support = grid.support();
        if !support.is_empty() {
            for i in 0..8 {
                let pick = |bit: usize, a: f32, b: f32| if i >> bit & 1 == 0 { a } else { b };
                let corner = Vec3::new(
                    pick(0, support.min.x, support.max.x),
                    pick(1, support.min.y, support.max.y),
                    pick(2, support.min.z, support.max.z),
                );
                bounds =
                    bounds.including(local_to_world.transform_point3(corner.as_dvec3()).as_vec3());
            }
        }
        let bricks = Bricks::new(&grid);
        let merging = Merging::Hierarchy;
        let majorants = MajorantGrid::of(&bricks, extinction, voxel_size, merging);
        let flights = FlightGrid::of(&bricks, extinction, voxel_size, merging);
        Self {
            grid,
            majorants,
            flights,
            placement: Placement::new(&local_to_world),
            voxel_size,
            bounds,
        }
    }

    /// The same of a grid of any finite values, in units of its own, with the extinction of 1 such
    /// unit for that of density 1 \[1/m\].
    #[must_use]
    pub fn in_units<S: Spectrum>(
        grid: impl Into<Arc<Grid>>,
        after: &DAffine3,
        origin: DVec3,
        sigma_t: S,
    ) -> (Self, S) {
        let (grid, unit) = grid.into().in_units();
        let sigma_t = sigma_t.map(|k| (k * unit).min(MOST_EXTINCTION));
        let field = Self::new(grid, after, origin, sigma_t.max_channel());
        (field, sigma_t)
    }

    /// The density at a world point.
    #[inline]
    #[must_use]
    pub fn density(&self, p: Vec3) -> f32 {
        self.grid.lookup(self.placement.local(p))
    }
}

impl GridField {
    /// Density 1 all over a box in the world, 0 outside, as a grid: the general form of a
    /// homogeneous medium.
    ///
    /// # Errors
    /// [`BuildError`]: a box that is empty or not finite.
    pub fn filled(bounds: &Bounds, extinction: f32) -> Result<Self, BuildError> {
        /// Voxels along an edge: bricks enough for bounds that differ from place to place.
        const VOXELS: i32 = 64;
        // In the middle of a brick, as boxes in files are: bricks that hold an edge vary.
        let first = IVec3::splat(crate::grid::BRICK / 2);
        let to_world = DAffine3::from_translation(bounds.min.as_dvec3())
            * DAffine3::from_scale(bounds.size().as_dvec3() / f64::from(VOXELS))
            * DAffine3::from_translation(-first.as_dvec3());
        let grid = Grid::from_fn(first, first + VOXELS, to_world, |_| 1.0)?;
        // The last voxels fall to 0 beyond the box.
        let low = (first - grid.origin()).as_vec3();
        let grid = grid.cut(&Bounds {
            min: low,
            max: low + VOXELS as f32,
        });
        Ok(Self::new(
            grid,
            &DAffine3::IDENTITY,
            DVec3::ZERO,
            extinction,
        ))
    }

    /// The same field in closed form, if its grid is of one value all over a box.
    #[must_use]
    pub fn plateau(&self) -> Option<PlateauField> {
        Some(PlateauField {
            plateau: self.grid.plateau()?,
            placement: self.placement,
            voxel_size: self.voxel_size,
            bounds: self.bounds,
        })
    }
}

/// A plateau placed in the world.
#[derive(Debug, Clone)]
pub struct PlateauField {
    /// The field.
    pub plateau: Plateau,
    /// Where it is.
    pub placement: Placement,
    /// Longest voxel edge. \[m\]
    pub voxel_size: f32,
    /// Box around the support in the world.
    pub bounds: Bounds,
}

/// Where the density comes from.
#[derive(Debug, Clone)]
pub enum Field {
    /// 1 inside a box, or everywhere.
    Constant {
        /// The box.
        bounds: Option<Bounds>,
    },
    /// A sparse grid.
    Grid(Box<GridField>),
    /// A grid of one value all over a box, in closed form.
    Plateau(Box<PlateauField>),
}

/// Emission from a temperature grid by Planck's law.
#[derive(Debug, Clone)]
pub struct EmissionField {
    /// Temperatures; times `scale` in kelvin.
    pub temperature: GridField,
    /// Kelvin where the grid is 1. \[K\]
    pub scale: f32,
    /// Luminance where the grid is 1. \[W/(m2 sr)\]
    pub radiance: f32,
    /// Planck's law.
    pub blackbody: Blackbody,
}

impl EmissionField {
    /// Emitted radiance at a world point. \[W/(m2 sr)\]
    #[must_use]
    pub fn radiance_at(&self, p: Vec3) -> Rgb {
        self.blackbody.rgb(self.temperature.density(p) * self.scale) * self.radiance
    }
}

/// One medium.
#[derive(Debug, Clone)]
pub struct Medium<S> {
    /// Extinction coefficient where the density is 1. \[1/m\]
    pub sigma_t: S,
    /// Single-scattering albedo.
    pub albedo: S,
    /// Phase function.
    pub phase: PhaseFunction,
    /// Density.
    pub field: Field,
    /// Emission.
    pub emission: Option<EmissionField>,
}

impl<S: Spectrum> Medium<S> {
    /// The density at a world point.
    #[inline]
    #[must_use]
    pub fn density(&self, p: Vec3) -> f32 {
        match &self.field {
            Field::Constant { bounds } => f32::from(u8::from(bounds.is_none_or(|b| b.contains(p)))),
            Field::Grid(field) => field.density(p),
            Field::Plateau(field) => field.plateau.at(field.placement.local(p)),
        }
    }

    /// True where some light is absorbed at collisions.
    #[inline]
    #[must_use]
    pub fn absorbs(&self) -> bool {
        self.albedo != S::ONE
    }

    /// Box around the medium; none where it is everywhere.
    #[must_use]
    pub fn bounds(&self) -> Option<Bounds> {
        match &self.field {
            Field::Constant { bounds } => *bounds,
            Field::Grid(field) => Some(field.bounds),
            Field::Plateau(field) => Some(field.bounds),
        }
    }

    /// Longest voxel edge \[m\]; none of a homogeneous medium.
    #[must_use]
    pub fn voxel_size(&self) -> Option<f32> {
        match &self.field {
            Field::Constant { .. } => None,
            Field::Grid(field) => Some(field.voxel_size),
            Field::Plateau(field) => Some(field.voxel_size),
        }
    }
}
