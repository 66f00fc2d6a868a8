//! Files that no exporter at hand writes, built byte by byte: cases of the format without a sample.

use glam::IVec3;
use half::f16;
use vpm_vdb::vdb::{Archive, Value};

/// Bytes of a streamed file.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    fn u32(self, v: u32) -> Self {
        self.raw(&v.to_le_bytes())
    }

    fn string(self, s: &str) -> Self {
        self.u32(s.len() as u32).raw(s.as_bytes())
    }

    fn origin(self, o: IVec3) -> Self {
        o.to_array()
            .into_iter()
            .fold(self, |b, v| b.raw(&v.to_le_bytes()))
    }

    /// A mask of `bits` bits with the first one set, or none.
    fn mask(self, bits: usize, first: bool) -> Self {
        let mut mask = vec![0; bits / 8];
        mask[0] = u8::from(first);
        self.raw(&mask)
    }

    fn header(version: u32, grids: u32) -> Self {
        let b = Self::default().raw(&[0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0]);
        b.u32(version)
            .u32(12)
            .u32(1)
            .raw(&[0])
            .raw(&[b'-'; 36])
            .u32(0)
            .u32(grids)
    }

    /// Descriptor, compression, no metadata, a map of voxel size 1.
    fn grid(self, name: &str, type_name: &str, parent: &str, compression: u32) -> Self {
        let b = self
            .string(name)
            .string(type_name)
            .string(parent)
            .raw(&[0; 24]);
        let b = b.u32(compression).u32(0).string("UniformScaleMap");
        (0..15).fold(b, |b, _| b.raw(&1f64.to_le_bytes()))
    }

    /// Internal nodes down to one leaf at the node's origin, all else background.
    fn branch(self, origin: IVec3) -> Self {
        let b = self.origin(origin);
        let b = b.mask(32768, true).mask(32768, false).raw(&[0]);
        b.mask(4096, true)
            .mask(4096, false)
            .raw(&[0])
            .mask(512, false)
    }

    /// A leaf whose buffer holds all its values, none active.
    fn leaf(self, buffer: &[u8]) -> Self {
        self.mask(512, false).raw(&[6]).raw(buffer)
    }
}

const MASK: u32 = 2;
const BLOSC: u32 = 4;

fn open(bytes: Bytes) -> Archive {
    Archive::from_bytes("made.vdb", bytes.0).expect("the file opens")
}

fn values(archive: &Archive) -> Vec<f32> {
    let grid = archive.read_scalar(0).expect("the grid loads");
    let mut out = vec![0.0; 512 * grid.leaf_origins.len()];
    grid.decode_leaves(&mut out, 512, |_, v, out| out.copy_from_slice(v))
        .expect("it unpacks");
    out
}

#[test]
fn half_grids_of_version_225() {
    let numbers: Vec<f16> = (0..512)
        .map(|i| f16::from_f32(i as f32 / 8.0 - 20.0))
        .collect();
    let buffer: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    let b = Bytes::header(225, 1).grid("density", "Tree_half_5_4_3", "", MASK);
    let b = b
        .u32(1)
        .raw(&f16::from_f32(0.5).to_le_bytes())
        .u32(0)
        .u32(1);
    let archive = open(b.branch(IVec3::ZERO).leaf(&buffer));
    let want: Vec<f32> = numbers.iter().map(|v| v.to_f32()).collect();
    assert_eq!(values(&archive), want);
    let probes = archive
        .probe(0, &[IVec3::new(0, 0, 7), IVec3::splat(-1)])
        .unwrap();
    assert_eq!(probes[0].value, Value::Float(7.0 / 8.0 - 20.0));
    assert_eq!(probes[1].value, Value::Float(0.5));
}

/// A Blosc chunk of LZ4 with byte shuffle in blocks of `blocksize`, as the Blosc library splits them.
fn blosc(plain: &[u8], blocksize: usize, typesize: usize) -> Vec<u8> {
    let mut blocks = Vec::new();
    for block in plain.chunks(blocksize) {
        let n = block.len() / typesize;
        let mut shuffled = block.to_vec();
        for i in 0..n {
            for t in 0..typesize {
                shuffled[t * n + i] = block[i * typesize + t];
            }
        }
        let split = block.len() == blocksize && blocksize / typesize >= 128;
        let streams = if split { typesize } else { 1 };
        let mut packed = Vec::new();
        for stream in shuffled.chunks(block.len() / streams) {
            let small = lz4_flex::block::compress(stream);
            let best = if small.len() < stream.len() {
                &small[..]
            } else {
                stream
            };
            packed.extend((best.len() as u32).to_le_bytes());
            packed.extend(best);
        }
        blocks.push(packed);
    }
    let body = 16 + 4 * blocks.len();
    let total = body + blocks.iter().map(Vec::len).sum::<usize>();
    let mut chunk = vec![2, 1, 1 | 1 << 5, typesize as u8];
    for v in [plain.len(), blocksize, total] {
        chunk.extend((v as u32).to_le_bytes());
    }
    let mut start = body;
    for block in &blocks {
        chunk.extend((start as u32).to_le_bytes());
        start += block.len();
    }
    chunk.extend(blocks.concat());
    chunk
}

#[test]
fn blosc_chunks_of_several_blocks() {
    let numbers: Vec<f32> = (0..512).map(|i| (i / 3) as f32 * 0.25).collect();
    let plain: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    // Whole blocks, split and not; a shorter last block; a last block that is no whole value.
    for (blocksize, typesize) in [
        (2048, 4),
        (1024, 4),
        (512, 4),
        (900, 4),
        (600, 3),
        (600, 8),
        (640, 2),
    ] {
        let chunk = blosc(&plain, blocksize, typesize);
        let b = Bytes::header(224, 1).grid("density", "Tree_float_5_4_3", "", MASK | BLOSC);
        let b = b.u32(1).u32(0).u32(0).u32(1).origin(IVec3::ZERO);
        // Of an internal node without active tiles the buffer is empty, its length 0.
        let empty = 0i64.to_le_bytes();
        let b = b.mask(32768, true).mask(32768, false).raw(&[0]).raw(&empty);
        let b = b
            .mask(4096, true)
            .mask(4096, false)
            .raw(&[0])
            .raw(&empty)
            .mask(512, false);
        let buffer = [&(chunk.len() as i64).to_le_bytes()[..], &chunk].concat();
        assert_eq!(
            values(&open(b.leaf(&buffer))),
            numbers,
            "blocks of {blocksize}, {typesize}"
        );
    }
}

fn two_roots(first: IVec3, second: IVec3) -> Bytes {
    let b = Bytes::header(224, 1).grid("density", "Tree_float_5_4_3", "", MASK);
    let b = b.u32(1).u32(0).u32(0).u32(2).branch(first).branch(second);
    let buffer = |v: f32| v.to_le_bytes().repeat(512);
    b.leaf(&buffer(1.0)).leaf(&buffer(2.0))
}

#[test]
fn leaf_buffers_follow_the_sorted_root() {
    // OpenVDB holds the root's children sorted and reads their buffers in that order.
    let archive = open(two_roots(IVec3::new(4096, 0, 0), IVec3::new(-4096, 0, 0)));
    let probes = archive
        .probe(0, &[IVec3::new(-4096, 0, 0), IVec3::new(4096, 0, 0)])
        .unwrap();
    assert_eq!(
        [probes[0].value, probes[1].value],
        [Value::Float(1.0), Value::Float(2.0)]
    );
}

#[test]
fn a_root_entry_given_twice_is_refused() {
    let bytes = two_roots(IVec3::ZERO, IVec3::ZERO).0;
    let e = Archive::from_bytes("made.vdb", bytes)
        .unwrap_err()
        .to_string();
    assert!(
        e.contains("made.vdb") && e.contains("the root holds [0, 0, 0] twice"),
        "{e}"
    );
}

#[test]
fn instances_in_a_ring_are_refused() {
    let b = Bytes::header(224, 2).grid("a", "Tree_float_5_4_3", "b", MASK);
    let archive = open(b.grid("b", "Tree_float_5_4_3", "a", MASK));
    let e = archive.read_scalar(0).unwrap_err().to_string();
    assert!(
        e.contains("shares the tree of grid `b`, which cannot be read"),
        "{e}"
    );
}

#[test]
fn grids_behind_points_in_a_streamed_file_are_said_to_be_lost() {
    let b = Bytes::header(224, 3).grid("points", "Tree_ptdataidx32_5_4_3", "", MASK);
    let archive = open(b.raw(&[1, 2, 3]));
    assert_eq!((archive.grids().len(), archive.unreached()), (1, 2));
    let e = archive.find("density").unwrap_err().to_string();
    assert!(
        e.contains("it has: points, and 2 that cannot be reached"),
        "{e}"
    );
}

#[test]
fn grids_that_share_their_metadata_do_not_multiply_it() {
    // A file with offsets: many descriptors, each of which points to the same long metadata.
    const GRIDS: usize = 2000;
    let mut b = Bytes::header(224, GRIDS as u32);
    b.0[20] = 1;
    let descriptor = |head: i64, end: i64| {
        let b = Bytes::default().u32(0).string("Tree_float_5_4_3").u32(0);
        b.raw(&head.to_le_bytes())
            .raw(&head.to_le_bytes())
            .raw(&end.to_le_bytes())
            .0
    };
    let length = descriptor(0, 0).len();
    let head = (b.0.len() + GRIDS * length) as i64;
    for i in 0..GRIDS {
        let end = (b.0.len() + length) as i64;
        b = b.raw(&descriptor(head, if i + 1 < GRIDS { end } else { 0 }));
    }
    b = b
        .u32(MASK)
        .u32(1)
        .string("note")
        .string("string")
        .string(&"x".repeat(1 << 20));
    b = (0..15).fold(b.string("UniformScaleMap"), |b, _| {
        b.raw(&1f64.to_le_bytes())
    });
    let archive = open(b);
    let held: usize = archive.grids().iter().map(|g| g.metadata.0.len()).sum();
    assert_eq!(
        (archive.grids().len(), held),
        (GRIDS, 1),
        "only the first keeps its metadata"
    );
    let e = archive.read_scalar(1).unwrap_err().to_string();
    assert!(e.contains("grids overlap"), "{e}");
}
