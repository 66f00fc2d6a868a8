//! The index of a grid under construction: entries of top cells and of their bricks.
//!
//! An entry names a table (of a top cell) or a brick (of a table) by its number, or a constant.
//! The finished grid keeps the same two levels, with places of values for numbers of bricks.

use glam::{IVec3, UVec3};

use super::{CONSTANT, TABLE_BRICKS, TOP_LOG2, in_table, top_cell, top_index};

/// Two levels of entries.
pub(super) struct Index {
    /// Index coordinates of local (0, 0, 0).
    pub(super) origin: IVec3,
    /// Top cells along each axis.
    pub(super) dims: UVec3,
    /// Entry of each top cell: a table, or a constant.
    pub(super) top: Vec<u32>,
    /// Entries of each table's bricks: a brick, or a constant.
    pub(super) tables: Vec<u32>,
    /// Values of constant cells; the first is 0.
    pub(super) constants: Vec<f32>,
}

impl Index {
    /// No cells.
    pub(super) fn empty() -> Self {
        Self {
            origin: IVec3::ZERO,
            dims: UVec3::ZERO,
            top: Vec::new(),
            tables: Vec::new(),
            constants: vec![0.0],
        }
    }

    /// Entry of a brick.
    pub(super) fn entry(&self, brick: IVec3) -> u32 {
        let cell = (brick >> 4i32).as_uvec3();
        if cell.cmpge(self.dims).any() {
            return CONSTANT;
        }
        let entry = self.top[top_index(self.dims, cell)];
        if entry & CONSTANT != 0 {
            return entry;
        }
        self.tables[entry as usize * TABLE_BRICKS + in_table(brick)]
    }

    /// Value of an entry that is a constant.
    pub(super) fn constant_value(&self, entry: u32) -> Option<f32> {
        (entry & CONSTANT != 0).then(|| self.constants[(entry & !CONSTANT) as usize])
    }

    /// Coordinates of the top cell at a linear index.
    pub(super) fn top_cell(&self, at: usize) -> IVec3 {
        top_cell(self.dims, at)
    }

    /// Entry of a constant, added if it is new.
    pub(super) fn constant(&mut self, value: f32) -> u32 {
        let constants = &mut self.constants;
        // Tiles of a file hold few distinct values; the last ones are the likeliest.
        let at = constants
            .iter()
            .rev()
            .take(16)
            .position(|c| c.to_bits() == value.to_bits());
        let index = match at {
            Some(back) => constants.len() - 1 - back,
            None => {
                constants.push(value);
                constants.len() - 1
            }
        };
        CONSTANT | index as u32
    }

    /// Sets the entries of top cells a..=b that the grid has.
    pub(super) fn set_top(&mut self, a: IVec3, b: IVec3, entry: u32) {
        let a = a.max(IVec3::ZERO);
        let b = b.min(self.dims.as_ivec3() - IVec3::ONE);
        for x in a.x..=b.x {
            for y in a.y..=b.y {
                for z in a.z..=b.z {
                    let at = top_index(self.dims, IVec3::new(x, y, z).as_uvec3());
                    self.top[at] = entry;
                }
            }
        }
    }

    /// Sets the entry of a brick, making the table it lies in.
    pub(super) fn set_brick(&mut self, brick: IVec3, entry: u32) {
        let cell = (brick >> 4i32).as_uvec3();
        if cell.cmpge(self.dims).any() {
            return;
        }
        let at = top_index(self.dims, cell);
        let table = match self.top[at] {
            constant if constant & CONSTANT != 0 => {
                let table = (self.tables.len() / TABLE_BRICKS) as u32;
                self.tables
                    .resize(self.tables.len() + TABLE_BRICKS, constant);
                self.top[at] = table;
                table
            }
            table => table,
        };
        self.tables[table as usize * TABLE_BRICKS + in_table(brick)] = entry;
    }

    /// Tables of one constant become that constant.
    pub(super) fn dissolve_tables(&mut self) {
        let value = |this: &Self, entry| this.constant_value(entry).map(f32::to_bits);
        let mut renamed = Vec::with_capacity(self.tables.len() / TABLE_BRICKS);
        let mut kept = 0;
        for index in 0..self.tables.len() / TABLE_BRICKS {
            let from = index * TABLE_BRICKS;
            let table = &self.tables[from..from + TABLE_BRICKS];
            let first = value(self, table[0]);
            if first.is_some() && table.iter().all(|entry| value(self, *entry) == first) {
                renamed.push(table[0]);
                continue;
            }
            self.tables
                .copy_within(from..from + TABLE_BRICKS, kept * TABLE_BRICKS);
            renamed.push(kept as u32);
            kept += 1;
        }
        self.tables.truncate(kept * TABLE_BRICKS);
        for entry in self.top.iter_mut().filter(|e| **e & CONSTANT == 0) {
            *entry = renamed[*entry as usize];
        }
    }
}

/// Number of the top cell around a voxel. \[local\]
pub(super) fn top_of(voxel: IVec3) -> IVec3 {
    voxel >> TOP_LOG2 as i32
}
