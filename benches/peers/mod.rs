//! The other libraries' side of a bench: a small C++ program, built where that is possible.

use std::path::{Path, PathBuf};
use std::process::Command;

use glam::Vec3;
use vpm_vdb::grid::Grid;

/// The program.
pub(crate) struct Peers {
    program: PathBuf,
    scratch: tempfile::TempDir,
}

/// What it says of a set of points.
pub(crate) struct Answer {
    /// Which set.
    pub(crate) points: usize,
    /// 0: OpenVDB, 1: NanoVDB.
    pub(crate) library: usize,
    /// Best of its rounds.
    pub(crate) seconds: f64,
    /// Of all values.
    pub(crate) sum: f64,
}

impl Peers {
    /// Builds it; none, and a word why, where there is no compiler or no OpenVDB.
    pub(crate) fn build() -> Option<Self> {
        let scratch = tempfile::tempdir().expect("a scratch folder");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/lookup.cpp");
        let program = scratch.path().join("lookup");
        let built = Command::new("c++")
            .args(["-std=c++17", "-O3", "-DNDEBUG", "-march=native"])
            .arg(&source)
            .arg("-o")
            .arg(&program)
            .args(["-lopenvdb", "-ltbb"])
            .output();
        match built {
            Ok(output) if output.status.success() => Some(Self { program, scratch }),
            Ok(output) => {
                let text = String::from_utf8_lossy(&output.stderr);
                let first = text.lines().find(|l| l.contains("error")).unwrap_or("");
                println!("OpenVDB and NanoVDB left out, their program cannot be built: {first}");
                None
            }
            Err(error) => {
                println!("OpenVDB and NanoVDB left out, no C++ compiler: {error}");
                None
            }
        }
    }

    /// Has sets of local points looked up in the density of a file, some rounds each.
    pub(crate) fn lookups(
        &self,
        file: &Path,
        grid: &Grid,
        sets: &[&Vec<Vec3>],
        rounds: usize,
    ) -> Vec<Answer> {
        let mut command = Command::new(&self.program);
        command.arg(file).args(["density", &rounds.to_string()]);
        for (i, points) in sets.iter().enumerate() {
            let path = self.scratch.path().join(format!("points{i}"));
            let index = points
                .iter()
                .map(|p| p.as_dvec3() + grid.origin().as_dvec3());
            let bytes: Vec<u8> = index
                .flat_map(|p| p.to_array().map(f64::to_le_bytes))
                .flatten()
                .collect();
            std::fs::write(&path, bytes).expect("points are written");
            command.arg(path);
        }
        let output = command.output().expect("the peers' program runs");
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let text = String::from_utf8(output.stdout).expect("text");
        text.lines()
            .enumerate()
            .map(|(i, line)| {
                let mut words = line
                    .split(' ')
                    .skip(1)
                    .map(|w| w.parse().expect("a number"));
                let mut next = || words.next().expect("two numbers");
                Answer {
                    points: i / 2,
                    library: i % 2,
                    seconds: next(),
                    sum: next(),
                }
            })
            .collect()
    }
}
