//! All integration tests in one binary.

mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
mod vdb_handmade;
mod vdb_mutations;
mod vdb_names;
