//! The plots of a study: which there are, and what each shows.

mod chart;
mod progress;
mod stages;

use plotters::prelude::RGBColor;

use super::StudyError;
use super::figures::Interval;
use super::plan::Knob;
use super::table::{Row, Study, same_picture};
use chart::{BLACK, BLUE, GREEN, GREY, Line, ORANGE, Style, enough, exact, log_log};

/// A plot and its file name.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    pub(super) name: &'static str,
    /// What it shows, for the page.
    pub(super) caption: String,
    pub(super) svg: String,
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
    all.extend(progress::convergence(study)?);
    all.extend(progress::parts(study)?);
    all.push(stages::stages(study)?);
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
        .filter(|r| r.knob != Knob::Base && same_picture(r.knob))
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
    )?;
    Ok(Some(Plot {
        name: "bias-radius",
        caption: format!(
            "Neighbours changed, all else equal, {passes} passes: a larger kernel blurs more and \
             is less noisy. Triangles: upper bounds of a bias too small to see."
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
    )?;
    Ok(Some(Plot {
        name: "error-orders",
        caption: "What is missing when scattering stops early.".to_owned(),
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
