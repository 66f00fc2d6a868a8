//! Why a study cannot be made.

use std::io;
use std::path::PathBuf;

use crate::atomic::OutputError;
use crate::image::ImageError;
use crate::render::RenderError;

/// Why a study cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// Rendering.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Loading.
    #[error(transparent)]
    Load(#[from] crate::grid::load::LoadError),
    /// Writing.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A picture.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file of the study.
    #[error("cannot use {}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file of the study that is not what it should be.
    #[error("{} is damaged: {reason}; remove it, and the study makes it again", file.display())]
    Damaged {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The folder is taken.
    #[error(
        "{} holds a study that was made differently (changed: {changed}); choose another folder with -o, or begin anew with --anew",
        folder.display()
    )]
    OtherStudy {
        /// The folder.
        folder: PathBuf,
        /// What changed.
        changed: String,
    },
    /// The reference picture does not fit.
    #[error("reference {}: {reason}", file.display())]
    Reference {
        /// The picture.
        file: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A plot could not be drawn.
    #[error("cannot draw {name}: {reason}")]
    Plot {
        /// Which.
        name: String,
        /// Why.
        reason: String,
    },
    /// Stopped before there was anything to show.
    #[error(
        "stopped before the first setting was done; what is finished is kept in {}, and the same command goes on",
        folder.display()
    )]
    TooEarly {
        /// The folder.
        folder: PathBuf,
    },
}
