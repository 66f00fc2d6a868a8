//! Which cells bounds are kept for: bricks, merged where that pays.
//!
//! ```text
//! sigma_t_scale * (majorant - minorant) * diagonal <= MERGE_OPTICAL_RANGE
//! ```
//!
//! Eight siblings become one cell where the null collisions expected of its looser bounds are fewer
//! than the steps it saves (Hofmann & Evans 2021, Ray Tracing Gems II ch. 43, whose threshold is
//! 1/ln 2). Empty bricks always merge.

use glam::UVec3;
use rayon::prelude::*;

use super::majorant::{Cell, DESCEND, MajorantGrid};
use super::place::Place;
use super::{BRICK, Grid, TABLE, TABLE_BRICKS, top_index};

/// Optical range of a merged cell. Larger: more null collisions; smaller: more steps.
pub const MERGE_OPTICAL_RANGE: f32 = std::f32::consts::LOG2_E;

/// Which cells the bounds are kept for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merging {
    /// Bricks, merged where that pays: the renderer's.
    Hierarchy,
    /// Every brick by itself. To measure against.
    Bricks,
    /// The whole field as one cell. To measure against.
    Global,
}

impl MajorantGrid {
    /// Bounds of `grid`, cells merged for `sigma_t_scale` [1/m where the density is 1] and
    /// `voxel_size` \[m, the longest edge\].
    #[must_use]
    pub fn new(grid: &Grid, sigma_t_scale: f32, voxel_size: f32) -> Self {
        // Optical range per unit of value range, for a cell of one brick.
        let weight = sigma_t_scale * voxel_size * BRICK as f32 * 3f32.sqrt();
        let mut this = Self::of_tables(grid, |table| merge_table(grid, table, weight));
        this.merge_top(weight);
        this
    }

    /// Bounds of `grid` in other cells than the renderer's: what those save is measured by this.
    #[must_use]
    pub fn with(grid: &Grid, sigma_t_scale: f32, voxel_size: f32, merging: Merging) -> Self {
        match merging {
            Merging::Hierarchy => Self::new(grid, sigma_t_scale, voxel_size),
            Merging::Bricks => {
                let mut this = Self::of_tables(grid, |table| {
                    let cells = brick_cells(grid, table);
                    (cells[0], cells)
                });
                for cell in this.top.iter_mut().filter(|c| c.link & DESCEND == 0) {
                    cell.link = 0;
                }
                this
            }
            Merging::Global => {
                let mut this = Self::of_tables(grid, |table| (brick_cells(grid, table)[0], vec![]));
                let [minorant, majorant] = grid.range();
                let edge = this.dims.max_element() * TABLE as u32;
                this.top.fill(Cell {
                    majorant,
                    minorant,
                    link: edge.next_power_of_two().ilog2(),
                });
                this
            }
        }
    }

    /// Bounds whose tables' bricks are merged by `merge`: the whole table's cell, and its bricks'.
    fn of_tables(grid: &Grid, merge: impl Fn(&[Place]) -> (Cell, Vec<Cell>) + Send + Sync) -> Self {
        let dims = grid.dims();
        // Top cells that share a table share its bounds.
        let merged: Vec<(Cell, Vec<Cell>)> =
            grid.tables.par_chunks(TABLE_BRICKS).map(merge).collect();
        let mut tables = Vec::new();
        let wholes: Vec<Cell> = merged
            .into_iter()
            .map(|(mut cell, table)| {
                if !table.is_empty() {
                    cell.link = DESCEND | (tables.len() / TABLE_BRICKS) as u32;
                    tables.extend(table);
                }
                cell
            })
            .collect();
        tables.shrink_to_fit();
        let top = grid
            .top
            .iter()
            .map(|&entry| {
                let Some(place) = grid.constant_place(entry) else {
                    return wholes[entry as usize];
                };
                let [minorant, majorant] = grid.range_at(place);
                Cell {
                    majorant,
                    minorant,
                    link: TABLE.ilog2(),
                }
            })
            .collect();
        Self {
            dims,
            top,
            tables,
            support: grid.support(),
        }
    }

    /// Merges top cells, cubes of 2, 4, 8 ... at a time.
    fn merge_top(&mut self, weight: f32) {
        let mut size = 1u32;
        while size * 2 <= self.dims.max_element() {
            let double = size * 2;
            let blocks = (self.dims + UVec3::splat(double - 1)) / double;
            for x in 0..blocks.x {
                for y in 0..blocks.y {
                    for z in 0..blocks.z {
                        self.merge_block(UVec3::new(x, y, z) * double, size, weight);
                    }
                }
            }
            size = double;
        }
    }

    /// Merges the eight cubes of `size` top cells from `lowest` on, if all are whole and alike.
    fn merge_block(&mut self, lowest: UVec3, size: u32, weight: f32) {
        let level = (size * TABLE as u32).ilog2();
        let mut bounds = [f32::MAX, f32::MIN];
        for i in 0..8u32 {
            let c = lowest + UVec3::new(i & 1, i >> 1 & 1, i >> 2) * size;
            if c.cmpge(self.dims).any() {
                continue;
            }
            let cell = self.top[top_index(self.dims, c)];
            if cell.link != level {
                return;
            }
            bounds = [bounds[0].min(cell.minorant), bounds[1].max(cell.majorant)];
        }
        let edge = (2 * size * TABLE as u32) as f32;
        if (bounds[1] - bounds[0]) * weight * edge > MERGE_OPTICAL_RANGE {
            return;
        }
        let high = (lowest + UVec3::splat(2 * size)).min(self.dims);
        for x in lowest.x..high.x {
            for y in lowest.y..high.y {
                for z in lowest.z..high.z {
                    let at = top_index(self.dims, UVec3::new(x, y, z));
                    self.top[at] = Cell {
                        minorant: bounds[0],
                        majorant: bounds[1],
                        link: level + 1,
                    };
                }
            }
        }
    }
}

/// Bounds of the bricks of one table.
fn brick_cells(grid: &Grid, table: &[Place]) -> Vec<Cell> {
    table
        .iter()
        .map(|&place| {
            let [minorant, majorant] = grid.range_at(place);
            Cell {
                majorant,
                minorant,
                link: Cell::brick_link(place),
            }
        })
        .collect()
}

/// Bounds of the bricks of one table, merged; an empty list where the whole cell is one.
fn merge_table(grid: &Grid, table: &[Place], weight: f32) -> (Cell, Vec<Cell>) {
    let mut cells = brick_cells(grid, table);
    for level in 0..4u32 {
        let (half, size) = (1usize << level, 2usize << level);
        for x in (0..16).step_by(size) {
            for y in (0..16).step_by(size) {
                for z in (0..16).step_by(size) {
                    merge_eight(&mut cells, [x, y, z], half, level, weight);
                }
            }
        }
    }
    let whole = cells[0];
    if whole.level() == 4 {
        (whole, Vec::new())
    } else {
        (whole, cells)
    }
}

/// Merges eight sibling cubes of `half` bricks, if all are whole and alike.
fn merge_eight(cells: &mut [Cell], at: [usize; 3], half: usize, level: u32, weight: f32) {
    let index = |x: usize, y: usize, z: usize| (x << 8) | (y << 4) | z;
    let mut bounds = [f32::MAX, f32::MIN];
    for i in 0..8 {
        let cell = cells[index(
            at[0] + (i & 1) * half,
            at[1] + (i >> 1 & 1) * half,
            at[2] + (i >> 2) * half,
        )];
        if cell.level() != level {
            return;
        }
        bounds = [bounds[0].min(cell.minorant), bounds[1].max(cell.majorant)];
    }
    let edge = (2 * half) as f32;
    if (bounds[1] - bounds[0]) * weight * edge > MERGE_OPTICAL_RANGE {
        return;
    }
    for x in at[0]..at[0] + 2 * half {
        for y in at[1]..at[1] + 2 * half {
            for z in at[2]..at[2] + 2 * half {
                cells[index(x, y, z)] = Cell {
                    minorant: bounds[0],
                    majorant: bounds[1],
                    link: level + 1,
                };
            }
        }
    }
}
