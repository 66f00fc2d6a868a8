//! Damaged, hostile and foreign files: an error that names file and fault, or a right reading.

use std::path::Path;

use vpm_vdb::vdb::{Archive, VdbError};

use super::vdb_files::{folder, vdb_files};

/// Opens a file and unpacks everything in it, as far as it goes.
pub(crate) fn read_all(name: &str, bytes: Vec<u8>) -> Result<usize, VdbError> {
    let archive = Archive::from_bytes(name, bytes)?;
    let mut read = 0;
    for (index, grid) in archive.grids().iter().enumerate() {
        if grid.value_type.is_vec3() {
            let grid = archive.read_vec3(index)?;
            let mut out = vec![0.0; 3 * grid.leaf_origins.len()];
            grid.decode_leaves(&mut out, 3, |_, v, out| out.copy_from_slice(&v[511]))?;
        } else {
            let grid = archive.read_scalar(index)?;
            let mut out = vec![0.0; grid.leaf_origins.len()];
            grid.decode_leaves(&mut out, 1, |_, v, out| out[0] = v[511])?;
        }
        read += 1;
    }
    Ok(read)
}

/// What each file of the folder must say, or `ok` where only something unused is damaged.
const EXPECTED: [(&str, &str); 40] = [
    (
        "block_pos_past_end",
        "grid `density`: ends too early: leaf buffers at byte 1099511627776",
    ),
    (
        "blosc_chunk_of_1_byte",
        "Blosc chunk: shorter than its header",
    ),
    (
        "blosc_claims_256mb",
        "says it is 268435472 bytes long, the buffer has 16",
    ),
    ("blosc_good_stored", "ok"),
    (
        "blosc_length_max",
        "packed values at byte 24565 needs 9223372036854775807 bytes",
    ),
    (
        "blosc_length_min",
        "9223372036854775808 raw bytes of values where 2048 belong",
    ),
    (
        "blosc_length_minus_8",
        "8 raw bytes of values where 2048 belong",
    ),
    (
        "blosc_length_zero",
        "0 raw bytes of values where 2048 belong",
    ),
    (
        "blosc_nbytes_not_multiple",
        "unpacks to 2051 bytes where 2048 belong",
    ),
    ("blosc_too_long", "unpacks to 4096 bytes where 2048 belong"),
    ("blosc_too_short", "unpacks to 1024 bytes where 2048 belong"),
    ("buffer_count_2", "tree with 2 buffers"),
    (
        "compression_bit_3",
        "compression 0xf, only the bits 1, 2 and 4 exist",
    ),
    ("damaged_oiio_bad-bbox-bomb_a", "ok"),
    ("damaged_oiio_bad-bbox-empty_a", "ok"),
    ("damaged_oiio_bad-bbox-huge_a", "ok"),
    ("damaged_oiio_bad-bbox-inverted_a", "ok"),
    ("damaged_oiio_bad-bbox-overflow_a", "ok"),
    ("damaged_oiio_bad-bbox-roundup_a", "ok"),
    (
        "damaged_oiio_truncated_a",
        "ends too early: grid type at byte 77",
    ),
    ("end_pos_zero", "ok"),
    ("grid_count_2", "ends too early: grid name at byte 33607"),
    ("grid_count_max", "ends too early: grid name at byte 33607"),
    ("grid_pos_negative", "position of the grid is -1"),
    (
        "grid_pos_past_end",
        "ends too early: grid at byte 1099511627776",
    ),
    ("meta_count_max", "ends too early: metadata type"),
    (
        "name_len_max",
        "ends too early: grid name at byte 69 needs 4294967295 bytes",
    ),
    ("nanovdb_magic", "is a NanoVDB file"),
    ("no_offsets_flag", "ok"),
    ("png", "is not an OpenVDB file: it begins with 89 50 4e 47"),
    ("random", "is not an OpenVDB file"),
    ("root_count_max", "node flag 141, only 0 to 6 exist"),
    ("text", "is not an OpenVDB file"),
    ("tile_count_max", "not a multiple of 4096"),
    ("version_212", "file version 212; versions 220 to 225"),
    ("version_217", "file version 217"),
    ("version_999", "file version 999"),
    ("wrong_magic", "is not an OpenVDB file"),
    ("zero_length", "it is empty"),
    ("zeros", "is not an OpenVDB file"),
];

#[test]
fn bad_files_are_refused_by_name_and_fault() {
    let Some(folder) = folder("bad") else { return };
    let paths = vdb_files(&folder);
    assert_eq!(
        paths.len(),
        EXPECTED.len(),
        "every file of the folder is in the table"
    );
    for (path, (stem, want)) in paths.iter().zip(EXPECTED) {
        let name = format!("{stem}.vdb");
        assert_eq!(
            path.file_name().and_then(|n| n.to_str()),
            Some(name.as_str()),
            "sorted"
        );
        match read_all(&name, std::fs::read(path).unwrap()) {
            Ok(_) => assert_eq!("ok", want, "{name} was read"),
            Err(e) => {
                let e = e.to_string();
                assert!(
                    e.starts_with(&name) && e.contains(want),
                    "{e}\nshould say {want}"
                );
            }
        }
    }
}

/// A grid of the one-grid file `fog_default`, read from another file that differs in unused parts.
#[test]
fn damage_to_unused_parts_changes_no_value() {
    let Some(folder) = folder("bad") else { return };
    let values = |path: &Path| {
        let archive = Archive::open(path).unwrap();
        let grid = archive.read_scalar(0).unwrap();
        let mut out = vec![0.0; 512 * grid.leaf_origins.len()];
        grid.decode_leaves(&mut out, 512, |_, v, out| out.copy_from_slice(v))
            .unwrap();
        (
            grid.background,
            grid.tiles.clone(),
            grid.leaf_origins.clone(),
            out,
        )
    };
    let whole = values(&folder.join("../corpus/codec_blosc_mask.vdbx.vdb"));
    for name in ["end_pos_zero", "no_offsets_flag"] {
        assert!(
            values(&folder.join(name).with_extension("vdb")) == whole,
            "{name}"
        );
    }
}
