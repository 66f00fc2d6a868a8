//! Plots of a study, as SVG whose text is text.
//!
//! Both axes are logarithmic. Whiskers are 95 % intervals; a value that is not above 0 within its
//! noise (a bias too small to see) is drawn as a hollow triangle at the upper end of its interval.

use std::ops::Range;

use plotters::coord::combinators::IntoLogRange;
use plotters::prelude::*;

use super::StudyError;
use super::figures::Interval;
use super::plan::Knob;
use super::table::{Row, Study};

/// Width and height: small, so that text stays readable on a phone.
const SIZE: (u32, u32) = (520, 400);
const FONT: &str = "sans-serif";

/// Colour-blind safe (Okabe & Ito 2008).
const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const GREY: RGBColor = RGBColor(150, 150, 150);
const BLACK: RGBColor = RGBColor(30, 30, 30);

/// A plot and its file name.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    pub(super) name: &'static str,
    /// What it shows, for the page.
    pub(super) caption: String,
    pub(super) svg: String,
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Style {
    /// Points joined by a line.
    Line,
    /// Points alone.
    Points,
    /// Large rings.
    Rings,
    /// A dashed line without points.
    Guide,
}

struct Line {
    label: String,
    colour: RGBColor,
    style: Style,
    points: Vec<(f64, Interval)>,
}

impl Line {
    fn new(label: impl Into<String>, colour: RGBColor, style: Style) -> Self {
        Self {
            label: label.into(),
            colour,
            style,
            points: Vec::new(),
        }
    }

    fn with<'a>(
        mut self,
        rows: impl IntoIterator<Item = &'a &'a Row>,
        x: impl Fn(&Row) -> Option<f64>,
        y: impl Fn(&Row) -> Option<Interval>,
    ) -> Self {
        self.points = rows
            .into_iter()
            .filter_map(|r| Some((x(r)?, y(r)?)))
            .filter(|(x, _)| *x > 0.0)
            .collect();
        self.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        self
    }
}

fn exact(value: f64) -> Interval {
    Interval {
        value,
        low: None,
        high: None,
    }
}

fn method_colour(method: &str) -> RGBColor {
    match method {
        "beam" => BLUE,
        "path" => ORANGE,
        _ => GREEN,
    }
}

/// All plots of a study.
pub(super) fn plots(study: &Study) -> Result<Vec<Plot>, StudyError> {
    let mut all = vec![error_time(study)?];
    for method in study.methods().into_iter().filter(|m| *m != "path") {
        if method == study.methods()[0] {
            all.extend(radius(study, method)?);
            all.extend(step(study, method)?);
            all.extend(orders(study, method)?);
        }
    }
    all.extend(convergence(study)?);
    all.push(stages(study)?);
    Ok(all)
}

fn relmse(r: &Row) -> Option<Interval> {
    Some(r.figures.relmse)
}

fn error_time(study: &Study) -> Result<Plot, StudyError> {
    let seconds = |r: &Row| Some(r.seconds_own_resolution);
    let all: Vec<&Row> = study.rows.iter().collect();
    let others: Vec<&Row> = all
        .iter()
        .copied()
        .filter(|r| matches!(r.knob, Knob::Photons | Knob::Neighbours | Knob::Rays))
        .collect();
    let front: Vec<&Row> = all.iter().copied().filter(|r| r.pareto).collect();
    let mut lines = vec![
        Line::new("other photons, radii, rays", GREY, Style::Points).with(&others, seconds, relmse),
    ];
    for method in study.methods() {
        lines.push(Line::new(method, method_colour(method), Style::Line).with(
            &study.base(method),
            seconds,
            relmse,
        ));
    }
    lines.push(
        Line::new("Pareto front", BLACK, Style::Rings)
            .with(&front, seconds, |r| Some(exact(r.figures.relmse.value))),
    );
    let [w, h] = study.own_resolution;
    let svg = log_log(
        "Error against time",
        &format!("time at {w} x {h} pixels [s]"),
        "relMSE [1]",
        &lines,
        SeriesLabelPosition::UpperRight,
    )?;
    Ok(Plot {
        name: "error-time",
        caption: "Each method at the scene's settings, more passes (paths) to the right; rings: \
                  no other setting is both faster and better. Measured on the study's smaller pictures; \
                  camera rays scaled by the pixels."
            .to_owned(),
        svg,
    })
}

/// At least two points to draw?
fn enough(lines: &[Line]) -> bool {
    lines.iter().any(|l| l.points.len() >= 2)
}

fn radius(study: &Study, method: &str) -> Result<Option<Plot>, StudyError> {
    let rows = study.turned(Knob::Neighbours, method);
    let x = |r: &Row| r.radius;
    let lines = [
        Line::new("bias²", ORANGE, Style::Line).with(&rows, x, |r| r.figures.bias2),
        Line::new("variance", BLUE, Style::Line).with(&rows, x, |r| r.figures.variance),
        Line::new("relMSE", BLACK, Style::Points).with(&rows, x, relmse),
    ];
    if !enough(&lines) {
        return Ok(None);
    }
    let passes = rows.first().map_or(0, |r| r.passes);
    let svg = log_log(
        "Bias and variance against radius",
        "radius / radius of the scene's first pass [1]",
        "share of relMSE [1]",
        &lines,
        SeriesLabelPosition::LowerRight,
    )?;
    Ok(Some(Plot {
        name: "bias-radius",
        caption: format!(
            "Neighbours changed, all else equal, {passes} passes: a larger kernel blurs more and \
             is less noisy. Hollow triangles: upper bounds of a bias too small to see."
        ),
        svg,
    }))
}

fn step(study: &Study, method: &str) -> Result<Vec<Plot>, StudyError> {
    let rows = study.turned(Knob::March, method);
    let x = |r: &Row| r.march.parse().ok();
    let points = study.turned(Knob::March, "point");
    let error = [
        Line::new("beam: added by the step", ORANGE, Style::Line)
            .with(&rows, x, |r| r.figures.paired),
        Line::new("beam: relMSE", BLACK, Style::Points).with(&rows, x, relmse),
        Line::new("point: relMSE", GREEN, Style::Line).with(&points, x, relmse),
    ];
    if !enough(&error) {
        return Ok(Vec::new());
    }
    let exact_row = rows.iter().find(|r| r.march == "exact");
    let gather = |r: &Row| Some(exact(r.time_s.gather));
    let mut time = vec![
        Line::new("beam, fixed steps", BLUE, Style::Line).with(&rows, x, gather),
        Line::new("point, fixed steps", GREEN, Style::Line).with(&points, x, gather),
    ];
    if let Some(row) = exact_row {
        let mut line = Line::new("beam, exact", BLACK, Style::Guide);
        let ends = time[0].points.first().zip(time[0].points.last());
        line.points = ends
            .map(|(a, b)| {
                vec![
                    (a.0, exact(row.time_s.gather)),
                    (b.0, exact(row.time_s.gather)),
                ]
            })
            .unwrap_or_default();
        time.push(line);
    }
    Ok(vec![
        Plot {
            name: "error-step",
            caption: "Optical depth in fixed steps: squared difference from the exact march at \
                      equal photons, and the whole error. Steps of the point estimate are \
                      shifted at random: they cost noise."
                .to_owned(),
            svg: log_log(
                "Error against step size",
                "step [voxels]",
                "share of relMSE [1]",
                &error,
                SeriesLabelPosition::LowerRight,
            )?,
        },
        Plot {
            name: "time-step",
            caption: "Seconds of the camera rays with fixed steps; dashed, with the exact march."
                .to_owned(),
            svg: log_log(
                "Time against step size",
                "step [voxels]",
                "time of camera rays [s]",
                &time,
                SeriesLabelPosition::UpperRight,
            )?,
        },
    ])
}

fn orders(study: &Study, method: &str) -> Result<Option<Plot>, StudyError> {
    let rows = study.turned(Knob::Orders, method);
    let x = |r: &Row| Some(f64::from(r.max_bounces));
    let lines = [
        Line::new("relMSE", BLACK, Style::Line).with(&rows, x, relmse),
        Line::new("bias²", ORANGE, Style::Line).with(&rows, x, |r| r.figures.bias2),
    ];
    if !enough(&lines) {
        return Ok(None);
    }
    let svg = log_log(
        "Error against scattering orders",
        "highest scattering order",
        "relMSE [1]",
        &lines,
        SeriesLabelPosition::UpperRight,
    )?;
    Ok(Some(Plot {
        name: "error-orders",
        caption: "What is missing when scattering stops early.".to_owned(),
        svg,
    }))
}

/// Error of the photon methods against photons, with the slope of the theory.
fn convergence(study: &Study) -> Result<Option<Plot>, StudyError> {
    let mut lines = Vec::new();
    let mut words = Vec::new();
    for rate in study.convergence.iter().filter(|c| c.method != "path") {
        let rows: Vec<&Row> = study
            .rows
            .iter()
            .filter(|r| r.setting == rate.setting)
            .collect();
        let photons = |r: &Row| Some(r.photons as f64 * f64::from(r.passes));
        let colour = match rate.setting.as_str() {
            "rate" => BLACK,
            _ => method_colour(&rate.method),
        };
        let line =
            Line::new(rate.setting.as_str(), colour, Style::Line).with(&rows, photons, relmse);
        let mut guide = Line::new(format!("slope {:.2}", rate.theory), colour, Style::Guide);
        if let (Some((x, y)), Some((end, _))) = (line.points.first(), line.points.last()) {
            let at = |to: f64| (to, exact(y.value * (to / x).powf(rate.theory)));
            guide.points = vec![at(*x), at(*end)];
        }
        words.push(format!(
            "{}: {}",
            rate.setting,
            interval_words(&rate.slope, 2)
        ));
        lines.extend([line, guide]);
    }
    if !enough(&lines) {
        return Ok(None);
    }
    let svg = log_log(
        "Convergence of the progressive estimate",
        "photons emitted",
        "relMSE [1]",
        &lines,
        SeriesLabelPosition::LowerLeft,
    )?;
    Ok(Some(Plot {
        name: "convergence",
        caption: format!(
            "Measured slopes: {}. Dashed: the theory of photons. Where camera rays make most of the noise, as in the base, it falls faster.",
            words.join("; ")
        ),
        svg,
    }))
}

/// A value with its interval.
pub(super) fn interval_words(i: &Interval, digits: usize) -> String {
    match (i.low, i.high) {
        (Some(low), Some(high)) => {
            format!("{:.digits$} ({low:.digits$} to {high:.digits$})", i.value)
        }
        _ => format!("{:.digits$}", i.value),
    }
}

/// Powers of ten, and what is between them.
fn tick(v: &f64) -> String {
    if (0.01..=10_000.0).contains(v) {
        format!("{v}")
    } else {
        format!("{v:.0e}")
    }
}

/// Labelled values: powers of ten over more than two and a half decades, else 1, 2, 5.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let digits: &[i32] = if range.end / range.start > 300.0 {
        &[1]
    } else {
        &[1, 2, 5]
    };
    let [first, last] = [range.start, range.end].map(|v| v.log10().floor() as i32);
    (first..=last)
        .flat_map(|power| {
            // Parsed, so that 0.02 is the nearest number to 0.02.
            digits
                .iter()
                .filter_map(move |d| format!("{d}e{power}").parse().ok())
        })
        .filter(|v| range.contains(v))
        .collect()
}

/// Room around the values, at least a decade.
fn range(values: impl Iterator<Item = f64>, padding: f64) -> Option<Range<f64>> {
    let (low, high) = values
        .filter(|v| v.is_finite() && *v > 0.0)
        .fold((f64::MAX, 0.0f64), |(a, b), v| (a.min(v), b.max(v)));
    (low <= high).then(|| {
        let wide = (10.0 / (high / low)).max(1.0).sqrt();
        low / wide / padding..high * wide * padding
    })
}

fn log_log(
    title: &str,
    x: &str,
    y: &str,
    lines: &[Line],
    legend: SeriesLabelPosition,
) -> Result<String, StudyError> {
    let mut svg = String::new();
    draw(&mut svg, [title, x, y], lines, legend).map_err(|reason| StudyError::Plot {
        name: format!("'{title}'"),
        reason,
    })?;
    Ok(svg)
}

fn draw(
    svg: &mut String,
    [title, x, y]: [&str; 3],
    lines: &[Line],
    legend: SeriesLabelPosition,
) -> Result<(), String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let points = || lines.iter().flat_map(|l| &l.points);
    let values = points().flat_map(|(_, v)| {
        let drawn = if v.value > 0.0 { Some(v.value) } else { v.high };
        [drawn, v.high]
    });
    let xs = range(points().map(|(x, _)| *x), 1.25).ok_or("there is nothing to draw")?;
    let ys = range(values.flatten(), 1.6).ok_or("there is nothing to draw")?;
    let floor = ys.start;
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE).map_err(|e| text(&e))?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, (FONT, 23))
        .margin(8)
        .margin_right(16)
        .x_label_area_size(52)
        .y_label_area_size(74)
        .build_cartesian_2d(
            xs.clone().log_scale().with_key_points(ticks(&xs)),
            ys.clone().log_scale().with_key_points(ticks(&ys)),
        )
        .map_err(|e| text(&e))?;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .label_style((FONT, 18))
        .axis_desc_style((FONT, 19))
        .light_line_style(WHITE.mix(0.0))
        .bold_line_style(RGBColor(225, 225, 225))
        .x_labels(30)
        .y_labels(30)
        .draw()
        .map_err(|e| text(&e))?;
    for line in lines.iter().filter(|l| !l.points.is_empty()) {
        let colour = line.colour;
        let seen: Vec<(f64, f64)> = line
            .points
            .iter()
            .filter(|(_, v)| v.value > 0.0)
            .map(|(x, v)| (*x, v.value))
            .collect();
        for (x, v) in &line.points {
            if let (Some(low), Some(high), true) = (v.low, v.high, v.value > 0.0) {
                let whisker = PathElement::new(
                    vec![(*x, low.max(floor)), (*x, high.max(floor))],
                    colour.stroke_width(1),
                );
                chart.plotting_area().draw(&whisker).map_err(|e| text(&e))?;
            } else if let (Some(high), true) =
                (v.high, v.value <= 0.0 && line.style != Style::Rings)
                && high > 0.0
            {
                let mark = TriangleMarker::new((*x, high), 5, colour.stroke_width(1));
                chart.plotting_area().draw(&mark).map_err(|e| text(&e))?;
            }
        }
        let drawn = match line.style {
            Style::Line => {
                chart
                    .draw_series(LineSeries::new(seen.clone(), colour.stroke_width(2)))
                    .map_err(|e| text(&e))?;
                let dots = seen.iter().map(|p| Circle::new(*p, 3, colour.filled()));
                chart.draw_series(dots)
            }
            Style::Points => {
                chart.draw_series(seen.iter().map(|p| Circle::new(*p, 3, colour.filled())))
            }
            Style::Rings => chart.draw_series(
                seen.iter()
                    .map(|p| Circle::new(*p, 7, colour.stroke_width(1))),
            ),
            Style::Guide => {
                chart.draw_series(DashedLineSeries::new(seen, 6, 4, colour.stroke_width(1)))
            }
        }
        .map_err(|e| text(&e))?;
        let style = line.style;
        drawn.label(&line.label).legend(move |(x, y)| {
            let dot = match style {
                Style::Rings => Circle::new((x + 10, y), 6, colour.stroke_width(1)),
                Style::Guide => Circle::new((x + 10, y), 0, colour.filled()),
                Style::Line | Style::Points => Circle::new((x + 10, y), 3, colour.filled()),
            };
            let joined = matches!(style, Style::Line | Style::Guide);
            let end = if joined { x + 20 } else { x };
            EmptyElement::at((0, 0))
                + PathElement::new(vec![(x, y), (end, y)], colour.stroke_width(1))
                + dot
        });
    }
    chart
        .configure_series_labels()
        .position(legend)
        .label_font((FONT, 17))
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .draw()
        .map_err(|e| text(&e))?;
    root.present().map_err(|e| text(&e))?;
    Ok(())
}

/// Seconds by stage of each method's base, as bars.
fn stages(study: &Study) -> Result<Plot, StudyError> {
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
