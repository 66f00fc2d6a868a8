//! The value at an index coordinate, at the precision of the file: what OpenVDB would return.
//!
//! A coordinate lies in the leaf at its multiple of 8, else in the tile at its multiple of 8, 128
//! or 4096, else in the background.

use std::collections::HashMap;

use glam::IVec3;

use super::archive::Archive;
use super::codec::Work;
use super::error::{Fault, VdbError};
use super::leaves::VOXELS;
use super::tree::{Tree, TreePlace, for_stored_type};
use super::value::{Stored, Value};

/// What a grid holds at a coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// The value.
    pub value: Value,
    /// Whether the voxel is active.
    pub active: bool,
}

impl Archive {
    /// Looks up grid `index` at each coordinate. Works for frustum grids too.
    pub fn probe(&self, index: usize, at: &[IVec3]) -> Result<Vec<Probe>, VdbError> {
        self.place(index)
            .and_then(|(_, place)| {
                for_stored_type!(
                    place.value_type,
                    T => probe::<T>(self.bytes(), place, at),
                    _ => Err(Fault::Unsupported("its values are not read".to_owned()))
                )
            })
            .map_err(|fault| self.error(Some(index), fault))
    }
}

fn probe<T: Stored>(bytes: &[u8], place: &TreePlace, at: &[IVec3]) -> Result<Vec<Probe>, Fault> {
    let tree = Tree::<T>::read(bytes, place)?;
    let leaves: HashMap<IVec3, usize> = tree
        .topology
        .leaf_origins
        .iter()
        .enumerate()
        .map(|(i, &o)| (o, i))
        .collect();
    let tiles: HashMap<(u8, IVec3), (T, bool)> = tree
        .topology
        .tiles
        .iter()
        .map(|t| ((t.log2_size, t.origin), (t.value, t.active)))
        .collect();
    let mut work = Work::new();
    let mut values = [T::default(); VOXELS];
    let mut unpacked = None;
    let mut probes = Vec::with_capacity(at.len());
    for &ijk in at {
        let (value, active) = if let Some(&leaf) = leaves.get(&(ijk & !7)) {
            if unpacked != Some(leaf) {
                tree.leaves.unpack(leaf, &mut work, &mut values)?;
                unpacked = Some(leaf);
            }
            let local = ijk & 7;
            let voxel = (local.x << 6 | local.y << 3 | local.z) as usize;
            (
                values[voxel],
                tree.masks[leaf][voxel / 64] >> (voxel % 64) & 1 != 0,
            )
        } else {
            [3u8, 7, 12]
                .iter()
                .find_map(|&log2| tiles.get(&(log2, ijk & !((1 << log2) - 1))).copied())
                .unwrap_or((tree.topology.background, false))
        };
        probes.push(Probe {
            value: value.value(),
            active,
        });
    }
    Ok(probes)
}
