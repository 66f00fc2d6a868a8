//! How the error of progressive methods falls: relMSE with the slope of the theory, and its parts
//! with their laws (`rate`).

use super::chart::{BLACK, BLUE, Line, ORANGE, Style, enough, exact, log_log};
use super::{Plot, interval_words, method_colour, relmse};
use crate::study::StudyError;
use crate::study::rate::Convergence;
use crate::study::table::{Row, Study};

fn rows_of<'a>(study: &'a Study, rate: &Convergence) -> Vec<&'a Row> {
    study
        .rows
        .iter()
        .filter(|r| r.setting == rate.setting)
        .collect()
}

fn photons(r: &Row) -> Option<f64> {
    Some(r.photons as f64 * f64::from(r.passes))
}

/// Error of the photon methods against photons, with the slope of the theory.
pub(super) fn convergence(study: &Study) -> Result<Option<Plot>, StudyError> {
    let mut lines = Vec::new();
    let mut words = Vec::new();
    for rate in study.convergence.iter().filter(|c| c.method != "path") {
        let rows = rows_of(study, rate);
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

/// Bias² and variance of the `rate` setting against photons, with the fitted laws.
pub(super) fn parts(study: &Study) -> Result<Option<Plot>, StudyError> {
    let rate = study.convergence.iter().find(|c| c.setting == "rate");
    let Some((rate, law)) = rate.and_then(|r| Some((r, r.law?))) else {
        return Ok(None);
    };
    let rows = rows_of(study, rate);
    let mut lines = vec![
        Line::new("bias²", ORANGE, Style::Points).with(&rows, photons, |r| r.figures.bias2),
        Line::new("variance", BLUE, Style::Points).with(&rows, photons, |r| r.figures.variance),
    ];
    if !enough(&lines) {
        return Ok(None);
    }
    let guide = |label: &str, colour, of: &dyn Fn(u32) -> f64| {
        let mut line = Line::new(label, colour, Style::Guide);
        line.points = rows
            .iter()
            .filter_map(|r| Some((photons(r)?, exact(of(r.passes)))))
            .collect();
        line
    };
    if law.bias2 > 0.0 {
        lines.push(guide("law of bias²", ORANGE, &|n| law.at(n)[0]));
    }
    lines.push(guide("law of variance", BLUE, &|n| law.at(n)[1]));
    lines.push(guide("variance of photons", BLACK, &|n| {
        law.at(n)[1] * (1.0 - law.share_of_rays(n))
    }));
    let [first, last] = rate.passes.map(|n| 100.0 * law.share_of_rays(n));
    let svg = log_log(
        "Bias and variance of the progressive estimate",
        "photons emitted",
        "share of relMSE [1]",
        &lines,
    )?;
    Ok(Some(Plot {
        name: "rate",
        caption: format!(
            "The setting `rate`, few photons and four camera rays in each pass. Dashed: bias² as the \
             radii's schedule has it, and variance as photons (like the photons to the -0.67) and \
             camera rays (like 1 / passes) together. {first:.0} % of the first point's variance is \
             not photons', {last:.0} % of the last one's."
        ),
        svg,
    }))
}
