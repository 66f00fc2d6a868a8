//! Results as files: `study.csv`, `study.json`, plots, pictures, `index.html`.
//!
//! Columns of `study.csv`, one row for each setting and checkpoint: what was set; `seeds`;
//! `seconds` (median; loading and writing excluded) and, estimated, at the scene's own resolution; `relmse` with its 95 % interval;
//! `bias` = sign · √|bias²| and `variance`, so that relmse = bias² + variance; mean over the
//! reference's mean; `step_error` = √ of the squared difference from the base at equal seeds.
//! An empty cell is not known.

use std::path::PathBuf;

use super::encode::{picture, png, toned};
use super::figures::{Interval, Reference};
use super::page;
use super::plan::Sweep;
use super::plot;
use super::store::{Pixels, Store};
use super::table::{Row, Study};
use super::{Options, StudyError};
use crate::atomic::write_bytes;
use crate::compare::heat_map;
use crate::scene::Scene;

/// A method's picture at its last checkpoint, and its error.
#[derive(Debug)]
pub(super) struct Shown {
    /// Method.
    pub(super) method: String,
    /// What it is, in a few words.
    pub(super) words: String,
    /// Tone-mapped PNG.
    pub(super) toned: Vec<u8>,
    /// Heat map PNG.
    pub(super) error: Vec<u8>,
}

/// Writes everything; returns the files.
pub(super) fn write(
    study: &Study,
    scene: &Scene,
    sweep: &Sweep,
    store: &Store,
    reference: &Reference,
    options: &Options,
) -> Result<Vec<PathBuf>, StudyError> {
    let folder = &options.folder;
    let mut files = Vec::new();
    let mut put = |name: &str, bytes: &[u8]| -> Result<(), StudyError> {
        let file = folder.join(name);
        write_bytes(&file, bytes)?;
        files.push(file);
        Ok(())
    };
    put("study.csv", csv(study).as_bytes())?;
    let mut json = serde_json::to_string_pretty(study).map_err(|e| StudyError::Plot {
        name: "study.json".to_owned(),
        reason: e.to_string(),
    })?;
    json.push('\n');
    put("study.json", json.as_bytes())?;
    let plots = plot::plots(study)?;
    for plot in &plots {
        put(&format!("{}.svg", plot.name), plot.svg.as_bytes())?;
    }
    let exposure = scene.settings.exposure;
    let size = sweep.resolution;
    let mean: Pixels = reference.mean.iter().map(|p| p.map(|v| v as f32)).collect();
    let reference = picture(&mean, size);
    let reference_png = toned(&reference, exposure)?;
    put("reference.png", &reference_png)?;
    let mut shown = Vec::new();
    for row in study
        .methods()
        .iter()
        .filter_map(|m| study.base(m).last().copied())
    {
        let Some(run) = store.get(&row.setting, 0)? else {
            continue;
        };
        let Some(pixels) = run.pictures.last() else {
            continue;
        };
        let picture = picture(pixels, size);
        let one = Shown {
            method: row.method.clone(),
            words: words(row),
            toned: toned(&picture, exposure)?,
            error: png(size[0], size[1], &heat_map(&picture, &reference))?,
        };
        put(&format!("{}.png", row.method), &one.toned)?;
        put(&format!("{}-error.png", row.method), &one.error)?;
        shown.push(one);
    }
    let html = page::page(study, &plots, &reference_png, &shown, options);
    put("index.html", html.as_bytes())?;
    Ok(files)
}

/// A row in words.
pub(super) fn words(row: &Row) -> String {
    let percent = 100.0 * row.figures.relmse.value.max(0.0).sqrt();
    let what = match row.method.as_str() {
        "path" => format!("{} paths a pixel", row.spp),
        _ => format!("{} passes of {} photons", row.passes, row.photons),
    };
    format!("{what}, {:.2} s, √relMSE {percent:.2} %", row.seconds)
}

const COLUMNS: &str = "method,setting,photons,passes,spp,neighbours,kernel,march,direct,\
    max_bounces,radius,seeds,seconds,seconds_own_resolution,relmse,relmse_low,relmse_high,bias,bias_low,bias_high,\
    variance,variance_low,variance_high,mean_ratio,mean_ratio_low,mean_ratio_high,step_error,\
    seconds_build,seconds_photons,seconds_map,seconds_gather,pareto\n";

fn csv(study: &Study) -> String {
    let mut text = String::from(COLUMNS);
    let number = |v: Option<f64>| v.map_or_else(String::new, |v| format!("{v:.6e}"));
    let root = |v: f64| v.signum() * v.abs().sqrt();
    let three = |i: Option<Interval>, f: fn(f64) -> f64| {
        let part = |v: Option<f64>| number(v.map(f));
        let all = i.map(|i| [Some(i.value), i.low, i.high]);
        all.unwrap_or_default().map(part).join(",")
    };
    for r in &study.rows {
        let f = &r.figures;
        let t = &r.time_s;
        let cells = [
            r.method.clone(),
            r.setting.clone(),
            r.photons.to_string(),
            r.passes.to_string(),
            r.spp.to_string(),
            r.neighbours.to_string(),
            r.kernel.clone(),
            r.march.clone(),
            r.direct.clone(),
            r.max_bounces.to_string(),
            number(r.radius),
            r.seeds.to_string(),
            number(Some(r.seconds)),
            number(Some(r.seconds_own_resolution)),
            three(Some(f.relmse), |v| v),
            three(f.bias2, root),
            three(f.variance, |v| v),
            three(Some(f.mean_ratio), |v| v),
            number(f.paired.map(|i| root(i.value))),
            number(Some(t.build)),
            number(Some(t.photons)),
            number(Some(t.map)),
            number(Some(t.gather)),
            r.pareto.to_string(),
        ];
        text += &cells.join(",");
        text.push('\n');
    }
    text
}
