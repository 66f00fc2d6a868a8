//! Bounds of the field, cell by cell: for marches and ratio tracking.
//!
//! ```text
//! minorant(C) <= f(p) <= majorant(C)   for every p in cell C, faces included
//! ```
//!
//! The bounds are those of the *interpolated* field: a brick's 9^3 values are all that its cells
//! can interpolate between, so their extremes bound it exactly. Cells are cubes of 8, 16, 32 ...
//! voxels (merge.rs), found by tables.rs. A brick by itself is empty outside the box of its values
//! (place.rs): a ray meets its bounds only inside. Rays meet cells in segments.rs. Free flights have
//! cells of their own (flights.rs).

use glam::{IVec3, Vec3};
use wide::i32x4;

use super::merge::{Bricks, Merging, Price, merged};
use super::place::Place;
use super::segments::{MajorantSegment, Segments};
use super::tables::{Entry, Tables};
use super::{BRICK, Grid};
use crate::ray::Ray;

/// Time of a collision of ratio tracking, which is one with what the field is above the minorant,
/// over that of a step. Lower: marches miss stretches of one value (docs/grid.md); higher: ratio
/// tracking takes more steps than it saves look-ups.
const COLLISION: f64 = 3.0;

/// Bounds over one cube of bricks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    /// Largest value.
    pub(super) majorant: f32,
    /// Smallest value.
    pub(super) minorant: f32,
    /// log2 of the cube's edge in bricks and the box of its values, or a table.
    pub(super) link: u32,
}

/// Marks the link of a brick of which only a box is not empty; the box follows the level.
const BOXED: u32 = 1 << 30;

impl Cell {
    /// The link of a brick that is empty outside the cells of a place's box.
    pub(super) fn brick_link(place: &Place) -> u32 {
        let (low, cells) = (place.low(), place.size() - IVec3::ONE);
        if cells == IVec3::splat(BRICK) {
            return 0;
        }
        let pack = |v: IVec3| (v.x << 8 | v.y << 4 | v.z) as u32;
        BOXED | pack(low) << 4 | pack(cells) << 16
    }
}

impl Entry for Cell {
    const NOTHING: Self = Self {
        majorant: 0.0,
        minorant: 0.0,
        link: 0,
    };

    #[inline]
    fn link(self) -> u32 {
        self.link
    }

    #[inline]
    fn bounds(self) -> [f32; 2] {
        [self.minorant, self.majorant]
    }

    #[inline]
    fn filled(self) -> Option<(i32x4, i32x4)> {
        let field = |shift: u32| (self.link >> shift & 0xf) as i32;
        let at = |shift| i32x4::new([field(shift + 8), field(shift + 4), field(shift), 0]);
        (self.link & BOXED != 0).then(|| (at(4), at(4) + at(16)))
    }
}

/// Bounds of a [`Grid`], merged for a given extinction.
#[derive(Debug, Clone)]
pub struct MajorantGrid(Tables<Cell>);

impl MajorantGrid {
    /// Bounds of `grid`, cells merged for `sigma_t_scale` [1/m where the density is 1] and
    /// `voxel_size` \[m, the longest edge\].
    #[must_use]
    pub fn new(grid: &Grid, sigma_t_scale: f32, voxel_size: f32) -> Self {
        Self::with(grid, sigma_t_scale, voxel_size, Merging::Hierarchy)
    }

    /// Bounds of `grid` in other cells than the renderer's: what those save is measured by this.
    #[must_use]
    pub fn with(grid: &Grid, sigma_t_scale: f32, voxel_size: f32, merging: Merging) -> Self {
        Self::of(&Bricks::new(grid), sigma_t_scale, voxel_size, merging)
    }

    /// The same of bricks whose bounds are known.
    pub(crate) fn of(
        bricks: &Bricks<'_>,
        sigma_t_scale: f32,
        voxel_size: f32,
        merging: Merging,
    ) -> Self {
        let price = Price {
            sigma_t: f64::from(sigma_t_scale) * f64::from(voxel_size),
            collision: COLLISION,
            residual: true,
        };
        Self(merged(bricks, &price, merging).0)
    }

    /// The segments of a local-space ray inside [t0, t1].
    #[inline]
    pub fn segments(
        &self,
        ray: &Ray,
        t0: f32,
        t1: f32,
    ) -> impl Iterator<Item = MajorantSegment> + use<'_> {
        Segments::new(&self.0, ray, [t0, t1])
    }

    /// Smallest and largest density in the merged cell around a local point.
    #[must_use]
    pub fn bounds_at(&self, p: Vec3) -> [f32; 2] {
        self.0.bounds_at(p)
    }

    /// Largest density of the grid.
    #[must_use]
    pub fn highest(&self) -> f32 {
        let mut highest = 0.0f32;
        self.visit_cells(|_, _, majorant| highest = highest.max(majorant));
        highest
    }

    /// Visits the merged cells that are not empty: corners in local voxels, and the largest
    /// density.
    pub fn visit_cells(&self, mut visit: impl FnMut(Vec3, Vec3, f32)) {
        self.0.visit(|low, high, cell| {
            if cell.majorant > 0.0 {
                visit(low, high, cell.majorant);
            }
        });
    }

    /// Bytes that the bounds take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.0.memory_bytes()
    }

    /// The most that the bounds of `grid` take, whatever its extinction: no cells merged.
    #[must_use]
    pub fn most_memory_bytes(grid: &Grid) -> usize {
        Tables::<Cell>::most_bytes(grid)
    }
}
