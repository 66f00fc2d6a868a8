//! All integration tests in one binary.

mod cli;
mod film_image;
mod scene_file;
mod surface;
mod transport;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
