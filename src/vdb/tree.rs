//! A grid's tree with values of one type: its shape and its leaves, ready to unpack.

use super::bytes::Cursor;
use super::codec::{Compression, Format};
use super::error::Fault;
use super::leaves::{LeafKind, Leaves};
use super::topology::Topology;
use super::value::{Stored, ValueType};

/// Where a tree lies in the file, and what its bytes mean.
#[derive(Debug, Clone)]
pub(crate) struct TreePlace {
    pub(crate) value_type: ValueType,
    pub(crate) version: u32,
    pub(crate) compression: Compression,
    pub(crate) half: bool,
    /// Position of the topology.
    pub(crate) topology: usize,
    /// Position of the leaf buffers; `None`: they follow the topology, as in streamed files.
    pub(crate) leaves: Option<usize>,
}

/// A tree read from its place.
#[derive(Debug)]
pub(crate) struct Tree<'a, T> {
    pub(crate) topology: Topology<T>,
    pub(crate) leaves: Leaves<'a, T>,
    /// Active masks of the leaves.
    pub(crate) masks: Vec<[u64; 8]>,
    /// The byte after the tree.
    pub(crate) end: usize,
}

impl<'a, T: Stored> Tree<'a, T> {
    pub(crate) fn read(bytes: &'a [u8], place: &TreePlace) -> Result<Self, Fault> {
        let format = Format {
            version: place.version,
            compression: place.compression,
            half: place.half,
        };
        let kind = match place.value_type {
            ValueType::Bool => LeafKind::Bits,
            ValueType::Mask => LeafKind::Mask,
            _ => LeafKind::Values,
        };
        let mut c = Cursor::new(bytes, place.topology, "tree")?;
        let topology = Topology::read(&mut c, format)?;
        if let Some(at) = place.leaves
            && !topology.leaf_origins.is_empty()
        {
            c = Cursor::new(bytes, at, "leaf buffers")?;
        }
        let count = topology.leaf_origins.len();
        let (leaves, masks) =
            Leaves::find(&mut c, bytes, format, kind, topology.background, count)?;
        Ok(Self {
            topology,
            leaves,
            masks,
            end: c.at(),
        })
    }
}

/// Evaluates `$body` with `$T` the Rust type of `$value_type`'s values, or `$otherwise`.
macro_rules! for_stored_type {
    ($value_type:expr, $T:ident => $body:expr, _ => $otherwise:expr) => {{
        use $crate::vdb::value::ValueType as V;
        match $value_type {
            V::Half => {
                type $T = half::f16;
                $body
            }
            V::Float => {
                type $T = f32;
                $body
            }
            V::Double => {
                type $T = f64;
                $body
            }
            V::Int32 => {
                type $T = i32;
                $body
            }
            V::Int64 => {
                type $T = i64;
                $body
            }
            V::Bool | V::Mask => {
                type $T = bool;
                $body
            }
            V::Vec3s => {
                type $T = [f32; 3];
                $body
            }
            V::Vec3d => {
                type $T = [f64; 3];
                $body
            }
            V::Vec3i => {
                type $T = [i32; 3];
                $body
            }
            V::Points | V::Other => $otherwise,
        }
    }};
}
pub(crate) use for_stored_type;
