//! Tree to grid: leaves and tiles become bricks with aprons.
//!
//! Leaves are decoded straight into the low 8^3 corner of their bricks; then every brick's apron
//! is read from its neighbours. Where a constant region (empty space, a tile) borders on other
//! values, the cells that straddle the border need bricks of their own, so that a lookup never
//! looks at a neighbour (border.rs); bricks that turn out equal share their storage (compact.rs), and
//! values that fit in 16 bits take no more (values.rs).

use glam::{DAffine3, IVec3};
use rayon::prelude::*;
use thiserror::Error;

use super::index::{Index, top_of};
use super::{APRON, BRICK, BRICK_VALUES, CONSTANT, Grid, TOP_LOG2, corner_index};

/// Most top cells a grid may span: 64 MiB of index. Two voxels 10^9 apart would need more;
/// a real cloud of 2000^3 voxels has 4096.
pub const MAX_TOP_CELLS: u64 = 1 << 24;

/// Most top cells along an axis: 131,072 voxels, at which f32 coordinates still resolve 1/128 voxel.
pub const MAX_TOP_AXIS: u32 = 1024;

/// Bricks whose aprons are gathered at a time: bounds the scratch memory to a few megabytes.
const BATCH: usize = 4096;

/// A region of one value.
#[derive(Debug, Clone, Copy)]
pub struct Tile {
    /// Lowest voxel; a multiple of the size. \[index\]
    pub origin: IVec3,
    /// log2 of the edge: 3, 7 or 12. \[voxels\]
    pub log2_size: u32,
    /// The value.
    pub value: f32,
}

/// What a grid is made of, leaf values aside.
#[derive(Debug, Clone)]
pub struct Topology {
    /// Value where there is neither leaf nor tile.
    pub background: f32,
    /// Constant regions.
    pub tiles: Vec<Tile>,
    /// Lowest voxel of each 8^3 leaf; a multiple of 8. \[index\]
    pub leaves: Vec<IVec3>,
    /// Lowest and highest active voxel; a background other than 0 ends there. \[index\]
    pub active: Option<[IVec3; 2]>,
    /// Index to world. \[m\]
    pub index_to_world: DAffine3,
}

/// Why a grid cannot be built.
#[derive(Debug, Error)]
pub enum BuildError {
    /// Voxels too far apart.
    #[error(
        "the grid spans {size} voxels, more than this renderer's index can hold: {cells} cells of 128^3 voxels, at most {MAX_TOP_CELLS} and {MAX_TOP_AXIS} along an axis"
    )]
    TooWide {
        /// Extent. \[voxels\]
        size: String,
        /// Top cells it would take.
        cells: u64,
    },
    /// More bricks than an index entry can name.
    #[error("the grid has {bricks} bricks, more than this renderer's index can hold")]
    TooManyBricks {
        /// Bricks.
        bricks: usize,
    },
    /// The transform cannot be inverted.
    #[error("the grid's transform cannot be inverted")]
    Singular,
}

/// A grid under construction.
pub(super) struct Builder {
    /// Which bricks and constants are where.
    pub(super) index: Index,
    /// The values of its bricks, 9^3 each, z fastest.
    pub(super) values: Vec<f32>,
    /// Voxels outside this box are 0 whatever the tree says (backgrounds other than 0).
    pub(super) clip: Option<[IVec3; 2]>,
    /// Index to world. \[m\]
    pub(super) index_to_world: DAffine3,
}

impl Grid {
    /// Builds the grid. `decode` gets room for `leaves.len()` bricks of [`BRICK_VALUES`] and fills
    /// the 8^3 low corner of each, value (x, y, z) at [`corner_index`].
    ///
    /// # Errors
    /// [`BuildError`] as `E`, or what `decode` returns.
    pub fn build<E: From<BuildError>>(
        topology: &Topology,
        decode: impl FnOnce(&mut [f32]) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut builder = Builder::new(topology)?;
        builder.values = vec![0.0; topology.leaves.len() * BRICK_VALUES];
        decode(&mut builder.values)?;
        builder.place(topology);
        builder.clip_leaves(topology);
        builder.add_borders()?;
        builder.fill_aprons(topology);
        Ok(builder.finish()?)
    }

    /// A grid of the values of a function over a box of voxels (inclusive); 0 outside.
    ///
    /// # Errors
    /// [`BuildError`].
    pub fn from_fn(
        min: IVec3,
        max: IVec3,
        index_to_world: DAffine3,
        f: impl Fn(IVec3) -> f32 + Sync,
    ) -> Result<Self, BuildError> {
        let (lo, hi) = (min >> 3i32, max >> 3i32);
        let leaves: Vec<IVec3> = (lo.x..=hi.x)
            .flat_map(|x| {
                (lo.y..=hi.y)
                    .flat_map(move |y| (lo.z..=hi.z).map(move |z| IVec3::new(x, y, z) * BRICK))
            })
            .collect();
        let topology = Topology {
            background: 0.0,
            tiles: Vec::new(),
            leaves,
            active: Some([min, max]),
            index_to_world,
        };
        let origins = topology.leaves.clone();
        Self::build(&topology, |values| {
            values
                .par_chunks_mut(BRICK_VALUES)
                .zip(&origins)
                .for_each(|(brick, &origin)| {
                    for_each_cell(|v| {
                        let voxel = origin + v;
                        if voxel.cmpge(min).all() && voxel.cmple(max).all() {
                            brick[corner_index(v)] = f(voxel);
                        }
                    });
                });
            Ok(())
        })
    }
}

/// Calls with each of 0..8 cubed, z fastest.
pub(super) fn for_each_cell(mut f: impl FnMut(IVec3)) {
    for x in 0..BRICK {
        for y in 0..BRICK {
            for z in 0..BRICK {
                f(IVec3::new(x, y, z));
            }
        }
    }
}

/// Calls with the corners of 0..=8 cubed that are not in 0..8 cubed.
pub(super) fn for_each_apron(mut f: impl FnMut(IVec3)) {
    for x in 0..=BRICK {
        for y in 0..=BRICK {
            let z0 = if x == BRICK || y == BRICK { 0 } else { BRICK };
            for z in z0..=BRICK {
                f(IVec3::new(x, y, z));
            }
        }
    }
}

impl Builder {
    /// The empty index over the box of leaves and tiles.
    fn new(topology: &Topology) -> Result<Self, BuildError> {
        let map = topology.index_to_world;
        let determinant = map.matrix3.determinant();
        if !(determinant.is_finite() && determinant != 0.0 && map.is_finite()) {
            return Err(BuildError::Singular);
        }
        let mut lo = IVec3::MAX;
        let mut hi = IVec3::MIN;
        for &leaf in &topology.leaves {
            lo = lo.min(leaf);
            hi = hi.max(leaf.saturating_add(IVec3::splat(BRICK - 1)));
        }
        for tile in topology.tiles.iter().filter(|tile| tile.value != 0.0) {
            lo = lo.min(tile.origin);
            hi = hi.max(
                tile.origin
                    .saturating_add(IVec3::splat((1 << tile.log2_size) - 1)),
            );
        }
        let clip = if topology.background == 0.0 {
            None
        } else {
            topology.active
        };
        if let Some([a, b]) = clip {
            // The background fills all of the active box, and nothing is left outside it.
            (lo, hi) = (a, b);
        }
        let mut index = Index::empty();
        if lo.cmple(hi).all() {
            // One voxel more on either side, where the interpolant falls to 0.
            let lo = lo.saturating_sub(IVec3::ONE) >> TOP_LOG2 as i32;
            let hi = hi.saturating_add(IVec3::ONE) >> TOP_LOG2 as i32;
            let dims = (hi - lo + IVec3::ONE).as_uvec3();
            let cells = u64::from(dims.x)
                .saturating_mul(dims.y.into())
                .saturating_mul(dims.z.into());
            if cells > MAX_TOP_CELLS || dims.max_element() > MAX_TOP_AXIS {
                let size = dims.as_u64vec3() << 7u32;
                return Err(BuildError::TooWide {
                    size: format!("{} x {} x {}", size.x, size.y, size.z),
                    cells,
                });
            }
            index.origin = lo << TOP_LOG2 as i32;
            index.dims = dims;
            index.top = vec![CONSTANT; cells as usize];
        }
        let clip = clip.map(|[a, b]| [a - index.origin, b - index.origin]);
        if let (Some([a, b]), true) = (clip, topology.background != 0.0) {
            let background = index.constant(topology.background);
            index.set_top(top_of(a), top_of(b), background);
        }
        Ok(Self {
            index,
            values: Vec::new(),
            clip,
            index_to_world: map,
        })
    }

    /// Enters tiles, coarse ones first, then leaves.
    fn place(&mut self, topology: &Topology) {
        let mut tiles = topology.tiles.clone();
        tiles.sort_by_key(|tile| std::cmp::Reverse(tile.log2_size));
        for tile in tiles {
            let entry = self.index.constant(tile.value);
            let lo = tile.origin - self.index.origin;
            if tile.log2_size == 3 {
                self.index.set_brick(lo >> 3, entry);
            } else {
                let hi = lo + IVec3::splat((1 << tile.log2_size) - 1);
                self.index.set_top(top_of(lo), top_of(hi), entry);
            }
        }
        for (number, &leaf) in topology.leaves.iter().enumerate() {
            let brick = (leaf - self.index.origin) >> 3;
            self.index.set_brick(brick, number as u32);
        }
    }

    /// Zeroes leaf values outside the clip box.
    fn clip_leaves(&mut self, topology: &Topology) {
        let Some([a, b]) = self.clip else { return };
        let origin = self.index.origin;
        self.values
            .par_chunks_mut(BRICK_VALUES)
            .zip(&topology.leaves)
            .for_each(|(brick, &leaf)| {
                let lo = leaf - origin;
                if lo.cmpge(a).all() && (lo + IVec3::splat(BRICK - 1)).cmple(b).all() {
                    return;
                }
                for_each_cell(|v| {
                    if (lo + v).cmplt(a).any() || (lo + v).cmpgt(b).any() {
                        brick[corner_index(v)] = 0.0;
                    }
                });
            });
    }

    /// Value of a voxel from its own leaf or constant; aprons need not be there yet.
    pub(super) fn value(&self, voxel: IVec3) -> f32 {
        if self
            .clip
            .is_some_and(|[a, b]| voxel.cmplt(a).any() || voxel.cmpgt(b).any())
        {
            return 0.0;
        }
        let entry = self.index.entry(voxel >> 3);
        self.index
            .constant_value(entry)
            .unwrap_or_else(|| self.values[entry as usize * BRICK_VALUES + corner_index(voxel & 7)])
    }

    /// Reads every leaf brick's apron from its neighbours.
    fn fill_aprons(&mut self, topology: &Topology) {
        let origin = self.index.origin;
        let apron = APRON.pow(3) - (BRICK as usize).pow(3);
        let mut scratch = vec![0.0; BATCH * apron];
        for (batch, leaves) in topology.leaves.chunks(BATCH).enumerate() {
            let this = &*self;
            scratch
                .par_chunks_mut(apron)
                .zip(leaves)
                .for_each(|(out, &leaf)| {
                    let mut slots = out.iter_mut();
                    for_each_apron(|v| {
                        if let Some(slot) = slots.next() {
                            *slot = this.value(leaf - origin + v);
                        }
                    });
                });
            let start = batch * BATCH * BRICK_VALUES;
            let bricks = &mut self.values[start..start + leaves.len() * BRICK_VALUES];
            bricks
                .par_chunks_mut(BRICK_VALUES)
                .zip(scratch.par_chunks(apron))
                .for_each(|(brick, values)| {
                    let mut values = values.iter();
                    for_each_apron(|v| {
                        if let Some(&value) = values.next() {
                            brick[corner_index(v)] = value;
                        }
                    });
                });
        }
    }
}
