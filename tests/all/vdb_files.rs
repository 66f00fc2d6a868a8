//! The folder of test volumes, which lies beside the repository; tests say so where it is absent.

use std::path::{Path, PathBuf};

use serde_json::Value;

/// A folder of the test volumes, or `None` with a message that the test is skipped.
pub(crate) fn folder(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared/vdb")
        .join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    println!(
        "SKIPPED: there is no folder {} with volumes to test with",
        folder.display()
    );
    None
}

/// The .vdb files of a folder, in order of their names.
pub(crate) fn vdb_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .expect("the folder can be listed")
        .map(|entry| entry.expect("the entry can be read").path())
        .filter(|path| path.extension().is_some_and(|e| e == "vdb"))
        .collect();
    files.sort();
    files
}

/// The expected values beside a file.
pub(crate) fn json(path: &Path) -> Value {
    let text = std::fs::read(path).expect("the sidecar can be read");
    serde_json::from_slice(&text).expect("the sidecar is JSON")
}
