//! The page: one file, no network, from a phone's width to a wide screen's.
//!
//! Pictures are data URIs, plots are inline SVG; the little script moves the edge between a
//! method's picture and the reference, picks the method, and copies commands.

use std::fmt::Write;

use super::Options;
use super::encode::{data_uri, html};
use super::figures::Interval;
use super::output::Shown;
use super::plot::{Plot, interval_words};
use super::rate::Convergence;
use super::table::Study;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The whole page.
pub(super) fn page(
    study: &Study,
    plots: &[Plot],
    reference: &[u8],
    shown: &[Shown],
    options: &Options,
) -> String {
    let title = format!("{}: what accuracy costs", html(&study.scene));
    let body = [
        heading(study),
        targets(study, options),
        pictures(study, reference, shown),
        equal_time(study),
        figures(study, plots),
        rows(study),
        notes(),
    ]
    .concat();
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}</style>\n\
         </head>\n<body>\n<main>\n{body}</main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
    )
}

fn heading(study: &Study) -> String {
    let [w, h] = study.resolution;
    let [ow, oh] = study.own_resolution;
    let seeds = study.rows.iter().map(|r| r.seeds).max().unwrap_or(0);
    let reference = match study.reference_spp {
        0 => "a given picture".to_owned(),
        n => format!("{n} paths a pixel"),
    };
    format!(
        "<header><h1>{}: what accuracy costs</h1>\n<p>Pictures of {w} x {h} pixels (the scene's \
         own: {ow} x {oh}), {} threads of {}, vpm-vdb {}. Up to {seeds} seeds of each setting. \
         Reference: {reference}; its own noise, relMSE {:.1e}, is subtracted everywhere.</p>\
         </header>\n",
        html(&study.scene),
        study.threads,
        html(&study.machine),
        html(&study.version),
        study.reference_relmse,
    )
}

fn targets(study: &Study, options: &Options) -> String {
    let scene = options.scene_file.display().to_string();
    let mut out = String::from(
        "<section><h2>For this error, use this setting</h2>\n\
         <p>Error is √relMSE. The second time is for the scene's own resolution, where camera \
         rays take longer in proportion to the pixels and photons do not. Extrapolated: by the \
         method's rate, not rendered.</p>\n\
         <div class=\"scroll\"><table class=\"targets\"><thead><tr><th>error</th><th>method</th>\
         <th>time here</th><th>at full size</th></tr></thead>\n<tbody>\n",
    );
    for target in &study.targets {
        let row = match &target.choice {
            None => "<td colspan=\"3\">no setting of this study reaches it</td>".to_owned(),
            Some(c) => {
                let mark = if c.extrapolated {
                    " <small>extrapolated</small>"
                } else {
                    ""
                };
                let command = format!("vpm-vdb render {scene} {}", c.options);
                format!(
                    "<td>{}{mark}</td><td>{}</td><td>{}</td></tr>\n<tr class=\"command\">\
                     <td colspan=\"4\"><button type=\"button\" class=\"copy\">copy</button> \
                     <code>{}</code></td>",
                    html(&c.method),
                    seconds(c.seconds),
                    seconds(c.seconds_own_resolution),
                    html(&command)
                )
            }
        };
        let _ = writeln!(out, "<tr><th>{} %</th>{row}</tr>", target.percent);
    }
    out + "</tbody></table></div></section>\n"
}

fn seconds(s: f64) -> String {
    match s {
        s if s < 10.0 => format!("{s:.2} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

fn pictures(study: &Study, reference: &[u8], shown: &[Shown]) -> String {
    let [w, h] = study.resolution;
    let size = format!("width=\"{w}\" height=\"{h}\"");
    let reference = data_uri(reference);
    let mut out = String::from(
        "<section><h2>Pictures</h2>\n<p>Move the edge: the method on the left, the reference on \
         the right. Heat maps share one scale: red is too bright, blue too dark, full colour at \
         one half of the reference.</p>\n<div class=\"pictures\">\n",
    );
    for s in shown {
        let method = html(&s.method);
        let _ = writeln!(
            out,
            "<figure><figcaption><b>{method}</b>: {}</figcaption>\n<div class=\"pair\">\
             <div class=\"slide\" style=\"--edge:50%\"><img {size} alt=\"reference\" \
             src=\"{reference}\"><img class=\"over\" {size} alt=\"{method}\" src=\"{}\"></div>\
             <img {size} alt=\"error of {method}\" src=\"{}\"></div>\n<label>edge <input \
             type=\"range\" min=\"0\" max=\"100\" value=\"50\"></label> <button type=\"button\" \
             class=\"toggle\">toggle</button></figure>",
            html(&s.words),
            data_uri(&s.toned),
            data_uri(&s.error),
        );
    }
    out + "</div></section>\n"
}

fn equal_time(study: &Study) -> String {
    if study.equal_time.is_empty() {
        return String::new();
    }
    let first = html(&study.equal_time[0].method);
    let mut out = format!(
        "<section><h2>After the same time</h2>\n<p>relMSE at the scene's own resolution.</p>\n\
         <div class=\"scroll\"><table><thead><tr><th>time</th><th>{first}</th><th>other</th>\
         <th>its</th><th>ratio</th></tr></thead>\n<tbody>\n",
    );
    for e in &study.equal_time {
        let _ = writeln!(
            out,
            "<tr><th>{}</th><td>{:.2e}</td><td>{}</td><td>{:.2e}</td><td>{:.2}</td></tr>",
            seconds(e.seconds),
            e.relmse,
            html(&e.other),
            e.other_relmse,
            e.ratio
        );
    }
    out + "</tbody></table></div></section>\n"
}

fn figures(study: &Study, plots: &[Plot]) -> String {
    let mut out = String::from("<section><h2>Plots</h2>\n<div class=\"plots\">\n");
    for plot in plots {
        let _ = writeln!(
            out,
            "<figure>{}<figcaption>{}</figcaption></figure>",
            plot.svg,
            html(&plot.caption)
        );
    }
    out += "</div>\n";
    if !study.convergence.is_empty() {
        out += "<ul>\n";
        for c in &study.convergence {
            let unit = if c.method == "path" {
                "paths"
            } else {
                "photons"
            };
            let _ = writeln!(
                out,
                "<li>{}: relMSE falls like {unit} to the {} over passes {} to {}; theory {:.2}{}</li>",
                html(&c.setting),
                interval_words(&c.slope, 3),
                c.passes[0],
                c.passes[1],
                c.theory,
                parts(c)
            );
        }
        out += "</ul>\n";
    }
    out + "</section>\n"
}

/// What of the variance is photons', and how it falls.
fn parts(c: &Convergence) -> String {
    let (Some(law), Some(slope)) = (c.law, c.variance_slope) else {
        return String::new();
    };
    let [first, last] = c.passes.map(|n| 100.0 * law.share_of_rays(n));
    let bias = c
        .bias_slope
        .map_or_else(String::new, |s| format!(", bias² to the {s:.3}"));
    format!(
        "; variance to the {slope:.3}{bias}; of the variance {first:.0} % at first and {last:.0} % \
         at last has no radius, as the noise of camera rays"
    )
}

fn rows(study: &Study) -> String {
    let mut out = String::from(
        "<section><h2>All settings</h2>\n<div class=\"scroll\"><table><thead><tr><th>setting</th>\
         <th>passes</th><th>seeds</th><th>time [s]</th><th>relMSE</th><th>bias²</th>\
         <th>variance</th><th>mean / reference</th></tr></thead>\n<tbody>\n",
    );
    let optional = |i: &Option<Interval>| i.as_ref().map_or_else(|| "?".to_owned(), small);
    for r in &study.rows {
        let f = &r.figures;
        let _ = writeln!(
            out,
            "<tr{}><th>{}</th><td>{}</td><td>{}</td><td>{:.3}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td>{}</td></tr>",
            if r.pareto { " class=\"front\"" } else { "" },
            html(&r.setting),
            r.passes,
            r.seeds,
            r.seconds,
            small(&f.relmse),
            optional(&f.bias2),
            optional(&f.variance),
            interval_words(&f.mean_ratio, 4),
        );
    }
    out + "</tbody></table></div></section>\n"
}

/// A small figure with half the width of its interval.
fn small(i: &Interval) -> String {
    match i.high {
        Some(high) => format!("{:.2e} ± {:.0e}", i.value, high - i.value),
        None => format!("{:.2e}", i.value),
    }
}

fn notes() -> String {
    "<section><h2>How to read it</h2>\n\
     <p>relMSE = mean((a-b)² / (b² + 0.01 mean(b)²)) = bias² + variance. The variance is what \
     differs from seed to seed; the bias is the error of the mean over seeds, the noise of that \
     mean and of the reference subtracted, so where there is none to see it scatters about 0 and \
     may be negative. Intervals are 95 %: Student's t over the seeds, with the reference's noise. \
     Highlighted rows are on the Pareto front. Seconds are medians over the seeds, loading and \
     writing left out.</p></section>\n"
        .to_owned()
}
