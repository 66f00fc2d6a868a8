//! The values of one node as stored: which of them are there, and how they are packed.
//!
//! From version 222 on a node's values begin with a flag that says what the inactive values are:
//!
//! | flag | inactive values | stored before the buffer |
//! |---|---|---|
//! | 0 | background | |
//! | 1 | minus background | |
//! | 2 | one value | value |
//! | 3 | minus background, background where selected | selection mask |
//! | 4 | one value, background where selected | value, selection mask |
//! | 5 | one value, a second where selected | two values, selection mask |
//! | 6 | all values are in the buffer | |
//!
//! If the grid uses active-mask compression and the flag is not 6, the buffer holds the active
//! values only. Inactive values have full width even where the buffer has half floats.
//!
//! The buffer is raw; or, with zip or Blosc, an i64 length L and L packed bytes, or -L raw bytes
//! where L <= 0. Blosc wins if both are set. A half-float buffer without values is absent
//! altogether, a full one has its length.

use zune_inflate::{DeflateDecoder, DeflateOptions};

use super::blosc;
use super::bytes::{Bits, Cursor, ones};
use super::error::Fault;
use super::value::Stored;

/// How a grid's buffers are packed: bits 1 zip, 2 active mask, 4 Blosc.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Compression(pub(crate) u32);

impl Compression {
    pub(crate) const NONE: Self = Self(0);
    pub(crate) const ZIP: Self = Self(1);
    const KNOWN: u32 = 7;

    pub(crate) fn from_bits(bits: u32) -> Option<Self> {
        (bits & !Self::KNOWN == 0).then_some(Self(bits))
    }

    /// The bits as stored: 1 zip, 2 active mask, 4 Blosc.
    pub fn bits(self) -> u32 {
        self.0
    }

    fn active_mask(self) -> bool {
        self.0 & 2 != 0
    }

    fn packing(self) -> Packing {
        match self.0 {
            bits if bits & 4 != 0 => Packing::Blosc,
            bits if bits & 1 != 0 => Packing::Zip,
            _ => Packing::None,
        }
    }
}

impl std::fmt::Display for Compression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let packing = match self.packing() {
            Packing::Blosc => Some("blosc"),
            Packing::Zip => Some("zip"),
            _ => None,
        };
        match (packing, self.active_mask()) {
            (Some(packing), true) => write!(f, "{packing} + active mask"),
            (Some(packing), false) => f.write_str(packing),
            (None, true) => f.write_str("active mask"),
            (None, false) => f.write_str("none"),
        }
    }
}

/// What a node's bytes mean, the same for all nodes of a grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Format {
    pub(crate) version: u32,
    pub(crate) compression: Compression,
    pub(crate) half: bool,
}

impl Format {
    /// Version 222 brought the flag and, in internal nodes, values for the slots of children.
    pub(crate) fn has_flags(self) -> bool {
        self.version >= 222
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    None,
    Zip,
    Blosc,
    /// Raw after a length <= 0.
    Stored,
}

/// The values of a node, found but not yet unpacked.
#[derive(Debug)]
pub(crate) struct NodeValues<'a, T> {
    /// Inactive values: where not selected, where selected.
    inactive: [T; 2],
    selection: Option<Bits<'a>>,
    flag: u8,
    /// Values in the node, values in the buffer.
    count: usize,
    stored: usize,
    packing: Packing,
    buffer: &'a [u8],
    at: usize,
    half: bool,
}

impl<'a, T: Stored> NodeValues<'a, T> {
    /// Finds the `count` values of a node whose active mask is `active` and steps over them.
    pub(crate) fn find(
        c: &mut Cursor<'a>,
        format: Format,
        background: T,
        count: usize,
        active: Bits<'a>,
    ) -> Result<Self, Fault> {
        let at = c.at();
        let flag = if format.has_flags() {
            c.u8("node flag")?
        } else {
            6
        };
        if flag > 6 {
            return Err(Fault::damaged(
                at,
                format!("node flag {flag}, only 0 to 6 exist"),
            ));
        }
        let mut inactive = match flag {
            0 => [background; 2],
            _ => [background.negative(), background],
        };
        if matches!(flag, 2 | 4 | 5) {
            inactive[0] = T::load(c.take(T::BYTES, "inactive value")?);
        }
        if flag == 5 {
            inactive[1] = T::load(c.take(T::BYTES, "second inactive value")?);
        }
        let selection = matches!(flag, 3..=5)
            .then(|| c.take(count / 8, "selection mask"))
            .transpose()?
            .map(Bits);
        let all = flag == 6 || !format.compression.active_mask();
        let stored = if all { count } else { active.count() };
        let size = stored * if format.half { T::HALF_BYTES } else { T::BYTES };
        let half = format.half && T::HALF_BYTES < T::BYTES;
        let absent = stored == 0 && format.half && T::REAL;
        let mut packing = format.compression.packing();
        let mut at = c.at();
        let buffer = if absent {
            &[]
        } else if packing == Packing::None {
            c.take(size, "values")?
        } else {
            let length = c.i64("length of a buffer")?;
            at = c.at();
            if length <= 0 {
                if length.unsigned_abs() != size as u64 {
                    return Err(Fault::damaged(
                        at - 8,
                        format!(
                            "{} raw bytes of values where {size} belong",
                            length.unsigned_abs()
                        ),
                    ));
                }
                packing = Packing::Stored;
                c.take(size, "values")?
            } else {
                c.take(
                    usize::try_from(length).unwrap_or(usize::MAX),
                    "packed values",
                )?
            }
        };
        Ok(Self {
            inactive,
            selection,
            flag,
            count,
            stored,
            packing,
            buffer,
            at,
            half,
        })
    }

    /// Whether every inactive value is the background.
    pub(crate) fn inactive_is_background(&self) -> bool {
        self.flag == 0 && self.stored < self.count
    }

    /// Unpacks to `out`, which has `count` places.
    pub(crate) fn unpack(
        &self,
        active: Bits<'_>,
        work: &mut Work<T>,
        out: &mut [T],
    ) -> Result<(), Fault> {
        if self.stored == self.count {
            return self.unpack_buffer(&mut work.bytes, out);
        }
        if work.values.len() < self.stored {
            work.values.resize(self.stored, T::default());
        }
        let packed = &mut work.values[..self.stored];
        self.unpack_buffer(&mut work.bytes, packed)?;
        let mut packed = packed.iter().copied();
        let [unselected, selected] = self.inactive;
        let mut selection = self.selection.map(Bits::words);
        for (out, mask) in out.chunks_exact_mut(64).zip(active.words()) {
            let selection = selection.as_mut().and_then(Iterator::next).unwrap_or(0);
            if mask == u64::MAX {
                for (v, p) in out.iter_mut().zip(&mut packed) {
                    *v = p;
                }
                continue;
            }
            out.fill(unselected);
            for i in ones(selection & !mask) {
                out[i] = selected;
            }
            for (i, p) in ones(mask).zip(&mut packed) {
                out[i] = p;
            }
        }
        Ok(())
    }

    fn unpack_buffer(&self, work: &mut ByteWork, out: &mut [T]) -> Result<(), Fault> {
        let size = self.stored * if self.half { T::HALF_BYTES } else { T::BYTES };
        if size == 0 {
            return Ok(());
        }
        let raw = match self.packing {
            Packing::None | Packing::Stored => self.buffer,
            Packing::Zip | Packing::Blosc => {
                if work.raw.len() < size {
                    work.raw.resize(size, 0);
                }
                let raw = &mut work.raw[..size];
                if self.packing == Packing::Blosc {
                    blosc::unpack(self.buffer, self.at, &mut work.block, raw)?;
                } else {
                    inflate(self.buffer, self.at, raw)?;
                }
                raw
            }
        };
        if self.half {
            T::unpack_half(raw, out);
        } else {
            T::unpack(raw, out);
        }
        Ok(())
    }
}

/// Unpacks a zlib stream to exactly `out`.
fn inflate(packed: &[u8], at: usize, out: &mut [u8]) -> Result<(), Fault> {
    let options = DeflateOptions::default()
        .set_size_hint(out.len())
        .set_limit(out.len())
        .set_confirm_checksum(true);
    let plain = DeflateDecoder::new_with_options(packed, options)
        .decode_zlib()
        .map_err(|e| Fault::damaged(at, format!("zip buffer: {:?}", e.error)))?;
    if plain.len() != out.len() {
        let what = format!(
            "zip buffer unpacks to {} bytes where {} belong",
            plain.len(),
            out.len()
        );
        return Err(Fault::damaged(at, what));
    }
    out.copy_from_slice(&plain);
    Ok(())
}

/// Work buffers of one thread.
#[derive(Debug)]
pub(crate) struct Work<T> {
    values: Vec<T>,
    bytes: ByteWork,
}

#[derive(Debug)]
struct ByteWork {
    raw: Vec<u8>,
    block: Vec<u8>,
}

impl<T> Work<T> {
    pub(crate) fn new() -> Self {
        Self {
            values: Vec::new(),
            bytes: ByteWork {
                raw: Vec::new(),
                block: Vec::new(),
            },
        }
    }
}
