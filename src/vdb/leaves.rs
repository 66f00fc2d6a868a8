//! The leaves' buffers: found by one quick scan, then unpacked one by one in any order.
//!
//! ```text
//! values  active mask, (up to version 221: i32 x 3 origin, u8 buffer count 1), values (codec.rs)
//! bool    active mask, i32 x 3 origin, value bits
//! mask    active mask, i32 x 3 origin; the active mask is the value
//! ```

use super::bytes::{Bits, Cursor, leaf_words};
use super::codec::{Format, NodeValues, Work};
use super::error::Fault;
use super::value::Stored;

/// Voxels of a leaf.
pub(crate) const VOXELS: usize = 512;

/// What a leaf stores per voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeafKind {
    Values,
    Bits,
    Mask,
}

/// Where the buffers of a tree's leaves are.
#[derive(Debug)]
pub(crate) struct Leaves<'a, T> {
    bytes: &'a [u8],
    format: Format,
    kind: LeafKind,
    background: T,
    /// Position of each leaf's active mask in the file.
    starts: Vec<usize>,
}

impl<'a, T: Stored> Leaves<'a, T> {
    /// Scans `count` leaves from `c` on; also returns their active masks.
    pub(crate) fn find(
        c: &mut Cursor<'a>,
        bytes: &'a [u8],
        format: Format,
        kind: LeafKind,
        background: T,
        count: usize,
    ) -> Result<(Self, Vec<[u64; 8]>), Fault> {
        let mut starts = Vec::with_capacity(count);
        let mut masks = Vec::with_capacity(count);
        let mut leaves = Self {
            bytes,
            format,
            kind,
            background,
            starts: Vec::new(),
        };
        for _ in 0..count {
            starts.push(c.at());
            let (active, _) = leaves.leaf(c)?;
            masks.push(leaf_words(active.0));
        }
        leaves.starts = starts;
        Ok((leaves, masks))
    }

    pub(crate) fn len(&self) -> usize {
        self.starts.len()
    }

    fn leaf(&self, c: &mut Cursor<'a>) -> Result<(Bits<'a>, Content<'a, T>), Fault> {
        let active = Bits(c.take(64, "active mask of a leaf")?);
        let content = match self.kind {
            LeafKind::Values => {
                if !self.format.has_flags() {
                    c.take(12, "origin of a leaf")?;
                    let at = c.at();
                    let buffers = c.u8("buffer count of a leaf")?;
                    if buffers != 1 {
                        return Err(Fault::damaged(
                            at,
                            format!("leaf with {buffers} buffers, only 1 is known"),
                        ));
                    }
                }
                Content::Values(NodeValues::find(
                    c,
                    self.format,
                    self.background,
                    VOXELS,
                    active,
                )?)
            }
            LeafKind::Bits => {
                c.take(12, "origin of a leaf")?;
                Content::Bits(Bits(c.take(64, "values of a bool leaf")?))
            }
            LeafKind::Mask => {
                c.take(12, "origin of a leaf")?;
                Content::Bits(active)
            }
        };
        Ok((active, content))
    }

    /// Unpacks leaf `i`, inactive values included.
    pub(crate) fn unpack(
        &self,
        i: usize,
        work: &mut Work<T>,
        out: &mut [T; VOXELS],
    ) -> Result<(), Fault> {
        let mut c = Cursor::new(self.bytes, self.starts[i], "leaf")?;
        match self.leaf(&mut c)? {
            (active, Content::Values(values)) => values.unpack(active, work, out),
            (_, Content::Bits(bits)) => {
                for (out, word) in out.chunks_exact_mut(64).zip(bits.words()) {
                    for (b, v) in out.iter_mut().enumerate() {
                        *v = T::from_bit(word >> b & 1 != 0);
                    }
                }
                Ok(())
            }
        }
    }
}

enum Content<'a, T> {
    Values(NodeValues<'a, T>),
    Bits(Bits<'a>),
}
