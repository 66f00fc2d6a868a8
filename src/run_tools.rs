//! The commands that tell about scenes, volumes and pictures, and render none: `info`, `plan`,
//! `compare`, `selftest`.

use std::ffi::OsStr;
use std::io;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, bail};
use vpm_vdb::atomic::check_writable;
use vpm_vdb::compare::{Figures, compare, heat_map};
use vpm_vdb::image;
use vpm_vdb::report::PhotonCounts;
use vpm_vdb::selftest::{Check, Effort, FAMILIES, run_family};

use crate::cli::{CompareArgs, InfoArgs, PlanArgs, SelftestArgs};
use crate::engine;
use crate::run::{FAILED, load, print};

pub(crate) fn info(args: &InfoArgs) -> anyhow::Result<ExitCode> {
    let out = &mut io::stdout().lock();
    let remarks = engine::run_info(&args.file, args.json, args.grid.clone(), &args.at, out)?;
    for remark in remarks {
        eprintln!("note: {remark}");
    }
    Ok(ExitCode::SUCCESS)
}

pub(crate) fn plan(args: &PlanArgs) -> anyhow::Result<ExitCode> {
    let scene = load(&args.scene, None)?;
    let (plan, forecast) = engine::run_plan(&scene, &|text| eprintln!("warning: {text}"))?;
    let (effects, dropped, stages) = (plan.effects, plan.dropped, forecast.stages);
    if args.json {
        let json = serde_json::json!({
            "effects": effects,
            "dropped": dropped,
            "stages": stages,
            "photons": forecast.photons,
        });
        print(&serde_json::to_string_pretty(&json)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let width = effects.iter().map(|e| e.name.len()).max().unwrap_or(0);
    for e in &effects {
        let mark = if e.active { "yes" } else { "no " };
        let form = if e.form.is_empty() { "" } else { "  -> " };
        print(&format!(
            "{mark}  {:width$}  {}{form}{}",
            e.name, e.reason, e.form
        ))?;
    }
    for d in &dropped {
        print(&format!("no   {:width$}  {}", d.what, d.reason))?;
    }
    print("")?;
    for s in &stages {
        let seconds = s.seconds_estimate.map(|t| format!("{t:.2} s"));
        let mebibytes = |b: u64| format!("{:.1} MiB", b as f64 / 1_048_576.0);
        let memory = s.memory_bytes.map(mebibytes).unwrap_or_default();
        let seconds = seconds.unwrap_or_default();
        print(&format!(
            "     {:width$}  {seconds:>10}  {memory:>12}",
            s.name
        ))?;
    }
    let seconds: f64 = stages.iter().filter_map(|s| s.seconds_estimate).sum();
    let seconds = format!("{seconds:.2} s");
    print(&format!("     {:width$}  {seconds:>10}", "total"))?;
    let PhotonCounts { emitted, stored } = forecast.photons;
    if emitted > 0 {
        print(&format!(
            "     {:width$}  {emitted} emitted, about {stored} kept",
            "photons of all passes"
        ))?;
    }
    Ok(ExitCode::SUCCESS)
}

pub(crate) fn run_compare(args: &CompareArgs) -> anyhow::Result<ExitCode> {
    if let Some(file) = &args.heatmap {
        if file.extension().and_then(OsStr::to_str) != Some("png") {
            bail!("the heat map {} has to end in .png", file.display());
        }
        check_writable(file)?;
    }
    let (a, b) = (image::read_exr(&args.a)?, image::read_exr(&args.b)?);
    let figures = compare(&a, &b)
        .with_context(|| format!("{} and {}", args.a.display(), args.b.display()))?;
    if let Some(file) = &args.heatmap {
        image::write_rgb8(file, a.width, a.height, &heat_map(&a, &b))?;
    }
    if args.json {
        print(&serde_json::to_string(&figures)?)?;
    } else {
        print(&table(&figures))?;
    }
    let passed = args.max_relmse.is_none_or(|max| figures.within(max));
    Ok(ExitCode::from(if passed { 0 } else { FAILED }))
}

fn table(f: &Figures) -> String {
    let [r, g, b] = f.mean_ratio;
    let mut text = format!(
        "mean ratio  {r:.6} {g:.6} {b:.6}\nRMSE        {:.6e}\nrelMSE      {:.6e}\nmax abs     {:.6e}",
        f.rmse, f.relmse, f.max_abs
    );
    if let Some(chi2) = f.chi2 {
        text += &format!("\nchi2        {chi2:.4}");
    }
    if f.nonfinite_pixels > 0 {
        text += &format!("\nnot finite  {} pixels, left out", f.nonfinite_pixels);
    }
    text
}

/// Runs every check; a family's lines are printed as soon as it is done.
pub(crate) fn selftest(args: &SelftestArgs) -> anyhow::Result<ExitCode> {
    let effort = if args.quick {
        Effort::Quick
    } else {
        Effort::Full
    };
    let started = Instant::now();
    let mut all: Vec<Check> = Vec::new();
    if !args.json {
        print(Check::HEADINGS)?;
    }
    let asked = |family: &str| args.family.as_ref().is_none_or(|f| f == family);
    for (family, _) in FAMILIES.iter().filter(|(family, _)| asked(family)) {
        let checks = run_family(family, effort)?;
        if !args.json {
            checks.iter().try_for_each(|c| print(&c.to_string()))?;
        }
        all.extend(checks);
    }
    let failed = all.iter().filter(|c| !c.passed).count();
    if args.json {
        let json = serde_json::json!({ "checks": all });
        print(&serde_json::to_string_pretty(&json)?)?;
    } else {
        let seconds = started.elapsed().as_secs_f64();
        let count = all.len();
        print(&format!("{count} checks, {failed} failed, {seconds:.0} s"))?;
    }
    Ok(ExitCode::from(if failed == 0 { 0 } else { FAILED }))
}
