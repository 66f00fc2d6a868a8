//! The file as a whole: its header, and the descriptor, metadata and transform of each grid.
//!
//! ```text
//! file    20 42 44 56 00 00 00 00, u32 version, u32 x 2 library version, u8 offsets flag,
//!         (versions 220, 221: u8 zip), 36 bytes UUID, metadata, u32 grid count, grids
//! grid    unique name, type name, instance parent; i64 positions of grid, leaf buffers and end
//!         at the grid's position: (from 222: u32 compression), metadata, map, tree
//! ```
//! With the offsets flag each descriptor is at the end position of the grid before; without it
//! (a streamed file) all positions are zero and everything follows at once. A unique name is the
//! name, and for repeated or empty names U+001E and a number. An instance has no tree of its
//! own; it shows that of its parent, named by unique name, under its own transform.
//!
//! A fault inside one grid refuses that grid; the others still load.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::DMat4;

use super::bytes::Cursor;
use super::codec::Compression;
use super::error::{Fault, VdbError};
use super::metadata::Metadata;
use super::opener;
use super::transform::Map;
use super::tree::{Tree, TreePlace, for_stored_type};
use super::value::ValueType;

const MAGIC: [u8; 8] = [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];
const HALF_SUFFIX: &str = "_HalfFloat";

/// A .vdb file in memory, its grids listed but not yet read.
#[derive(Debug)]
pub struct Archive {
    file: String,
    bytes: Vec<u8>,
    version: FileVersion,
    metadata: Metadata,
    grids: Vec<GridHeader>,
    places: Vec<Option<TreePlace>>,
    unreached: usize,
}

/// Versions and layout of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileVersion {
    /// Version of the format, 220 to 225.
    pub format: u32,
    /// Version of the library that wrote it, major and minor.
    pub library: [u32; 2],
    /// Whether it was streamed: no offsets, grids one after another.
    pub streamed: bool,
}

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
    fn from_metadata(metadata: &Metadata) -> Self {
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

/// A grid found by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// Its place in [`Archive::grids`].
    pub index: usize,
    /// How many grids of the file have this name, itself included.
    pub same_name: usize,
}

impl Archive {
    /// Reads a file and lists its grids.
    pub fn open(path: &Path) -> Result<Self, VdbError> {
        let file = path.display().to_string();
        match std::fs::read(path) {
            Ok(bytes) => Self::from_bytes(&file, bytes),
            Err(e) => Err(VdbError {
                file,
                grid: None,
                fault: Fault::Io(e),
            }),
        }
    }

    /// Lists the grids of a file held in memory; `name` is for messages.
    pub fn from_bytes(name: &str, bytes: Vec<u8>) -> Result<Self, VdbError> {
        let mut archive = Self {
            file: name.to_owned(),
            bytes,
            version: FileVersion {
                format: 0,
                library: [0; 2],
                streamed: false,
            },
            metadata: Metadata::default(),
            grids: Vec::new(),
            places: Vec::new(),
            unreached: 0,
        };
        let bytes = std::mem::take(&mut archive.bytes);
        let walked = archive.walk(&bytes);
        archive.bytes = bytes;
        match walked {
            Ok(()) => Ok(archive),
            Err(fault) => Err(archive.error(None, fault)),
        }
    }

    /// The file's name as given.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Size of the file. \[bytes\]
    pub fn file_size(&self) -> usize {
        self.bytes.len()
    }

    /// Versions and layout of the file.
    pub fn version(&self) -> FileVersion {
        self.version
    }

    /// The file's own metadata.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The grids in the file's order.
    pub fn grids(&self) -> &[GridHeader] {
        &self.grids
    }

    /// Grids that cannot be found because they follow, in a streamed file, one of unknown length.
    pub fn unreached(&self) -> usize {
        self.unreached
    }

    /// Finds a grid: `density` is the first of that name, `density[1]` the second.
    pub fn find(&self, name: &str) -> Result<Found, VdbError> {
        let find = |name: &str, ordinal: usize| {
            let same = || {
                self.grids
                    .iter()
                    .enumerate()
                    .filter(|(_, g)| g.name == name)
            };
            let (index, _) = same().nth(ordinal)?;
            Some(Found {
                index,
                same_name: same().count(),
            })
        };
        let numbered = || {
            let (name, number) = name.strip_suffix(']')?.rsplit_once('[')?;
            find(name, number.parse().ok()?)
        };
        find(name, 0).or_else(numbered).ok_or_else(|| {
            let fault = Fault::NoSuchGrid {
                asked: name.to_owned(),
                has: self.names(),
            };
            self.error(None, fault)
        })
    }

    /// All names as `find` takes them.
    fn names(&self) -> String {
        const SHOWN: usize = 50;
        let mut names: Vec<String> = self
            .grids
            .iter()
            .take(SHOWN)
            .map(GridHeader::label)
            .collect();
        if self.grids.len() > SHOWN {
            names.push(format!("and {} more", self.grids.len() - SHOWN));
        }
        if self.unreached > 0 {
            names.push(format!(
                "and {} that cannot be reached behind a grid of unknown type in a streamed file",
                self.unreached
            ));
        }
        if names.is_empty() {
            "no grid at all".to_owned()
        } else {
            names.join(", ")
        }
    }

    pub(crate) fn error(&self, grid: Option<usize>, fault: Fault) -> VdbError {
        let grid = grid.and_then(|i| self.grids.get(i)).map(GridHeader::label);
        VdbError {
            file: self.file.clone(),
            grid,
            fault,
        }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The header and tree of a grid, or why there is none.
    pub(crate) fn place(&self, index: usize) -> Result<(&GridHeader, &TreePlace), Fault> {
        let (Some(header), Some(place)) = (self.grids.get(index), self.places.get(index)) else {
            let asked = format!("number {index}");
            return Err(Fault::NoSuchGrid {
                asked,
                has: self.names(),
            });
        };
        match (place, &header.refused) {
            (Some(place), _) => Ok((header, place)),
            (None, Some(refusal)) => Err(Fault::Unsupported(refusal.reason().to_owned())),
            (None, None) => Err(Fault::Unsupported("it has no tree".to_owned())),
        }
    }

    fn walk(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        check_magic(bytes)?;
        let mut c = Cursor::new(bytes, MAGIC.len(), "header")?;
        let format = c.u32("file version")?;
        if !(220..=225).contains(&format) {
            return Err(Fault::Version(format));
        }
        let library = [c.u32("library version")?, c.u32("library version")?];
        let at = c.at();
        let streamed = match c.u8("offsets flag")? {
            0 => true,
            1 => false,
            flag => {
                return Err(Fault::damaged(
                    at,
                    format!("offsets flag {flag}, not 0 or 1"),
                ));
            }
        };
        self.version = FileVersion {
            format,
            library,
            streamed,
        };
        let mut compression = None;
        if format < 222 {
            let zip = c.u8("compression flag")? != 0;
            compression = Some(if zip {
                Compression::ZIP
            } else {
                Compression::NONE
            });
        }
        c.take(36, "UUID")?;
        self.metadata = Metadata::read(&mut c)?;
        let count = c.u32("grid count")?;
        for n in 0..count {
            let next = self.grid(&mut c, bytes, compression)?;
            let last = n + 1 == count;
            match next {
                Next::Here => {}
                Next::Unknown => {
                    self.unreached = (count - n - 1) as usize;
                    break;
                }
                Next::At(_) if last => {}
                Next::At(end) => {
                    let end = usize::try_from(end).ok().filter(|&end| end >= c.at());
                    let end = end.ok_or_else(|| {
                        Fault::damaged(c.at() - 8, "the grid's end lies before its beginning")
                    })?;
                    c = Cursor::new(bytes, end, "next grid")?;
                }
            }
        }
        self.open_checked(bytes)?;
        self.number_equal_names();
        self.connect_instances();
        Ok(())
    }

    /// Takes descriptors and metadata from vdb-rs where that reads the file safely.
    fn open_checked(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        let damaged = |g: &GridHeader| matches!(g.refused, Some(Refusal::Damaged(_)));
        let names: HashSet<&str> = self.grids.iter().map(|g| g.unique_name.as_str()).collect();
        let repeated = names.len() < self.grids.len();
        if self.version.streamed || repeated || self.grids.iter().any(damaged) {
            return Ok(());
        }
        let Some(mut opened) = opener::open(bytes) else {
            return Ok(());
        };
        self.metadata = opened.metadata;
        for grid in &mut self.grids {
            let read = opened.grids.remove(&grid.unique_name).filter(|read| {
                read.type_name
                    .strip_suffix(HALF_SUFFIX)
                    .unwrap_or(&read.type_name)
                    == grid.type_name
                    && read.instance_of == grid.instance_of.as_deref().unwrap_or_default()
                    && read.compression == grid.compression.bits()
            });
            let read = read.ok_or_else(|| {
                let what = format!(
                    "two readings of the descriptor of grid `{}` differ",
                    grid.name
                );
                Fault::damaged(0, what)
            })?;
            grid.metadata = read.metadata;
            grid.class = GridClass::from_metadata(&grid.metadata);
        }
        Ok(())
    }

    /// Reads one descriptor and the head of its grid.
    fn grid<'a>(
        &mut self,
        c: &mut Cursor<'a>,
        bytes: &'a [u8],
        compression: Option<Compression>,
    ) -> Result<Next, Fault> {
        let unique_name = c.string("grid name")?;
        let stored_type = c.string("grid type")?;
        let parent = c.string("instance parent")?;
        let at = c.at();
        let position = c.i64("grid position")?;
        let leaves = c.i64("leaf position")?;
        let end = c.i64("end position")?;

        let type_name = stored_type
            .strip_suffix(HALF_SUFFIX)
            .unwrap_or(&stored_type)
            .to_owned();
        let mut header = GridHeader {
            name: unique_name
                .split('\u{1e}')
                .next()
                .unwrap_or_default()
                .to_owned(),
            ordinal: 0,
            value_type: ValueType::from_type_name(&type_name),
            half: stored_type.ends_with(HALF_SUFFIX),
            class: GridClass::Unknown,
            compression: Compression::NONE,
            metadata: Metadata::default(),
            map: String::new(),
            index_to_world: None,
            instance_of: (!parent.is_empty()).then_some(parent),
            refused: None,
            unique_name,
            type_name,
        };
        let mut place = None;
        let next;
        if self.version.streamed {
            let head = read_head(c, &mut header, self.version.format, compression)?;
            next = match self.streamed_tree(c, bytes, &header, &head)? {
                Some(end) => {
                    *c = Cursor::new(bytes, end, "next grid")?;
                    Next::Here
                }
                None => Next::Unknown,
            };
            place = Some(head);
        } else {
            let head = position_in_file(position, at, "grid").and_then(|position| {
                let mut c = Cursor::new(bytes, position, "grid")?;
                let mut head = read_head(&mut c, &mut header, self.version.format, compression)?;
                if header.instance_of.is_none() {
                    let leaves = position_in_file(leaves, at + 8, "leaf buffers")?;
                    Cursor::new(bytes, leaves, "leaf buffers")?;
                    head.leaves = Some(leaves);
                }
                Ok(head)
            });
            match head {
                Ok(head) => place = Some(head),
                Err(fault) => header.refused = Some(Refusal::Damaged(fault.to_string())),
            }
            next = Next::At(end);
        }
        if matches!(header.value_type, ValueType::Points | ValueType::Other) {
            let name = &header.type_name;
            let reason = if header.value_type == ValueType::Points {
                format!(
                    "it holds points ({name}), not a density; rasterise them in the exporting program"
                )
            } else {
                format!("values of type {name} are not read")
            };
            header.refused.get_or_insert(Refusal::Unsupported(reason));
            place = None;
        }
        if header.refused.is_some() && header.map != "NonlinearFrustumMap" {
            place = None;
        }
        self.grids.push(header);
        self.places.push(place);
        Ok(next)
    }

    /// Steps over the tree of a streamed grid; `None` if its type is unknown, so its length too.
    fn streamed_tree(
        &self,
        c: &Cursor<'_>,
        bytes: &[u8],
        header: &GridHeader,
        place: &TreePlace,
    ) -> Result<Option<usize>, Fault> {
        if header.instance_of.is_some() {
            return Ok(Some(c.at()));
        }
        for_stored_type!(
            place.value_type,
            T => Ok(Some(Tree::<T>::read(bytes, place)?.end)),
            _ => Ok(None)
        )
    }

    fn number_equal_names(&mut self) {
        let mut seen = HashMap::new();
        for grid in &mut self.grids {
            let count = seen.entry(grid.name.clone()).or_insert(0);
            grid.ordinal = *count;
            *count += 1;
        }
    }

    /// Gives each instance the place of the tree that it shows.
    fn connect_instances(&mut self) {
        let by_name: HashMap<String, usize> = self
            .grids
            .iter()
            .enumerate()
            .map(|(i, g)| (g.unique_name.clone(), i))
            .collect();
        for i in 0..self.grids.len() {
            if self.grids[i].instance_of.is_none() || self.places[i].is_none() {
                continue;
            }
            // An instance of an instance is followed to its end; a ring has none.
            let mut owner = Some(i);
            let mut steps = 0;
            while let Some(o) = owner
                && let Some(parent) = &self.grids[o].instance_of
            {
                owner = by_name.get(parent).copied().filter(|_| steps < 64);
                steps += 1;
            }
            let owner = owner.filter(|&o| self.grids[o].type_name == self.grids[i].type_name);
            self.places[i] = owner.and_then(|o| self.places[o].clone());
            if self.places[i].is_none() {
                let parent = self.grids[i].instance_of.as_deref().unwrap_or_default();
                let reason = format!("it shares the tree of grid `{parent}`, which cannot be read");
                self.grids[i]
                    .refused
                    .get_or_insert(Refusal::Damaged(reason));
            }
        }
    }
}

impl GridHeader {
    /// The name as [`Archive::find`] takes it: `density`, `density[1]`.
    pub fn label(&self) -> String {
        match self.ordinal {
            0 => self.name.clone(),
            n => format!("{}[{n}]", self.name),
        }
    }
}

/// Where the next descriptor is.
enum Next {
    Here,
    At(i64),
    Unknown,
}

fn check_magic(bytes: &[u8]) -> Result<(), Fault> {
    if bytes.starts_with(&MAGIC) {
        return Ok(());
    }
    if bytes.starts_with(b"NanoVDB") {
        return Err(Fault::NanoVdb);
    }
    let found = match &bytes[..bytes.len().min(4)] {
        [] => "it is empty".to_owned(),
        first => {
            let hex: Vec<String> = first.iter().map(|b| format!("{b:02x}")).collect();
            format!("it begins with {}", hex.join(" "))
        }
    };
    Err(Fault::NotVdb { found })
}

fn position_in_file(position: i64, at: usize, what: &str) -> Result<usize, Fault> {
    usize::try_from(position)
        .ok()
        .filter(|&p| p > 0)
        .ok_or_else(|| Fault::damaged(at, format!("position of the {what} is {position}")))
}

/// Compression, metadata and map; the tree follows.
fn read_head(
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
