//! Scene file to scene: gathers every fault with line and column.
