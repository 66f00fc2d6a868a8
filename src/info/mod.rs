//! `vpm-vdb info`: what a .vdb file holds, for people and for scripts.
//!
//! For people a table with one line per grid, and the details of up to four. For scripts
//! (`json`) an array with one object per grid, or, with coordinates, the values there. A grid that
//! is not read says why; a damaged one does too, and the call then fails after the others are out.

mod memory;
mod numbers;
mod row;
mod text;

use std::io::Write;
use std::path::Path;

use glam::IVec3;
use serde_json::{Value as Json, json};

use self::row::{Row, value_json};
use crate::vdb::{Archive, Fault, GridHeader, Refusal, VdbError};

/// What to print.
#[derive(Debug, Clone, Default)]
pub struct InfoOptions {
    /// JSON instead of text.
    pub json: bool,
    /// Only this grid, by the name that [`Archive::find`] takes.
    pub grid: Option<String>,
    /// Print the values at these index coordinates instead.
    pub at: Vec<[i32; 3]>,
}

/// Why there is no, or not all, information.
#[derive(Debug, thiserror::Error)]
pub enum InfoError {
    /// The file, or a grid of it.
    #[error(transparent)]
    Vdb(#[from] VdbError),
    /// Writing failed.
    #[error("cannot write the information: {0}")]
    Write(#[from] std::io::Error),
    /// Coordinates without a grid, and no grid suggests itself.
    #[error("{file} has several grids; choose one with --grid: {has}")]
    WhichGrid {
        /// The file.
        file: String,
        /// Its grids.
        has: String,
    },
}

/// Prints what `path` holds to `out` and returns remarks for the user.
pub fn run(
    path: &Path,
    options: &InfoOptions,
    out: &mut dyn Write,
) -> Result<Vec<String>, InfoError> {
    let archive = Archive::open(path)?;
    let mut remarks = Vec::new();
    let chosen = match &options.grid {
        Some(name) => Some(find(&archive, name, &mut remarks)?),
        None => None,
    };
    if !options.at.is_empty() {
        let index = match chosen {
            Some(index) => index,
            None => usual_grid(&archive, &mut remarks)?,
        };
        values(&archive, index, options, out)?;
        return Ok(remarks);
    }
    if archive.unreached() > 0 {
        remarks.push(format!(
            "{} more grids follow one of unknown length in this streamed file and cannot be reached",
            archive.unreached()
        ));
    }

    let indices: Vec<usize> =
        chosen.map_or_else(|| (0..archive.grids().len()).collect(), |i| vec![i]);
    let mut fault = None;
    let rows: Vec<Row<'_>> = indices
        .into_iter()
        .map(|index| {
            let header = &archive.grids()[index];
            let row = Row::new(&archive, index);
            if let Some(Refusal::Damaged(reason)) = &row.refused
                && fault.is_none()
            {
                fault = Some(VdbError {
                    file: archive.file().to_owned(),
                    grid: Some(header.label()),
                    fault: Fault::Unsupported(reason.clone()),
                });
            }
            row
        })
        .collect();
    if options.json {
        let grids: Vec<Json> = rows.iter().map(Row::json).collect();
        serde_json::to_writer_pretty(&mut *out, &grids).map_err(std::io::Error::from)?;
        writeln!(out)?;
    } else {
        text::text(&archive, &rows, out)?;
    }
    match fault {
        Some(fault) => Err(fault.into()),
        None => Ok(remarks),
    }
}

fn find(archive: &Archive, name: &str, remarks: &mut Vec<String>) -> Result<usize, VdbError> {
    let found = archive.find(name)?;
    if found.same_name > 1 && archive.grids()[found.index].name == name {
        remarks.push(format!(
            "{} grids are named `{name}`; this is the first, `{name}[1]` is the second",
            found.same_name
        ));
    }
    Ok(found.index)
}

/// `density`, else the only grid of numbers.
fn usual_grid(archive: &Archive, remarks: &mut Vec<String>) -> Result<usize, InfoError> {
    if archive.grids().iter().any(|g| g.name == "density") {
        return Ok(find(archive, "density", remarks)?);
    }
    let mut readable =
        (0..archive.grids().len()).filter(|&i| archive.grids()[i].value_type.is_scalar());
    match (readable.next(), readable.next()) {
        (Some(index), None) => Ok(index),
        _ => Err(InfoError::WhichGrid {
            file: archive.file().to_owned(),
            has: archive
                .grids()
                .iter()
                .map(GridHeader::label)
                .collect::<Vec<_>>()
                .join(", "),
        }),
    }
}

/// The values at the coordinates asked for.
fn values(
    archive: &Archive,
    index: usize,
    options: &InfoOptions,
    out: &mut dyn Write,
) -> Result<(), InfoError> {
    let at: Vec<IVec3> = options.at.iter().map(|&c| c.into()).collect();
    let probes = archive.probe(index, &at)?;
    if options.json {
        let list: Vec<Json> = at
            .iter()
            .zip(&probes)
            .map(|(ijk, probe)| json!({"ijk": ijk.to_array(), "value": value_json(probe.value)}))
            .collect();
        serde_json::to_writer(&mut *out, &list).map_err(std::io::Error::from)?;
        writeln!(out)?;
        return Ok(());
    }
    for (ijk, probe) in at.iter().zip(&probes) {
        let active = if probe.active { "" } else { "  (inactive)" };
        writeln!(
            out,
            "{},{},{}  {}{active}",
            ijk.x,
            ijk.y,
            ijk.z,
            value_json(probe.value)
        )?;
    }
    Ok(())
}
