//! Any bytes as a .vdb: everything the reader offers must return, with a value or an error.

#![no_main]

use glam::IVec3;
use libfuzzer_sys::fuzz_target;
use vpm_vdb::vdb::{Archive, Cleaner};

fuzz_target!(|bytes: &[u8]| {
    let Ok(archive) = Archive::from_bytes("fuzz.vdb", bytes.to_vec()) else { return };
    let _ = archive.find("density[1]");
    // A damaged file may list one tree under a thousand names; a few are enough.
    for index in 0..archive.grids().len().min(8) {
        let _ = archive.probe(index, &[IVec3::ZERO, IVec3::MAX, IVec3::MIN, IVec3::splat(-1)]);
        let _ = archive.statistics(index);
        let cleaner = Cleaner::new();
        if let Ok(grid) = archive.read_scalar(index) {
            let mut out = vec![0.0; grid.leaf_origins.len()];
            let _ = grid.decode_leaves(&mut out, 1, |_, v, out| out[0] = cleaner.value(v[511]));
        }
        if let Ok(grid) = archive.read_vec3(index) {
            let mut out = vec![0.0; 3 * grid.leaf_origins.len()];
            let _ = grid.decode_leaves(&mut out, 3, |_, v, out| out.copy_from_slice(&v[0]));
        }
    }
});
