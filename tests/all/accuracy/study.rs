//! The study: figures that are what they say, runs that resume, a page that opens.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::study::{Reference, figures, slope};

use super::{fog, normal};
use crate::cli::{self, stderr, stdout};
use crate::stats::{Welford, z_bound};

/// Pictures with a known bias, noise that a block of pixels shares in part as photons' does, and a
/// noisy reference: the estimates hit the truth on average, and the intervals hold it as often as
/// they say.
#[test]
fn bias_and_variance_are_told_apart() {
    const PIXELS: usize = 256;
    const SEEDS: usize = 4;
    let (bias, shared, own, reference_sd) = (0.05f64, 0.04f64, 0.1f64, 0.02f64);
    let truth: Vec<f64> = (0..PIXELS).map(|i| 0.5 + i as f64 / 255.0).collect();
    let n = PIXELS as f64;
    let floor = 0.01 * (truth.iter().sum::<f64>() / n).powi(2);
    let over = |sd: f64| truth.iter().map(|t| sd * sd / (t * t + floor)).sum::<f64>() / n;
    // The weight w = 1 / (R^2 + floor) shares the reference's noise n, of variance V: to first order
    // E[w ((bias - n)^2 - V)] = w bias^2 + 4 bias V R w^2.
    let along: f64 = truth
        .iter()
        .map(|t| 4.0 * bias * reference_sd.powi(2) * t / (t * t + floor).powi(2))
        .sum();
    let exact = [over(bias) + along / n, over(shared) + over(own)];
    let mut found = [Welford::default(); 3];
    let mut held = [0; 3];
    let trials = 400;
    let mut rng = Rng::stream(11, Stage::Check, 9, 0);
    for _ in 0..trials {
        let pictures: Vec<Vec<[f32; 3]>> = (0..SEEDS)
            .map(|_| {
                let mut block = 0.0;
                truth
                    .iter()
                    .enumerate()
                    .map(|(i, t)| {
                        if i % 16 == 0 {
                            block = normal(&mut rng);
                        }
                        [(); 3]
                            .map(|()| (t + bias + shared * block + own * normal(&mut rng)) as f32)
                    })
                    .collect()
            })
            .collect();
        let reference = Reference {
            mean: truth
                .iter()
                .map(|t| [(); 3].map(|()| t + reference_sd * normal(&mut rng)))
                .collect(),
            variance: vec![[reference_sd * reference_sd; 3]; PIXELS],
        };
        let f = figures(&pictures, &reference, None);
        let [b, v] = [f.bias2.unwrap(), f.variance.unwrap()];
        let exact = [exact[0], exact[1], exact[0] + exact[1]];
        for (i, interval) in [b, v, f.relmse].iter().enumerate() {
            found[i].add(interval.value);
            let inside = interval.low.unwrap() <= exact[i] && exact[i] <= interval.high.unwrap();
            held[i] += u32::from(inside);
        }
    }
    // Of second order, 3 V / R^2: below 0.5 %.
    for (i, exact) in [exact[0], exact[1], exact[0] + exact[1]].iter().enumerate() {
        let off = (found[i].mean() / exact - 1.0).abs();
        let noise = z_bound(3) * found[i].standard_error() / exact;
        let share = f64::from(held[i]) / f64::from(trials);
        println!("figure {i}: {off:.4} off, noise {noise:.4}, intervals hold {share:.3}");
        assert!(off < 0.005 + noise, "figure {i}: {off} off, noise {noise}");
        // A binomial of 95 % in 400 trials has a standard deviation of 1.1 %; jackknife intervals
        // of four seeds are not exact.
        assert!(share > 0.90, "figure {i}: intervals hold {share}");
    }
}

#[test]
fn slopes_are_those_of_power_laws() {
    let points: Vec<(f64, f64)> = (1..6)
        .map(|i| (f64::from(i), f64::from(i).powf(-0.7)))
        .collect();
    assert!((slope(&points).unwrap() + 0.7).abs() < 1e-12, "slope");
    assert_eq!(slope(&points[..1]), None, "one point has no slope");
    assert_eq!(slope(&[(1.0, 1.0), (2.0, -1.0)]), None, "no logarithm");
}

fn scene(albedo: f64) -> String {
    fog(
        [24, 16],
        1.0,
        "photons = 1600\nneighbours = 20\nmax_bounces = 4",
    )
    .replace("albedo = 0.8", &format!("albedo = {albedo}"))
}

const STUDY: [&str; 7] = [
    "study",
    "fog.toml",
    "-o",
    "out",
    "--quick",
    "--threads",
    "1",
];

fn run(folder: &Path, arguments: &[&str]) -> Output {
    cli::run(folder, &[&STUDY, arguments].concat())
}

/// A folder with a finished quick study of a small fog.
fn studied() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("scratch folder");
    fs::write(dir.path().join("fog.toml"), scene(0.8)).expect("scratch scene");
    let out = run(dir.path(), &[]);
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
    dir
}

fn runs(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder.join("out/runs"))
        .expect("runs")
        .map(|e| e.expect("an entry").path())
        .filter(|p| p.extension().is_some_and(|e| e == "run"))
        // Parts of the reference follow the clock.
        .filter(|p| !p.to_string_lossy().contains("reference"))
        .collect();
    files.sort();
    files
}

/// When each file was written.
fn stamps(files: &[PathBuf]) -> Vec<SystemTime> {
    files
        .iter()
        .map(|f| {
            let known = fs::metadata(f).and_then(|m| m.modified());
            known.expect("a file of the study")
        })
        .collect()
}

#[test]
fn a_study_is_whole_resumes_and_refuses_what_changed() {
    let dir = studied();
    let folder = dir.path();
    for name in [
        "study.csv",
        "study.json",
        "index.html",
        "error-time.svg",
        "error-step.svg",
    ] {
        let length = fs::metadata(folder.join("out").join(name)).map(|m| m.len());
        assert!(length.is_ok_and(|n| n > 200), "{name}");
    }
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("out/study.json")).unwrap()).unwrap();
    let rows = json["rows"].as_array().unwrap();
    for method in ["beam", "point", "path"] {
        let row = rows.iter().rfind(|r| r["setting"] == method).unwrap();
        assert_eq!(row["seeds"], 3, "{method}");
        assert!(row["relmse"]["value"].as_f64().unwrap() > 0.0, "{method}");
        assert!(row["relmse"]["low"].is_f64(), "{method} has an interval");
    }
    let choice = &json["targets"][0]["choice"];
    assert!(
        choice["options"].as_str().unwrap().contains("--method"),
        "{choice}"
    );

    // Nothing is rendered twice; what is missing is.
    let before = runs(folder);
    let old = stamps(&before);
    let lines = || {
        let csv = fs::read_to_string(folder.join("out/study.csv")).unwrap();
        csv.lines().count()
    };
    let rows_before = lines();
    fs::remove_file(&before[3]).unwrap();
    let out = run(folder, &[]);
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
    let after = runs(folder);
    assert_eq!(before, after, "the missing run is there again");
    let changed = old
        .iter()
        .zip(stamps(&after))
        .filter(|(a, b)| **a != *b)
        .count();
    assert_eq!(changed, 1, "runs made again");
    assert_eq!(rows_before, lines(), "rows");

    // A changed scene is another study.
    fs::write(folder.join("fog.toml"), scene(0.7)).unwrap();
    let out = run(folder, &[]);
    assert_eq!(out.status.code(), Some(2));
    let message = stderr(&out);
    assert!(
        message.contains("(changed: scene)") && message.contains("--anew"),
        "{message}"
    );
    let out = run(folder, &["--anew", "--budget", "1s"]);
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));

    // A damaged run is told by name.
    let file = &runs(folder)[0];
    fs::write(file, b"vpmrun01").unwrap();
    let out = run(folder, &["--budget", "1s"]);
    assert_eq!(out.status.code(), Some(2));
    let name = file.file_name().unwrap().to_string_lossy().into_owned();
    let message = stderr(&out);
    assert!(
        message.contains(&name) && message.contains("damaged"),
        "{message}"
    );
}

/// A study that is killed loses the run in hand; the same command makes the rest.
#[test]
fn a_killed_study_goes_on() {
    let dir = tempfile::tempdir().expect("scratch folder");
    fs::write(dir.path().join("fog.toml"), scene(0.8)).expect("scratch scene");
    let mut child = Command::new(env!("CARGO_BIN_EXE_vpm-vdb"))
        .args(STUDY)
        .current_dir(dir.path())
        .stdout(Stdio::null())
        .spawn()
        .expect("the command starts");
    let begun = || dir.path().join("out/runs").is_dir() && runs(dir.path()).len() >= 4;
    let patience = Instant::now();
    while !begun() {
        assert!(
            patience.elapsed() < Duration::from_secs(300),
            "no runs appear"
        );
        thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("it is still at work");
    child.wait().expect("it ends");
    let kept = runs(dir.path());
    assert!(
        !dir.path().join("out/index.html").exists(),
        "it was at work"
    );
    let old = stamps(&kept);
    let out = run(dir.path(), &[]);
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
    assert_eq!(old, stamps(&kept), "finished runs are kept");
    assert!(runs(dir.path()).len() > kept.len(), "the rest is made");
    assert!(dir.path().join("out/index.html").exists(), "the page");
}

#[test]
fn a_reference_that_does_not_fit_is_refused() {
    let dir = tempfile::tempdir().expect("scratch folder");
    fs::write(dir.path().join("fog.toml"), scene(0.8)).unwrap();
    let pixel = |_, _| (1.0_f32, 1.0_f32, 1.0_f32);
    exr::prelude::write_rgb_file(dir.path().join("square.exr"), 16, 16, pixel).unwrap();
    let out = run(dir.path(), &["--reference", "square.exr"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(
        stderr(&out).contains("its shape, 16x16"),
        "{}",
        stderr(&out)
    );
    let out = run(dir.path(), &["--reference", "none.exr"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(stderr(&out).contains("none.exr"), "{}", stderr(&out));
}

/// The page opens from disk without the network and without a word on the console.
#[test]
fn the_page_opens_in_a_browser() {
    let dir = studied();
    let page = dir.path().join("out/index.html");
    let html = fs::read_to_string(&page).unwrap();
    for outside in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!html.contains(outside), "{outside}");
    }
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let browser = names.iter().find(|name| {
        let version = Command::new(name).arg("--version").output();
        version.is_ok_and(|v| v.status.success())
    });
    let Some(browser) = browser else {
        println!("skipped: no chromium on this machine (Debian: apt-get install chromium)");
        return;
    };
    // What the script did: the slider's value moved the edge.
    let probe = "<script>const r=document.querySelector('.pictures input');r.value=25;\
        r.dispatchEvent(new Event('input'));document.title='edge '+\
        document.querySelector('.slide').style.getPropertyValue('--edge')+' wide '+\
        (document.documentElement.scrollWidth<=innerWidth)+' images '+\
        [...document.images].every(i=>i.complete&&i.naturalWidth>0)</script></html>";
    let probed = dir.path().join("out/probed.html");
    fs::write(&probed, html.replace("</html>", probe)).unwrap();
    let out = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-logging=stderr",
        ])
        .arg(format!(
            "--user-data-dir={}",
            dir.path().join("profile").display()
        ))
        .args([
            "--window-size=500,800",
            "--virtual-time-budget=3000",
            "--dump-dom",
        ])
        .arg(format!("file://{}", probed.display()))
        .output()
        .expect("the browser starts");
    let dom = stdout(&out);
    let title = dom
        .split("<title>")
        .nth(1)
        .and_then(|t| t.split('<').next());
    assert_eq!(
        title,
        Some("edge 25% wide true images true"),
        "{}",
        stderr(&out)
    );
    let console: Vec<String> = stderr(&out)
        .lines()
        .filter(|l| l.contains("CONSOLE"))
        .map(str::to_owned)
        .collect();
    assert!(console.is_empty(), "{console:?}");
}
