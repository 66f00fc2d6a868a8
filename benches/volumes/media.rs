//! Media of the volumes, with bounds in one kind of cells or another.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use vpm_vdb::grid::Grid;
use vpm_vdb::grid::flights::FlightGrid;
use vpm_vdb::grid::majorant::MajorantGrid;
use vpm_vdb::grid::merge::Merging;
use vpm_vdb::grid::walk::integral;
use vpm_vdb::medium::{Field, GridField, Medium, Placement};
use vpm_vdb::phase::PhaseFunction;
use vpm_vdb::ray::Ray;

/// Optical thickness through the middle, along the longest axis.
pub(crate) const THICKNESS: f32 = 30.0;

/// The cells of the bounds, by name.
pub(crate) const MERGINGS: [(&str, Merging); 3] = [
    ("hierarchy", Merging::Hierarchy),
    ("bricks", Merging::Bricks),
    ("global", Merging::Global),
];

/// The extinction \[1/voxel\] that makes a grid [`THICKNESS`] thick through its middle.
pub(crate) fn extinction(grid: &Grid) -> f32 {
    let support = grid.support();
    let axis = support.size().max_position();
    let direction = Vec3::AXES[axis];
    let mut origin = support.center();
    origin[axis] = support.min[axis] - 1.0;
    let majorants = MajorantGrid::new(grid, 1.0, 1.0);
    let ray = Ray { origin, direction };
    let whole = [0.0, f32::INFINITY];
    let (depth, _) = integral(grid, &majorants, &(&ray).into(), whole, f64::INFINITY);
    THICKNESS / depth as f32
}

/// A medium in the grid's own voxels, with bounds in these cells. All share the grid: copies would
/// drive each other out of the cache.
pub(crate) fn medium(grid: &Arc<Grid>, sigma_t: f32, merging: Merging) -> Medium<f32> {
    let to_local = DAffine3::IDENTITY;
    let mut field = GridField::new(Arc::clone(grid), &to_local, DVec3::ZERO, sigma_t);
    field.placement = Placement::IDENTITY;
    field.majorants = MajorantGrid::with(grid, sigma_t, 1.0, merging);
    field.flights = FlightGrid::with(grid, sigma_t, 1.0, merging);
    Medium {
        sigma_t,
        albedo: 1.0,
        phase: PhaseFunction::Isotropic,
        field: Field::Grid(Box::new(field)),
        emission: None,
    }
}
