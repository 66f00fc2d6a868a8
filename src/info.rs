//! `vpm-vdb info`: what a .vdb file holds, for people and for scripts.
//!
//! For people a table with one line per grid, and the details of up to four. For scripts
//! (`json`) an array with one object per grid, or, with coordinates, the values there. A grid that
//! is not read says why; a damaged one does too, and the call then fails after the others are out.

use std::io::Write;
use std::path::Path;

use glam::{DMat4, DVec3, IVec3};
use serde_json::{Map, Value as Json, json};

use crate::vdb::{Archive, Fault, GridHeader, Refusal, Statistics, Value, ValueType, VdbError};

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

/// Bytes of a brick of 9 x 9 x 9 values.
const BRICK_BYTES: usize = 9 * 9 * 9 * 4;
/// Grids whose details are printed without being asked for.
const DETAILED: usize = 4;

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
            let stats = archive.statistics(index);
            let refused = match (&stats, &header.refused) {
                (Ok(_), refused) => refused.clone(),
                (Err(_), Some(refused)) => Some(refused.clone()),
                (Err(e), None) => Some(Refusal::Damaged(e.fault.to_string())),
            };
            if let Some(Refusal::Damaged(reason)) = &refused
                && fault.is_none()
            {
                fault = Some(VdbError {
                    file: archive.file().to_owned(),
                    grid: Some(header.label()),
                    fault: Fault::Unsupported(reason.clone()),
                });
            }
            Row {
                header,
                stats: stats.ok(),
                refused,
            }
        })
        .collect();
    if options.json {
        let grids: Vec<Json> = rows.iter().map(Row::json).collect();
        serde_json::to_writer_pretty(&mut *out, &grids).map_err(std::io::Error::from)?;
        writeln!(out)?;
    } else {
        text(&archive, &rows, out)?;
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

/// A float's exact value; every f32 is an f64.
fn value_json(value: Value) -> Json {
    match value {
        Value::Float(v) => json!(f64::from(v)),
        Value::Double(v) => json!(v),
        Value::Int(v) => json!(v),
        Value::Bool(v) => json!(v),
        Value::Vec3s(v) => json!(v.map(f64::from)),
        Value::Vec3d(v) => json!(v),
        Value::Vec3i(v) => json!(v),
    }
}

/// One grid.
struct Row<'a> {
    header: &'a GridHeader,
    stats: Option<Statistics>,
    refused: Option<Refusal>,
}

impl Row<'_> {
    /// Leaves, and tiles of their size, each become a brick; larger tiles stay one value.
    fn bricks(&self) -> usize {
        self.stats.as_ref().map_or(0, |s| s.leaves + s.small_tiles)
    }

    fn memory(&self) -> usize {
        self.bricks() * BRICK_BYTES * self.stats.as_ref().map_or(1, |s| s.components.len())
    }

    fn json(&self) -> Json {
        let h = self.header;
        let mut o = Map::new();
        let mut put = |key: &str, value: Json| o.insert(key.to_owned(), value);
        put("name", json!(h.name));
        put("label", json!(h.label()));
        put("type", json!(type_name(h)));
        put("stored_as_half", json!(h.half));
        put("grid_class", json!(h.class.name()));
        put("map", json!(h.map));
        put(
            "voxel_size",
            json!(h.index_to_world.map(|m| voxel_size(m).to_array())),
        );
        put("transform", json!(h.index_to_world.map(rows)));
        put("compression", json!(h.compression.to_string()));
        put("instance_of", json!(h.instance_of));
        put("refused", json!(self.refused.as_ref().map(Refusal::reason)));
        let Some(s) = &self.stats else {
            for key in [
                "active_voxels",
                "bbox_min",
                "bbox_max",
                "min",
                "max",
                "mean",
                "std",
            ] {
                put(key, Json::Null);
            }
            return Json::Object(o);
        };
        let filled = s.active_voxels > s.not_finite;
        let list = |f: fn(&crate::vdb::Moments) -> f64| {
            let v: Vec<f64> = s.components.iter().map(f).collect();
            match (filled, v.as_slice()) {
                (false, _) => Json::Null,
                (true, &[v]) => json!(v),
                (true, v) => json!(v),
            }
        };
        put("active_voxels", json!(s.active_voxels));
        put("bbox_min", json!(s.bbox.map(|b| b[0].to_array())));
        put("bbox_max", json!(s.bbox.map(|b| b[1].to_array())));
        put("min", list(|m| m.min));
        put("max", list(|m| m.max));
        put("mean", list(|m| m.mean));
        put("std", list(|m| m.std));
        let percentiles: Map<String, Json> = PERCENTILES
            .iter()
            .filter_map(|&p| Some((p.to_string(), json!(s.histogram.percentile(p / 100.0)?))))
            .collect();
        put("percentiles", Json::Object(percentiles));
        put("not_finite", json!(s.not_finite));
        put("negative", json!(s.negative));
        put("background", value_json(s.background));
        put("leaves", json!(s.leaves));
        put("tiles", json!(s.tiles));
        put("bricks", json!(self.bricks()));
        put("memory_bytes", json!(self.memory()));
        Json::Object(o)
    }

    /// Cells of the table.
    fn cells(&self) -> Vec<String> {
        let h = self.header;
        let mut kind = type_name(h).to_owned();
        if h.half {
            kind.push_str(" as half");
        }
        let mut cells = vec![shown_name(h), kind, h.class.name().to_owned()];
        match &self.stats {
            None => cells.extend(vec![String::new(); 5]),
            Some(s) => {
                cells.push(thousands(s.active_voxels));
                cells.push(h.index_to_world.map_or_else(
                    || "frustum".to_owned(),
                    |m| {
                        let v = voxel_size(m);
                        if v.max_element() - v.min_element() <= 1e-6 * v.max_element() {
                            short(v.x)
                        } else {
                            format!("{} x {} x {}", short(v.x), short(v.y), short(v.z))
                        }
                    },
                ));
                cells.push(range(s));
                cells.push(bars(s, 12));
                cells.push(bytes(self.memory()));
            }
        }
        cells
    }

    fn details(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let h = self.header;
        writeln!(out, "\n{}", shown_name(h))?;
        if let Some(refusal) = &self.refused {
            writeln!(out, "  not read     {}", refusal.reason())?;
        }
        let Some(s) = &self.stats else { return Ok(()) };
        let share = match &h.instance_of {
            Some(parent) => format!(", shares the tree of `{}`", parent.replace('\u{1e}', "#")),
            None => String::new(),
        };
        writeln!(
            out,
            "  stored       {} leaves, {} tiles, {}{share}",
            thousands(s.leaves as u64),
            thousands(s.tiles as u64),
            h.compression
        )?;
        if let Some([low, high]) = s.bbox {
            let size = (high.as_i64vec3() - low.as_i64vec3() + 1).as_dvec3();
            writeln!(
                out,
                "  index box    {low} to {high}, {} x {} x {} voxels",
                size.x, size.y, size.z
            )?;
            if let Some(m) = h.index_to_world {
                let (a, b) = world_box(m, low, high);
                writeln!(out, "  world box    {} to {}", point(a), point(b))?;
            }
        }
        writeln!(out, "  background   {}", value_json(s.background))?;
        if s.active_voxels > s.not_finite {
            for (axis, c) in s.components.iter().enumerate() {
                let name = if s.components.len() == 1 {
                    "values"
                } else {
                    ["x", "y", "z"][axis]
                };
                writeln!(
                    out,
                    "  {name:<12} {} to {}, mean {}, standard deviation {}",
                    short(c.min),
                    short(c.max),
                    short(c.mean),
                    short(c.std)
                )?;
            }
            let list: Vec<String> = PERCENTILES
                .iter()
                .filter_map(|&p| {
                    Some(format!(
                        "{p}% {}",
                        short(s.histogram.percentile(p / 100.0)?)
                    ))
                })
                .collect();
            let of = if s.components.len() == 1 {
                ""
            } else {
                " (of the length)"
            };
            writeln!(out, "  percentiles  {}{of}", list.join("   "))?;
        }
        if s.not_finite > 0 || (s.negative > 0 && h.class == crate::vdb::GridClass::FogVolume) {
            writeln!(
                out,
                "  beware       {} values not finite, {} negative; as a density they count as 0",
                thousands(s.not_finite),
                thousands(s.negative)
            )?;
        }
        writeln!(
            out,
            "  rendering    {} bricks, {}",
            thousands(self.bricks() as u64),
            bytes(self.memory())
        )
    }
}

const PERCENTILES: [f64; 7] = [1.0, 10.0, 25.0, 50.0, 75.0, 90.0, 99.0];
const HEADINGS: [&str; 8] = [
    "grid",
    "type",
    "class",
    "active voxels",
    "voxel size",
    "values",
    "histogram",
    "to render",
];

fn text(archive: &Archive, rows: &[Row<'_>], out: &mut dyn Write) -> std::io::Result<()> {
    let version = archive.version();
    writeln!(
        out,
        "{}  {}, file version {}, written by OpenVDB {}.{}{}",
        archive.file(),
        bytes(archive.file_size()),
        version.format,
        version.library[0],
        version.library[1],
        if version.streamed { ", streamed" } else { "" }
    )?;
    if rows.is_empty() {
        return writeln!(out, "\nno grids");
    }
    let table: Vec<Vec<String>> = std::iter::once(HEADINGS.map(str::to_owned).to_vec())
        .chain(rows.iter().map(Row::cells))
        .collect();
    let widths: Vec<usize> = (0..HEADINGS.len())
        .map(|c| {
            table
                .iter()
                .map(|row| row[c].chars().count())
                .max()
                .unwrap_or(0)
        })
        .collect();
    writeln!(out)?;
    for (i, row) in table.iter().enumerate() {
        let mut line = String::new();
        for (c, cell) in row.iter().enumerate() {
            let fill = " ".repeat(widths[c] - cell.chars().count());
            // Counts and sizes stand under one another by their last digit.
            let right = matches!(HEADINGS[c], "active voxels" | "to render");
            line += &if right {
                format!("{fill}{cell}  ")
            } else {
                format!("{cell}{fill}  ")
            };
        }
        writeln!(out, "{}", line.trim_end())?;
        if let Some(refusal) = i.checked_sub(1).and_then(|i| rows[i].refused.as_ref())
            && rows.len() > DETAILED
        {
            writeln!(out, "  not read: {}", refusal.reason())?;
        }
    }
    if rows.len() <= DETAILED {
        for row in rows {
            row.details(out)?;
        }
    } else {
        writeln!(out, "\n--grid NAME prints the details of one grid")?;
    }
    Ok(())
}

fn type_name(h: &GridHeader) -> &str {
    if h.value_type == ValueType::Other {
        &h.type_name
    } else {
        h.value_type.name()
    }
}

fn shown_name(h: &GridHeader) -> String {
    if h.name.is_empty() {
        format!("(unnamed){}", h.label())
    } else {
        h.label()
    }
}

fn voxel_size(m: DMat4) -> DVec3 {
    DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
}

/// Row by row, for column vectors: the translation is the last column.
fn rows(m: DMat4) -> [[f64; 4]; 4] {
    m.transpose().to_cols_array_2d()
}

/// Axis-aligned box around the voxels' cubes, which reach half a voxel beyond their centres.
fn world_box(m: DMat4, low: IVec3, high: IVec3) -> (DVec3, DVec3) {
    let corners = [low.as_dvec3() - 0.5, high.as_dvec3() + 0.5];
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for i in 0..8 {
        let pick = |bit: usize| corners[i >> bit & 1];
        let p = m.transform_point3(DVec3::new(pick(0).x, pick(1).y, pick(2).z));
        bounds = (bounds.0.min(p), bounds.1.max(p));
    }
    bounds
}

fn point(p: DVec3) -> String {
    format!("[{}, {}, {}]", short(p.x), short(p.y), short(p.z))
}

fn range(s: &Statistics) -> String {
    if s.active_voxels == s.not_finite {
        return "none".to_owned();
    }
    let low = s.components.iter().fold(f64::INFINITY, |m, c| m.min(c.min));
    let high = s
        .components
        .iter()
        .fold(f64::NEG_INFINITY, |m, c| m.max(c.max));
    if low == high {
        short(low)
    } else {
        format!("{} to {}", short(low), short(high))
    }
}

/// A bar for each step between the extremes; its height goes with the fourth root of the count,
/// so that rare values are seen beside common ones.
fn bars(s: &Statistics, n: usize) -> String {
    const BARS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let (Some(low), Some(high)) = (s.histogram.percentile(0.0), s.histogram.percentile(1.0)) else {
        return String::new();
    };
    if low >= high {
        return String::new();
    }
    let counts = s.histogram.bars(low, high, n);
    let most = counts.iter().max().copied().unwrap_or(1) as f64;
    counts
        .iter()
        .map(|&c| BARS[((c as f64 / most).powf(0.25) * 8.0).ceil() as usize])
        .collect()
}

/// Four significant digits.
fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let size = v.abs();
    if !(1e-4..1e6).contains(&size) {
        return format!("{v:.3e}");
    }
    let decimals = (3 - size.log10().floor() as i32).max(0) as usize;
    let text = format!("{v:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(d);
    }
    text
}

fn bytes(n: usize) -> String {
    const UNITS: [&str; 4] = ["kB", "MB", "GB", "TB"];
    let mut size = n as f64;
    if n < 1000 {
        return format!("{n} B");
    }
    let mut unit = 0;
    size /= 1000.0;
    while size >= 999.95 && unit + 1 < UNITS.len() {
        size /= 1000.0;
        unit += 1;
    }
    format!("{size:.1} {}", UNITS[unit])
}

#[cfg(test)]
mod tests {
    use super::{bytes, short, thousands};

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(0.453_616), "0.4536");
        assert_eq!(short(-12.0), "-12");
        assert_eq!(short(5.714_84), "5.715");
        assert_eq!(short(1e-7), "1.000e-7");
        assert_eq!(short(123_456.0), "123456");
        assert_eq!(thousands(1_049_275), "1,049,275");
        assert_eq!(bytes(999_960), "1.0 MB");
    }
}
