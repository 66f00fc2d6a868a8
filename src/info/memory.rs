//! What a grid takes in memory when it is rendered.
//!
//! ```text
//! grid      b * 729 + 8 bytes per brick, 4 * 4096 per table of bricks, 4 per 128^3 voxels
//! b         2 where every value is a 16-bit float that is not negative, else 4
//! bounds    at most 12 * 4096 per table, 12 per 128^3 voxels; fewer where cells merge
//! ratio     grid / (4 * voxels),   voxels: 512 per leaf, or those active in leaves
//! ```
//!
//! Which bricks need storage depends on the values (constant and equal bricks take none, borders
//! of leaves some), so the grid is built and measured, not estimated.

use std::path::Path;

use crate::grid::flights::FlightGrid;
use crate::grid::load::{Taking, load_grid};
use crate::grid::majorant::MajorantGrid;
use crate::scene::Convert;
use crate::vdb::{Archive, GridClass, GridHeader, Statistics};

/// Bytes of a grid that is rendered.
pub(super) struct Memory {
    /// Bricks with storage.
    pub(super) bricks: usize,
    /// Bits of a brick's value.
    pub(super) value_bits: u32,
    /// The grid. \[bytes\]
    pub(super) grid: usize,
    /// The most that its bounds take, whatever the extinction. \[bytes\]
    pub(super) bounds: usize,
    /// Grid over all values of the leaves as f32; none without leaves.
    pub(super) per_leaf_value: Option<f64>,
    /// Grid over the active values of the leaves as f32; none without any.
    pub(super) per_active_value: Option<f64>,
}

impl Memory {
    /// Builds the grid and measures it; none if it cannot be rendered as a density. A level set
    /// is measured as the fog that it can be made into.
    pub(super) fn of(archive: &Archive, header: &GridHeader, stats: &Statistics) -> Option<Self> {
        let taking = Taking {
            convert: match header.class {
                GridClass::LevelSet => Convert::LevelSet,
                _ => Convert::None,
            },
            strict: false,
        };
        let label = header.label();
        let loaded = load_grid(archive, Path::new(archive.file()), Some(&label), taking);
        let grid = loaded.ok()?.grid;
        let bytes = grid.memory_bytes();
        let per = |values: u64| (values > 0).then(|| bytes as f64 / (4 * values) as f64);
        Some(Self {
            bricks: grid.bricks(),
            value_bits: grid.value_bits(),
            grid: bytes,
            bounds: MajorantGrid::most_memory_bytes(&grid) + FlightGrid::most_memory_bytes(&grid),
            per_leaf_value: per(512 * stats.leaves as u64),
            per_active_value: per(stats.leaf_voxels),
        })
    }
}
