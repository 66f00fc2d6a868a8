//! Where constant regions end: bricks for the cells between one value and another.
//!
//! A cube of edge e (a brick of 8 voxels, a table of 128) whose own voxels and seven upper
//! neighbours are constants is decided by these eight values u and by the clip box [a, b] as far
//! as it cuts the cube:
//!
//! ```text
//! v(p) = u(p.x == e, p.y == e, p.z == e)   a <= p <= b,    0 elsewhere,    p in 0..=e cubed
//! ```
//!
//! Equal patterns are equal cubes, so each is made once and shared, tables like bricks: a tile of
//! 4096^3 voxels has 6144 tables and 1.6 million bricks on its faces, but 26 and 26 patterns (its
//! faces, edges and corners). Only constants that touch leaves take a brick each.

use std::collections::HashMap;

use glam::IVec3;
use rayon::prelude::*;

use super::build::{BuildError, Builder, for_each_apron, for_each_cell};
use super::{
    BRICK, BRICK_VALUES, CONSTANT, TABLE, TABLE_BRICKS, TOP_LOG2, corner_index, top_index,
};

/// Top cells whose borders are gathered at a time: bounds the scratch memory.
const BATCH: usize = 64;

/// A cube of constants, see the module's page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Pattern {
    /// Bits of the values u: of the cube, and of its neighbours at (i & 1, i >> 1 & 1, i >> 2).
    values: [u32; 8],
    /// The clip box, moved to the cube and cut to what its voxels can tell.
    clip: [IVec3; 2],
    /// e. \[voxels\]
    edge: i32,
}

impl Pattern {
    /// The pattern of a cube at `lowest`, from the values of it and its neighbours.
    fn new(values: [u32; 8], clip: Option<[IVec3; 2]>, lowest: IVec3, edge: i32) -> Self {
        let e = IVec3::splat(edge);
        let clip = clip.map_or([IVec3::ZERO, e], |[a, b]| {
            [
                (a - lowest).clamp(IVec3::ZERO, e + IVec3::ONE),
                (b - lowest).clamp(-IVec3::ONE, e),
            ]
        });
        Self { values, clip, edge }
    }

    /// The pattern of a brick of this table.
    fn brick(&self, brick: IVec3) -> Self {
        let values = std::array::from_fn(|i| {
            let beyond = (brick + neighbour(i)).cmpeq(IVec3::splat(TABLE));
            self.values[beyond.bitmask() as usize]
        });
        Self::new(values, Some(self.clip), brick * BRICK, BRICK)
    }

    /// True if the cube is its own constant all over.
    fn is_constant(&self) -> bool {
        let own = f32::from_bits(self.values[0]);
        let uncut = self.clip == [IVec3::ZERO, IVec3::splat(self.edge)];
        (own == 0.0 || uncut) && self.values.iter().all(|v| f32::from_bits(*v) == own)
    }

    /// The value at a voxel, 0..=edge cubed.
    fn value(&self, voxel: IVec3) -> f32 {
        let [a, b] = self.clip;
        if voxel.cmplt(a).any() || voxel.cmpgt(b).any() {
            return 0.0;
        }
        let beyond = voxel.cmpeq(IVec3::splat(self.edge));
        f32::from_bits(self.values[beyond.bitmask() as usize])
    }
}

/// Offset of the i-th upper neighbour; itself for 0.
fn neighbour(i: usize) -> IVec3 {
    IVec3::new((i & 1) as i32, (i >> 1 & 1) as i32, (i >> 2) as i32)
}

/// A brick that a border needs.
enum Border {
    /// Between constants.
    Pattern(Pattern),
    /// Beside a leaf.
    Values(Box<[f32; BRICK_VALUES]>),
}

/// Border bricks made so far; their numbers follow those of the leaves.
struct Bricks {
    first: usize,
    values: Vec<f32>,
    known: HashMap<Pattern, u32>,
}

impl Bricks {
    /// The entry of a border's brick, made if it is new.
    fn entry(&mut self, border: Border) -> u32 {
        let next = (self.first + self.values.len() / BRICK_VALUES) as u32;
        match border {
            Border::Values(values) => self.values.extend_from_slice(&*values),
            Border::Pattern(pattern) => {
                if let Some(&entry) = self.known.get(&pattern) {
                    return entry;
                }
                let mut values = [0.0; BRICK_VALUES];
                let mut take = |v: IVec3| values[corner_index(v)] = pattern.value(v);
                for_each_cell(&mut take);
                for_each_apron(&mut take);
                self.values.extend_from_slice(&values);
                self.known.insert(pattern, next);
            }
        }
        next
    }
}

/// What a top cell needs.
enum Need {
    /// It is a table of that pattern.
    Table(Pattern),
    /// Some of its bricks border on others.
    Bricks,
}

impl Builder {
    /// Makes bricks of the constant regions' cells that border on other values.
    pub(super) fn add_borders(&mut self) -> Result<(), BuildError> {
        let this = &*self;
        let needs: Vec<(usize, Need)> = (0..this.index.top.len())
            .into_par_iter()
            .filter_map(|at| Some((at, this.need(at)?)))
            .collect();
        let mut bricks = Bricks {
            first: self.values.len() / BRICK_VALUES,
            values: Vec::new(),
            known: HashMap::new(),
        };
        // Entries are set only when all borders are known: they are read until then.
        let mut tables: Vec<u32> = Vec::new();
        let mut known = HashMap::new();
        let mut table_of = Vec::new();
        for (at, need) in &needs {
            let Need::Table(pattern) = need else { continue };
            let table = *known.entry(*pattern).or_insert_with(|| {
                let own = this.index.top[*at];
                tables.extend((0..TABLE_BRICKS).map(|slot| {
                    let brick = pattern.brick(in_cell(slot));
                    if brick.is_constant() {
                        own
                    } else {
                        bricks.entry(Border::Pattern(brick))
                    }
                }));
                tables.len() / TABLE_BRICKS - 1
            });
            table_of.push((*at, table));
        }
        let mut set = Vec::new();
        let mixed: Vec<usize> = needs
            .iter()
            .filter(|(_, need)| matches!(need, Need::Bricks))
            .map(|(at, _)| *at)
            .collect();
        for batch in mixed.chunks(BATCH) {
            let found: Vec<Vec<(IVec3, Border)>> =
                batch.par_iter().map(|at| this.borders_of(*at)).collect();
            for (brick, border) in found.into_iter().flatten() {
                set.push((brick, bricks.entry(border)));
            }
        }

        let count = bricks.first + bricks.values.len() / BRICK_VALUES;
        if count >= CONSTANT as usize {
            return Err(BuildError::TooManyBricks { bricks: count });
        }
        self.values.reserve_exact(bricks.values.len());
        self.values.extend_from_slice(&bricks.values);
        for (brick, entry) in set {
            self.index.set_brick(brick, entry);
        }
        let first = self.index.tables.len() / TABLE_BRICKS;
        self.index.tables.extend_from_slice(&tables);
        for (at, table) in table_of {
            self.index.top[at] = (first + table) as u32;
        }
        Ok(())
    }

    /// What the top cell `at` needs, if anything.
    fn need(&self, at: usize) -> Option<Need> {
        let index = &self.index;
        let cell = index.top_cell(at);
        let mut entries = [CONSTANT; 8];
        for (i, entry) in entries.iter_mut().enumerate() {
            let c = (cell + neighbour(i)).as_uvec3();
            if c.cmplt(index.dims).all() {
                *entry = index.top[top_index(index.dims, c)];
            }
        }
        if entries == [CONSTANT; 8] {
            return None;
        }
        let edge = 1 << TOP_LOG2;
        match self.pattern(entries, cell * edge, edge) {
            None => Some(Need::Bricks),
            Some(pattern) if pattern.is_constant() => None,
            Some(pattern) => Some(Need::Table(pattern)),
        }
    }

    /// The pattern of the cube at `lowest`, if it and its neighbours are all constants.
    fn pattern(&self, entries: [u32; 8], lowest: IVec3, edge: i32) -> Option<Pattern> {
        let mut values = [0; 8];
        for (value, entry) in values.iter_mut().zip(entries) {
            *value = self.index.constant_value(entry)?.to_bits();
        }
        Some(Pattern::new(values, self.clip, lowest, edge))
    }

    /// The bricks of one top cell that borders need.
    fn borders_of(&self, at: usize) -> Vec<(IVec3, Border)> {
        let lowest = self.index.top_cell(at) * TABLE;
        let mut found = Vec::new();
        for slot in 0..TABLE_BRICKS {
            let brick = lowest + in_cell(slot);
            let Some(own) = self.index.constant_value(self.index.entry(brick)) else {
                continue;
            };
            let entries = std::array::from_fn(|i| self.index.entry(brick + neighbour(i)));
            if let Some(pattern) = self.pattern(entries, brick * BRICK, BRICK) {
                if !pattern.is_constant() {
                    found.push((brick, Border::Pattern(pattern)));
                }
                continue;
            }
            let mut values = Box::new([own; BRICK_VALUES]);
            let mut differs = false;
            let mut take = |v: IVec3| {
                let value = self.value(brick * BRICK + v);
                differs |= value != own;
                values[corner_index(v)] = value;
            };
            if self.clip.is_some() {
                for_each_cell(&mut take);
            }
            for_each_apron(&mut take);
            if differs {
                found.push((brick, Border::Values(values)));
            }
        }
        found
    }
}

/// Brick of a slot of its table.
fn in_cell(slot: usize) -> IVec3 {
    let slot = slot as i32;
    IVec3::new(slot >> 8, slot >> 4 & 15, slot & 15)
}
