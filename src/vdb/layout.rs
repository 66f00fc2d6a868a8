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

use super::archive::{Archive, FileVersion};
use super::bytes::Cursor;
use super::codec::Compression;
use super::error::Fault;
use super::header::{GridClass, GridHeader, Refusal, read_head};
use super::metadata::Metadata;
use super::opener;
use super::tree::{Tree, TreePlace, for_stored_type};
use super::value::ValueType;

const MAGIC: [u8; 8] = [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];
const HALF_SUFFIX: &str = "_HalfFloat";

impl Archive {
    /// Lists the grids of the file.
    pub(super) fn walk(&mut self, bytes: &[u8]) -> Result<(), Fault> {
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
                Cursor::new(bytes, position, "grid")?;
                // A thousand grids that name the same metadata must not multiply it.
                let limit = position.saturating_add(self.head_budget).min(bytes.len());
                let mut c = Cursor::new(&bytes[..limit], position, "grid")?;
                let head = read_head(&mut c, &mut header, self.version.format, compression);
                let mut head = head.map_err(|fault| match fault {
                    Fault::Truncated { .. } if limit < bytes.len() => {
                        Fault::damaged(position, "grids overlap one another")
                    }
                    fault => fault,
                })?;
                self.head_budget -= head.topology - position;
                if header.instance_of.is_none() {
                    let leaves = position_in_file(leaves, at + 8, "leaf buffers")?;
                    Cursor::new(bytes, leaves, "leaf buffers")?;
                    head.leaves = Some(leaves);
                }
                Ok(head)
            });
            match head {
                Ok(head) => place = Some(head),
                Err(fault) => {
                    header.metadata = Metadata::default();
                    header.refused = Some(Refusal::Damaged(fault.to_string()));
                }
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
