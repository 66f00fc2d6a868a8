//! Reading .vdb files: every grid that exporters write, and no harm from those that nobody should.
//!
//! ```text
//! layout     header, descriptors ──> GridHeader (name, type, class, transform)
//! topology   one grid's tree      ──> background, tiles, origins of the leaves
//! leaves     a scan of buffers    ──> where each leaf's values are
//! codec      one node's values    ──> 512 numbers, on all threads, straight into bricks
//! ```
//!
//! Covered: file versions 220 to 225, streamed files, instances, zip, Blosc and active-mask
//! compression, full and half floats, all scalar and vec3 types, all affine maps.
//! Refused by name, while the file's other grids load: points, frustums, unknown types.
//!
//! Nothing in a file is believed: each length is compared with the bytes there are before it is
//! used, and memory is in proportion to the file. `tests/all/vdb_*.rs` prove both.

mod archive;
mod blosc;
mod bytes;
mod codec;
mod density;
mod error;
mod grid;
mod header;
mod layout;
mod leaves;
mod lookup;
mod metadata;
mod opener;
mod stats;
mod topology;
mod transform;
mod tree;
mod value;

pub use archive::{Archive, FileVersion, Found};
pub use codec::Compression;
pub use density::{Cleaner, LevelSetToFog};
pub use error::{Fault, VdbError};
pub use grid::{ScalarGrid, Vec3Grid};
pub use header::{GridClass, GridHeader, Refusal};
pub use lookup::Probe;
pub use metadata::{MetaValue, Metadata};
pub use stats::{Histogram, Moments, Statistics};
pub use topology::Tile;
pub use value::{Value, ValueType};
