//! One grid's descriptor and head: name, type, class, transform, and why it may be refused.
//!
//! ```text
//! head    (from 222: u32 compression), metadata, map; the tree follows
//! ```

use glam::DMat4;

use super::bytes::Cursor;
use super::codec::Compression;
use super::error::Fault;
use super::metadata::Metadata;
use super::transform::Map;
use super::tree::TreePlace;
use super::value::ValueType;

/// What a grid is, as its metadata says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridClass {
    /// A density, zero outside.
    FogVolume,
    /// A signed distance, negative inside, in a narrow band.
    LevelSet,
    /// A velocity on cell faces.
    Staggered,
    /// Not said.
    Unknown,
}

impl GridClass {
    pub(super) fn from_metadata(metadata: &Metadata) -> Self {
        match metadata.string("class") {
            Some("fog volume") => Self::FogVolume,
            Some("level set") => Self::LevelSet,
            Some("staggered") => Self::Staggered,
            _ => Self::Unknown,
        }
    }

    /// OpenVDB's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::FogVolume => "fog volume",
            Self::LevelSet => "level set",
            Self::Staggered => "staggered",
            Self::Unknown => "unknown",
        }
    }
}

/// Why a grid cannot be rendered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refusal {
    /// It is whole, but of a kind that is not read.
    Unsupported(String),
    /// Its part of the file is damaged.
    Damaged(String),
}

impl Refusal {
    /// The reason in words.
    pub fn reason(&self) -> &str {
        match self {
            Self::Unsupported(reason) | Self::Damaged(reason) => reason,
        }
    }
}

/// A grid as its descriptor and metadata describe it.
#[derive(Debug, Clone)]
pub struct GridHeader {
    /// The name as exporters show it; may be empty, and several grids may share it.
    pub name: String,
    /// The name in the file, with U+001E and a number where the name is repeated or empty.
    pub unique_name: String,
    /// 0 for the first grid of this name, 1 for the second, ...
    pub ordinal: usize,
    /// Type of its values.
    pub value_type: ValueType,
    /// Type name as stored, without the suffix for half floats.
    pub type_name: String,
    /// Whether its values are stored as 16-bit floats.
    pub half: bool,
    /// Its class.
    pub class: GridClass,
    /// How its buffers are packed.
    pub compression: Compression,
    /// Its metadata.
    pub metadata: Metadata,
    /// The kind of its map, such as `UniformScaleMap`.
    pub map: String,
    /// Index to world for column vectors; `None` for a frustum or a damaged grid. [m per voxel, m]
    pub index_to_world: Option<DMat4>,
    /// Unique name of the grid whose tree it shares.
    pub instance_of: Option<String>,
    /// Why it cannot be read, if so.
    pub refused: Option<Refusal>,
}

impl GridHeader {
    /// The name as [`Archive::find`](super::Archive::find) takes it: `density`, `density[1]`.
    pub fn label(&self) -> String {
        match self.ordinal {
            0 => self.name.clone(),
            n => format!("{}[{n}]", self.name),
        }
    }
}

/// Compression, metadata and map; the tree follows.
pub(super) fn read_head(
    c: &mut Cursor<'_>,
    header: &mut GridHeader,
    version: u32,
    compression: Option<Compression>,
) -> Result<TreePlace, Fault> {
    header.compression = match compression {
        Some(compression) => compression,
        None => {
            let at = c.at();
            let bits = c.u32("compression")?;
            Compression::from_bits(bits).ok_or_else(|| {
                Fault::damaged(
                    at,
                    format!("compression {bits:#x}, only the bits 1, 2 and 4 exist"),
                )
            })?
        }
    };
    header.metadata = Metadata::read(c)?;
    header.class = GridClass::from_metadata(&header.metadata);
    let map = Map::read(c)?;
    header.refused = map.refusal().map(Refusal::Unsupported);
    header.index_to_world = map.index_to_world;
    header.map = map.kind;
    Ok(TreePlace {
        value_type: header.value_type,
        version,
        compression: header.compression,
        half: header.half,
        topology: c.at(),
        leaves: None,
    })
}
