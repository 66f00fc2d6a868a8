//! The command as people and scripts use it: outputs, messages whole, exit codes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use vpm_vdb::film::{Film, Sample};
use vpm_vdb::image::{Metadata, read_exr, write_exr};
use vpm_vdb::scene::Rgb;

/// Runs the command in a folder.
pub(crate) fn run(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vpm-vdb"))
        .args(args)
        .current_dir(folder)
        .output()
        .expect("the command starts")
}

fn scratch() -> tempfile::TempDir {
    tempfile::tempdir().expect("scratch folder")
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("an exit code")
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Writes a picture whose pixels are `values` in every channel.
fn picture(file: &Path, width: u32, values: &[f32], passes: u32) {
    let mut film = Film::new(width, values.len() as u32 / width, None);
    let pass: Vec<_> = values
        .iter()
        .map(|v| Sample {
            direct: Rgb::splat(*v),
            ..Sample::NOTHING
        })
        .collect();
    for _ in 0..passes {
        film.add_pass(&pass);
    }
    write_exr(file, &film, &Metadata::default()).expect("scratch picture");
}

#[test]
fn compare_prints_the_figures() {
    let dir = scratch();
    picture(&dir.path().join("a.exr"), 2, &[1.0, 3.0, 4.0, 0.0], 1);
    picture(&dir.path().join("b.exr"), 2, &[1.0, 2.0, 5.0, 0.0], 1);
    let out = run(dir.path(), &["compare", "a.exr", "b.exr", "--json"]);
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    // mean(b) = 2, so 0.01 mean(b)^2 = 0.04; relMSE = (1 / 4.04 + 1 / 25.04) / 4.
    let relmse = (1.0 / 4.04 + 1.0 / 25.04) / 4.0;
    let v: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["mean_ratio"], serde_json::json!([1.0, 1.0, 1.0]));
    assert!(
        (v["relmse"].as_f64().unwrap() - relmse).abs() < 1e-12,
        "{v}"
    );
    assert!(
        (v["rmse"].as_f64().unwrap() - 0.5_f64.sqrt()).abs() < 1e-12,
        "{v}"
    );
    assert_eq!(v["max_abs"], 1.0);
    assert_eq!(v["chi2"], serde_json::Value::Null);

    let out = run(dir.path(), &["compare", "a.exr", "b.exr"]);
    assert_eq!(
        stdout(&out),
        "mean ratio  1.000000 1.000000 1.000000\nRMSE        7.071068e-1\n\
         relMSE      7.186521e-2\nmax abs     1.000000e0\n"
    );
}

#[test]
fn compare_fails_past_the_bound() {
    let dir = scratch();
    picture(&dir.path().join("a.exr"), 1, &[1.1], 1);
    picture(&dir.path().join("b.exr"), 1, &[1.0], 1);
    picture(&dir.path().join("nan.exr"), 1, &[f32::NAN], 1);
    let bound = |a, x| {
        code(&run(
            dir.path(),
            &["compare", a, "b.exr", "--max-relmse", x],
        ))
    };
    // relMSE = 0.01 / 1.01
    assert_eq!(bound("a.exr", "0.0100"), 0);
    assert_eq!(bound("a.exr", "0.0098"), 1);
    assert_eq!(bound("b.exr", "0"), 0);
}

/// A picture with NaN in it never passes, however generous the bound.
#[test]
fn compare_fails_on_nan() {
    let dir = scratch();
    picture(&dir.path().join("b.exr"), 1, &[1.0, 1.0], 1);
    // A film never averages in NaN, so other programs' files have to bring it.
    let pixel = |_, y| (if y == 0 { f32::NAN } else { 1.0 }, 1.0_f32, 1.0_f32);
    exr::prelude::write_rgb_file(dir.path().join("a.exr"), 1, 2, pixel).unwrap();
    let out = run(
        dir.path(),
        &["compare", "a.exr", "b.exr", "--json", "--max-relmse", "9"],
    );
    assert_eq!(code(&out), 1);
    let v: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["nonfinite_pixels"], 1);
    assert_eq!(v["relmse"], 0.0);
}

#[test]
fn compare_uses_standard_errors() {
    let dir = scratch();
    let film = |a: f32, b: f32| {
        let mut film = Film::new(1, 1, None);
        for v in [a, b] {
            film.add_pass(&[Sample {
                direct: Rgb::splat(v),
                ..Sample::NOTHING
            }]);
        }
        film
    };
    let write = |name: &str, film: &Film| {
        write_exr(&dir.path().join(name), film, &Metadata::default()).unwrap();
    };
    // Means 2 and 5; standard errors 1 and 2: chi2 = 9 / 5.
    write("a.exr", &film(1.0, 3.0));
    write("b.exr", &film(3.0, 7.0));
    let out = run(dir.path(), &["compare", "a.exr", "b.exr", "--json"]);
    let v: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!((v["chi2"].as_f64().unwrap() - 1.8).abs() < 1e-6, "{v}");
}

#[test]
fn compare_draws_where_they_differ() {
    let dir = scratch();
    picture(&dir.path().join("a.exr"), 3, &[1.0, 2.0, 0.5], 1);
    picture(&dir.path().join("b.exr"), 3, &[1.0, 1.0, 1.0], 1);
    let out = run(
        dir.path(),
        &["compare", "a.exr", "b.exr", "--heatmap", "h.png"],
    );
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    let file = std::io::BufReader::new(fs::File::open(dir.path().join("h.png")).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; 9];
    reader.next_frame(&mut bytes).unwrap();
    assert_eq!(bytes[..6], [255, 255, 255, 255, 0, 0]);
    // (0.5 - 1) against sqrt(1.01): not quite half, so not quite full blue.
    assert_eq!(bytes[6..], [1, 1, 255]);
}

#[test]
fn compare_says_what_is_wrong() {
    let dir = scratch();
    picture(&dir.path().join("a.exr"), 1, &[1.0], 1);
    picture(&dir.path().join("b.exr"), 2, &[1.0, 1.0], 1);
    fs::write(dir.path().join("c.exr"), "no picture").unwrap();
    for (args, message) in [
        (
            ["a.exr", "b.exr"],
            "error: a.exr and b.exr: the pictures differ in size: 1x1 against 2x1; they have to \
             show the same pixels\n",
        ),
        (
            ["a.exr", "d.exr"],
            "error: cannot read d.exr: No such file or directory (os error 2)\n",
        ),
        (
            ["c.exr", "a.exr"],
            "error: cannot read c.exr as EXR: invalid: file identifier missing\n",
        ),
    ] {
        let out = run(dir.path(), &["compare", args[0], args[1]]);
        assert_eq!((code(&out), stderr(&out).as_str()), (2, message));
        assert_eq!(stdout(&out), "");
    }
}

/// A ball of fog in a light box, small enough for tests.
const FOG: &str = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nresolution = [24, 16]\n\
    [render]\nphotons = 2000\npasses = 3\n\
    [[fog]]\nbox = { min = [-1, -1, -1], max = [1, 1, 1] }\nextinction = 1\nalbedo = 0.8\n\
    [[light]]\npoint = { position = [0, 2, 0], power = 50 }\n";

#[test]
fn render_checks_everything_beforehand() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    fs::write(dir.path().join("bad.toml"), "[camera]\nposition = 3\n").unwrap();
    fs::create_dir(dir.path().join("folder.png")).unwrap();
    let sequence = "[[volume]]\nfile = \"s.####.vdb\"\nextinction = 1\nalbedo = 1\n";
    fs::write(dir.path().join("sequence.toml"), format!("{FOG}{sequence}")).unwrap();
    for (args, message) in [
        (
            &["bad.toml"][..],
            "error: the scene bad.toml has 2 faults\n\n\
             at bad.toml, line 1, column 1\n  |\n1 | [camera]\n  | ^^^^^^^^\n\
             `look_at` is missing in `camera`\n\n\
             at bad.toml, line 2, column 12\n  |\n2 | position = 3\n  |            ^\n\
             `position` is a whole number; it has to be [x, y, z]\n",
        ),
        (
            &["fog.toml", "-o", "x.png"],
            "error: the output x.png has to end in .exr; the PNG is written beside it\n",
        ),
        (
            &["fog.toml", "-o", "no/x.exr"],
            "error: cannot write no/x.exr: there is no folder no\n",
        ),
        (
            &["fog.toml", "-o", "folder.exr"],
            "error: cannot write folder.png: it is not a regular file\n",
        ),
        (
            &["fog.toml", "--crop", "0,0,30,10"],
            "error: --crop 0,0,30,10 has no pixels of a picture of 24x16; it takes X0 < X1 <= 24 \
             and Y0 < Y1 <= 16\n",
        ),
        (
            &["fog.toml", "--frames", "1-3"],
            "error: --frames needs a volume with #### or %04d in its file name; fog.toml has \
             none\n",
        ),
        (
            &["sequence.toml"],
            "error: s.####.vdb is a sequence; say which frames with --frames A-B\n",
        ),
        (
            &["sequence.toml", "--frames", "1-3"],
            "error: s.0001.vdb is not there (3 of the volume files are missing)\n",
        ),
        (
            &["none.toml"],
            "error: cannot read the scene none.toml: No such file or directory (os error 2)\n",
        ),
    ] {
        let out = run(dir.path(), &[&["render"], args].concat());
        assert_eq!(
            (code(&out), stderr(&out).as_str()),
            (2, message),
            "{args:?}"
        );
        assert_eq!(stdout(&out), "", "{args:?}");
    }
}

#[test]
fn options_that_mean_nothing_are_refused() {
    let dir = scratch();
    for (args, part) in [
        (&["render"][..], "required arguments were not provided"),
        (
            &["render", "a.toml", "--method", "beams"],
            "a similar value exists: 'beam'",
        ),
        (
            &["render", "a.toml", "--photons", "0"],
            "it takes a whole number from 1 to 10000000000",
        ),
        (
            &["render", "a.toml", "--time", "soon"],
            "`soon` is no time; write 30s, 10m, 1.5h or 1h30m",
        ),
        (
            &["render", "a.toml", "--resolution", "640"],
            "it takes width and height, as in 640x480",
        ),
        (
            &["render", "a.toml", "--crop", "1,2,3"],
            "it takes 4 whole numbers with commas",
        ),
        (
            &["render", "a.toml", "--frames", "9-3"],
            "the first frame, 9, comes after the last, 3",
        ),
        (
            &["render", "a.toml", "--threads", "0"],
            "0 is not in 1..=4096",
        ),
        (
            &["compare", "a", "b", "--max-relmse", "-1"],
            "it takes a number of 0 or more",
        ),
        (
            &["info", "a.vdb", "--at", "1,2"],
            "it takes 3 whole numbers with commas",
        ),
        (&["paint"], "unrecognized subcommand 'paint'"),
    ] {
        let out = run(dir.path(), args);
        assert_eq!(code(&out), 2, "{args:?}");
        assert!(stderr(&out).contains(part), "{args:?}: {}", stderr(&out));
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("scratch folder");
    let name = |e: std::io::Result<fs::DirEntry>| e.expect("entry").file_name();
    let mut names: Vec<_> = entries
        .map(|e| name(e).to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn render_writes_picture_and_report() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    let out = run(
        dir.path(),
        &["render", "fog.toml", "--report", "r.json", "--seed", "5"],
    );
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    let line = stdout(&out);
    assert!(line.starts_with("fog.exr fog.png  "), "{line}");
    assert!(
        line.contains(" s, 3 passes, error ") && line.ends_with(" % (noise alone)\n"),
        "{line}"
    );
    assert_eq!(
        names(dir.path()),
        ["fog.exr", "fog.png", "fog.toml", "r.json"]
    );

    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.path().join("r.json")).unwrap()).unwrap();
    assert_eq!(report["scene"], "fog");
    assert_eq!(report["method"], "beam");
    assert_eq!(report["resolution"], serde_json::json!([24, 16]));
    assert_eq!((&report["seed"], &report["passes"]), (&5.into(), &3.into()));
    assert!(
        report["time_s"]["total"].as_f64() > report["time_s"]["output"].as_f64(),
        "{report}"
    );
    assert!(
        report["image"]["mean"][0].as_f64().unwrap() > 0.0,
        "{report}"
    );
    if cfg!(target_os = "linux") {
        assert!(
            report["peak_rss_bytes"].as_u64().unwrap() > 1_000_000,
            "{report}"
        );
    }
}

#[test]
fn render_is_silent_when_told_so() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    let out = run(
        dir.path(),
        &["render", "fog.toml", "-o", "x.exr", "--quiet"],
    );
    assert_eq!(
        (code(&out), stdout(&out).as_str(), stderr(&out).as_str()),
        (0, "", "")
    );
    assert_eq!(names(dir.path()), ["fog.toml", "x.exr", "x.png"]);
}

/// The command line wins over `[render]`, and a crop holds the pixels that the whole picture has.
#[test]
fn a_crop_is_a_part_of_the_picture() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    let method = ["--method", "path", "--spp", "8", "--resolution", "20x10"];
    let whole = [&["render", "fog.toml", "-o", "a.exr"][..], &method].concat();
    let part = [
        &["render", "fog.toml", "-o", "b.exr", "--crop", "5,2,12,9"][..],
        &method,
    ]
    .concat();
    for args in [whole, part] {
        let out = run(dir.path(), &args);
        assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    }
    let a = read_exr(&dir.path().join("a.exr")).unwrap();
    let b = read_exr(&dir.path().join("b.exr")).unwrap();
    assert_eq!((a.width, a.height), (20, 10));
    assert_eq!((b.width, b.height, b.origin), (7, 7, [5, 2]));
    for y in 0..7 {
        for x in 0..7 {
            assert_eq!(
                b.rgb[y * 7 + x],
                a.rgb[(y + 2) * 20 + x + 5],
                "pixel {x}, {y}"
            );
        }
    }
}

#[test]
fn threads_change_nothing() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    for (threads, file) in [("1", "a.exr"), ("2", "b.exr"), ("5", "c.exr")] {
        let out = run(
            dir.path(),
            &["render", "fog.toml", "-o", file, "--threads", threads],
        );
        assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    }
    let read = |file: &str| fs::read(dir.path().join(file)).unwrap();
    for (one, other) in [("a.exr", "b.exr"), ("a.exr", "c.exr"), ("a.png", "c.png")] {
        assert!(read(one) == read(other), "{one} and {other} differ");
    }
}

#[test]
fn time_without_passes_is_used_up() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    let out = run(
        dir.path(),
        &["render", "fog.toml", "--time", "1s", "--report", "r.json"],
    );
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.path().join("r.json")).unwrap()).unwrap();
    // Three passes of this scene take milliseconds.
    assert!(report["passes"].as_u64().unwrap() > 3, "{report}");
}

#[test]
fn plan_names_every_effect() {
    let dir = scratch();
    fs::write(dir.path().join("fog.toml"), FOG).unwrap();
    let out = run(dir.path(), &["plan", "fog.toml", "--json"]);
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    let plan: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let effects = plan["effects"].as_array().unwrap();
    let names: Vec<_> = effects
        .iter()
        .map(|e| e["name"].as_str().unwrap())
        .collect();
    let expected = "absorption single_scattering multiple_scattering anisotropic_phase emission \
                    chromatic heterogeneous surfaces specular_surfaces surface_photons \
                    medium_boundaries area_lights environment depth_of_field";
    assert_eq!(names.join(" "), expected);
    let stages = plan["stages"].as_array().unwrap();
    let names: Vec<_> = stages.iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(names.join(" "), "load build photons map gather output");
    for s in stages {
        let seconds = s["seconds_estimate"].as_f64().unwrap();
        assert!(seconds.is_finite() && seconds >= 0.0, "{s}");
        assert!(s["memory_bytes"].is_u64(), "{s}");
    }
    for (stage, scattering) in [("photons", true), ("gather", true), ("load", false)] {
        let s = &stages[names.iter().position(|n| *n == stage).unwrap()];
        let bytes = s["memory_bytes"].as_u64().unwrap();
        assert_eq!(bytes > 0, scattering, "{s}: fog alone, no grid");
    }
    for e in effects {
        assert!(!e["reason"].as_str().unwrap().is_empty(), "{e}");
    }
}

#[test]
fn info_of_no_file() {
    let dir = scratch();
    let out = run(dir.path(), &["info", "none.vdb", "--json"]);
    assert_eq!((code(&out), stdout(&out).as_str()), (2, ""));
    // Once, though both the error and its cause say it.
    assert_eq!(
        stderr(&out).matches("No such file").count(),
        1,
        "{}",
        stderr(&out)
    );
}

/// A lone volume, and a sequence of them: the first frame sets the camera for all.
#[test]
fn volumes_without_a_scene() {
    let dir = scratch();
    let smoke = Path::new(env!("CARGO_MANIFEST_DIR")).join("volumes/rising_smoke.vdb");
    for name in ["smoke.vdb", "s.0004.vdb", "s.0005.vdb"] {
        fs::copy(&smoke, dir.path().join(name)).unwrap();
    }
    let quick = [
        "--resolution",
        "16x20",
        "--passes",
        "2",
        "--photons",
        "2000",
    ];
    let out = run(dir.path(), &[&["render", "smoke.vdb"][..], &quick].concat());
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    let frames = [
        "render",
        "s.####.vdb",
        "--frames",
        "4-5",
        "-o",
        "o.exr",
        "--report",
        "o.json",
    ];
    let out = run(dir.path(), &[&frames[..], &quick].concat());
    assert_eq!((code(&out), stderr(&out).as_str()), (0, ""));
    assert_eq!(stdout(&out).lines().count(), 2, "{}", stdout(&out));
    let expected = "o.0004.exr o.0004.json o.0004.png o.0005.exr o.0005.json o.0005.png \
                    s.0004.vdb s.0005.vdb smoke.exr smoke.png smoke.vdb";
    assert_eq!(names(dir.path()).join(" "), expected);
    // Equal volumes under one camera and one seed make equal pictures.
    let figures = ["compare", "o.0004.exr", "o.0005.exr", "--max-relmse", "0"];
    assert_eq!(code(&run(dir.path(), &figures)), 0);

    let out = run(dir.path(), &["render", "s.####.vdb"]);
    let message = "error: s.####.vdb is a sequence; say which with --frames A-B\n";
    assert_eq!((code(&out), stderr(&out).as_str()), (2, message));
}
