//! The grids of a scene's volumes, from their files.
//!
//! Which grid: the one asked for by name; else `density`; else the file's only float grid.
//! Densities that are negative or not finite scatter no light anyone could sample: they are
//! counted and set to 0, with one warning, or refused if the scene is strict. A level set is a
//! distance, not a density: refused, unless the scene converts it (its interior becomes fog of
//! density 1, falling to 0 over the band inside the surface).

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DAffine3, IVec3};
use thiserror::Error;

use super::build::{BuildError, Tile, Topology};
use super::{BRICK_VALUES, Grid};
use crate::scene::{Convert, Emission, Scene};
use crate::vdb::{Archive, GridClass, ScalarGrid, ValueType, VdbError};
use crate::world::LoadedVolume;

/// Why a volume cannot be loaded.
#[derive(Debug, Error)]
pub enum LoadError {
    /// The file cannot be read.
    #[error(transparent)]
    Vdb(#[from] VdbError),
    /// The grid cannot be built.
    #[error("{file}: grid `{grid}`: {source}")]
    Build {
        /// File.
        file: String,
        /// Grid.
        grid: String,
        /// Fault.
        source: BuildError,
    },
    /// No grid to take.
    #[error("{file}: which grid is the density? There is no `density`; the file has: {has}")]
    Ambiguous {
        /// File.
        file: String,
        /// Names of its grids.
        has: String,
    },
    /// A level set asked for as density.
    #[error(
        "{file}: grid `{grid}` is a level set (distances), not a density; convert = \"level_set\" fills its inside with fog"
    )]
    LevelSet {
        /// File.
        file: String,
        /// Grid.
        grid: String,
    },
    /// Values that a strict scene refuses.
    #[error(
        "{file}: grid `{grid}` has {negative} negative values and {not_finite} that are not finite; without strict = true they are taken as 0"
    )]
    BadValues {
        /// File.
        file: String,
        /// Grid.
        grid: String,
        /// Below 0.
        negative: u64,
        /// NaN or infinite.
        not_finite: u64,
    },
}

/// How the values of a grid are to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Taking {
    /// Level sets.
    pub convert: Convert,
    /// Refuse rather than clean.
    pub strict: bool,
}

/// A grid, and what is to be said about it.
#[derive(Debug)]
pub struct Loaded {
    /// The grid.
    pub grid: Grid,
    /// Its name.
    pub name: String,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Loads the grids of all volumes of a scene; warnings go to `warn`.
///
/// # Errors
/// [`LoadError`] of the first volume that fails.
pub fn load_volumes(scene: &Scene, warn: &dyn Fn(&str)) -> Result<Vec<LoadedVolume>, LoadError> {
    let mut open: Option<(PathBuf, Archive)> = None;
    let mut volumes = Vec::new();
    for volume in &scene.volumes {
        // Volumes of one file follow one another in scenes: the last one stays open.
        let archive = match open.take() {
            Some((path, archive)) if path == volume.file => archive,
            _ => Archive::open(&volume.file)?,
        };
        let taking = Taking {
            convert: volume.convert,
            strict: volume.strict,
        };
        let density = load_grid(&archive, &volume.file, volume.density.as_deref(), taking)?;
        density.warnings.iter().for_each(|w| warn(w));
        let temperature = match &volume.emission {
            Some(Emission::Blackbody { temperature, .. }) => {
                let taking = Taking {
                    convert: Convert::None,
                    strict: volume.strict,
                };
                let loaded = load_grid(&archive, &volume.file, Some(temperature), taking)?;
                loaded.warnings.iter().for_each(|w| warn(w));
                Some(Arc::new(loaded.grid))
            }
            None => None,
        };
        volumes.push(LoadedVolume {
            density: Arc::new(density.grid),
            temperature,
        });
        open = Some((volume.file.clone(), archive));
    }
    Ok(volumes)
}

/// Loads one grid of numbers: the named one, or the default choice.
///
/// # Errors
/// [`LoadError`].
pub fn load_grid(
    archive: &Archive,
    path: &Path,
    name: Option<&str>,
    taking: Taking,
) -> Result<Loaded, LoadError> {
    let file = path.display().to_string();
    let mut warnings = Vec::new();
    let index = match name {
        Some(name) => {
            let found = archive.find(name)?;
            if found.same_name > 1 && !name.contains('[') {
                warnings.push(format!(
                    "{file}: {} grids are called `{name}`; the first is taken, `{name}[1]` is the second",
                    found.same_name
                ));
            }
            found.index
        }
        None => default_grid(archive, &file)?,
    };
    let label = archive.grids()[index].label();
    let scalar = archive.read_scalar(index)?;
    let fill = scalar.class == GridClass::LevelSet;
    if fill && taking.convert == Convert::None {
        return Err(LoadError::LevelSet { file, grid: label });
    }
    let band = scalar.background.abs();
    let (negative, not_finite) = (AtomicU64::new(0), AtomicU64::new(0));
    let clean = |v: f32| {
        if !v.is_finite() {
            not_finite.fetch_add(1, Ordering::Relaxed);
            0.0
        } else if fill {
            (-v / band).clamp(0.0, 1.0)
        } else if v < 0.0 {
            negative.fetch_add(1, Ordering::Relaxed);
            0.0
        } else {
            v
        }
    };
    let grid = build(&scalar, &clean).map_err(|e| match e {
        Fail::Vdb(e) => LoadError::Vdb(e),
        Fail::Build(source) => LoadError::Build {
            file: file.clone(),
            grid: label.clone(),
            source,
        },
    })?;
    let (negative, not_finite) = (negative.into_inner(), not_finite.into_inner());
    if negative + not_finite > 0 {
        if taking.strict {
            return Err(LoadError::BadValues {
                file,
                grid: label,
                negative,
                not_finite,
            });
        }
        warnings.push(format!(
            "{file}: grid `{label}`: {negative} negative values and {not_finite} that are not finite are taken as 0"
        ));
    }
    if scalar.background != 0.0 && !fill {
        warnings.push(format!(
            "{file}: grid `{label}` has a background of {}; it ends at the box of the active voxels",
            scalar.background
        ));
    }
    Ok(Loaded {
        grid,
        name: label,
        warnings,
    })
}

/// True of types that hold fractions.
fn is_float(value_type: ValueType) -> bool {
    matches!(
        value_type,
        ValueType::Half | ValueType::Float | ValueType::Double
    )
}

/// `density`, or the only float grid.
fn default_grid(archive: &Archive, file: &str) -> Result<usize, LoadError> {
    if let Ok(found) = archive.find("density") {
        return Ok(found.index);
    }
    let numbers: Vec<usize> = (0..archive.grids().len())
        .filter(|i| is_float(archive.grids()[*i].value_type))
        .collect();
    match numbers[..] {
        [only] => Ok(only),
        _ => Err(LoadError::Ambiguous {
            file: file.to_owned(),
            has: archive
                .grids()
                .iter()
                .map(|g| format!("{} ({})", g.label(), g.type_name))
                .collect::<Vec<_>>()
                .join(", "),
        }),
    }
}

/// Either fault of building a grid from a file.
enum Fail {
    Vdb(VdbError),
    Build(BuildError),
}

impl From<BuildError> for Fail {
    fn from(e: BuildError) -> Self {
        Self::Build(e)
    }
}

/// Bricks of a decoded tree.
fn build(scalar: &ScalarGrid<'_>, clean: &(impl Fn(f32) -> f32 + Sync)) -> Result<Grid, Fail> {
    let background = clean(scalar.background);
    let topology = Topology {
        background,
        tiles: scalar
            .tiles
            .iter()
            .map(|t| Tile {
                origin: t.origin,
                log2_size: t.log2_size.into(),
                value: clean(t.value),
            })
            .collect(),
        leaves: scalar.leaf_origins.clone(),
        active: active_box(scalar),
        index_to_world: DAffine3::from_mat4(scalar.index_to_world),
    };
    Grid::build(&topology, |bricks| {
        scalar
            .decode_leaves(bricks, BRICK_VALUES, |_, values, brick| {
                for x in 0..8 {
                    for y in 0..8 {
                        let from = &values[x * 64 + y * 8..][..8];
                        let to = &mut brick[x * 81 + y * 9..][..8];
                        for (to, from) in to.iter_mut().zip(from) {
                            *to = clean(*from);
                        }
                    }
                }
            })
            .map_err(Fail::Vdb)
    })
}

/// Lowest and highest active voxel.
fn active_box(scalar: &ScalarGrid<'_>) -> Option<[IVec3; 2]> {
    let mut lo = IVec3::MAX;
    let mut hi = IVec3::MIN;
    for tile in scalar.tiles.iter().filter(|t| t.active) {
        lo = lo.min(tile.origin);
        hi = hi.max(
            tile.origin
                .saturating_add(IVec3::splat((1 << tile.log2_size) - 1)),
        );
    }
    for (origin, mask) in scalar.leaf_origins.iter().zip(&scalar.leaf_masks) {
        let within = |lo: IVec3, hi: IVec3| {
            origin.cmpge(lo).all() && (*origin + IVec3::splat(7)).cmple(hi).all()
        };
        if within(lo, hi) {
            continue;
        }
        for (x, word) in mask.iter().enumerate() {
            let mut bits = *word;
            while bits != 0 {
                let bit = bits.trailing_zeros() as i32;
                bits &= bits - 1;
                let voxel = *origin + IVec3::new(x as i32, bit >> 3, bit & 7);
                lo = lo.min(voxel);
                hi = hi.max(voxel);
            }
        }
    }
    lo.cmple(hi).all().then_some([lo, hi])
}
