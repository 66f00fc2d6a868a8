//! One chart: lines with whiskers over logarithmic axes, as SVG whose text is text.
//!
//! Whiskers are 95 % intervals; a value that is not above 0 within its noise (a bias too small to
//! see) is drawn as a triangle at the upper end of its interval.

use std::ops::Range;

use plotters::coord::combinators::IntoLogRange;
use plotters::prelude::*;

use crate::study::StudyError;
use crate::study::figures::Interval;
use crate::study::table::Row;

/// Width and height: small, so that text stays readable on a phone.
pub(super) const SIZE: (u32, u32) = (520, 400);
pub(super) const FONT: &str = "sans-serif";

/// Colour-blind safe (Okabe & Ito 2008).
pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(super) const ORANGE: RGBColor = RGBColor(213, 94, 0);
pub(super) const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(super) const GREY: RGBColor = RGBColor(150, 150, 150);
pub(super) const BLACK: RGBColor = RGBColor(30, 30, 30);

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    /// Points joined by a line.
    Line,
    /// Points alone.
    Points,
    /// Large rings.
    Rings,
    /// A dashed line without points.
    Guide,
}

/// One line of a chart.
#[derive(Debug)]
pub(super) struct Line {
    label: String,
    colour: RGBColor,
    style: Style,
    pub(super) points: Vec<(f64, Interval)>,
}

impl Line {
    pub(super) fn new(label: impl Into<String>, colour: RGBColor, style: Style) -> Self {
        Self {
            label: label.into(),
            colour,
            style,
            points: Vec::new(),
        }
    }

    pub(super) fn with<'a>(
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

/// A value without an interval.
pub(super) fn exact(value: f64) -> Interval {
    Interval {
        value,
        low: None,
        high: None,
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

/// A chart with a title and labels of its axes.
pub(super) fn log_log(title: &str, x: &str, y: &str, lines: &[Line]) -> Result<String, StudyError> {
    let mut svg = String::new();
    draw(&mut svg, [title, x, y], lines).map_err(|reason| StudyError::Plot {
        name: format!("'{title}'"),
        reason,
    })?;
    Ok(svg)
}

/// The corner whose legend covers least of the lines.
fn emptiest_corner(lines: &[Line], xs: &Range<f64>, ys: &Range<f64>) -> SeriesLabelPosition {
    /// Parts into which the way between two points is cut.
    const PARTS: u32 = 8;
    // Of the plot's width and height, about.
    let (wide, high) = (0.5, 0.09 * lines.len() as f64 + 0.05);
    let share = |v: f64, range: &Range<f64>| {
        ((v / range.start).ln() / (range.end / range.start).ln()).clamp(0.0, 1.0)
    };
    let places: Vec<(f64, f64)> = lines
        .iter()
        .flat_map(|line| {
            let marks: Vec<(f64, f64)> = line
                .points
                .iter()
                .map(|(x, v)| {
                    let y = if v.value > 0.0 { Some(v.value) } else { v.high };
                    (share(*x, xs), share(y.unwrap_or(ys.start), ys))
                })
                .collect();
            let drawn = matches!(line.style, Style::Line | Style::Guide);
            let between: Vec<(f64, f64)> = marks
                .windows(2)
                .filter(|_| drawn)
                .flat_map(|pair| {
                    let [(x0, y0), (x1, y1)] = [pair[0], pair[1]];
                    (0..=PARTS).map(move |i| {
                        let t = f64::from(i) / f64::from(PARTS);
                        (x0 + t * (x1 - x0), y0 + t * (y1 - y0))
                    })
                })
                .collect();
            marks.into_iter().chain(between)
        })
        .collect();
    [
        (SeriesLabelPosition::UpperRight, [true, true]),
        (SeriesLabelPosition::LowerLeft, [false, false]),
        (SeriesLabelPosition::LowerRight, [true, false]),
        (SeriesLabelPosition::UpperLeft, [false, true]),
    ]
    .into_iter()
    .min_by_key(|(_, [right, upper])| {
        let covers = |(x, y): &&(f64, f64)| {
            let x = if *right { 1.0 - x } else { *x };
            let y = if *upper { 1.0 - y } else { *y };
            x < wide && y < high
        };
        places.iter().filter(covers).count()
    })
    .map_or(SeriesLabelPosition::UpperRight, |(corner, _)| corner)
}

fn draw(svg: &mut String, [title, x, y]: [&str; 3], lines: &[Line]) -> Result<(), String> {
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
            // Where the stroke stops and goes on: dashed, whole, or not there.
            let [stop, on, end] = match style {
                Style::Guide => [x + 6, x + 13, x + 20],
                Style::Line => [x + 10, x + 10, x + 20],
                Style::Points | Style::Rings => [x, x, x],
            };
            EmptyElement::at((0, 0))
                + PathElement::new(vec![(x, y), (stop, y)], colour.stroke_width(1))
                + PathElement::new(vec![(on, y), (end, y)], colour.stroke_width(1))
                + dot
        });
    }
    chart
        .configure_series_labels()
        .position(emptiest_corner(lines, &xs, &ys))
        .label_font((FONT, 17))
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .draw()
        .map_err(|e| text(&e))?;
    root.present().map_err(|e| text(&e))?;
    Ok(())
}

/// At least two points to draw?
pub(super) fn enough(lines: &[Line]) -> bool {
    lines.iter().any(|l| l.points.len() >= 2)
}
