//! Checkpoints: a render that was stopped goes on later, to the same bytes.
//!
//! ```text
//! magic, fingerprints, work done, film (`Film::to_bytes`), checksum of all before it
//! ```
//!
//! Passes are independent and their random streams follow from seed and number, so the film after
//! n passes and n are the whole state. A checkpoint is written beside the picture, whole or not at
//! all (`atomic`), every `SAVE_EVERY` and when the render is stopped, and removed once the
//! picture is done.
//!
//! Fingerprints say what it is a checkpoint of: the program's version, the settings that change a
//! pass, the scene without the places of its files, and those files' bytes, read before the render
//! begins. The number of passes may differ: a finished picture's successor may have more. The hash
//! guards against mistakes, not against malice; what a .gltf or .obj file names in turn is not
//! looked into.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::passes::{Tally, pass_count};
use crate::atomic::{self, OutputError};
use crate::film::Film;
use crate::photon::Energy;
use crate::scene::{Light, Material, Method, Scene, Shape};
use crate::tracking::{EFFECTS, EffectCounts};

/// Time between checkpoints; at most one pass more. Longer: more is lost in a power cut; shorter:
/// more of the time goes into writing 132 bytes a pixel.
pub(super) const SAVE_EVERY: Duration = Duration::from_secs(60);

/// First bytes; the digit counts layouts.
const MAGIC: &[u8; 8] = b"vpmckpt2";

/// What the fingerprints are of.
const PARTS: [&str; 4] = [
    "the version of the program",
    "the settings",
    "the scene",
    "the content of a volume, mesh or texture",
];

/// Numbers of the work done.
const COUNTS: usize = 11 + EFFECTS;

/// Bytes ahead of the film.
const HEADER: usize = MAGIC.len() + 8 * (PARTS.len() + COUNTS);

/// A checkpoint cannot be gone on from.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// A file cannot be read.
    #[error("cannot read {}", file.display())]
    Read {
        /// The checkpoint, or a file of the scene.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Not what was written.
    #[error("the checkpoint {} is damaged: {reason}; remove it to begin anew", file.display())]
    Damaged {
        /// The checkpoint.
        file: PathBuf,
        /// How it shows.
        reason: String,
    },
    /// Of another render.
    #[error(
        "the checkpoint {} is of another render, which differs in {part}; render as before, or remove it to begin anew",
        file.display()
    )]
    Other {
        /// The checkpoint.
        file: PathBuf,
        /// What differs.
        part: &'static str,
    },
    /// It is further than asked for.
    #[error(
        "the checkpoint {} has {done} passes and {asked} are asked for; ask for as many or more, or remove it to begin anew",
        file.display()
    )]
    Further {
        /// The checkpoint.
        file: PathBuf,
        /// Its passes.
        done: u32,
        /// Asked for.
        asked: u32,
    },
}

/// Where the state of a render is kept, and the state to go on from.
#[derive(Debug)]
pub struct Checkpoint {
    file: PathBuf,
    of: [u64; PARTS.len()],
    saved: Option<(Film, [u64; COUNTS])>,
    /// The file is of this render.
    own: bool,
}

impl Checkpoint {
    /// A render from the start that keeps its state in `file`.
    ///
    /// # Errors
    /// [`CheckpointError::Read`]: a file of the scene cannot be read.
    pub fn begin(file: &Path, scene: &Scene) -> Result<Self, CheckpointError> {
        Ok(Self {
            file: file.to_owned(),
            of: fingerprints(scene)?,
            saved: None,
            own: false,
        })
    }

    /// A render that goes on from what `file` holds.
    ///
    /// # Errors
    /// [`CheckpointError`]: the file cannot be read, is damaged, or is of another render.
    pub fn resume(file: &Path, scene: &Scene) -> Result<Self, CheckpointError> {
        let bytes = fs::read(file).map_err(|source| CheckpointError::Read {
            file: file.to_owned(),
            source,
        })?;
        let damaged = |reason: String| CheckpointError::Damaged {
            file: file.to_owned(),
            reason,
        };
        if !bytes.starts_with(MAGIC) {
            return Err(damaged("other first bytes".to_owned()));
        }
        let Some((body, checksum)) = bytes
            .split_last_chunk::<8>()
            .filter(|(body, _)| body.len() >= HEADER)
        else {
            return Err(damaged("it ends early".to_owned()));
        };
        if hash(body) != u64::from_le_bytes(*checksum) {
            return Err(damaged("its checksum is wrong".to_owned()));
        }
        let (header, film) = body.split_at(HEADER);
        let mut numbers = header[MAGIC.len()..]
            .chunks_exact(8)
            .map(|b| u64::from_le_bytes(std::array::from_fn(|i| b[i])));
        let mut next = || numbers.next().unwrap_or(0);
        let found: [u64; PARTS.len()] = std::array::from_fn(|_| next());
        let counts = std::array::from_fn(|_| next());
        let film = Film::from_bytes(film).map_err(|e| damaged(e.to_string()))?;
        let this = Self::begin(file, scene)?;
        let differs = PARTS.iter().zip(this.of.iter().zip(&found));
        if let Some((part, _)) = differs.clone().find(|(_, (a, b))| a != b) {
            return Err(CheckpointError::Other {
                file: file.to_owned(),
                part,
            });
        }
        let asked = pass_count(&scene.settings);
        if film.passes() > asked {
            return Err(CheckpointError::Further {
                file: file.to_owned(),
                done: film.passes(),
                asked,
            });
        }
        Ok(Self {
            saved: Some((film, counts)),
            own: true,
            ..this
        })
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Takes the state to go on from.
    pub(super) fn take(&mut self) -> Option<(Film, Tally)> {
        let (film, counts) = self.saved.take()?;
        Some((film, Tally::from_counts(counts)))
    }

    /// Writes the state; the file before stays if that fails.
    pub(super) fn save(&mut self, film: &Film, tally: &Tally) -> Result<(), OutputError> {
        let mut bytes = MAGIC.to_vec();
        for number in self.of.into_iter().chain(tally.counts()) {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.append(&mut film.to_bytes());
        bytes.extend_from_slice(&hash(&bytes).to_le_bytes());
        atomic::write_bytes(&self.file, &bytes)?;
        self.own = true;
        Ok(())
    }

    /// Removes the file if it is of this render: the picture is done.
    ///
    /// # Errors
    /// The system's.
    pub fn remove(&self) -> io::Result<()> {
        if self.own {
            fs::remove_file(&self.file)
        } else {
            Ok(())
        }
    }
}

impl Tally {
    /// What was done, without the times, which are a run's own.
    fn counts(&self) -> [u64; COUNTS] {
        let (p, c, e) = (&self.photons, &self.counters, &self.energy);
        let mut counts = [0; COUNTS];
        let first: [u64; COUNTS - EFFECTS] = [
            p.emitted,
            p.stored,
            c.free_flights,
            c.transmittance_rays,
            c.density_lookups,
            c.gathered_photons,
            e.emitted.to_bits(),
            e.absorbed.to_bits(),
            e.on_surfaces.to_bits(),
            e.escaped.to_bits(),
            e.cut_off.to_bits(),
        ];
        counts[..COUNTS - EFFECTS].copy_from_slice(&first);
        counts[COUNTS - EFFECTS..].copy_from_slice(&c.effects.to_array());
        counts
    }

    /// From [`Tally::counts`].
    fn from_counts(counts: [u64; COUNTS]) -> Self {
        let mut this = Self::default();
        let mut energy = [0; 5];
        [
            this.photons.emitted,
            this.photons.stored,
            this.counters.free_flights,
            this.counters.transmittance_rays,
            this.counters.density_lookups,
            this.counters.gathered_photons,
            ..,
        ] = counts;
        let mut effects = [0; EFFECTS];
        effects.copy_from_slice(&counts[COUNTS - EFFECTS..]);
        this.counters.effects = EffectCounts::from_array(effects);
        energy.copy_from_slice(&counts[COUNTS - EFFECTS - 5..COUNTS - EFFECTS]);
        let [emitted, absorbed, on_surfaces, escaped, cut_off] = energy.map(f64::from_bits);
        this.energy = Energy {
            emitted,
            absorbed,
            on_surfaces,
            escaped,
            cut_off,
        };
        this
    }
}

/// What a render is of; see [`PARTS`].
fn fingerprints(scene: &Scene) -> Result<[u64; PARTS.len()], CheckpointError> {
    let mut scene = scene.clone();
    let mut files = Vec::new();
    for volume in &mut scene.volumes {
        files.push(std::mem::take(&mut volume.file));
    }
    for light in &mut scene.lights {
        if let Light::SkyImage { file, .. }
        | Light::Spot {
            image: Some(file), ..
        } = light
        {
            files.push(std::mem::take(file));
        }
    }
    for object in &mut scene.objects {
        if let Shape::Mesh { file } = &mut object.shape {
            files.push(std::mem::take(file));
        }
        if let Material::Diffuse {
            texture: Some(file),
            ..
        } = &mut object.material
        {
            files.push(std::mem::take(file));
        }
    }
    let mut settings = std::mem::take(&mut scene.settings);
    // They change how many passes there are and how the PNG looks, not what a pass is.
    settings.passes = 0;
    settings.exposure = 0.0;
    if settings.method == Method::Path {
        settings.spp = 0;
    }
    let mut contents = Vec::new();
    for file in &files {
        let content = hash_file(file).map_err(|source| CheckpointError::Read {
            file: file.clone(),
            source,
        })?;
        contents.extend_from_slice(&content.to_le_bytes());
    }
    // Debug writes every number so that it is read back as it was.
    Ok([
        hash(env!("CARGO_PKG_VERSION").as_bytes()),
        hash(format!("{settings:?}").as_bytes()),
        hash(format!("{scene:?}").as_bytes()),
        hash(&contents),
    ])
}

/// Bytes hashed at a time.
const BLOCK: usize = 1 << 20;

/// Goes on hashing with a block, all but the last of which are whole words long. For a given start
/// each step is one-to-one in the word: no single change goes unnoticed.
fn mix(start: u64, block: &[u8]) -> u64 {
    block.chunks(8).fold(start, |h, chunk| {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        (h.rotate_left(5) ^ u64::from_le_bytes(word)).wrapping_mul(0x517c_c1b7_2722_0a95)
    })
}

/// Ends a hash with the length, and lets every bit reach every other (MurmurHash3's finaliser).
fn finish(h: u64, length: u64) -> u64 {
    let mut h = mix(h, &length.to_le_bytes());
    h = (h ^ (h >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    h = (h ^ (h >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    h ^ (h >> 33)
}

fn hash(bytes: &[u8]) -> u64 {
    finish(mix(0, bytes), bytes.len() as u64)
}

/// As [`hash`] of the file's bytes, a block at a time.
fn hash_file(file: &Path) -> io::Result<u64> {
    let mut file = File::open(file)?;
    let (mut h, mut length) = (0, 0);
    let mut block = Vec::with_capacity(BLOCK);
    loop {
        block.clear();
        let read = file.by_ref().take(BLOCK as u64).read_to_end(&mut block)?;
        h = mix(h, &block);
        length += read as u64;
        if read < BLOCK {
            return Ok(finish(h, length));
        }
    }
}
