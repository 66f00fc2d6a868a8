//! The volumes that lookups, tracking and marching are measured on.

use std::path::{Path, PathBuf};
use std::time::Instant;

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::scene::Convert;
use vpm_vdb::vdb::Archive;

/// The files of the command line; without any, the repository's and those of ../shared.
pub(crate) fn files() -> Vec<PathBuf> {
    // cargo adds --bench.
    let given: Vec<PathBuf> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .map(PathBuf::from)
        .collect();
    if !given.is_empty() {
        return given;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    [
        "volumes/rising_smoke.vdb",
        "volumes/cumulus.vdb",
        "../shared/vdb/real/openvdb_smoke1_v222.vdb",
        "../shared/vdb/real/usd_smoke_000003.vdb",
        "../shared/vdb/real/wdas_cloud_sixteenth.vdb",
        "../shared/vdb/real/teapot_cloud.vdb",
        "../shared/vdb/real/houdini_singlecloud.vdb",
    ]
    .map(|file| root.join(file))
    .into_iter()
    .filter(|file| file.exists())
    .collect()
}

/// A file's stem and density.
pub(crate) fn load(file: &Path) -> (String, Grid) {
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let archive = Archive::open(file).expect("the file opens");
    let grid = load_grid(&archive, file, None, taking)
        .expect("the file holds a density")
        .grid;
    let name = file.file_stem().unwrap_or_default();
    (name.to_string_lossy().into_owned(), grid)
}

/// Seconds of a run, and what it gives.
pub(crate) fn timed<T>(run: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let result = std::hint::black_box(run());
    (start.elapsed().as_secs_f64(), result)
}
