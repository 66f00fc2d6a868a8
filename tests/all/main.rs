//! All integration tests in one binary.

mod surface;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
mod surface;
mod cli;
mod film_image;
mod scene_file;
mod vdb_corpus;
mod vdb_files;
