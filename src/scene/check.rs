//! From a scene file to a valid [`Scene`], or to all of its faults with line and column.
//!
//! Order: the text has to be readable, then TOML (all syntax faults), then a scene (all faults of
//! keys, kinds and ranges). Each fault is shown in the form the `toml` crate has for its own:
//!
//! ```text
//! at scenes/cloud.toml, line 12, column 14
//!    |
//! 12 | extinction = -1.0
//!    |              ^^^^
//! `extinction` is -1; it has to be 0 or more
//! ```

use std::fmt;
use std::path::{Path, PathBuf};

use toml::de::DeTable;

use super::keys::{Fault, Faults, Keys};
use super::{Scene, file};

/// A scene file is no scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file cannot be read.
    #[error("cannot read the scene {}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file has faults.
    #[error(transparent)]
    Faults(#[from] SceneFaults),
}

/// All faults of a scene file, with the text to show them in.
#[derive(Debug, thiserror::Error)]
pub struct SceneFaults {
    file: PathBuf,
    text: String,
    faults: Vec<Fault>,
}

impl SceneFaults {
    /// Where and what, in the order of the text.
    pub fn faults(&self) -> &[Fault] {
        &self.faults
    }
}

impl Scene {
    /// Reads a scene file; on failure all its faults are reported.
    pub fn load(file: &Path) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(file).map_err(|source| SceneError::Read {
            file: file.to_owned(),
            source,
        })?;
        Ok(Self::from_text(file, text)?)
    }

    /// Reads the text of a scene file; `file` names the scene and is where relative paths start.
    pub fn from_text(file: &Path, text: String) -> Result<Self, SceneFaults> {
        let folder = file.parent().unwrap_or(Path::new(""));
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        match parse(folder, name.into_owned(), &text) {
            Ok(scene) => Ok(scene),
            Err(faults) => Err(SceneFaults {
                file: file.to_owned(),
                text,
                faults,
            }),
        }
    }
}

fn parse(folder: &Path, name: String, text: &str) -> Result<Scene, Vec<Fault>> {
    let faults = Faults::new(folder);
    let (document, errors) = DeTable::parse_recoverable(text);
    // One fault of syntax tends to cause more on its line: the first one is told.
    let mut line = None;
    for e in &errors {
        let span = e.span().unwrap_or(0..0);
        let here = text.as_bytes()[..span.start.min(text.len())]
            .iter()
            .filter(|b| **b == b'\n')
            .count();
        if line.replace(here) != Some(here) {
            faults.note(span, e.message());
        }
    }
    // The keys of a half-understood document would only add noise.
    let scene = if errors.is_empty() {
        // What is missing at top level is missing at the end of the file.
        let end = text.len()..text.len();
        let table = document.get_ref();
        Keys::read(table, end, "the scene", &faults, |t| file::scene(t, name))
    } else {
        None
    };
    match (scene, faults.into_sorted()) {
        (Some(scene), faults) if faults.is_empty() => Ok(scene),
        (_, faults) => Err(faults),
    }
}

impl fmt::Display for SceneFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = match self.faults.len() {
            1 => "a fault".to_owned(),
            n => format!("{n} faults"),
        };
        write!(f, "the scene {} has {count}", self.file.display())?;
        for fault in &self.faults {
            write!(f, "\n\n{}", Excerpt { all: self, fault })?;
        }
        Ok(())
    }
}

/// A fault under the line it is in.
struct Excerpt<'a> {
    all: &'a SceneFaults,
    fault: &'a Fault,
}

impl fmt::Display for Excerpt<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = &self.all.text;
        let at = floor_char(text, self.fault.span.start);
        let start = text[..at].rfind('\n').map_or(0, |i| i + 1);
        let line = text[start..].lines().next().unwrap_or("");
        let number = text[..start].matches('\n').count() + 1;
        let before = &text[start..at];
        // One caret at least, and none past the end of the line.
        let end = floor_char(text, self.fault.span.end).min(start + line.len());
        let marked = text.get(at..end).map_or(0, |s| s.chars().count()).max(1);
        let column = before.chars().count() + 1;

        let file = self.all.file.display();
        writeln!(f, "at {file}, line {number}, column {column}")?;
        let gutter = " ".repeat(number.to_string().len());
        writeln!(f, "{gutter} |")?;
        writeln!(f, "{number} | {line}")?;
        // Tabs stay tabs, so that the carets stand where the text does.
        let blank: String = before
            .chars()
            .map(|c| if c == '\t' { c } else { ' ' })
            .collect();
        writeln!(f, "{gutter} | {blank}{}", "^".repeat(marked))?;
        write!(f, "{}", self.fault.message)
    }
}

/// The largest character boundary up to `at`.
fn floor_char(text: &str, at: usize) -> usize {
    let at = at.min(text.len());
    (0..=at)
        .rev()
        .find(|i| text.is_char_boundary(*i))
        .unwrap_or(0)
}
