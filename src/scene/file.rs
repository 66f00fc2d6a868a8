//! Mirror of the scene file's TOML text.
