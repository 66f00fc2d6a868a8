//! What can be wrong with a .vdb file, said with the facts: file, grid, place, what was found, what is possible.

use std::fmt;

/// A fault of a .vdb file, with the file and, where one is concerned, the grid.
#[derive(Debug)]
pub struct VdbError {
    /// The file as the user named it.
    pub file: String,
    /// The grid's name, where the fault concerns one.
    pub grid: Option<String>,
    /// What is wrong.
    pub fault: Fault,
}

impl fmt::Display for VdbError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.fault, &self.grid) {
            (Fault::NoSuchGrid { asked, has }, _) => {
                write!(f, "grid `{asked}` not in {}; it has: {has}", self.file)
            }
            (fault, Some(grid)) => write!(f, "{}: grid `{grid}`: {fault}", self.file),
            (fault, None) => write!(f, "{}: {fault}", self.file),
        }
    }
}

impl std::error::Error for VdbError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.fault {
            Fault::Io(e) => Some(e),
            _ => None,
        }
    }
}

/// The kinds of fault.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The operating system did not hand over the bytes.
    #[error("cannot be read: {0}")]
    Io(std::io::Error),
    /// A NanoVDB file, which is another format.
    #[error(
        "is a NanoVDB file (.nvdb), not OpenVDB; convert it with `nanovdb_convert in.nvdb out.vdb`"
    )]
    NanoVdb,
    /// Not a .vdb file at all.
    #[error("is not an OpenVDB file: {found}, a .vdb begins with 20 42 44 56")]
    NotVdb {
        /// What its first bytes are.
        found: String,
    },
    /// A file version that no rule here covers.
    #[error("has file version {0}; versions 220 to 225 (OpenVDB 2.0 and later) can be read")]
    Version(u32),
    /// The file ends, or a position lies, beyond its last byte.
    #[error("ends too early: {what} at byte {at} needs {need} bytes, {left} are left")]
    Truncated {
        /// What was being read.
        what: &'static str,
        /// Position of its first byte.
        at: u64,
        /// Bytes it needs.
        need: u64,
        /// Bytes there are.
        left: u64,
    },
    /// The bytes are there and contradict the format.
    #[error("is damaged at byte {at}: {what}")]
    Damaged {
        /// What is wrong.
        what: String,
        /// Position in the file.
        at: u64,
    },
    /// A valid grid of a kind that this program does not read.
    #[error("{0}")]
    Unsupported(String),
    /// No grid of that name.
    #[error("grid `{asked}` not in the file; it has: {has}")]
    NoSuchGrid {
        /// The name asked for.
        asked: String,
        /// The names there are, separated by commas.
        has: String,
    },
    /// A vector grid asked for as a scalar, or the other way round.
    #[error("holds {found}, where {wanted} was asked for")]
    WrongType {
        /// The grid's value type.
        found: &'static str,
        /// What the caller wanted.
        wanted: &'static str,
    },
    /// Values that no density can have, refused because the caller is strict.
    #[error("{0}")]
    UnfitValues(String),
}

impl Fault {
    pub(crate) fn damaged(at: usize, what: impl Into<String>) -> Self {
        Self::Damaged {
            what: what.into(),
            at: at as u64,
        }
    }
}
