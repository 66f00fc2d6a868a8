//! All integration tests in one binary.

mod cli;
mod fields;
mod film_image;
mod grid;
mod scene_file;
mod stats;
mod surface;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
