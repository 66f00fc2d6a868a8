//! All integration tests in one binary.

mod surface;
mod vdb_bad;
mod vdb_corpus;
mod vdb_files;
