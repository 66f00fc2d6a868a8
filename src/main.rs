//! The `vpm-vdb` command.

fn main() {}
