//! All integration tests in one binary.

mod accuracy;
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
mod scene_energy;
mod scene_file;
mod selftest;
mod stats;
mod surface;
mod transmittance;
mod transport;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
mod vdb_handmade;
mod vdb_mutations;
mod vdb_names;
