//! A .vdb file in memory: its grids by number and by name, and where their trees are.
//!
//! A name that repeats is told apart by a number: `density`, `density[1]`. A fault inside one grid
//! refuses that grid; the others still load.

use std::path::Path;

use super::error::{Fault, VdbError};
use super::header::GridHeader;
use super::metadata::Metadata;
use super::tree::TreePlace;

/// A .vdb file in memory, its grids listed but not yet read.
#[derive(Debug)]
pub struct Archive {
    file: String,
    bytes: Vec<u8>,
    pub(super) version: FileVersion,
    pub(super) metadata: Metadata,
    pub(super) grids: Vec<GridHeader>,
    pub(super) places: Vec<Option<TreePlace>>,
    pub(super) unreached: usize,
    /// Bytes that the heads of grids may still take; all of them together fit into the file.
    pub(super) head_budget: usize,
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
            version: FileVersion {
                format: 0,
                library: [0; 2],
                streamed: false,
            },
            metadata: Metadata::default(),
            grids: Vec::new(),
            places: Vec::new(),
            unreached: 0,
            head_budget: bytes.len(),
            bytes,
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
}
