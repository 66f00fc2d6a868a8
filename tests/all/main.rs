//! All integration tests in one binary.

mod agreement;
mod cli;
mod effects;
mod fields;
mod film_image;
mod furnace;
mod grid;
mod grid_values;
mod lights;
mod main_job;
mod point;
mod resume;
mod scene_file;
mod selftest;
mod stats;
mod study;
mod surface;
mod target_error;
mod transmittance;
mod transport;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
mod vdb_handmade;
mod vdb_mutations;
mod vdb_names;
