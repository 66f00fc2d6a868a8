//! The table with one line per grid, and the details below it.

use std::io::Write;

use glam::{DMat4, DVec3, IVec3};

use super::numbers::{bars, bytes, range, short, thousands};
use super::row::{PERCENTILES, Row, shown_name, type_name, value_json, voxel_size};
use crate::vdb::Archive;

/// Grids whose details are printed without being asked for.
const DETAILED: usize = 4;

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

/// Prints the file's line, the table and the details.
pub(super) fn text(
    archive: &Archive,
    rows: &[Row<'_>],
    out: &mut dyn Write,
) -> std::io::Result<()> {
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

impl Row<'_> {
    /// Cells of the table.
    fn cells(&self) -> Vec<String> {
        let h = self.header;
        let mut kind = type_name(h).to_owned();
        if h.half && h.value_type.is_real() {
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
                cells.push(
                    self.memory
                        .as_ref()
                        .map_or_else(String::new, |m| bytes(m.grid)),
                );
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
                .filter_map(|&p| Some(format!("{p}% {}", short(s.percentile(p / 100.0)?))))
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
        let Some(m) = &self.memory else { return Ok(()) };
        let times = |name: &str, ratio: Option<f64>| {
            ratio.map_or_else(String::new, |r| format!(", {r:.2} x {name} as f32"))
        };
        writeln!(
            out,
            "  rendering    {} bricks of {}-bit values, {}{}{}; bounds at most {}",
            thousands(m.bricks as u64),
            m.value_bits,
            bytes(m.grid),
            times("leaves", m.per_leaf_value),
            times("active values", m.per_active_value),
            bytes(m.bounds)
        )
    }
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
