//! The command line as typed, and the turning of its words into values.
//!
//! Options that a scene file can set, too, are `Option`s here: what is given wins.

use std::ffi::OsString;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use vpm_vdb::frames;
use vpm_vdb::scene::Method;
use vpm_vdb::selftest::FAMILIES;

/// Renders smoke, clouds, fog and fire stored in OpenVDB files by volumetric photon mapping.
///
/// Exit codes: 0 done; 1 a comparison, a self-test or a target error was missed, or a study was
/// interrupted; 2 bad input.
#[derive(Debug, Parser)]
#[command(name = "vpm-vdb", version, help_expected = true, max_term_width = 100)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render a scene, or a lone .vdb, to a layered EXR and a PNG beside it.
    ///
    /// A lone .vdb is framed by a camera and lit by sun and sky. Ctrl-C ends the render after the
    /// pass in hand and writes what there is, and a checkpoint for --resume; a second Ctrl-C ends it
    /// at once.
    Render(RenderArgs),
    /// List the grids of a .vdb file, or values of one of them.
    Info(InfoArgs),
    /// Tell which effects of light a scene calls for, and why, without rendering.
    Plan(PlanArgs),
    /// Measure what accuracy costs in time, for a scene.
    ///
    /// Renders the scene with many settings and seeds against a long path-traced reference;
    /// writes tables, plots and a page that names the cheapest setting for each error. Finished
    /// runs stay on disk: the same command goes on where it stopped. Ctrl-C ends after the run in
    /// hand with what there is.
    Study(StudyArgs),
    /// Compare a picture with a reference.
    Compare(CompareArgs),
    /// Check the physics on this machine: figures against their bounds, exit code 1 if one fails.
    ///
    /// Furnaces, optical depths, distributions, bounds, phase functions, invariances: each against
    /// an exact answer or by a statistical test on fixed seeds. No files are read or written.
    Selftest(SelftestArgs),
}

/// Options of `render`; they win over the scene's `[render]`.
#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// Scene file (.toml), or volume (.vdb; `####` or `%04d` in its name stand for the frame).
    #[arg(value_name = "SCENE.toml | FILE.vdb")]
    pub(crate) scene: PathBuf,
    /// Picture to write, .exr; the PNG goes beside it [default: scene name in the current folder].
    #[arg(short, long, value_name = "OUT.exr")]
    pub(crate) output: Option<PathBuf>,
    /// Estimator [default: the scene's, or beam].
    ///
    /// beam: photons gathered along whole camera rays (Jarosz et al. 2008). point: photons
    /// gathered in spheres at the steps of a ray march (Jensen & Christensen 1998). path: path
    /// tracing, the reference.
    #[arg(long, value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)).map(method))]
    pub(crate) method: Option<Method>,
    /// Photons emitted in each pass; 1e6 and 1_000_000 are the same [default: the scene's, or 1e6].
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub(crate) photons: Option<u64>,
    /// Passes of fresh photons; each refines the picture [default: the scene's, or 8].
    #[arg(long, value_name = "N", value_parser = parse_count32)]
    pub(crate) passes: Option<u32>,
    /// Photons within the radius of a photon: more is smoother and more blurred [default: the
    /// scene's, or 50].
    #[arg(long, value_name = "N", value_parser = parse_count32)]
    pub(crate) neighbours: Option<u32>,
    /// Camera rays of a pixel, in each pass (beam, point) or in all (path) [default: the scene's,
    /// or 1].
    #[arg(long, value_name = "N", value_parser = parse_count32)]
    pub(crate) spp: Option<u32>,
    /// Time for each frame: 30s, 10m, 1.5h; no pass begins after it [default: none].
    ///
    /// Without --passes (path: without --spp) there are as many passes as fit, at least one.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) time: Option<Duration>,
    /// Render until the error, noise and bias together, is below this share of the light: 2%.
    ///
    /// The error is that of `compare`, the root of relMSE; it is estimated while rendering, and
    /// the render ends when it lies below with 95 % confidence. Without --passes (path: without
    /// --spp) there are as many passes as it takes; exit code 1 if --passes, --spp or --time end
    /// it before.
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent)]
    pub(crate) target_error: Option<f64>,
    /// Width and height in pixels [default: the scene's].
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    pub(crate) resolution: Option<[u32; 2]>,
    /// Pixels to render: corners, the second one excluded [default: all].
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_numbers::<u32, 4>)]
    pub(crate) crop: Option<[u32; 4]>,
    /// Seed of all random numbers; the same seed gives the same picture, bit for bit, whatever the
    /// number of threads [default: the scene's, or 0].
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Threads to use [default: one for each core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) threads: Option<u32>,
    /// Frames to render, one or a range; their numbers go into the names of volumes and pictures.
    #[arg(long, value_name = "A-B", value_parser = frames::parse_range)]
    pub(crate) frames: Option<RangeInclusive<u32>>,
    /// Simulate every effect in its general form: the same picture, more slowly.
    #[arg(long)]
    pub(crate) no_pruning: bool,
    /// Write times, counts and errors as JSON.
    #[arg(long, value_name = "OUT.json")]
    pub(crate) report: Option<PathBuf>,
    /// Go on from the checkpoint that a stopped render left beside the picture, if there is one.
    ///
    /// The pictures are those of a render without a stop, byte for byte. Scene, volumes and settings
    /// have to be as before; --passes may be more (path: --spp). A checkpoint, OUT.checkpoint, is
    /// written once a minute and at Ctrl-C, and removed when the picture is done.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Print errors only.
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Options of `info`.
#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// Volume.
    #[arg(value_name = "FILE.vdb")]
    pub(crate) file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Grid to look into [default: all].
    #[arg(long, value_name = "NAME")]
    pub(crate) grid: Option<String>,
    /// Voxels whose values to print, by index coordinates.
    #[arg(long, value_name = "I,J,K", num_args = 1..,
        value_parser = parse_numbers::<i32, 3>)]
    pub(crate) at: Vec<[i32; 3]>,
}

/// Options of `plan`.
#[derive(Debug, Args)]
pub(crate) struct PlanArgs {
    /// Scene file (.toml), or volume (.vdb).
    #[arg(value_name = "SCENE.toml | FILE.vdb")]
    pub(crate) scene: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Options of `study`.
#[derive(Debug, Args)]
pub(crate) struct StudyArgs {
    /// Scene file (.toml), or volume (.vdb).
    #[arg(value_name = "SCENE.toml | FILE.vdb")]
    pub(crate) scene: PathBuf,
    /// Folder for runs and results; made if need be [default: scene name + _study].
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Three minutes: fewer pixels, photons, passes, values and seeds.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Reference picture with channels R, G, B and, for its noise, stderr.R, .G, .B; its size is
    /// the study's [default: path tracing].
    #[arg(long, value_name = "REF.exr")]
    pub(crate) reference: Option<PathBuf>,
    /// Time for the whole study: 10m, 2h [default: 30m; with --quick 150s].
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) budget: Option<Duration>,
    /// Width and height of the study's pictures [default: the scene's shape with some 16000
    /// pixels; with --quick 5000].
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    pub(crate) resolution: Option<[u32; 2]>,
    /// Begin anew: remove the runs of another study from the folder.
    #[arg(long)]
    pub(crate) anew: bool,
    /// Threads to use [default: one for each core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) threads: Option<u32>,
    /// Print errors only.
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Options of `compare`.
#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// Picture to judge.
    #[arg(value_name = "A.exr")]
    pub(crate) a: PathBuf,
    /// Reference.
    #[arg(value_name = "B.exr")]
    pub(crate) b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Exit with code 1 if relMSE = mean((a-b)^2 / (b^2 + 0.01 mean(b)^2)) is above this.
    #[arg(long, value_name = "X", allow_negative_numbers = true, value_parser = parse_bound)]
    pub(crate) max_relmse: Option<f64>,
    /// Write the relative difference as a picture: red where A is brighter, blue where darker,
    /// full colour at one half.
    #[arg(long, visible_alias = "heat-map", value_name = "OUT.png")]
    pub(crate) heatmap: Option<PathBuf>,
}

/// Options of `selftest`.
#[derive(Debug, Args)]
pub(crate) struct SelftestArgs {
    /// Fewer points, rays and samples: half a minute instead of two.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Only the checks of one family [default: all].
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(FAMILIES.map(|f| f.0)))]
    pub(crate) family: Option<String>,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Parses the command line; prints help or what is wrong with it, and exits, where need be.
pub(crate) fn parse() -> Cli {
    Cli::parse_from(std::env::args_os().map(protect_negative))
}

/// `-1,2,3` is a list of numbers, not an option: a space ahead of it, which the number parser
/// ignores, tells clap so.
fn protect_negative(arg: OsString) -> OsString {
    match arg.to_str() {
        Some(s) if s.contains(',') && parse_numbers::<i32, 3>(s).is_ok() => format!(" {s}").into(),
        _ => arg,
    }
}

/// clap has checked that it is one of the names.
fn method(name: String) -> Method {
    let found = Method::ALL.into_iter().find(|m| m.name() == name);
    found.unwrap_or(Method::Beam)
}

/// `N` numbers with commas between them.
fn parse_numbers<T: std::str::FromStr + Copy, const N: usize>(
    text: &str,
) -> Result<[T; N], String> {
    let parts = text.split(',').map(|s| s.trim().parse::<T>().ok());
    let numbers: Option<Vec<T>> = parts.collect();
    numbers
        .and_then(|n| n.try_into().ok())
        .ok_or_else(|| format!("it takes {N} whole numbers with commas between them"))
}

/// `640x480`.
fn parse_resolution(text: &str) -> Result<[u32; 2], String> {
    let number = |s: &str| s.trim().parse::<u32>().ok();
    let size = text
        .split_once(['x', 'X'])
        .map(|(w, h)| (number(w), number(h)));
    match size {
        Some((Some(w), Some(h))) if (1..=16384).contains(&w) && (1..=16384).contains(&h) => {
            Ok([w, h])
        }
        _ => Err("it takes width and height, as in 640x480, each from 1 to 16384".to_owned()),
    }
}

/// A whole number from 1 to 10^10, with underscores or an exponent if need be.
fn parse_count(text: &str) -> Result<u64, String> {
    let plain = text.replace('_', "");
    let number = plain.parse::<f64>().ok();
    match number {
        // Whole f64 are exact far beyond the bound.
        Some(v) if v.fract() == 0.0 && (1.0..=1e10).contains(&v) => Ok(v as u64),
        _ => Err("it takes a whole number from 1 to 10000000000".to_owned()),
    }
}

/// A whole number from 1 to 10^6.
fn parse_count32(text: &str) -> Result<u32, String> {
    let count = parse_count(text).ok().filter(|v| *v <= 1_000_000);
    count
        .and_then(|v| u32::try_from(v).ok())
        .ok_or_else(|| "it takes a whole number from 1 to 1000000".to_owned())
}

/// `30`, `30s`, `10m`, `1.5h`, `1h30m`.
fn parse_duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("`{text}` is no time; write 30s, 10m, 1.5h or 1h30m");
    let (mut rest, mut seconds) = (text.trim(), 0.0);
    if rest.is_empty() {
        return Err(wrong());
    }
    while !rest.is_empty() {
        let length = rest
            .find(|c: char| !c.is_ascii_digit() && c != '.')
            .unwrap_or(rest.len());
        let value: f64 = rest[..length].parse().map_err(|_| wrong())?;
        rest = &rest[length..];
        let letters = rest
            .find(|c: char| !c.is_alphabetic())
            .unwrap_or(rest.len());
        let unit = match &rest[..letters] {
            "" | "s" => 1.0,
            "m" | "min" => 60.0,
            "h" => 3600.0,
            _ => return Err(wrong()),
        };
        rest = rest[letters..].trim_start();
        seconds += value * unit;
    }
    match Duration::try_from_secs_f64(seconds) {
        Ok(d) if !d.is_zero() => Ok(d),
        _ => Err(format!("{text} is no time to render in")),
    }
}

/// `2%`, as a share.
fn parse_percent(text: &str) -> Result<f64, String> {
    let number = text
        .trim()
        .strip_suffix('%')
        .map(|n| n.trim().parse::<f64>());
    match number {
        Some(Ok(v)) if v > 0.0 && v <= 1000.0 => Ok(v / 100.0),
        _ => Err("it takes per cent, as in 2% or 0.5%".to_owned()),
    }
}

/// A bound: 0 or more, finite.
fn parse_bound(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v >= 0.0 => Ok(v),
        _ => Err("it takes a number of 0 or more".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        <Cli as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn durations() {
        for (text, seconds) in [
            ("30", 30.0),
            ("30s", 30.0),
            ("10m", 600.0),
            ("1.5h", 5400.0),
            ("1h30m", 5400.0),
            ("2min", 120.0),
        ] {
            let expected = Duration::from_secs_f64(seconds);
            assert_eq!(parse_duration(text), Ok(expected), "{text}");
        }
        for bad in [
            "",
            "s",
            "-3s",
            "1.2.3s",
            "3 fortnights",
            "0s",
            "1e99h",
            "nan",
        ] {
            assert!(parse_duration(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn per_cents() {
        assert_eq!(parse_percent("2%"), Ok(0.02));
        assert_eq!(parse_percent(" 0.5 % "), Ok(0.005));
        for bad in ["2", "0%", "-1%", "nan%", "%", "inf%", "x%"] {
            assert!(parse_percent(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn numbers() {
        assert_eq!(parse_numbers("1,-2, 3"), Ok([1, -2, 3]));
        assert!(parse_numbers::<i32, 3>("1,2").is_err(), "too few");
        assert_eq!(parse_resolution("640x480"), Ok([640, 480]));
        for bad in ["640", "0x3", "640x480x3", "x", "1x20000"] {
            assert!(parse_resolution(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_count("1e6"), Ok(1_000_000));
        assert_eq!(parse_count("2_500_000"), Ok(2_500_000));
        for bad in ["0", "1.5", "-1", "1e11", "x"] {
            assert!(parse_count(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn negative_coordinates_are_values() {
        let args = [
            "vpm-vdb", "info", "a.vdb", "--grid", "d", "--at", "-1,2,3", "4,-5,6", "--json",
        ];
        let cli = Cli::parse_from(args.map(|a| protect_negative(a.into())));
        let Command::Info(info) = cli.command else {
            panic!("not info");
        };
        assert_eq!(info.at, [[-1, 2, 3], [4, -5, 6]]);
        assert!(info.json, "--json after the list");
    }
}
