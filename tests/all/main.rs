//! All integration tests in one binary.

mod cli;
mod determinism;
mod fields;
mod film_image;
mod grid;
mod scene_file;
mod segments;
mod stats;
mod surface;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
mod vdb_handmade;
mod vdb_mutations;
mod vdb_names;
