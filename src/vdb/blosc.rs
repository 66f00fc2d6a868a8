//! A chunk of Blosc 1, as OpenVDB writes it: LZ4 with byte shuffle, or stored.
//!
//! ```text
//! u8 version (2)  u8 codec version  u8 flags  u8 typesize  u32 nbytes  u32 blocksize  u32 cbytes
//! flags: 1 byte shuffle, 2 stored, 4 bit shuffle, 16 blocks not split, bits 5-7 codec (1 = LZ4)
//! stored: nbytes bytes.  Else: u32 start of each block, then the blocks.
//! block: one stream, or `typesize` streams of equal length; stream: i32 length, bytes
//! ```
//! A block is split unless flag 16 is set, it is the shorter last one, `typesize` > 16, or a
//! stream would have fewer than 128 bytes. A stream as long as its output is stored. The byte
//! shuffle puts the first bytes of all values of a block first, then the second bytes, and so on;
//! bytes beyond the last whole value stay where they are.

use super::error::Fault;

const HEADER: usize = 16;
const SHUFFLED: u8 = 1;
const STORED: u8 = 2;
const BIT_SHUFFLED: u8 = 4;
const NOT_SPLIT: u8 = 16;
const LZ4: u8 = 1;

/// Unpacks `chunk`, which lies at `at` in the file, to exactly `out`. `block` is a work buffer.
pub(crate) fn unpack(
    chunk: &[u8],
    at: usize,
    block: &mut Vec<u8>,
    out: &mut [u8],
) -> Result<(), Fault> {
    let bad = |what: &str| Fault::damaged(at, format!("Blosc chunk: {what}"));
    let (&[version, _, flags, typesize, sizes @ ..], body) = chunk
        .split_first_chunk::<HEADER>()
        .ok_or_else(|| bad("shorter than its header"))?;
    let size = |i: usize| {
        u32::from_le_bytes([sizes[i], sizes[i + 1], sizes[i + 2], sizes[i + 3]]) as usize
    };
    let (nbytes, blocksize, cbytes) = (size(0), size(4), size(8));
    if version != 2 {
        return Err(bad(&format!("format version {version}, only 2 is known")));
    }
    if cbytes != chunk.len() {
        return Err(bad(&format!(
            "says it is {cbytes} bytes long, the buffer has {}",
            chunk.len()
        )));
    }
    if nbytes != out.len() {
        return Err(bad(&format!(
            "unpacks to {nbytes} bytes where {} belong",
            out.len()
        )));
    }
    if nbytes == 0 {
        return Ok(());
    }
    if flags & STORED != 0 {
        if body.len() != nbytes {
            return Err(bad("stored data has not the length of the values"));
        }
        out.copy_from_slice(body);
        return Ok(());
    }
    if flags >> 5 != LZ4 {
        return Err(bad(&format!("codec {}, only LZ4 (1) is known", flags >> 5)));
    }
    if flags & BIT_SHUFFLED != 0 {
        return Err(bad("bit shuffle, only byte shuffle is known"));
    }
    if blocksize == 0 || typesize == 0 {
        return Err(bad("block or value size 0"));
    }
    let typesize = usize::from(typesize);
    let shuffled = flags & SHUFFLED != 0 && typesize > 1;
    for (b, out) in out.chunks_mut(blocksize).enumerate() {
        let start = chunk
            .get(HEADER + 4 * b..HEADER + 4 * b + 4)
            .map(|s| u32::from_le_bytes([s[0], s[1], s[2], s[3]]) as usize)
            .ok_or_else(|| bad("its table of blocks is cut short"))?;
        let split = flags & NOT_SPLIT == 0
            && out.len() == blocksize
            && typesize <= 16
            && blocksize / typesize >= 128;
        let streams = if split { typesize } else { 1 };
        let length = out.len();
        let plain = if shuffled {
            block.resize(length.max(block.len()), 0);
            &mut block[..length]
        } else {
            &mut *out
        };
        let mut rest = chunk
            .get(start..)
            .ok_or_else(|| bad("a block begins beyond its end"))?;
        if plain.len() % streams != 0 {
            return Err(bad("a block is no whole number of streams"));
        }
        for stream in plain.chunks_exact_mut(length / streams) {
            let (n, tail) = rest
                .split_first_chunk()
                .ok_or_else(|| bad("a stream is cut short"))?;
            let n = usize::try_from(i32::from_le_bytes(*n)).unwrap_or(usize::MAX);
            let (packed, tail) = tail
                .split_at_checked(n)
                .ok_or_else(|| bad("a stream is cut short"))?;
            rest = tail;
            if n == stream.len() {
                stream.copy_from_slice(packed);
            } else {
                match lz4_flex::block::decompress_into(packed, stream) {
                    Ok(got) if got == stream.len() => {}
                    Ok(got) => {
                        return Err(bad(&format!(
                            "a stream unpacks to {got} bytes where {} belong",
                            stream.len()
                        )));
                    }
                    Err(e) => return Err(bad(&format!("LZ4: {e}"))),
                }
            }
        }
        if shuffled {
            unshuffle(&block[..length], typesize, out);
        }
    }
    Ok(())
}

/// `out[i * typesize + t] = block[t * n + i]` for the n whole values; the rest is copied.
fn unshuffle(block: &[u8], typesize: usize, out: &mut [u8]) {
    let n = out.len() / typesize;
    if typesize == 4 {
        let (a, rest) = block.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, rest) = rest.split_at(n);
        let (d, rest) = rest.split_at(n);
        let (values, tail) = out.as_chunks_mut::<4>();
        for ((((v, &a), &b), &c), &d) in values.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *v = [a, b, c, d];
        }
        tail.copy_from_slice(rest);
    } else {
        for t in 0..typesize {
            for i in 0..n {
                out[i * typesize + t] = block[t * n + i];
            }
        }
        out[n * typesize..].copy_from_slice(&block[n * typesize..]);
    }
}
