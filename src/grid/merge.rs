//! Which cells bounds are kept for: bricks, merged where that pays.
//!
//! ```text
//! price(C) = 3/2 edge^2 + collision edge^3 sigma_t d
//! d          majorant, where that collides (flights.rs), or what it is above the minorant (majorant.rs)
//! ```
//!
//! The work of rays through a cube, in steps from cell to cell, when each of its voxels is crossed
//! as often as any other: a line through a cube of this edge is 2/3 edge long in the mean, so that
//! steps number 3/2 / edge in a unit of length, and collisions sigma_t d. From the bricks up, a cube
//! becomes one cell where that is cheaper than what it is made of, at its best. Real collisions are
//! in both prices alike, and empty bricks always merge.
//!
//! Hofmann & Evans 2021 (Ray Tracing Gems II, ch. 43) merge eight cells that are whole themselves, up
//! to an optical range of 1/ln 2 across; that counts as null collisions what the eight have themselves,
//! and leaves dense clouds in small cells.

use glam::{IVec3, UVec3};
use rayon::prelude::*;

use super::majorant::Cell;
use super::place::Place;
use super::tables::{DESCEND, Entry, Tables};
use super::{BRICK, Grid, TABLE, TABLE_BRICKS, in_table, top_index};

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

/// The bounds of a grid's bricks, before any are merged.
pub(crate) struct Bricks<'a> {
    pub(super) grid: &'a Grid,
    /// By table and slot.
    cells: Vec<Cell>,
}

impl<'a> Bricks<'a> {
    /// Looks at every value of a grid.
    pub(crate) fn new(grid: &'a Grid) -> Self {
        let cell = |place: &Place| {
            let [minorant, majorant] = grid.range_at(place);
            Cell {
                majorant,
                minorant,
                link: Cell::brick_link(place),
            }
        };
        let table = |number| -> Vec<Cell> {
            let places = grid.places.table(number);
            places.iter().map(cell).collect()
        };
        let numbers = (0..grid.places.tables()).into_par_iter();
        let cells = numbers.flat_map_iter(table).collect();
        Self { grid, cells }
    }
}

/// Bounds of cells merged for a price; with [`Merging::Hierarchy`], tables are kept unless they are of
/// one value. And which of the grid's tables each one is.
pub(super) fn merged(
    bricks: &Bricks<'_>,
    price: &Price,
    merging: Merging,
) -> (Tables<Cell>, Vec<usize>) {
    let grid = bricks.grid;
    match merging {
        Merging::Hierarchy => {
            let (mut this, kept) = of_tables(bricks, |table| merge_table(table, price));
            merge_top(&mut this, price);
            (this, kept)
        }
        Merging::Bricks => {
            let (mut this, kept) = of_tables(bricks, <[Cell]>::to_vec);
            for cell in this.top.iter_mut().filter(|c| c.table().is_none()) {
                cell.link = 0;
            }
            (this, kept)
        }
        Merging::Global => {
            let [minorant, majorant] = grid.range();
            let edge = grid.dims().max_element() * TABLE as u32;
            let whole = Cell {
                majorant,
                minorant,
                link: edge.next_power_of_two().ilog2(),
            };
            let this = Tables {
                dims: grid.dims(),
                top: vec![whole; grid.places.top().len()],
                bricks: Vec::new(),
                support: grid.support(),
            };
            (this, Vec::new())
        }
    }
}

/// Bounds whose tables' bricks are merged by `merge`, which gives one cell for a table without any.
fn of_tables(
    bricks: &Bricks<'_>,
    merge: impl Fn(&[Cell]) -> Vec<Cell> + Send + Sync,
) -> (Tables<Cell>, Vec<usize>) {
    // Top cells that share a table share its bounds.
    let of_tables = bricks.cells.par_chunks(TABLE_BRICKS);
    let merged: Vec<Vec<Cell>> = of_tables.map(merge).collect();
    let grid = bricks.grid;
    let (mut bricks, mut kept) = (Vec::new(), Vec::new());
    let mut wholes = Vec::new();
    for (number, cells) in merged.into_iter().enumerate() {
        let mut whole = cells[0];
        if cells.len() > 1 {
            whole.link = DESCEND | kept.len() as u32;
            bricks.extend(cells);
            kept.push(number);
        }
        wholes.push(whole);
    }
    bricks.shrink_to_fit();
    let top = grid
        .places
        .top()
        .iter()
        .map(|&entry| {
            let Some(place) = grid.places.constant(entry) else {
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
    let tables = Tables {
        dims: grid.dims(),
        top,
        bricks,
        support: grid.support(),
    };
    (tables, kept)
}

/// Merges top cells, cubes of 2, 4, 8 ... at a time.
fn merge_top(cells: &mut Tables<Cell>, price: &Price) {
    let mut size = 1u32;
    while size * 2 <= cells.dims.max_element() {
        let double = size * 2;
        let blocks = (cells.dims + UVec3::splat(double - 1)) / double;
        for x in 0..blocks.x {
            for y in 0..blocks.y {
                for z in 0..blocks.z {
                    merge_block(cells, UVec3::new(x, y, z) * double, size, price);
                }
            }
        }
        size = double;
    }
}

/// Merges the eight cubes of `size` top cells from `lowest` on, if all are whole and it pays.
fn merge_block(cells: &mut Tables<Cell>, lowest: UVec3, size: u32, price: &Price) {
    let level = (size * TABLE as u32).ilog2();
    let mut parts = Cube::NOTHING;
    for i in 0..8u32 {
        let c = lowest + UVec3::new(i & 1, i >> 1 & 1, i >> 2) * size;
        if c.cmpge(cells.dims).any() {
            continue;
        }
        let cell = cells.top[top_index(cells.dims, c)];
        if cell.link != level {
            return;
        }
        parts.add(&Cube::of(cell, price));
    }
    let whole = parts.cell(level + 1);
    if price.of(&whole) > parts.price {
        return;
    }
    let high = (lowest + UVec3::splat(2 * size)).min(cells.dims);
    for x in lowest.x..high.x {
        for y in lowest.y..high.y {
            for z in lowest.z..high.z {
                let at = top_index(cells.dims, UVec3::new(x, y, z));
                cells.top[at] = whole;
            }
        }
    }
}

/// What cells cost.
pub(super) struct Price {
    /// Where the density is 1. \[1/voxel\]
    pub(super) sigma_t: f64,
    /// Time of a collision over that of a step.
    pub(super) collision: f64,
    /// Set where what is below the minorant does not collide.
    pub(super) residual: bool,
}

impl Price {
    fn of(&self, cell: &Cell) -> f64 {
        let edge = f64::from(BRICK << cell.level());
        let mut density = f64::from(cell.majorant);
        if self.residual {
            density -= f64::from(cell.minorant);
        }
        edge * edge * (1.5 + self.collision * edge * self.sigma_t * density)
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

/// Bounds of the bricks of one table, merged; of the whole alone where it is of one value.
fn merge_table(bricks: &[Cell], price: &Price) -> Vec<Cell> {
    let mut cells = bricks.to_vec();
    merge_cube(&mut cells, IVec3::ZERO, TABLE.ilog2(), price);
    let whole = cells[0];
    if whole.level() == TABLE.ilog2() && whole.majorant == whole.minorant {
        cells.truncate(1);
    }
    cells
}

/// Merges a cube of bricks of one table, and the cubes in it, where that pays.
fn merge_cube(cells: &mut [Cell], lowest: IVec3, level: u32, price: &Price) -> Cube {
    if level == 0 {
        return Cube::of(cells[in_table(lowest)], price);
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
