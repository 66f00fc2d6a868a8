//! The study on disk: each finished run in a file of its own, so that nothing is rendered twice.
//!
//! `DIR/runs/plan.json` says what the runs belong to: scene, volumes, sweep, threads, program. A
//! study goes on only where all of it is unchanged; else it refuses and says what changed. A run
//! is one setting with one seed, or one part of the reference:
//!
//! ```text
//! "vpmrun01"  u32 length  JSON header  f32 pictures, one for each checkpoint, RGB row-major
//! ```
//!
//! little-endian. Files appear whole or not at all (`atomic`), so an interrupted study loses the
//! run in hand and nothing else.

use std::collections::BTreeMap;
use std::fs;
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::StudyError;
use crate::atomic;
use crate::report::Times;

const MAGIC: &[u8; 8] = b"vpmrun01";

/// What a study's runs depend on: a name and a digest of each part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint(pub BTreeMap<String, String>);

impl Fingerprint {
    /// The parts by name, each by the text that stands for it.
    #[must_use]
    pub fn new<'a>(parts: impl IntoIterator<Item = (&'a str, String)>) -> Self {
        Self(
            parts
                .into_iter()
                .map(|(name, text)| (name.to_owned(), digest(text.as_bytes())))
                .collect(),
        )
    }

    /// Names of the parts that differ.
    fn differences(&self, other: &Self) -> Vec<String> {
        let names = self.0.keys().chain(other.0.keys());
        let mut all: Vec<String> = names
            .filter(|n| self.0.get(*n) != other.0.get(*n))
            .cloned()
            .collect();
        all.sort();
        all.dedup();
        all
    }
}

/// What `plan.json` says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// The scene's photons of a pass over the study's: chosen by the budget when it began, and kept
    /// when it goes on with another one.
    pub fewer_photons: u64,
    /// What the runs depend on.
    pub made_from: Fingerprint,
}

impl Plan {
    fn file(folder: &Path) -> PathBuf {
        folder.join("runs").join("plan.json")
    }

    /// The plan of the study in `folder`, if there is one.
    ///
    /// # Errors
    /// [`StudyError`]: it cannot be read, or is no plan.
    pub fn read(folder: &Path) -> Result<Option<Self>, StudyError> {
        let file = Self::file(folder);
        match fs::read(&file) {
            Ok(bytes) => match serde_json::from_slice(&bytes) {
                Ok(plan) => Ok(Some(plan)),
                Err(e) => Err(StudyError::Damaged {
                    file,
                    reason: e.to_string(),
                }),
            },
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(StudyError::Io { file, source }),
        }
    }
}

/// 64 bits of FNV-1a, which never changes between versions: enough to tell edits, not attacks.
#[derive(Debug, Clone, Copy)]
struct Fnv(u64);

impl Hasher for Fnv {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
}

impl BuildHasher for Fnv {
    type Hasher = Self;
    fn build_hasher(&self) -> Self {
        *self
    }
}

fn digest(bytes: &[u8]) -> String {
    let mut hasher = Fnv(0xcbf2_9ce4_8422_2325).build_hasher();
    hasher.write(bytes);
    format!("{:016x}", hasher.finish())
}

/// Length and time of change of a file: what stands for its content.
#[must_use]
pub fn stamp(file: &Path) -> String {
    let Ok(meta) = fs::metadata(file) else {
        return "absent".to_owned();
    };
    let changed = meta
        .modified()
        .ok()
        .and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    format!("{} {} {changed:?}", file.display(), meta.len())
}

/// One checkpoint of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Passes so far.
    pub passes: u32,
    /// Since the render began, loading excluded. \[s\]
    pub seconds: f64,
    /// By stage.
    pub times: Times,
}

/// What a run's file says ahead of its pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Setting, or `reference`.
    pub name: String,
    /// Seed.
    pub seed: u64,
    /// Width and height. \[px\]
    pub resolution: [u32; 2],
    /// Checkpoints, rising.
    pub checkpoints: Vec<Checkpoint>,
    /// Pixels that were not finite in some pass.
    pub nonfinite_pixels: u64,
    /// Photons emitted and stored in all.
    pub photons: crate::report::PhotonCounts,
    /// Photons gathered and so on, in all.
    pub counters: crate::report::Counters,
}

/// RGB of each pixel, row-major. \[W/(m2 sr)\]
pub type Pixels = Vec<[f32; 3]>;

/// A finished run.
#[derive(Debug, Clone)]
pub struct Run {
    /// What it is.
    pub header: Header,
    /// One picture for each checkpoint.
    pub pictures: Vec<Pixels>,
}

/// The folder of a study.
#[derive(Debug)]
pub struct Store {
    runs: PathBuf,
}

impl Store {
    /// Opens or begins the study in `folder`. With `anew`, what another study left there is
    /// removed.
    ///
    /// # Errors
    /// [`StudyError`]: the folder holds another study, or cannot be used.
    pub fn open(folder: &Path, plan: &Plan, anew: bool) -> Result<Self, StudyError> {
        let runs = folder.join("runs");
        let io = |file: &Path| {
            let file = file.to_owned();
            move |source| StudyError::Io { file, source }
        };
        fs::create_dir_all(&runs).map_err(io(&runs))?;
        let file = Plan::file(folder);
        if anew {
            let old = fs::read_dir(&runs).map_err(io(&runs))?;
            for entry in old.filter_map(Result::ok) {
                let old = entry.path();
                if old == file || old.extension().is_some_and(|e| e == "run") {
                    fs::remove_file(&old).map_err(io(&old))?;
                }
            }
        }
        match Plan::read(folder)? {
            Some(old) => {
                let changed = old.made_from.differences(&plan.made_from);
                if !changed.is_empty() {
                    return Err(StudyError::OtherStudy {
                        folder: folder.to_owned(),
                        changed: changed.join(", "),
                    });
                }
            }
            None => {
                let text = serde_json::to_string_pretty(plan).map_err(|e| StudyError::Damaged {
                    file: file.clone(),
                    reason: e.to_string(),
                })?;
                atomic::write_bytes(&file, text.as_bytes())?;
            }
        }
        Ok(Self { runs })
    }

    fn file(&self, name: &str, seed: u64) -> PathBuf {
        self.runs.join(format!("{name}.{seed}.run"))
    }

    /// Keeps a run.
    ///
    /// # Errors
    /// [`StudyError`] where it cannot be written.
    pub fn put(&self, run: &Run) -> Result<(), StudyError> {
        let header = serde_json::to_vec(&run.header).map_err(|e| StudyError::Damaged {
            file: self.runs.clone(),
            reason: e.to_string(),
        })?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((header.len() as u32).to_le_bytes());
        bytes.extend(&header);
        for value in run.pictures.iter().flatten().flatten() {
            bytes.extend(value.to_le_bytes());
        }
        let file = self.file(&run.header.name, run.header.seed);
        Ok(atomic::write_bytes(&file, &bytes)?)
    }

    /// The run of a setting with a seed, if it is finished.
    ///
    /// # Errors
    /// [`StudyError`]: the file is there and damaged.
    pub fn get(&self, name: &str, seed: u64) -> Result<Option<Run>, StudyError> {
        let file = self.file(name, seed);
        let bytes = match fs::read(&file) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(StudyError::Io { file, source }),
        };
        parse(&bytes)
            .map(Some)
            .map_err(|reason| StudyError::Damaged { file, reason })
    }
}

fn parse(bytes: &[u8]) -> Result<Run, String> {
    let short = || "it ends early".to_owned();
    let (magic, rest) = bytes.split_first_chunk::<8>().ok_or_else(short)?;
    if magic != MAGIC {
        return Err("it is no run of a study".to_owned());
    }
    let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    let (text, data) = rest
        .split_at_checked(u32::from_le_bytes(*length) as usize)
        .ok_or_else(short)?;
    let header: Header = serde_json::from_slice(text).map_err(|e| e.to_string())?;
    let [width, height] = header.resolution.map(u64::from);
    let each = width.checked_mul(height).and_then(|n| n.checked_mul(12));
    let count = header.checkpoints.len() as u64;
    let (Some(each), true) = (each, count > 0) else {
        return Err("its header makes no sense".to_owned());
    };
    if each == 0 || each.checked_mul(count) != Some(data.len() as u64) {
        return Err(short());
    }
    let pictures = data
        .chunks_exact(each as usize)
        .map(|picture| {
            let (values, _) = picture.as_chunks::<4>();
            let values: Vec<f32> = values.iter().map(|b| f32::from_le_bytes(*b)).collect();
            let (pixels, _) = values.as_chunks::<3>();
            pixels.to_vec()
        })
        .collect();
    Ok(Run { header, pictures })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run() -> Run {
        Run {
            header: Header {
                name: "beam".to_owned(),
                seed: 3,
                resolution: [2, 1],
                checkpoints: vec![
                    Checkpoint {
                        passes: 1,
                        seconds: 0.5,
                        times: Times::default(),
                    };
                    2
                ],
                nonfinite_pixels: 0,
                photons: crate::report::PhotonCounts::default(),
                counters: crate::report::Counters::default(),
            },
            pictures: vec![vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], vec![[7.0; 3]; 2]],
        }
    }

    #[test]
    fn runs_come_back_and_damage_is_told() {
        let dir = std::env::temp_dir().join(format!("vpm-store-{}", std::process::id()));
        let plan = |scene: &str| Plan {
            fewer_photons: 8,
            made_from: Fingerprint::new([("scene", scene.to_owned())]),
        };
        let key = plan("a");
        let store = Store::open(&dir, &key, true).unwrap();
        store.put(&run()).unwrap();
        let back = store.get("beam", 3).unwrap().unwrap();
        assert_eq!(back.header, run().header);
        assert_eq!(back.pictures, run().pictures);
        assert!(store.get("beam", 4).unwrap().is_none(), "no such seed");

        let file = store.file("beam", 3);
        let bytes = fs::read(&file).unwrap();
        for length in [0, 7, 10, 40, bytes.len() - 1] {
            fs::write(&file, &bytes[..length]).unwrap();
            let error = store.get("beam", 3).unwrap_err().to_string();
            assert!(error.contains("damaged"), "{length} bytes: {error}");
        }

        assert_eq!(Plan::read(&dir).unwrap(), Some(plan("a")));
        let other = plan("b");
        let error = Store::open(&dir, &other, false).unwrap_err().to_string();
        assert!(error.contains("(changed: scene)"), "{error}");
        Store::open(&dir, &other, true).unwrap();
        assert!(!file.exists(), "begun anew");
        fs::remove_dir_all(&dir).unwrap();
    }
}
