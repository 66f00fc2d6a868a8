//! Which cells bounds are kept for: bricks, merged where that pays.
//!
//! ```text
//! price(C) = 3/2 edge^2 + edge^3 sigma_t (COLLISION majorant + LOOKUP (majorant - minorant))
//! ```
//!
//! The work of flights through a cube, in steps from cell to cell, when each of its voxels is crossed
//! as often as any other: a line through a cube of this edge is 2/3 edge long in the mean, so that
//! steps number 3/2 / edge in a unit of length, and collisions sigma_t majorant, of which those above
//! the minorant cost a look-up. From the bricks up, a cube becomes one cell where that is cheaper
//! than what it is made of, at its best. Real collisions are in both prices alike, and empty
//! bricks always merge.
//!
//! A brick that is empty outside a box is dearer to step through and has collisions in its box alone:
//! where that does not pay flights take it whole.
//!
//! Hofmann & Evans 2021 (Ray Tracing Gems II, ch. 43) merge eight cells that are whole themselves, up
//! to an optical range of 1/ln 2 across; that counts as null collisions what the eight have themselves,
//! and leaves dense clouds in small cells.

use glam::{IVec3, UVec3};
use rayon::prelude::*;

use super::majorant::{Cell, DESCEND, MajorantGrid};
use super::place::Place;
use super::{BRICK, Grid, TABLE, TABLE_BRICKS, in_table, top_index};

/// Time of a collision, null or real, over that of a step (docs/grid.md). Larger, as [`LOOKUP`]: more
/// steps; smaller: more collisions.
const COLLISION: f64 = 0.4;
/// Time of a look-up over that of a step.
const LOOKUP: f64 = 0.6;
/// Time of a step through a boxed brick over that of another. Larger: more null collisions in empty
/// corners; smaller: more steps through bricks that hardly matter.
const BOXED_STEP: f64 = 1.4;

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
        let price = Price::new(sigma_t_scale, voxel_size);
        let mut this = Self::of_tables(grid, |table| merge_table(grid, table, &price));
        this.merge_top(&price);
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
    fn merge_top(&mut self, price: &Price) {
        let mut size = 1u32;
        while size * 2 <= self.dims.max_element() {
            let double = size * 2;
            let blocks = (self.dims + UVec3::splat(double - 1)) / double;
            for x in 0..blocks.x {
                for y in 0..blocks.y {
                    for z in 0..blocks.z {
                        self.merge_block(UVec3::new(x, y, z) * double, size, price);
                    }
                }
            }
            size = double;
        }
    }

    /// Merges the eight cubes of `size` top cells from `lowest` on, if all are whole and it pays.
    fn merge_block(&mut self, lowest: UVec3, size: u32, price: &Price) {
        let level = (size * TABLE as u32).ilog2();
        let mut parts = Cube::NOTHING;
        for i in 0..8u32 {
            let c = lowest + UVec3::new(i & 1, i >> 1 & 1, i >> 2) * size;
            if c.cmpge(self.dims).any() {
                continue;
            }
            let cell = self.top[top_index(self.dims, c)];
            if cell.link != level {
                return;
            }
            parts.add(&Cube::of(cell, price));
        }
        let whole = parts.cell(level + 1);
        if price.of(&whole) > parts.price {
            return;
        }
        let high = (lowest + UVec3::splat(2 * size)).min(self.dims);
        for x in lowest.x..high.x {
            for y in lowest.y..high.y {
                for z in lowest.z..high.z {
                    let at = top_index(self.dims, UVec3::new(x, y, z));
                    self.top[at] = whole;
                }
            }
        }
    }
}

/// What cells cost.
struct Price {
    /// Where the density is 1. [1/voxel]
    sigma_t: f64,
}

impl Price {
    fn new(sigma_t_scale: f32, voxel_size: f32) -> Self {
        Self {
            sigma_t: f64::from(sigma_t_scale) * f64::from(voxel_size),
        }
    }

    /// Of a cell, without a box.
    fn of(&self, cell: &Cell) -> f64 {
        let edge = f64::from(BRICK << cell.level());
        1.5 * edge * edge + self.collisions(cell, edge * edge * edge)
    }

    /// Of a boxed brick with its box.
    fn of_boxed(&self, cell: &Cell) -> f64 {
        let edge = f64::from(BRICK);
        BOXED_STEP * 1.5 * edge * edge + self.collisions(cell, f64::from(cell.filled_cells()))
    }

    fn collisions(&self, cell: &Cell, volume: f64) -> f64 {
        let (majorant, minorant) = (f64::from(cell.majorant), f64::from(cell.minorant));
        let each = COLLISION * majorant + LOOKUP * (majorant - minorant);
        volume * self.sigma_t * each
    }
}

/// A cube of cells, at its best.
struct Cube {
    minorant: f32,
    majorant: f32,
    price: f64,
}

impl Cube {
    const NOTHING: Self = Self {
        minorant: f32::MAX,
        majorant: f32::MIN,
        price: 0.0,
    };

    fn of(cell: Cell, price: &Price) -> Self {
        Self {
            minorant: cell.minorant,
            majorant: cell.majorant,
            price: price.of(&cell),
        }
    }

    fn add(&mut self, other: &Self) {
        self.minorant = self.minorant.min(other.minorant);
        self.majorant = self.majorant.max(other.majorant);
        self.price += other.price;
    }

    /// The cell that it is when merged.
    fn cell(&self, level: u32) -> Cell {
        Cell {
            majorant: self.majorant,
            minorant: self.minorant,
            link: level,
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
fn merge_table(grid: &Grid, table: &[Place], price: &Price) -> (Cell, Vec<Cell>) {
    let mut cells = brick_cells(grid, table);
    merge_cube(&mut cells, IVec3::ZERO, TABLE.ilog2(), price);
    let whole = cells[0];
    if whole.level() == TABLE.ilog2() {
        (whole, Vec::new())
    } else {
        (whole, cells)
    }
}

/// Merges a cube of bricks of one table, and the cubes in it, where that pays.
fn merge_cube(cells: &mut [Cell], lowest: IVec3, level: u32, price: &Price) -> Cube {
    if level == 0 {
        let cell = &mut cells[in_table(lowest)];
        let mut cube = Cube::of(*cell, price);
        if cell.is_boxed() {
            let boxed = price.of_boxed(cell);
            if boxed < cube.price {
                cube.price = boxed;
            } else {
                *cell = cell.loosened();
            }
        }
        return cube;
    }
    let mut parts = Cube::NOTHING;
    for i in 0..8 {
        let part = IVec3::new(i & 1, i >> 1 & 1, i >> 2) << (level - 1);
        parts.add(&merge_cube(cells, lowest + part, level - 1, price));
    }
    let whole = parts.cell(level);
    if price.of(&whole) > parts.price {
        return parts;
    }
    let size = 1 << level;
    for x in 0..size {
        for y in 0..size {
            for z in 0..size {
                cells[in_table(lowest + IVec3::new(x, y, z))] = whole;
            }
        }
    }
    Cube::of(whole, price)
}
