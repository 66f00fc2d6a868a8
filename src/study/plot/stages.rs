//! Seconds by stage of each method's base, as bars.

use plotters::prelude::*;

use super::Plot;
use super::chart::{BLUE, FONT, GREEN, GREY, ORANGE, SIZE};
use crate::study::StudyError;
use crate::study::table::{Row, Study};

/// The bars.
pub(super) fn stages(study: &Study) -> Result<Plot, StudyError> {
    let rows: Vec<&Row> = study
        .methods()
        .iter()
        .filter_map(|m| study.base(m).last().copied())
        .collect();
    let mut svg = String::new();
    bars(&mut svg, &rows).map_err(|reason| StudyError::Plot {
        name: "'Seconds by stage'".to_owned(),
        reason,
    })?;
    Ok(Plot {
        name: "stages",
        caption: "Where the time goes, at each method's last point.".to_owned(),
        svg,
    })
}

fn bars(svg: &mut String, rows: &[&Row]) -> Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    /// Label, colour, seconds.
    type Stage = (&'static str, RGBColor, fn(&Row) -> f64);
    let stages: [Stage; 4] = [
        ("build", GREY, |r| r.time_s.build),
        ("photons", BLUE, |r| r.time_s.photons),
        ("map", GREEN, |r| r.time_s.map),
        ("camera rays", ORANGE, |r| r.time_s.gather),
    ];
    let total = |r: &Row| stages.iter().map(|s| (s.2)(r)).sum::<f64>();
    let most = rows.iter().map(|r| total(r)).fold(1e-3, f64::max);
    let count = rows.len() as f64;
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE).map_err(|e| text(&e))?;
    let mut chart = ChartBuilder::on(&root)
        .caption("Seconds by stage", (FONT, 23))
        .margin(8)
        .margin_right(16)
        .x_label_area_size(52)
        .y_label_area_size(20)
        .build_cartesian_2d(0.0..1.05 * most, -0.6..count)
        .map_err(|e| text(&e))?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .disable_y_axis()
        .x_desc("time [s]")
        .label_style((FONT, 18))
        .axis_desc_style((FONT, 19))
        .light_line_style(WHITE.mix(0.0))
        .draw()
        .map_err(|e| text(&e))?;
    for (label, colour, of) in stages {
        let index = stages.iter().position(|s| s.0 == label).unwrap_or(0);
        let boxes = rows.iter().enumerate().map(|(i, row)| {
            let before: f64 = stages[..index].iter().map(|s| (s.2)(row)).sum();
            let y = count - 1.0 - i as f64;
            Rectangle::new([(before, y), (before + of(row), y + 0.45)], colour.filled())
        });
        chart
            .draw_series(boxes)
            .map_err(|e| text(&e))?
            .label(label)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    for (i, row) in rows.iter().enumerate() {
        let what = match row.method.as_str() {
            "path" => format!("path, {} paths a pixel", row.spp),
            method => format!("{method}, {} passes of {} photons", row.passes, row.photons),
        };
        let at = (0.01 * most, count - 1.0 - i as f64 + 0.66);
        let label = Text::new(what, at, (FONT, 18).into_font());
        chart.plotting_area().draw(&label).map_err(|e| text(&e))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .label_font((FONT, 17))
        .background_style(WHITE.mix(0.85))
        .draw()
        .map_err(|e| text(&e))?;
    root.present().map_err(|e| text(&e))?;
    Ok(())
}
