//! Statistics over a grid's active voxels, tiles counted with all their voxels, as OpenVDB does.
//!
//! mean m = Σ wᵢ vᵢ / Σ wᵢ, std² = Σ wᵢ vᵢ² / Σ wᵢ - m² (around a first value, for accuracy), wᵢ the
//! voxels of a tile or 1. Values that are not finite are counted and left out.
//!
//! Percentiles come from a histogram over the leading 16 bits of the value as f32 in an order that
//! preserves size: exact to 2⁻⁷ of the value. Sums are taken per piece of fixed length and then in
//! order, so the number of threads changes no bit.

use glam::IVec3;
use rayon::iter::{IndexedParallelIterator, ParallelIterator};
use rayon::slice::ParallelSlice;

use super::archive::Archive;
use super::bytes::ones;
use super::codec::Work;
use super::error::{Fault, VdbError};
use super::leaves::VOXELS;
use super::tree::{Tree, TreePlace, for_stored_type};
use super::value::{Stored, Value};

/// What a grid holds, from all its values.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// Value outside the tree.
    pub background: Value,
    /// Leaves of 8^3 voxels.
    pub leaves: usize,
    /// Tiles that are active or differ from the background.
    pub tiles: usize,
    /// Tiles among them that are 8^3 voxels.
    pub small_tiles: usize,
    /// Active voxels, those of tiles included.
    pub active_voxels: u64,
    /// Active voxels of leaves.
    pub leaf_voxels: u64,
    /// Lowest and highest active index coordinates, both inclusive.
    pub bbox: Option<[IVec3; 2]>,
    /// Per component; one for a number, three for a vector.
    pub components: Vec<Moments>,
    /// Active voxels with a component that is not finite.
    pub not_finite: u64,
    /// Active voxels with a negative component.
    pub negative: u64,
    /// Values (of a vector: lengths) of the active voxels.
    pub histogram: Histogram,
}

/// Range, mean and spread of the finite active values; all zero without any.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moments {
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the voxels.
    pub std: f64,
}

/// Counts of values by the leading 16 bits of their f32, in ascending order.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    counts: Vec<u64>,
}

impl Statistics {
    /// The value (of a vector: the length) below which the fraction `p` of the active voxels lies.
    pub fn percentile(&self, p: f64) -> Option<f64> {
        let v = self.histogram.percentile(p)?;
        // A bin's middle may lie beyond the extremes.
        Some(match self.components.as_slice() {
            [c] => v.clamp(c.min, c.max),
            _ => v,
        })
    }
}

impl Histogram {
    fn new() -> Self {
        Self {
            counts: vec![0; 1 << 16],
        }
    }

    /// Sign-magnitude bits become ascending: negative ones are flipped, others get the top bit.
    fn bin(v: f32) -> usize {
        let bits = v.to_bits();
        let ascending = if bits >> 31 != 0 {
            !bits
        } else {
            bits | 1 << 31
        };
        (ascending >> 16) as usize
    }

    /// A value inside the bin; zero for the bins at zero.
    fn value(bin: usize) -> f64 {
        let ascending = (bin as u32) << 16 | 1 << 15;
        let bits = if ascending >> 31 != 0 {
            ascending & !(1 << 31)
        } else {
            !ascending
        };
        let v = f32::from_bits(bits);
        if v.is_subnormal() { 0.0 } else { v.into() }
    }

    fn add(&mut self, v: f64, weight: u64) {
        // A double may be beyond what an f32 holds.
        let v = v.clamp(f32::MIN.into(), f32::MAX.into());
        let count = &mut self.counts[Self::bin(v as f32)];
        *count = count.saturating_add(weight);
    }

    fn merge(mut self, other: &Self) -> Self {
        for (a, b) in self.counts.iter_mut().zip(&other.counts) {
            *a = a.saturating_add(*b);
        }
        self
    }

    /// The value below which the fraction `p` of all values lies, if there is any.
    pub fn percentile(&self, p: f64) -> Option<f64> {
        let total: f64 = self.counts.iter().map(|&n| n as f64).sum();
        let mut below = 0.0;
        for (bin, &n) in self.counts.iter().enumerate() {
            below += n as f64;
            if n > 0 && below >= p * total {
                return Some(Self::value(bin));
            }
        }
        None
    }

    /// How many values lie in each of `n` equal steps from `min` to `max`.
    pub fn bars(&self, min: f64, max: f64, n: usize) -> Vec<u64> {
        let mut bars = vec![0u64; n];
        for (bin, &count) in self.counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            let step = (Self::value(bin) - min) / (max - min) * n as f64;
            let bar = &mut bars[(step.max(0.0) as usize).min(n - 1)];
            *bar = bar.saturating_add(count);
        }
        bars
    }
}

impl Archive {
    /// Unpacks grid `index` and sums it up. Works for frustum grids too.
    pub fn statistics(&self, index: usize) -> Result<Statistics, VdbError> {
        self.place(index)
            .and_then(|(_, place)| {
                for_stored_type!(
                    place.value_type,
                    T => statistics::<T>(self.bytes(), place),
                    _ => Err(Fault::Unsupported("its values are not read".to_owned()))
                )
            })
            .map_err(|fault| self.error(Some(index), fault))
    }
}

/// Leaves whose sums are taken together.
const PIECE: usize = 128;

fn statistics<T: Stored>(bytes: &[u8], place: &TreePlace) -> Result<Statistics, Fault> {
    let tree = Tree::<T>::read(bytes, place)?;
    let leaves = tree.leaves.len();
    let (mut sums, mut histogram) = tree
        .topology
        .leaf_origins
        .par_chunks(PIECE)
        .enumerate()
        .fold(
            || (Vec::new(), None, Work::new()),
            |(mut sums, histogram, mut work), (piece, origins)| {
                let mut histogram = histogram.unwrap_or_else(Histogram::new);
                let mut sum = Sums::new();
                let result = origins.iter().enumerate().try_for_each(|(n, &origin)| {
                    let i = piece * PIECE + n;
                    let mut values = [T::default(); VOXELS];
                    tree.leaves.unpack(i, &mut work, &mut values)?;
                    sum.leaf(origin, &tree.masks[i], &values, &mut histogram);
                    Ok(())
                });
                sums.push((piece, result.map(|()| sum)));
                (sums, Some(histogram), work)
            },
        )
        .map(|(sums, histogram, _)| (sums, histogram.unwrap_or_else(Histogram::new)))
        .reduce(
            || (Vec::new(), Histogram::new()),
            |(mut a, h), (b, i)| {
                a.extend(b);
                (a, h.merge(&i))
            },
        );
    sums.sort_unstable_by_key(|(piece, _)| *piece);

    let mut all = Sums::new();
    for (_, sum) in sums {
        all.merge(&sum?);
    }
    let leaf_voxels = all.active;
    for tile in tree.topology.tiles.iter().filter(|t| t.active) {
        let last = tile.origin + ((1 << tile.log2_size) - 1);
        let weight = 1u64 << (3 * tile.log2_size);
        all.bbox(tile.origin, last);
        all.voxels(tile.value, weight, &mut histogram);
    }
    let tiles = &tree.topology.tiles;
    Ok(Statistics {
        background: tree.topology.background.value(),
        leaves,
        tiles: tiles.len(),
        small_tiles: tiles.iter().filter(|t| t.log2_size == 3).count(),
        active_voxels: all.active,
        leaf_voxels,
        bbox: (all.active > 0).then_some([all.low, all.high]),
        components: all.components[..T::COMPONENTS]
            .iter()
            .map(Sum::moments)
            .collect(),
        not_finite: all.not_finite,
        negative: all.negative,
        histogram,
    })
}

struct Sums {
    active: u64,
    not_finite: u64,
    negative: u64,
    low: IVec3,
    high: IVec3,
    components: [Sum; 3],
}

/// Σw, Σw(v - shift), Σw(v - shift)²; the shift is the first value.
#[derive(Clone, Copy)]
struct Sum {
    min: f64,
    max: f64,
    shift: f64,
    weight: f64,
    first: f64,
    second: f64,
}

impl Sum {
    const NONE: Self = Self {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        shift: 0.0,
        weight: 0.0,
        first: 0.0,
        second: 0.0,
    };

    fn add(&mut self, v: f64, weight: f64) {
        if self.weight == 0.0 {
            self.shift = v;
        }
        let d = v - self.shift;
        self.min = self.min.min(v);
        self.max = self.max.max(v);
        self.weight += weight;
        self.first += weight * d;
        self.second += weight * d * d;
    }

    fn merge(&mut self, other: &Self) {
        if other.weight == 0.0 {
            return;
        }
        if self.weight == 0.0 {
            *self = *other;
            return;
        }
        // Σ(v - s)² = Σ(v - s')² + 2 (s' - s) Σ(v - s') + n (s' - s)²
        let d = other.shift - self.shift;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.weight += other.weight;
        self.first += other.first + other.weight * d;
        self.second += other.second + 2.0 * d * other.first + other.weight * d * d;
    }

    fn moments(&self) -> Moments {
        if self.weight == 0.0 {
            return Moments::default();
        }
        let off = self.first / self.weight;
        let variance = self.second / self.weight - off * off;
        Moments {
            min: self.min,
            max: self.max,
            mean: self.shift + off,
            std: variance.max(0.0).sqrt(),
        }
    }
}

impl Sums {
    fn new() -> Self {
        Self {
            active: 0,
            not_finite: 0,
            negative: 0,
            low: IVec3::MAX,
            high: IVec3::MIN,
            components: [Sum::NONE; 3],
        }
    }

    fn leaf<T: Stored>(
        &mut self,
        origin: IVec3,
        mask: &[u64; 8],
        values: &[T; VOXELS],
        histogram: &mut Histogram,
    ) {
        // The set bits of the words, or'ed together, give the extent in y and z.
        let mut rows = 0u64;
        for (x, &word) in mask.iter().enumerate().filter(|(_, w)| **w != 0) {
            rows |= word;
            self.low.x = self.low.x.min(origin.x + x as i32);
            self.high.x = self.high.x.max(origin.x + x as i32);
            for b in ones(word) {
                self.voxels(values[64 * x + b], 1, histogram);
            }
        }
        for b in ones(rows) {
            let (y, z) = (origin.y + (b >> 3) as i32, origin.z + (b & 7) as i32);
            self.low = self.low.min(IVec3::new(self.low.x, y, z));
            self.high = self.high.max(IVec3::new(self.high.x, y, z));
        }
    }

    fn bbox(&mut self, low: IVec3, high: IVec3) {
        self.low = self.low.min(low);
        self.high = self.high.max(high);
    }

    fn voxels<T: Stored>(&mut self, value: T, weight: u64, histogram: &mut Histogram) {
        self.active = self.active.saturating_add(weight);
        let numbers: [f64; 3] = std::array::from_fn(|a| {
            if a < T::COMPONENTS {
                value.component(a)
            } else {
                0.0
            }
        });
        let numbers = &numbers[..T::COMPONENTS];
        if numbers.iter().any(|v| !v.is_finite()) {
            self.not_finite = self.not_finite.saturating_add(weight);
            return;
        }
        if numbers.iter().any(|&v| v < 0.0) {
            self.negative = self.negative.saturating_add(weight);
        }
        for (sum, &v) in self.components.iter_mut().zip(numbers) {
            sum.add(v, weight as f64);
        }
        let size = match numbers {
            &[v] => v,
            _ => numbers.iter().map(|v| v * v).sum::<f64>().sqrt(),
        };
        histogram.add(size, weight);
    }

    fn merge(&mut self, other: &Self) {
        self.active = self.active.saturating_add(other.active);
        self.not_finite = self.not_finite.saturating_add(other.not_finite);
        self.negative = self.negative.saturating_add(other.negative);
        self.bbox(other.low, other.high);
        for (a, b) in self.components.iter_mut().zip(&other.components) {
            a.merge(b);
        }
    }
}
