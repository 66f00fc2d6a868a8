//! Files appear whole or not at all.
//!
//! A file is written under a temporary name beside its place and then renamed onto it, so an
//! interrupted or failed write leaves the previous file as it was and nothing half-written.
//! [`check_writable`] asks the same questions before hours of rendering, not after.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// An output file cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The folder is missing.
    #[error("cannot write {}: there is no folder {}", file.display(), folder.display())]
    NoFolder {
        /// Asked for.
        file: PathBuf,
        /// Missing.
        folder: PathBuf,
    },
    /// Something other than a file is in the place.
    #[error("cannot write {}: it is not a regular file", file.display())]
    NotAFile {
        /// Asked for.
        file: PathBuf,
    },
    /// The system refuses.
    #[error("cannot write {}", file.display())]
    Io {
        /// Asked for.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Where the bytes go for now, and where the file will be.
struct Place {
    temporary: PathBuf,
    target: PathBuf,
}

/// Follows a link, so that the link stays and the file it names is replaced.
fn place(file: &Path) -> Result<Place, OutputError> {
    let io = |source| OutputError::Io {
        file: file.to_owned(),
        source,
    };
    let target = match fs::metadata(file) {
        Ok(m) if m.is_file() && m.permissions().readonly() => {
            return Err(io(io::Error::new(
                io::ErrorKind::PermissionDenied,
                "the file is there and is write-protected",
            )));
        }
        Ok(m) if m.is_file() => fs::canonicalize(file).map_err(io)?,
        Ok(_) => {
            return Err(OutputError::NotAFile {
                file: file.to_owned(),
            });
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound => file.to_owned(),
        Err(e) => return Err(io(e)),
    };
    let folder = match target.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(OutputError::NoFolder {
            file: file.to_owned(),
            folder: folder.to_owned(),
        });
    }
    let Some(name) = target.file_name() else {
        return Err(OutputError::NotAFile {
            file: file.to_owned(),
        });
    };
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{}.part", std::process::id()));
    Ok(Place {
        temporary: folder.join(temporary),
        target,
    })
}

/// Removes the temporary file unless it was renamed.
struct Part(Option<PathBuf>);

impl Drop for Part {
    fn drop(&mut self) {
        if let Some(path) = self.0.take() {
            // Nothing more can be done if even this fails.
            let _ = fs::remove_file(path);
        }
    }
}

/// Can `file` be written? Leaves no trace.
pub fn check_writable(file: &Path) -> Result<(), OutputError> {
    let Place { temporary, .. } = place(file)?;
    File::create(&temporary)
        .map_err(|source| OutputError::Io {
            file: file.to_owned(),
            source,
        })
        .map(|_| drop(Part(Some(temporary))))
}

/// Writes `file` with `fill`, whole or not at all.
pub fn write<E: From<OutputError>>(
    file: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), E> {
    let io = |source| OutputError::Io {
        file: file.to_owned(),
        source,
    };
    let Place { temporary, target } = place(file)?;
    let mut out = BufWriter::new(File::create(&temporary).map_err(io)?);
    let mut part = Part(Some(temporary.clone()));
    fill(&mut out)?;
    out.flush().map_err(io)?;
    // On disk before the name changes: a power cut leaves the old file or the new one.
    out.get_ref().sync_all().map_err(io)?;
    drop(out);
    fs::rename(&temporary, &target).map_err(io)?;
    part.0 = None;
    Ok(())
}

/// Writes `bytes` as `file`, whole or not at all.
pub fn write_bytes(file: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write(file, |out| {
        out.write_all(bytes).map_err(|source| OutputError::Io {
            file: file.to_owned(),
            source,
        })
    })
}
