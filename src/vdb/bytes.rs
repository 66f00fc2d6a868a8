//! Little-endian reading from a byte slice; every step is checked against the end of the file.
//!
//! All numbers in a .vdb are little-endian; a string is a u32 length and that many bytes of UTF-8.

use glam::IVec3;

use super::error::Fault;

/// A position in the file's bytes.
#[derive(Debug, Clone)]
pub(crate) struct Cursor<'a> {
    data: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// Starts at `at`, which must not lie beyond the end.
    pub(crate) fn new(data: &'a [u8], at: usize, what: &'static str) -> Result<Self, Fault> {
        if at > data.len() {
            return Err(Fault::Truncated {
                what,
                at: at as u64,
                need: 1,
                left: 0,
            });
        }
        Ok(Self { data, at })
    }

    pub(crate) fn at(&self) -> usize {
        self.at
    }

    pub(crate) fn take(&mut self, n: usize, what: &'static str) -> Result<&'a [u8], Fault> {
        let left = self.data.len() - self.at;
        if n > left {
            return Err(Fault::Truncated {
                what,
                at: self.at as u64,
                need: n as u64,
                left: left as u64,
            });
        }
        let taken = &self.data[self.at..self.at + n];
        self.at += n;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &'static str) -> Result<[u8; N], Fault> {
        let mut a = [0; N];
        a.copy_from_slice(self.take(N, what)?);
        Ok(a)
    }

    pub(crate) fn u8(&mut self, what: &'static str) -> Result<u8, Fault> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(crate) fn u32(&mut self, what: &'static str) -> Result<u32, Fault> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn i32(&mut self, what: &'static str) -> Result<i32, Fault> {
        Ok(i32::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn i64(&mut self, what: &'static str) -> Result<i64, Fault> {
        Ok(i64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn f64(&mut self, what: &'static str) -> Result<f64, Fault> {
        Ok(f64::from_le_bytes(self.array(what)?))
    }

    pub(crate) fn ivec3(&mut self, what: &'static str) -> Result<IVec3, Fault> {
        Ok(IVec3::new(
            self.i32(what)?,
            self.i32(what)?,
            self.i32(what)?,
        ))
    }

    /// A string; bytes that are not UTF-8 are replaced by U+FFFD.
    pub(crate) fn string(&mut self, what: &'static str) -> Result<String, Fault> {
        let n = self.u32(what)? as usize;
        Ok(String::from_utf8_lossy(self.take(n, what)?).into_owned())
    }
}

/// A bit mask of a node as stored: bit i is bit i % 8 of byte i / 8.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bits<'a>(pub(crate) &'a [u8]);

impl<'a> Bits<'a> {
    /// The mask in words of 64 bits; every mask of the format is a whole number of them.
    pub(crate) fn words(self) -> impl Iterator<Item = u64> + 'a {
        self.0.chunks_exact(8).map(word)
    }

    pub(crate) fn count(self) -> usize {
        self.words().map(|w| w.count_ones() as usize).sum()
    }
}

fn word(b: &[u8]) -> u64 {
    u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]])
}

/// The active mask of a leaf as eight words, bit `x << 6 | y << 3 | z`.
pub(crate) fn leaf_words(bytes: &[u8]) -> [u64; 8] {
    let mut words = [0; 8];
    for (w, b) in words.iter_mut().zip(bytes.chunks_exact(8)) {
        *w = word(b);
    }
    words
}

/// The positions of the set bits of a word, ascending.
pub(crate) fn ones(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (word != 0).then(|| {
            let i = word.trailing_zeros() as usize;
            word &= word - 1;
            i
        })
    })
}
