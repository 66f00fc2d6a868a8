//! A grid ready to be unpacked into the renderer's bricks.
//!
//! Reading a grid finds its tiles and the places of its leaves; [`ScalarGrid::decode_leaves`] then
//! unpacks the leaves on all threads straight to where the caller wants them. Nothing of the tree
//! is kept but two small arrays, so the peak of memory is the file plus the bricks.

use std::fmt;

use glam::{DMat4, IVec3};
use rayon::iter::{IndexedParallelIterator, ParallelIterator};
use rayon::slice::ParallelSliceMut;

use super::archive::Archive;
use super::codec::Work;
use super::error::{Fault, VdbError};
use super::header::GridClass;
use super::leaves::{Leaves, VOXELS};
use super::topology::Tile;
use super::tree::{Tree, TreePlace};
use super::value::{Scalar, Stored, ValueType, Vector};

/// A grid of numbers, every type as f32.
pub struct ScalarGrid<'a> {
    /// Value wherever neither a tile nor a leaf is.
    pub background: f32,
    /// Tiles that are active or differ from the background; they overlap no leaf.
    pub tiles: Vec<Tile>,
    /// Lowest index coordinates of each leaf: unique, multiples of 8, in the file's order.
    pub leaf_origins: Vec<IVec3>,
    /// Active mask of each leaf, bit `x << 6 | y << 3 | z`.
    pub leaf_masks: Vec<[u64; 8]>,
    /// Index to world for column vectors.
    pub index_to_world: DMat4,
    /// Its class.
    pub class: GridClass,
    archive: &'a Archive,
    index: usize,
    leaves: ScalarLeaves<'a>,
}

/// A grid of vectors, every type as f32.
pub struct Vec3Grid<'a> {
    /// Value wherever neither a tile nor a leaf is.
    pub background: [f32; 3],
    /// Tiles that are active or differ from the background; they overlap no leaf.
    pub tiles: Vec<Tile<[f32; 3]>>,
    /// Lowest index coordinates of each leaf: unique, multiples of 8, in the file's order.
    pub leaf_origins: Vec<IVec3>,
    /// Active mask of each leaf, bit `x << 6 | y << 3 | z`.
    pub leaf_masks: Vec<[u64; 8]>,
    /// Index to world for column vectors.
    pub index_to_world: DMat4,
    /// Its class.
    pub class: GridClass,
    archive: &'a Archive,
    index: usize,
    leaves: VectorLeaves<'a>,
}

enum ScalarLeaves<'a> {
    Half(Leaves<'a, half::f16>),
    Float(Leaves<'a, f32>),
    Double(Leaves<'a, f64>),
    Int32(Leaves<'a, i32>),
    Int64(Leaves<'a, i64>),
    Bool(Leaves<'a, bool>),
}

enum VectorLeaves<'a> {
    Vec3s(Leaves<'a, [f32; 3]>),
    Vec3d(Leaves<'a, [f64; 3]>),
    Vec3i(Leaves<'a, [i32; 3]>),
}

impl Archive {
    /// Reads the shape of a grid of numbers: float, half, double, int32, int64, bool or mask.
    pub fn read_scalar(&self, index: usize) -> Result<ScalarGrid<'_>, VdbError> {
        self.scalar(index)
            .map_err(|fault| self.error(Some(index), fault))
    }

    /// Reads the shape of a grid of vectors: vec3s, vec3d or vec3i.
    pub fn read_vec3(&self, index: usize) -> Result<Vec3Grid<'_>, VdbError> {
        self.vec3(index)
            .map_err(|fault| self.error(Some(index), fault))
    }

    /// The place and transform of a grid that can be rendered.
    fn affine_place(&self, index: usize) -> Result<(&TreePlace, DMat4, GridClass), Fault> {
        let (header, place) = self.place(index)?;
        match (&header.refused, header.index_to_world) {
            (None, Some(index_to_world)) => Ok((place, index_to_world, header.class)),
            (refused, _) => {
                let reason = refused
                    .as_ref()
                    .map_or("it has no transform", |r| r.reason());
                Err(Fault::Unsupported(reason.to_owned()))
            }
        }
    }

    fn scalar(&self, index: usize) -> Result<ScalarGrid<'_>, Fault> {
        let (place, index_to_world, class) = self.affine_place(index)?;
        macro_rules! read {
            ($T:ty, $Kind:ident) => {{
                let tree = Tree::<$T>::read(self.bytes(), place)?;
                Ok(ScalarGrid {
                    background: tree.topology.background.scalar(),
                    tiles: convert(tree.topology.tiles, <$T>::scalar),
                    leaf_origins: tree.topology.leaf_origins,
                    leaf_masks: tree.masks,
                    index_to_world,
                    class,
                    archive: self,
                    index,
                    leaves: ScalarLeaves::$Kind(tree.leaves),
                })
            }};
        }
        match place.value_type {
            ValueType::Half => read!(half::f16, Half),
            ValueType::Float => read!(f32, Float),
            ValueType::Double => read!(f64, Double),
            ValueType::Int32 => read!(i32, Int32),
            ValueType::Int64 => read!(i64, Int64),
            ValueType::Bool | ValueType::Mask => read!(bool, Bool),
            other => Err(Fault::WrongType {
                found: other.name(),
                wanted: "a number",
            }),
        }
    }

    fn vec3(&self, index: usize) -> Result<Vec3Grid<'_>, Fault> {
        let (place, index_to_world, class) = self.affine_place(index)?;
        macro_rules! read {
            ($T:ty, $Kind:ident) => {{
                let tree = Tree::<$T>::read(self.bytes(), place)?;
                Ok(Vec3Grid {
                    background: tree.topology.background.vector(),
                    tiles: convert(tree.topology.tiles, <$T>::vector),
                    leaf_origins: tree.topology.leaf_origins,
                    leaf_masks: tree.masks,
                    index_to_world,
                    class,
                    archive: self,
                    index,
                    leaves: VectorLeaves::$Kind(tree.leaves),
                })
            }};
        }
        match place.value_type {
            ValueType::Vec3s => read!([f32; 3], Vec3s),
            ValueType::Vec3d => read!([f64; 3], Vec3d),
            ValueType::Vec3i => read!([i32; 3], Vec3i),
            other => Err(Fault::WrongType {
                found: other.name(),
                wanted: "a vector (vec3)",
            }),
        }
    }
}

fn convert<T, V>(tiles: Vec<Tile<T>>, value: fn(T) -> V) -> Vec<Tile<V>> {
    tiles
        .into_iter()
        .map(|t| Tile {
            origin: t.origin,
            log2_size: t.log2_size,
            value: value(t.value),
            active: t.active,
        })
        .collect()
}

impl ScalarGrid<'_> {
    /// Unpacks every leaf on all threads. `place(i, values, chunk)` gets the 512 values of leaf i,
    /// inactive ones included, in the order `x << 6 | y << 3 | z`, and the i-th piece of `out`,
    /// `stride` long.
    ///
    /// # Panics
    /// If `out` is shorter than `stride` times the number of leaves.
    pub fn decode_leaves<F>(&self, out: &mut [f32], stride: usize, place: F) -> Result<(), VdbError>
    where
        F: Fn(usize, &[f32; VOXELS], &mut [f32]) + Sync,
    {
        match &self.leaves {
            ScalarLeaves::Half(l) => unpack_all(l, half::f16::scalar, out, stride, place),
            ScalarLeaves::Float(l) => unpack_all(l, f32::scalar, out, stride, place),
            ScalarLeaves::Double(l) => unpack_all(l, f64::scalar, out, stride, place),
            ScalarLeaves::Int32(l) => unpack_all(l, i32::scalar, out, stride, place),
            ScalarLeaves::Int64(l) => unpack_all(l, i64::scalar, out, stride, place),
            ScalarLeaves::Bool(l) => unpack_all(l, bool::scalar, out, stride, place),
        }
        .map_err(|fault| self.archive.error(Some(self.index), fault))
    }
}

impl Vec3Grid<'_> {
    /// As [`ScalarGrid::decode_leaves`], with vectors.
    ///
    /// # Panics
    /// If `out` is shorter than `stride` times the number of leaves.
    pub fn decode_leaves<F>(&self, out: &mut [f32], stride: usize, place: F) -> Result<(), VdbError>
    where
        F: Fn(usize, &[[f32; 3]; VOXELS], &mut [f32]) + Sync,
    {
        match &self.leaves {
            VectorLeaves::Vec3s(l) => unpack_all(l, <[f32; 3]>::vector, out, stride, place),
            VectorLeaves::Vec3d(l) => unpack_all(l, <[f64; 3]>::vector, out, stride, place),
            VectorLeaves::Vec3i(l) => unpack_all(l, <[i32; 3]>::vector, out, stride, place),
        }
        .map_err(|fault| self.archive.error(Some(self.index), fault))
    }
}

/// Leaves a thread takes at once at least: enough to hide the cost of its work buffers.
const LEAVES_PER_TASK: usize = 32;

/// All leaves in parallel; of several faults, the one of the first leaf is returned.
fn unpack_all<T, V, F>(
    leaves: &Leaves<'_, T>,
    value: fn(T) -> V,
    out: &mut [f32],
    stride: usize,
    place: F,
) -> Result<(), Fault>
where
    T: Stored,
    V: Copy + Default + Send,
    F: Fn(usize, &[V; VOXELS], &mut [f32]) + Sync,
{
    let needed = leaves.len() * stride;
    assert!(
        stride > 0 && out.len() >= needed,
        "out has no room for {} leaves",
        leaves.len()
    );
    let worst = out[..needed]
        .par_chunks_mut(stride)
        .enumerate()
        .with_min_len(LEAVES_PER_TASK)
        .map_init(
            || (Work::new(), [T::default(); VOXELS], [V::default(); VOXELS]),
            |(work, stored, values), (i, chunk)| {
                leaves.unpack(i, work, stored)?;
                for (v, &s) in values.iter_mut().zip(stored.iter()) {
                    *v = value(s);
                }
                place(i, values, chunk);
                Ok(())
            },
        )
        .enumerate()
        .filter_map(|(i, result): (usize, Result<(), Fault>)| result.err().map(|e| (i, e)))
        .min_by_key(|(i, _)| *i);
    worst.map_or(Ok(()), |(_, fault)| Err(fault))
}

impl fmt::Debug for ScalarGrid<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ScalarGrid")
            .field("background", &self.background)
            .field("tiles", &self.tiles.len())
            .field("leaves", &self.leaf_origins.len())
            .field("class", &self.class)
            .finish_non_exhaustive()
    }
}

impl fmt::Debug for Vec3Grid<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Vec3Grid")
            .field("background", &self.background)
            .field("tiles", &self.tiles.len())
            .field("leaves", &self.leaf_origins.len())
            .field("class", &self.class)
            .finish_non_exhaustive()
    }
}
