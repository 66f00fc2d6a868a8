//! Fields of the self-test, real volumes, and what the physics tests share.

use std::path::{Path, PathBuf};

use glam::IVec3;

use vpm_vdb::grid::Grid;
use vpm_vdb::grid::load::{Taking, load_grid};
use vpm_vdb::render::Rendered;
use vpm_vdb::scene::{Convert, Scene};
use vpm_vdb::selftest::fields;
use vpm_vdb::vdb::Archive;
use vpm_vdb::world::LoadedVolume;

pub(crate) use vpm_vdb::selftest::fields::{
    blob, direction, medium, medium_at, noise, patchy, ray_through, rng, scene, smoke, trilinear,
    unit, volume,
};

use crate::vdb_files;

/// A field by its values over a box, unit voxels.
pub(crate) fn grid(min: IVec3, max: IVec3, f: impl Fn(IVec3) -> f32 + Sync) -> Grid {
    fields::grid(min, max, f).expect("a small grid can be built")
}

/// Fields with different faults to find, and their names.
pub(crate) fn generated() -> Vec<(&'static str, Grid)> {
    fields::generated().expect("small grids can be built")
}

/// The densities of the test volumes and of the repository's own, with their names.
pub(crate) fn real() -> Vec<(String, Grid)> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes");
    let folders = [vdb_files::folder("real"), own.is_dir().then_some(own)];
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let mut grids = Vec::new();
    for path in folders
        .iter()
        .flatten()
        .flat_map(|f| vdb_files::vdb_files(f))
    {
        let Ok(archive) = Archive::open(&path) else {
            continue;
        };
        for header in archive.grids() {
            let label = header.label();
            let Ok(loaded) = load_grid(&archive, &path, Some(&label), taking) else {
                continue;
            };
            let file = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            grids.push((format!("{} {label}", file.unwrap_or_default()), loaded.grid));
        }
    }
    grids
}

/// One density of the test volumes; none, with a word, where they are absent.
pub(crate) fn real_density(file: &str) -> Option<Grid> {
    let path: PathBuf = vdb_files::folder("real")?.join(file);
    let taking = Taking {
        convert: Convert::None,
        strict: false,
    };
    let archive = Archive::open(&path).expect("a test volume can be opened");
    let loaded = load_grid(&archive, &path, None, taking).expect("its density can be read");
    Some(loaded.grid)
}

/// Grids as a scene's volumes in memory.
pub(crate) fn loaded(grids: &[&Grid]) -> Vec<LoadedVolume> {
    grids
        .iter()
        .map(|g| LoadedVolume {
            density: (*g).clone().into(),
            temperature: None,
        })
        .collect()
}

/// Renders a scene whose volumes are `grids`, in order.
pub(crate) fn render(scene: &Scene, grids: &[&Grid], threads: Option<usize>) -> Rendered {
    fields::render(scene, grids, threads).expect("the scene can be rendered")
}
