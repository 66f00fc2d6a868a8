//! A tree's shape: root, two levels of internal nodes, and where its leaves are.
//!
//! ```text
//! tree      u32 buffer count (1), root
//! root      background, u32 tiles, u32 children,
//!           tiles:    i32 x 3 origin, value, u8 active
//!           children: i32 x 3 origin, internal node of 32^3
//! internal  child mask, active mask, values (codec.rs), then for each set bit of the child mask
//!           an internal node of 16^3 or the active mask of a leaf of 8^3
//! leaves    all leaf buffers, one after another (leaves.rs)
//! ```
//! A root entry spans 4096^3 voxels, its slots 128^3, theirs 8^3. Slots count z fastest. The
//! leaf buffers follow the order in which OpenVDB holds the root's children: by origin, x first.
//!
//! Up to version 221 the values of an internal node leave out the slots of its children.

use glam::IVec3;

use super::bytes::{Bits, Cursor, ones};
use super::codec::{Format, NodeValues, Work};
use super::error::Fault;
use super::value::Stored;

/// A cube of equal values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile<V = f32> {
    /// Lowest index coordinates.
    pub origin: IVec3,
    /// Edge length as a power of two: 3, 7 or 12.
    pub log2_size: u8,
    /// Its value.
    pub value: V,
    /// Whether its voxels are active.
    pub active: bool,
}

/// Shape of a tree, all but the leaves' values.
#[derive(Debug)]
pub(crate) struct Topology<T> {
    pub(crate) background: T,
    /// All tiles that are active or differ from the background.
    pub(crate) tiles: Vec<Tile<T>>,
    /// Origins of the leaves in the order of their buffers.
    pub(crate) leaf_origins: Vec<IVec3>,
}

impl<T: Stored> Topology<T> {
    pub(crate) fn read(c: &mut Cursor<'_>, format: Format) -> Result<Self, Fault> {
        let at = c.at();
        let buffers = c.u32("buffer count")?;
        if buffers != 1 {
            return Err(Fault::damaged(
                at,
                format!("tree with {buffers} buffers, only 1 is known"),
            ));
        }
        let background = T::load(c.take(T::BYTES, "background")?);
        let tile_count = c.u32("tile count")?;
        let child_count = c.u32("child count")?;
        let mut reader = Reader {
            format,
            values: Vec::new(),
            work: Work::new(),
            tree: Self {
                background,
                tiles: Vec::new(),
                leaf_origins: Vec::new(),
            },
        };
        let mut roots = Vec::new();
        for _ in 0..tile_count {
            let origin = root_origin(c)?;
            let value = T::load(c.take(T::BYTES, "root tile")?);
            let active = c.u8("root tile")? != 0;
            reader.tile(Tile {
                origin,
                log2_size: 12,
                value,
                active,
            });
            roots.push(origin.to_array());
        }
        let mut children = Vec::new();
        for _ in 0..child_count {
            let origin = root_origin(c)?;
            let first = reader.tree.leaf_origins.len();
            reader.internal(c, origin, 5)?;
            children.push((origin.to_array(), first..reader.tree.leaf_origins.len()));
            roots.push(origin.to_array());
        }
        roots.sort_unstable();
        if let Some(pair) = roots.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Fault::damaged(
                at,
                format!("the root holds {:?} twice", pair[0]),
            ));
        }
        let mut tree = reader.tree;
        if !children.is_sorted_by_key(|(origin, _)| *origin) {
            children.sort_unstable_by_key(|(origin, _)| *origin);
            let ranges = children.into_iter().map(|(_, leaves)| leaves);
            tree.leaf_origins = ranges
                .flat_map(|leaves| tree.leaf_origins[leaves].iter().copied())
                .collect();
        }
        Ok(tree)
    }
}

/// The whole tree's coordinates fit 32 bits if the origin is where OpenVDB puts it.
fn root_origin(c: &mut Cursor<'_>) -> Result<IVec3, Fault> {
    let at = c.at();
    let origin = c.ivec3("origin of a root entry")?;
    if origin & 4095 != IVec3::ZERO {
        return Err(Fault::damaged(
            at,
            format!("root entry at {origin}, not a multiple of 4096"),
        ));
    }
    Ok(origin)
}

struct Reader<T> {
    format: Format,
    values: Vec<T>,
    work: Work<T>,
    tree: Topology<T>,
}

impl<T: Stored> Reader<T> {
    fn tile(&mut self, tile: Tile<T>) {
        if tile.active || !tile.value.same(self.tree.background) {
            self.tree.tiles.push(tile);
        }
    }

    /// A node of `1 << log2` slots along each axis, log2 5 or 4.
    fn internal(&mut self, c: &mut Cursor<'_>, origin: IVec3, log2: u8) -> Result<(), Fault> {
        let slots = 1 << (3 * log2);
        let children = Bits(c.take(slots / 8, "child mask of a node")?);
        let active = Bits(c.take(slots / 8, "active mask of a node")?);
        let below = if log2 == 5 { 7 } else { 3 };
        let slot_origin = |i: usize| {
            let mask = (1 << log2) - 1;
            let (x, y, z) = (i >> (2 * log2) & mask, i >> log2 & mask, i & mask);
            origin + (IVec3::new(x as i32, y as i32, z as i32) << below)
        };

        let count = if self.format.has_flags() {
            slots
        } else {
            slots - children.count()
        };
        let values = NodeValues::find(c, self.format, self.tree.background, count, active)?;
        let active_tiles = active
            .words()
            .zip(children.words())
            .any(|(a, c)| a & !c != 0);
        if active_tiles || !values.inactive_is_background() {
            self.values
                .resize(count.max(self.values.len()), T::default());
            values.unpack(active, &mut self.work, &mut self.values[..count])?;
            let mut next = 0;
            for (w, (children, active)) in children.words().zip(active.words()).enumerate() {
                for b in 0..64 {
                    let is_child = children >> b & 1 != 0;
                    if is_child && !self.format.has_flags() {
                        continue;
                    }
                    let value = self.values[next];
                    next += 1;
                    let active = active >> b & 1 != 0;
                    if !is_child && (active || !value.same(self.tree.background)) {
                        let origin = slot_origin(64 * w + b);
                        self.tree.tiles.push(Tile {
                            origin,
                            log2_size: below,
                            value,
                            active,
                        });
                    }
                }
            }
        }

        for (w, children) in children.words().enumerate() {
            for b in ones(children) {
                let origin = slot_origin(64 * w + b);
                if log2 == 5 {
                    self.internal(c, origin, 4)?;
                } else {
                    c.take(64, "active mask of a leaf")?;
                    self.tree.leaf_origins.push(origin);
                }
            }
        }
        Ok(())
    }
}
