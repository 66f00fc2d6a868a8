//! Renders that are stopped and go on: the same bytes as without a stop, and nothing is gone on
//! from that is damaged or of another render.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use vpm_vdb::progress::Progress;
use vpm_vdb::render::checkpoint::{Checkpoint, CheckpointError};
use vpm_vdb::render::{Exec, Rendered, render_kept};
use vpm_vdb::scene::{Method, Rgb, Scene};

const FOG: &str = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nresolution = [16, 12]\n\
    [render]\nphotons = 1500\npasses = 7\nspp = 1\n\
    [[fog]]\nbox = { min = [-1, -1, -1], max = [1, 1, 1] }\nextinction = 1.5\nalbedo = 0.8\n\
    [[light]]\nsun = { direction = [0.3, -1, 0], irradiance = 3 }\n[[light]]\nsky = { radiance = 0.3 }\n";

fn fog() -> Scene {
    Scene::from_text(Path::new("fog.toml"), FOG.to_owned()).expect("the scene of the test")
}

/// Stops a render in its pass number `in_pass`.
struct Stopping {
    in_pass: u32,
    passes: AtomicU32,
    stop: AtomicBool,
}

impl Progress for Stopping {
    fn stage(&self, name: &str, _total: Option<u64>) {
        if name.starts_with("pass") {
            let pass = self.passes.fetch_add(1, Ordering::Relaxed) + 1;
            if pass == self.in_pass {
                self.stop.store(true, Ordering::Relaxed);
            }
        }
    }
    fn advance(&self, _n: u64) {}
    fn finish(&self) {}
}

/// Renders, to be stopped in pass `in_pass` of this run.
fn run(scene: &Scene, keep: Option<&mut Checkpoint>, in_pass: u32) -> Rendered {
    let progress = Stopping {
        in_pass,
        passes: AtomicU32::new(0),
        stop: AtomicBool::new(false),
    };
    let exec = Exec {
        threads: Some(2),
        progress: &progress,
        time_limit: None,
        warn: &|text| panic!("unexpected warning: {text}"),
        stop: &progress.stop,
    };
    render_kept(scene, &exec, keep).expect("it renders")
}

fn scratch() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().expect("scratch folder");
    let file = dir.path().join("fog.checkpoint");
    (dir, file)
}

#[test]
fn stopped_twice_it_ends_in_the_same_bytes() {
    for method in Method::ALL {
        let mut scene = fog();
        scene.settings.method = method;
        if method == Method::Path {
            scene.settings.spp = 28;
        }
        let whole = run(&scene, None, u32::MAX);
        let (_dir, file) = scratch();
        let mut keep = Checkpoint::begin(&file, &scene).expect("no files");
        let part = run(&scene, Some(&mut keep), 2);
        assert!(part.stopped_early, "{method:?}: stopped");
        assert_eq!(part.film.passes(), 2, "{method:?}: passes before the stop");
        let mut keep = Checkpoint::resume(&file, &scene).expect("its own");
        let part = run(&scene, Some(&mut keep), 3);
        assert_eq!(
            part.film.passes(),
            5,
            "{method:?}: passes before the second"
        );
        let mut keep = Checkpoint::resume(&file, &scene).expect("its own");
        let end = run(&scene, Some(&mut keep), u32::MAX);
        assert!(!end.stopped_early, "{method:?}: to the end");
        assert!(
            end.film.to_bytes() == whole.film.to_bytes(),
            "{method:?}: another picture"
        );
        assert_eq!(end.report.photons, whole.report.photons, "{method:?}");
        keep.remove().expect("it is there");
        assert!(!file.exists(), "{method:?}: removed");
    }
}

/// More passes than before are no other render; fewer than there are cannot be had.
#[test]
fn passes_may_grow_and_not_shrink() {
    let scene = fog();
    let (_dir, file) = scratch();
    let mut keep = Checkpoint::begin(&file, &scene).expect("no files");
    run(&scene, Some(&mut keep), 4);
    let mut more = scene.clone();
    more.settings.passes = 9;
    let mut keep = Checkpoint::resume(&file, &more).expect("more passes");
    let whole = run(&more, None, u32::MAX).film.to_bytes();
    assert!(run(&more, Some(&mut keep), u32::MAX).film.to_bytes() == whole);
    let mut fewer = scene.clone();
    fewer.settings.passes = 3;
    let refused = Checkpoint::resume(&file, &fewer).expect_err("four are done");
    assert!(
        matches!(
            refused,
            CheckpointError::Further {
                done: 4,
                asked: 3,
                ..
            }
        ),
        "{refused}"
    );
}

#[test]
fn of_another_render_it_is_refused() {
    let mut scene = fog();
    let (dir, file) = scratch();
    let volume = dir.path().join("a.vdb");
    fs::write(&volume, [7; 3000]).expect("scratch");
    let mut entry = crate::fields::volume(Rgb::ONE, Rgb::ONE, vpm_vdb::scene::Phase::Isotropic);
    entry.file = volume.clone();
    scene.volumes.push(entry);
    // What is rendered does not matter here, what it is called does.
    let mut keep = Checkpoint::begin(&file, &scene).expect("a readable file");
    let stand_in = fog();
    run(&stand_in, Some(&mut keep), 2);
    let before = fs::read(&file).expect("a checkpoint");
    Checkpoint::resume(&file, &scene).expect("its own");
    let refused = |change: &dyn Fn(&mut Scene), expected: &str| {
        let mut other = scene.clone();
        change(&mut other);
        let error = Checkpoint::resume(&file, &other).expect_err("another render");
        assert!(
            matches!(error, CheckpointError::Other { part, .. } if part == expected),
            "{expected}: {error}"
        );
    };
    refused(&|s| s.settings.seed = 1, "the settings");
    refused(&|s| s.settings.photons += 1, "the settings");
    refused(&|s| s.settings.method = Method::Point, "the settings");
    refused(&|s| s.settings.crop = Some([0, 0, 8, 8]), "the settings");
    refused(&|s| s.camera.position.x += 1e-9, "the scene");
    refused(&|s| s.camera.resolution = [16, 13], "the scene");
    refused(&|s| s.fogs[0].optics.albedo.y = 0.79, "the scene");
    let content = "the content of a volume, mesh or texture";
    // One bit, somewhere.
    for at in [0, 1234, 2999] {
        let mut bytes = [7; 3000];
        bytes[at] ^= 0x10;
        fs::write(&volume, bytes).expect("scratch");
        refused(&|_| (), content);
    }
    fs::write(&volume, [7; 3001]).expect("scratch");
    refused(&|_| (), content);
    // The same bytes in another place are the same volume.
    let moved = dir.path().join("b.vdb");
    fs::write(&moved, [7; 3000]).expect("scratch");
    scene.volumes[0].file = moved;
    Checkpoint::resume(&file, &scene).expect("moved");
    assert!(before == fs::read(&file).expect("still there"), "untouched");
}

#[test]
fn damaged_it_is_refused_and_kept() {
    let scene = fog();
    let (_dir, file) = scratch();
    let mut keep = Checkpoint::begin(&file, &scene).expect("no files");
    run(&scene, Some(&mut keep), 2);
    let whole = fs::read(&file).expect("a checkpoint");
    let refused = |bytes: &[u8], how: &str| {
        fs::write(&file, bytes).expect("scratch");
        let error = Checkpoint::resume(&file, &scene).expect_err(how);
        assert!(
            matches!(error, CheckpointError::Damaged { .. }),
            "{how}: {error}"
        );
        assert!(fs::read(&file).expect("kept") == bytes, "{how}: untouched");
    };
    for length in (0..whole.len()).step_by(97).chain([whole.len() - 1]) {
        refused(&whole[..length], &format!("cut at {length}"));
    }
    for at in (0..whole.len()).step_by(101).chain([whole.len() - 1]) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        refused(&bytes, &format!("a bit of byte {at}"));
    }
    refused(&[&whole[..], b"\0"].concat(), "a byte more");
}

/// A checkpoint that cannot be written leaves the one before, and the render goes on.
#[test]
fn a_failed_write_loses_nothing() {
    let scene = fog();
    let (dir, file) = scratch();
    let mut keep = Checkpoint::begin(&file, &scene).expect("no files");
    run(&scene, Some(&mut keep), 2);
    let before = fs::read(&file).expect("a checkpoint");
    // A folder where the temporary file goes.
    let part = format!(".fog.checkpoint.{}.part", std::process::id());
    fs::create_dir(dir.path().join(part)).expect("scratch");
    let warnings = AtomicU32::new(0);
    let progress = Stopping {
        in_pass: 2,
        passes: AtomicU32::new(0),
        stop: AtomicBool::new(false),
    };
    let exec = Exec {
        threads: None,
        progress: &progress,
        time_limit: None,
        warn: &|text| {
            assert!(text.contains("fog.checkpoint"), "{text}");
            warnings.fetch_add(1, Ordering::Relaxed);
        },
        stop: &progress.stop,
    };
    let mut keep = Checkpoint::resume(&file, &scene).expect("its own");
    let rendered = render_kept(&scene, &exec, Some(&mut keep)).expect("it renders");
    assert_eq!(rendered.film.passes(), 4, "two more passes");
    assert_eq!(warnings.into_inner(), 1, "the user is told");
    assert!(
        fs::read(&file).expect("kept") == before,
        "the old one stays"
    );
}

fn vpm(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vpm-vdb"));
    command.args(args).current_dir(folder);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Ctrl-C, then `--resume`, as people do it.
#[cfg(unix)]
#[test]
fn ctrl_c_and_resume() {
    let dir = tempfile::tempdir().expect("scratch folder");
    fs::write(dir.path().join("fog.toml"), FOG).expect("scratch");
    let many = ["render", "fog.toml", "--passes", "1000000"];
    let child = vpm(dir.path(), &many)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    std::thread::sleep(Duration::from_millis(1500));
    let killed = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(killed.expect("kill").success(), "a signal is sent");
    let out: Output = child.wait_with_output().expect("it ends");
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(
        text(&out.stderr).contains("--resume"),
        "{}",
        text(&out.stderr)
    );
    let line = text(&out.stdout);
    let passes: u32 = line
        .split(", ")
        .nth(1)
        .and_then(|part| part.split(' ').next())
        .and_then(|n| n.parse().ok())
        .expect("a number of passes");
    let checkpoint = dir.path().join("fog.checkpoint");
    assert!(checkpoint.is_file(), "a checkpoint beside the picture");

    let other = ["render", "fog.toml", "--resume", "--seed", "3"];
    let out = vpm(dir.path(), &other).output().expect("it runs");
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));
    assert_eq!(
        text(&out.stderr),
        "error: the checkpoint fog.checkpoint is of another render, which differs in the \
         settings; render as before, or remove it to begin anew\n"
    );
    assert!(checkpoint.is_file(), "it is still there");

    let more = (passes + 2).to_string();
    let more = ["render", "fog.toml", "--passes", &more];
    let out = vpm(dir.path(), &[&more[..], &["--resume"]].concat())
        .output()
        .expect("it runs");
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(!checkpoint.exists(), "done, it is gone");
    let out = vpm(dir.path(), &[&more[..], &["-o", "whole.exr"]].concat())
        .output()
        .expect("it runs");
    assert!(out.status.success(), "{}", text(&out.stderr));
    for kind in ["exr", "png"] {
        let read = |name: &str| fs::read(dir.path().join(name)).expect("a picture");
        assert!(
            read(&format!("fog.{kind}")) == read(&format!("whole.{kind}")),
            "the {kind} differs"
        );
    }
    // Without a checkpoint --resume begins.
    let out = vpm(dir.path(), &["render", "fog.toml", "--resume"])
        .output()
        .expect("it runs");
    assert!(out.status.success(), "{}", text(&out.stderr));
}
