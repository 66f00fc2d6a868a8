//! The archive layer of vdb-rs: header, descriptors and metadata. The only file that names `vdb_rs`.
//!
//! vdb-rs 0.6 believes every length and position, asserts where it should refuse, and decodes
//! strings as Latin-1. It is therefore called only after `archive.rs` has walked the whole archive
//! layer within bounds, and not at all for streamed files, repeated unique names or files with a
//! damaged grid, where it would panic; there, the walk's own reading stands. Its strings are
//! turned back to bytes, which are UTF-8.

use std::collections::HashMap;
use std::io::Cursor;

use vdb_rs::{MetadataValue, VdbReader};

use super::metadata::{MetaValue, Metadata};

/// What vdb-rs reads from the head of a file.
pub(crate) struct Opened {
    pub(crate) metadata: Metadata,
    /// Grids by unique name.
    pub(crate) grids: HashMap<String, OpenedGrid>,
}

/// A descriptor and the metadata of its grid.
pub(crate) struct OpenedGrid {
    pub(crate) type_name: String,
    pub(crate) instance_of: String,
    pub(crate) compression: u32,
    pub(crate) metadata: Metadata,
}

/// Opens a file that has been checked; `None` if vdb-rs does not read it after all.
pub(crate) fn open(checked: &[u8]) -> Option<Opened> {
    let reader = VdbReader::new(Cursor::new(checked)).ok()?;
    let grids = reader.grid_descriptors.into_iter().map(|(name, grid)| {
        let opened = OpenedGrid {
            type_name: utf8(&grid.grid_type),
            instance_of: utf8(&grid.instance_parent),
            compression: grid.compression.bits(),
            metadata: metadata(grid.meta_data)?,
        };
        Some((utf8(&name), opened))
    });
    Some(Opened {
        grids: grids.collect::<Option<_>>()?,
        metadata: metadata(reader.header.meta_data)?,
    })
}

/// Undoes the Latin-1 decoding: every character is one byte.
fn utf8(latin1: &str) -> String {
    let bytes: Vec<u8> = latin1.chars().map(|c| c as u8).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn metadata(read: vdb_rs::Metadata) -> Option<Metadata> {
    let entries = read.0.into_iter().map(|(name, value)| {
        let value = match value {
            MetadataValue::String(s) => MetaValue::String(utf8(&s)),
            MetadataValue::Vec3i(v) => MetaValue::Vec3i([v.x, v.y, v.z]),
            MetadataValue::I32(v) => MetaValue::Int32(v),
            MetadataValue::I64(v) => MetaValue::Int64(v),
            MetadataValue::Float(v) => MetaValue::Float(v),
            MetadataValue::Bool(v) => MetaValue::Bool(v),
            MetadataValue::Unknown { name, data } => MetaValue::parse(&utf8(&name), &data)?,
        };
        Some((utf8(&name), value))
    });
    Some(Metadata(entries.collect::<Option<_>>()?))
}
