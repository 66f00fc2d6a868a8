//! All integration tests in one binary.

mod vdb_corpus;
mod vdb_files;
mod surface;
