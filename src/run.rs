//! The commands: what `cli` understood is done here.
//!
//! Everything that can be wrong with the input (scene, frames, crop, places of the outputs) is found
//! before rendering begins.

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, bail};
use vpm_vdb::atomic::{self, check_writable};
use vpm_vdb::image::{self, Metadata};
use vpm_vdb::render::checkpoint::Checkpoint;
use vpm_vdb::render::error::{ErrorWatch, Pairs};
use vpm_vdb::render::{Exec, PassDone, Rendered, Watch};
use vpm_vdb::scene::file::settings_text;
use vpm_vdb::scene::{Method, Scene};
use vpm_vdb::{frames, progress, report};

use crate::cli::{Cli, Command, RenderArgs};
use crate::{engine, run_study, run_tools};

/// Passes of a render that is to end for another reason.
const MOST: u32 = 1_000_000;

/// A comparison or a check failed its bound.
pub(crate) const FAILED: u8 = 1;

/// Set by Ctrl-C: the renderer ends after the pass in hand.
pub(crate) static STOP: AtomicBool = AtomicBool::new(false);

/// Runs the command.
pub(crate) fn run(cli: &Cli) -> anyhow::Result<ExitCode> {
    match &cli.command {
        Command::Render(args) => render(args),
        Command::Info(args) => run_tools::info(args),
        Command::Plan(args) => run_tools::plan(args),
        Command::Study(args) => run_study::study(args),
        Command::Compare(args) => run_tools::run_compare(args),
        Command::Selftest(args) => run_tools::selftest(args),
    }
}

/// Did the reader of our output go away?
pub(crate) fn is_broken_pipe(e: &anyhow::Error) -> bool {
    let io = |e: &io::Error| e.kind() == io::ErrorKind::BrokenPipe;
    e.chain().any(|e| e.downcast_ref().is_some_and(io))
}

pub(crate) fn print(line: &str) -> anyhow::Result<()> {
    writeln!(io::stdout(), "{line}").context("cannot write to stdout")
}

fn has_extension(file: &Path, extension: &str) -> bool {
    file.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// A scene file, or a scene around a lone volume; the volume may be a sequence.
pub(crate) fn load(file: &Path, first_frame: Option<u32>) -> anyhow::Result<Scene> {
    if !has_extension(file, "vdb") {
        return Ok(Scene::load(file)?);
    }
    if !frames::is_pattern(file) {
        return engine::bare_scene(file);
    }
    let Some(first) = first_frame else {
        bail!(
            "{} is a sequence; say which with --frames A-B",
            file.display()
        );
    };
    // The first frame sets the camera; the sequence takes its place.
    let one = frames::file_of(file, first);
    let mut scene = engine::bare_scene(&one)?;
    for volume in scene.volumes.iter_mut().filter(|v| v.file == one) {
        volume.file = file.to_owned();
    }
    Ok(scene)
}

/// What was given on the command line wins.
fn apply(args: &RenderArgs, scene: &mut Scene) -> anyhow::Result<()> {
    let s = &mut scene.settings;
    s.method = args.method.unwrap_or(s.method);
    s.photons = args.photons.unwrap_or(s.photons);
    s.passes = args.passes.unwrap_or(s.passes);
    s.neighbours = args.neighbours.unwrap_or(s.neighbours);
    s.spp = args.spp.unwrap_or(s.spp);
    s.seed = args.seed.unwrap_or(s.seed);
    // A time without a number of passes (of paths) is to be used up, an error to be reached.
    if args.time.is_some() || args.target_error.is_some() {
        match s.method {
            Method::Path => s.spp = args.spp.unwrap_or(MOST),
            Method::Beam | Method::Point => s.passes = args.passes.unwrap_or(MOST),
        }
    }
    s.pruning = !args.no_pruning;
    scene.camera.resolution = args.resolution.unwrap_or(scene.camera.resolution);
    let [width, height] = scene.camera.resolution;
    if let Some(crop) = args.crop {
        let [x0, y0, x1, y1] = crop;
        if x0 >= x1 || y0 >= y1 || x1 > width || y1 > height {
            bail!(
                "--crop {x0},{y0},{x1},{y1} has no pixels of a picture of {width}x{height}; it \
                 takes X0 < X1 <= {width} and Y0 < Y1 <= {height}"
            );
        }
        scene.settings.crop = Some(crop);
    }
    Ok(())
}

/// One picture to make: its scene, and where it goes.
struct Job {
    scene: Scene,
    exr: PathBuf,
    png: PathBuf,
    report: Option<PathBuf>,
}

/// Splits a sequence into frames; checks that every file is there and every place writable.
fn jobs(args: &RenderArgs, scene: Scene) -> anyhow::Result<Vec<Job>> {
    let default = || PathBuf::from(format!("{}.exr", scene.name));
    let output = args.output.clone().unwrap_or_else(default);
    if !has_extension(&output, "exr") {
        bail!(
            "the output {} has to end in .exr; the PNG is written beside it",
            output.display()
        );
    }
    let pattern = scene.volumes.iter().find(|v| frames::is_pattern(&v.file));
    let jobs: Vec<Job> = match (&args.frames, pattern) {
        (None, None) => vec![Job {
            png: output.with_extension("png"),
            exr: output,
            report: args.report.clone(),
            scene,
        }],
        (None, Some(volume)) => bail!(
            "{} is a sequence; say which frames with --frames A-B",
            volume.file.display()
        ),
        (Some(_), None) => bail!(
            "--frames needs a volume with #### or %04d in its file name; {} has none",
            args.scene.display()
        ),
        (Some(range), Some(_)) => range
            .clone()
            .map(|frame| {
                let mut scene = scene.clone();
                for volume in &mut scene.volumes {
                    if frames::is_pattern(&volume.file) {
                        volume.file = frames::file_of(&volume.file, frame);
                    }
                }
                let exr = frames::output_of(&output, frame);
                Job {
                    png: exr.with_extension("png"),
                    exr,
                    report: args.report.as_ref().map(|r| frames::output_of(r, frame)),
                    scene,
                }
            })
            .collect(),
    };
    let volumes = jobs.iter().flat_map(|j| &j.scene.volumes);
    let missing: Vec<_> = volumes.map(|v| &v.file).filter(|f| !f.is_file()).collect();
    if let Some(first) = missing.first() {
        let count = missing.len();
        bail!(
            "{} is not there ({count} of the volume files are missing)",
            first.display()
        );
    }
    for job in &jobs {
        for file in [&job.exr, &job.png].into_iter().chain(&job.report) {
            check_writable(file)?;
        }
    }
    Ok(jobs)
}

fn render(args: &RenderArgs) -> anyhow::Result<ExitCode> {
    let first = args.frames.as_ref().map(|f| *f.start());
    let started = Instant::now();
    let mut scene = load(&args.scene, first)?;
    apply(args, &mut scene)?;
    let jobs = jobs(args, scene)?;
    let loaded = started.elapsed().as_secs_f64();

    let mut checkpoints = Vec::new();
    for job in &jobs {
        let file = job.exr.with_extension("checkpoint");
        let there = file.exists();
        if args.resume && there {
            checkpoints.push(Some(Checkpoint::resume(&file, &job.scene)?));
            continue;
        }
        if there && !args.quiet {
            eprintln!(
                "note: {} of a stopped render is left alone unless this one needs its place; \
                 --resume goes on from it",
                file.display()
            );
        }
        checkpoints.push(None);
    }

    with_terminal(args.quiet, args.threads, |exec| {
        let exec = Exec {
            time_limit: args.time,
            ..*exec
        };
        render_jobs(args, (&jobs, loaded), checkpoints, &exec)
    })
}

/// Renders the jobs, whose scene took `loaded` seconds, each going on from its checkpoint.
fn render_jobs(
    args: &RenderArgs,
    (jobs, loaded): (&[Job], f64),
    checkpoints: Vec<Option<Checkpoint>>,
    exec: &Exec<'_>,
) -> anyhow::Result<ExitCode> {
    // A render that ends at an error or at a time states its error, noise and bias.
    let pairs = match (args.target_error, args.time) {
        (Some(_), _) => Some(Pairs::Sure),
        (None, Some(_)) => Some(Pairs::Few),
        (None, None) => None,
    };
    let mut missed = false;
    for (job, checkpoint) in jobs.iter().zip(checkpoints) {
        let mut checkpoint = match checkpoint {
            Some(checkpoint) => checkpoint,
            None => Checkpoint::begin(&job.exr.with_extension("checkpoint"), &job.scene)?,
        };
        let method = job.scene.settings.method;
        let mut errors = pairs.map(|pairs| ErrorWatch::new(args.target_error, pairs, method));
        let mut unwatched = |_: &PassDone<'_>| ControlFlow::Continue(());
        let watch: &mut dyn Watch = match &mut errors {
            Some(errors) => errors,
            None => &mut unwatched,
        };
        let mut rendered = engine::run_render(&job.scene, exec, &mut checkpoint, watch)?;
        rendered.report.error = errors.and_then(|e| e.estimate);
        missed |=
            args.target_error.is_some() && !rendered.report.error.is_some_and(|e| e.reached());
        rendered.report.time_s.load += loaded;
        rendered.report.time_s.total += loaded;
        write(job, &mut rendered)?;
        if !rendered.stopped_early {
            checkpoint.remove().with_context(|| {
                format!(
                    "cannot remove {}",
                    job.exr.with_extension("checkpoint").display()
                )
            })?;
        }
        if !args.quiet {
            tell(job, &rendered)?;
        }
        if STOP.load(Ordering::Relaxed) {
            break;
        }
    }
    if missed {
        eprintln!("error: ended before the error was surely below the target");
    }
    Ok(ExitCode::from(if missed { FAILED } else { 0 }))
}

/// Calls `then` with what tells the terminal of progress and warnings unless `quiet`, and listens to
/// Ctrl-C.
pub(crate) fn with_terminal<T>(
    quiet: bool,
    threads: Option<u32>,
    then: impl FnOnce(&Exec<'_>) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    catch_ctrl_c(quiet)?;
    let progress = progress::for_stderr(quiet);
    let warn = |text: &str| {
        if !quiet {
            progress.message(&format!("warning: {text}"));
        }
    };
    then(&Exec {
        threads: threads.map(|n| n as usize),
        progress: progress.as_ref(),
        time_limit: None,
        warn: &warn,
        stop: &STOP,
    })
}

/// The first Ctrl-C asks the renderer to end after the pass in hand, the second one ends it all.
fn catch_ctrl_c(quiet: bool) -> anyhow::Result<()> {
    /// What shells expect of a program that Ctrl-C ended.
    const INTERRUPTED: i32 = 130;
    ctrlc::set_handler(move || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED);
        }
        if !quiet {
            eprintln!("finishing the pass in hand; Ctrl-C again ends at once");
        }
    })
    .context("cannot listen for Ctrl-C")
}

/// Writes picture and report, and completes the report with what writing took.
fn write(job: &Job, rendered: &mut Rendered) -> anyhow::Result<()> {
    let Rendered { film, report, .. } = rendered;
    if film.passes() == 0 {
        bail!("stopped before the first pass was done; nothing is written");
    }
    let started = Instant::now();
    let settings = &job.scene.settings;
    let metadata = Metadata {
        scene: job.scene.name.clone(),
        settings: settings_text(settings),
    };
    image::write_exr(&job.exr, film, &metadata)?;
    image::write_png(&job.png, film, settings.exposure)?;
    report.time_s.output = started.elapsed().as_secs_f64();
    report.time_s.total += report.time_s.output;
    report.peak_rss_bytes = report::peak_rss_bytes();
    if let Some(file) = &job.report {
        let mut text = serde_json::to_string_pretty(report)?;
        text.push('\n');
        atomic::write_bytes(file, text.as_bytes())?;
    }
    Ok(())
}

/// One line on stdout; what deserves attention on stderr.
fn tell(job: &Job, rendered: &Rendered) -> anyhow::Result<()> {
    let Rendered {
        film,
        report,
        stopped_early,
        ..
    } = rendered;
    let error = match (&report.error, film.mean_relative_standard_error()) {
        (Some(e), _) => format!(
            "error {:.2} % (noise {:.2} %, bias {:.2} %), below {:.2} % at {:.0} % confidence",
            100.0 * e.estimate,
            100.0 * e.noise,
            100.0 * e.bias,
            100.0 * e.upper,
            100.0 * e.confidence
        ),
        (None, Some(e)) => format!("error {:.2} % (noise alone)", 100.0 * e),
        (None, None) => "error unknown".to_owned(),
    };
    let passes = match film.passes() {
        1 => "1 pass".to_owned(),
        n => format!("{n} passes"),
    };
    print(&format!(
        "{} {}  {:.1} s, {passes}, {error}",
        job.exr.display(),
        job.png.display(),
        report.time_s.total
    ))?;
    if *stopped_early && STOP.load(Ordering::Relaxed) {
        eprintln!("stopped early: the picture has {passes}; the same with --resume goes on");
    }
    match film.nonfinite_pixels() {
        0 => {}
        n => eprintln!("warning: {n} pixels were NaN or infinite in some pass; those are left out"),
    }
    Ok(())
}
