//! Photons sorted into the tiles of a picture: which of them a tile of 8 x 8 camera rays can meet.
//!
//! Camera rays of a pinhole are coherent: a photon's sphere projects to a small rectangle of
//! pixels. Photons are sorted into bands of 8 rows, each band's photons into tiles of 8 columns.
//!
//! The projected rectangle is exact: a sphere of radius r at (x, z), z > r, is seen between the
//! slopes (x z -+ r sqrt(x^2 + z^2 - r^2)) / (z^2 - r^2). One that reaches the plane of the camera
//! is seen from one slope on, without end on its own side; one around the camera everywhere. In
//! fog most spheres near the camera are beside the picture.
//!
//! Photons are kept in the order of the bands that they reach, and nothing is listed beside them:
//!
//! ```text
//! bucket     (level, first band / 4^level, last - first of these: 0 to 3)      the least level that does
//! ```
//!
//! A band's photons lie in four runs of each level, one for each bucket that they may begin in, and
//! come into the cache as they lie in memory. Their pixels are found again, rather than kept.

use glam::Vec3;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::estimate::eight::Lit;
use crate::estimate::tiles::class;
use crate::photon::{Heading, Photon};
use crate::spectrum::Spectrum;

/// Pixels of a tile along an edge: the lanes of a SIMD register.
pub const TILE: u32 = 8;
/// Rays of a tile.
pub const TILE_RAYS: usize = 64;

/// Photons sorted by one unit of parallel work; 16 bits tell them apart.
const CHUNK: usize = 1 << 14;
/// Parts in which photons are sorted; each gives its space back before the next, so that no more
/// than one is there twice.
const PARTS: usize = 8;
/// Buckets that a photon reaches, at most, on its level.
const SPAN: u32 = 4;
/// log2 of how many buckets of a level one of the next takes.
const STEP: u32 = 2;

/// Rounding of a squared distance. Smaller: photons are lost at the end of what is seen; larger: more
/// are looked at in vain.
const ROUNDING: f32 = 1e-6;

/// Pixels of a picture that are rendered, in tiles.
#[derive(Debug, Clone, Copy)]
pub struct TileGrid {
    /// First pixel.
    pub low: [u32; 2],
    /// Last pixel, exclusive.
    pub high: [u32; 2],
}

impl TileGrid {
    /// Tiles across.
    #[must_use]
    pub fn columns(&self) -> u32 {
        (self.high[0] - self.low[0]).div_ceil(TILE)
    }

    /// Bands of tiles.
    #[must_use]
    pub fn bands(&self) -> u32 {
        (self.high[1] - self.low[1]).div_ceil(TILE)
    }

    /// The pixels of a sphere, in rows and columns of the grid: first and last of each; none
    /// where no ray of the grid can meet it.
    pub(crate) fn footprint(
        &self,
        camera: &Camera,
        frame: &[Vec3; 3],
        center: Vec3,
        radius: f32,
    ) -> Option<[[u32; 2]; 2]> {
        let to = center - camera.position;
        let z = to.dot(frame[2]);
        if z <= -radius {
            return None;
        }
        let scale = camera.pixels_per_slope();
        let middle = camera.principal_point();
        let mut out = [[0, 0]; 2];
        for axis in 0..2 {
            let size = self.high[axis] - self.low[axis];
            let x = to.dot(frame[axis]) * if axis == 0 { 1.0 } else { -1.0 };
            // Rays start within their pixel; a hundredth covers rounding.
            let [a, b] = slopes(x, z, radius)
                .map(|slope| slope * scale[axis] + middle[axis] - self.low[axis] as f32);
            let (a, b) = (a - 0.01, b + 0.01);
            if !(b >= 0.0 && a < size as f32) {
                return None;
            }
            out[axis] = [a.max(0.0) as u32, (b as u32).min(size - 1)];
        }
        Some(out)
    }
}

/// Slopes x / z between which a disc of radius r around (x, z), z > -r, is seen from the origin.
#[inline]
fn slopes(x: f32, z: f32, r: f32) -> [f32; 2] {
    let square = x * x + (z - r) * (z + r);
    if square <= 0.0 {
        return [f32::NEG_INFINITY, f32::INFINITY];
    }
    let root = r * square.sqrt();
    let (side, past) = (x.abs(), (z - r) * (z + r));
    if z > r {
        return [(x * z - root) / past, (x * z + root) / past];
    }
    // The same of |x|, in that one of two forms in which no terms of opposite signs are added.
    let nearer = if z > 0.0 {
        (side - r) * (side + r) / (side * z + root)
    } else {
        (side * z - root) / past
    };
    if x > 0.0 {
        [nearer, f32::INFINITY]
    } else {
        [f32::NEG_INFINITY, -nearer]
    }
}

/// Where the buckets of each level begin.
#[derive(Debug, Clone)]
struct Layout {
    /// By level; and the number of all buckets.
    begin: Vec<u32>,
}

impl Layout {
    fn new(bands: u32) -> Self {
        let mut begin = vec![0];
        let (mut all, mut buckets) = (0, bands);
        loop {
            all += buckets * SPAN;
            begin.push(all);
            if buckets <= SPAN {
                return Self { begin };
            }
            buckets = buckets.div_ceil(1 << STEP);
        }
    }

    /// The bucket of photons that reach from a band to another.
    #[inline]
    fn bucket(&self, [first, last]: [u32; 2]) -> u32 {
        let (mut level, [mut first, mut last]) = (0, [first, last]);
        while last - first >= SPAN {
            level += 1;
            (first, last) = (first >> STEP, last >> STEP);
        }
        self.begin[level] + first * SPAN + last - first
    }

    /// Number of buckets.
    fn count(&self) -> usize {
        self.begin.last().map_or(0, |all| *all as usize)
    }

    /// Runs of buckets whose photons may reach a band: first, and last exclusive.
    fn runs(&self, band: u32) -> impl Iterator<Item = [usize; 2]> {
        let levels = (0u32..).zip(&self.begin[..self.begin.len() - 1]);
        levels.flat_map(move |(level, begin)| {
            let place = band >> (STEP * level);
            (0..SPAN.min(place + 1)).rev().map(move |up| {
                let bucket = begin + (place - up) * SPAN;
                [bucket + up, bucket + SPAN].map(|b| b as usize)
            })
        })
    }
}

/// Some photons in the order of their buckets.
#[derive(Debug)]
struct Chunk<S: Spectrum, H> {
    photons: Vec<Photon<S, H>>,
    /// Of each bucket, and the end.
    starts: Vec<u16>,
}

/// Photons in the order of the bands of a picture that they reach; others are let go.
#[derive(Debug)]
pub struct Bands<S: Spectrum, H> {
    chunks: Vec<Chunk<S, H>>,
    layout: Layout,
    view: View,
}

/// A picture and the camera that takes it.
#[derive(Debug, Clone)]
struct View {
    camera: Camera,
    frame: [Vec3; 3],
    grid: TileGrid,
}

impl View {
    /// First and last column and row of the pixels of a photon's sphere.
    #[inline]
    fn pixels<S: Spectrum, H>(&self, photon: &Photon<S, H>) -> Option<[[u32; 2]; 2]> {
        let (center, radius) = (photon.position, photon.radius());
        self.grid
            .footprint(&self.camera, &self.frame, center, radius)
    }
}

/// First and last tile of pixels.
#[inline]
fn tiles_of(pixels: [u32; 2]) -> [u32; 2] {
    pixels.map(|pixel| pixel / TILE)
}

impl<S: Spectrum, H: Heading> Chunk<S, H> {
    /// Sorts by counting.
    fn new(photons: &[Photon<S, H>], view: &View, layout: &Layout) -> Self {
        let buckets: Vec<Option<u32>> = photons
            .iter()
            .map(|photon| {
                let [_, rows] = view.pixels(photon)?;
                Some(layout.bucket(tiles_of(rows)))
            })
            .collect();
        let mut starts = vec![0u16; layout.count() + 1];
        for bucket in buckets.iter().flatten() {
            starts[*bucket as usize + 1] += 1;
        }
        for bucket in 0..layout.count() {
            starts[bucket + 1] += starts[bucket];
        }
        let mut next = starts.clone();
        let mut order = vec![0u16; usize::from(starts[layout.count()])];
        for (i, bucket) in buckets.iter().enumerate() {
            if let Some(bucket) = bucket {
                let slot = &mut next[*bucket as usize];
                order[usize::from(*slot)] = i as u16;
                *slot += 1;
            }
        }
        Self {
            photons: order.iter().map(|i| photons[usize::from(*i)]).collect(),
            starts,
        }
    }
}

impl<S: Spectrum, H: Heading> Bands<S, H> {
    /// Sorts photons into the bands of a picture.
    #[must_use]
    pub fn new(mut photons: Vec<Photon<S, H>>, camera: &Camera, grid: &TileGrid) -> Self {
        let layout = Layout::new(grid.bands());
        let view = View {
            camera: camera.clone(),
            frame: camera.frame(),
            grid: *grid,
        };
        let mut chunks = Vec::with_capacity(photons.len().div_ceil(CHUNK));
        let part = photons.len().div_ceil(PARTS).next_multiple_of(CHUNK);
        while !photons.is_empty() {
            let from = (photons.len() - 1) / part * part;
            let sort = |photons: &[_]| Chunk::new(photons, &view, &layout);
            chunks.par_extend(photons[from..].par_chunks(CHUNK).map(sort));
            photons.truncate(from);
            photons.shrink_to_fit();
        }
        Self {
            chunks,
            layout,
            view,
        }
    }

    /// Bytes that the order takes in memory, as allocated, beside the photons.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let starts = self.chunks.iter().map(|c| size_of_val(&c.starts[..]));
        starts.sum()
    }

    /// The photons of each tile of a band; `salt` shuffles their classes.
    #[must_use]
    pub fn tiles(&self, band: u32, salt: u32) -> BandTiles {
        let columns = self.view.grid.columns() as usize;
        let mut reached = Vec::new();
        let mut first = vec![0u32; columns + 1];
        for chunk in &self.chunks {
            for run in self.layout.runs(band) {
                let [from, to] = run.map(|bucket| usize::from(chunk.starts[bucket]));
                for photon in &chunk.photons[from..to] {
                    let Some([across, rows]) = self.view.pixels(photon) else {
                        continue;
                    };
                    let [top, bottom] = tiles_of(rows);
                    if !(top..=bottom).contains(&band) {
                        continue;
                    }
                    let top = band * TILE;
                    let rows = [rows[0].max(top) - top, (rows[1] - top).min(TILE - 1)];
                    let tiles = tiles_of(across);
                    first[tiles[0] as usize + 1] += 1;
                    reached.push((photon, tiles, rows.map(|row| row as u8)));
                }
            }
        }
        // In the order of their first tiles: those of a tile then lie close together.
        let mut order = vec![0u32; reached.len()];
        sum_up(&mut first);
        for (i, (_, [tile, _], _)) in (0u32..).zip(&reached) {
            let slot = &mut first[*tile as usize];
            order[*slot as usize] = i;
            *slot += 1;
        }
        let ordered = || {
            order.iter().map(|i| {
                let (photon, tiles, rows) = reached[*i as usize];
                (photon, tiles.map(|tile| tile as usize), rows)
            })
        };
        let mut start = vec![0u32; columns + 1];
        for (_, [from, to], _) in ordered() {
            start[from + 1..=to + 1].iter_mut().for_each(|n| *n += 1);
        }
        sum_up(&mut start);
        let mut next = start.clone();
        let mut listed = vec![(0u32, [0u8; 2]); start[columns] as usize];
        for (photon, (_, [from, to], rows)) in (0u32..).zip(ordered()) {
            for slot in &mut next[from..=to] {
                listed[*slot as usize] = (photon, rows);
                *slot += 1;
            }
        }
        let camera = self.view.camera.position;
        BandTiles {
            photons: ordered()
                .map(|(photon, ..)| BandPhoton::new(photon, camera, salt))
                .collect(),
            lit: ordered().map(|(photon, ..)| Lit::new(photon)).collect(),
            start,
            listed,
        }
    }
}

/// Counts, each behind its own place, to where what they count begins.
fn sum_up(counts: &mut [u32]) {
    let mut sum = 0;
    for count in counts {
        sum += *count;
        *count = sum;
    }
}

/// Where the rays of a band find a photon.
#[derive(Debug, Clone, Copy)]
pub(super) struct BandPhoton {
    /// From the camera. \[m\]
    pub(super) to: Vec3,
    /// \[m\]
    pub(super) radius: f32,
    /// No ray meets it nearer to the camera: that distance, squared. \[m2\]
    pub(super) nearest2: f32,
    /// Its class in the roulette of `tiles`.
    pub(super) class: u8,
    pub(super) compartment: u8,
}

impl BandPhoton {
    #[inline]
    fn new<S: Spectrum, H: Heading>(photon: &Photon<S, H>, camera: Vec3, salt: u32) -> Self {
        let (to, radius) = (photon.position - camera, photon.radius());
        Self {
            to,
            radius,
            // Where a ray pierces the sphere, t^2 = |v|^2 - d^2 > |v|^2 - r^2.
            nearest2: to.length_squared() * (1.0 - ROUNDING) - radius * radius,
            class: class(photon.position, salt) as u8,
            compartment: photon.heading.compartment(),
        }
    }
}

/// Photons of the tiles of one band, unpacked once for all of them.
#[derive(Debug)]
pub struct BandTiles {
    /// Those that reach the band.
    photons: Vec<BandPhoton>,
    /// What they bring.
    lit: Vec<Lit>,
    /// Of each tile in `listed`.
    start: Vec<u32>,
    /// Index among the band's photons, and first and last row of pixels.
    listed: Vec<(u32, [u8; 2])>,
}

impl BandTiles {
    /// The photons of a tile.
    #[must_use]
    pub fn tile(&self, column: u32) -> TilePhotons<'_> {
        let [from, to] = [column, column + 1].map(|c| self.start[c as usize] as usize);
        TilePhotons {
            band: self,
            listed: &self.listed[from..to],
        }
    }
}

/// Photons of one tile.
#[derive(Debug, Clone, Copy)]
pub struct TilePhotons<'a> {
    band: &'a BandTiles,
    listed: &'a [(u32, [u8; 2])],
}

impl<'a> TilePhotons<'a> {
    /// Each of them, with what it brings and the first and last row of pixels that it reaches.
    pub(super) fn each(self) -> impl Iterator<Item = (&'a BandPhoton, &'a Lit, [u8; 2])> {
        self.listed.iter().map(move |(photon, rows)| {
            let photon = *photon as usize;
            (&self.band.photons[photon], &self.band.lit[photon], *rows)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    /// Discs before, beside, around and a little behind the origin: a direction meets the disc
    /// exactly where its slope lies between the two, but for rounding.
    #[test]
    fn slopes_bound_what_is_seen() {
        let mut rng = Rng::stream(5, Stage::Check, 0, 0);
        let (mut inside, mut outside) = (0, 0);
        for _ in 0..20_000 {
            let r = 0.1 + rng.uniform();
            let (x, z) = (8.0 * rng.uniform() - 4.0, 5.0f32.mul_add(rng.uniform(), -r));
            let [low, high] = slopes(x, z, r);
            for _ in 0..20 {
                let slope = 3.0 * (2.0 * rng.uniform() - 1.0);
                // The point of the half line nearest to the middle.
                let [dx, dz, x, z, r] = [slope, 1.0, x, z, r].map(f64::from);
                let t = ((x * dx + z * dz) / (dx * dx + dz * dz)).max(0.0);
                let distance = (x - t * dx).hypot(z - t * dz);
                if (distance - r).abs() < 1e-4 * (x.hypot(z) + r) {
                    continue;
                }
                let between = (low..=high).contains(&slope);
                assert_eq!(between, distance < r, "({x}, {z}), {r}: slope {slope}");
                inside += u32::from(between);
                outside += u32::from(!between);
            }
        }
        assert!(inside > 10_000 && outside > 10_000, "{inside} {outside}");
    }
}
