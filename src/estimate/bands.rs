//! Photons sorted into the tiles of a picture: which of them a tile of 8 x 8 camera rays can meet.
//!
//! Camera rays of a pinhole are coherent: a photon's sphere projects to a small rectangle of
//! pixels. Photons are sorted into bands of 8 rows, each band's photons into tiles of 8 columns.
//!
//! The projected rectangle is exact: a sphere of radius r at (x, z), z > r, is seen between the
//! slopes (x z -+ r sqrt(x^2 + z^2 - r^2)) / (z^2 - r^2). A sphere that reaches the plane of the
//! camera is put into every tile.
//!
//! A photon is listed once, 8 bytes, in the first band that it reaches, and again only beyond every
//! `SPAN`th: a band looks through the lists of those above it.

use glam::Vec3;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::photon::{Heading, Photon};
use crate::spectrum::Spectrum;

/// Pixels of a tile along an edge: the lanes of a SIMD register.
pub const TILE: u32 = 8;
/// Rays of a tile.
pub const TILE_RAYS: usize = 64;

/// Photons sorted by one unit of parallel work; 16 bits tell them apart.
const CHUNK: usize = 1 << 14;

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
            if z <= radius {
                out[axis] = [0, size - 1];
                continue;
            }
            let x = to.dot(frame[axis]) * if axis == 0 { 1.0 } else { -1.0 };
            let denominator = (z - radius) * (z + radius);
            let root = radius * (x * x + denominator).sqrt();
            // Rays start within their pixel; a hundredth covers rounding.
            let a = (x * z - root) / denominator * scale[axis] + middle[axis]
                - self.low[axis] as f32
                - 0.01;
            let b = (x * z + root) / denominator * scale[axis] + middle[axis]
                - self.low[axis] as f32
                + 0.01;
            if !(b >= 0.0 && a < size as f32) {
                return None;
            }
            out[axis] = [a.max(0.0) as u32, (b as u32).min(size - 1)];
        }
        Some(out)
    }
}

/// Bands that one entry of a photon covers, at most. More: bands look through more entries that do
/// not concern them; fewer: more entries.
const SPAN: u32 = 4;

/// A photon in some bands, the first of which lists it: its index in the chunk, and the first and
/// last of its columns of tiles and of its rows of pixels there, from the first band's top on.
#[derive(Debug, Clone, Copy)]
struct Entry {
    photon: u16,
    columns: [u16; 2],
    rows: [u8; 2],
}

/// Photons sorted into bands of a picture.
#[derive(Debug)]
pub struct Bands {
    /// By chunk of photons and band, in order.
    entries: Vec<Vec<Vec<Entry>>>,
}

impl Bands {
    /// Sorts photons into the bands of a picture.
    #[must_use]
    pub fn new<S: Spectrum, H: Heading>(
        photons: &[Photon<S, H>],
        camera: &Camera,
        grid: &TileGrid,
    ) -> Self {
        let frame = camera.frame();
        let entries = photons
            .par_chunks(CHUNK)
            .map(|photons| {
                let mut bands = vec![Vec::new(); grid.bands() as usize];
                for (i, photon) in photons.iter().enumerate() {
                    let Some([[c0, c1], [r0, r1]]) =
                        grid.footprint(camera, &frame, photon.position, photon.radius)
                    else {
                        continue;
                    };
                    let columns = [(c0 / TILE) as u16, (c1 / TILE) as u16];
                    for band in (r0 / TILE..=r1 / TILE).step_by(SPAN as usize) {
                        let top = band * TILE;
                        let last = r1.min((band + SPAN) * TILE - 1);
                        bands[band as usize].push(Entry {
                            photon: i as u16,
                            columns,
                            rows: [r0.max(top) - top, last - top].map(|row| row as u8),
                        });
                    }
                }
                bands.iter_mut().for_each(Vec::shrink_to_fit);
                bands
            })
            .collect();
        Self { entries }
    }

    /// Bytes that the bands take in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let bands = self.entries.iter().flatten();
        bands.map(|b| b.capacity() * size_of::<Entry>()).sum()
    }

    /// The photons of each tile of a band.
    #[must_use]
    pub fn tiles(&self, band: u32, grid: &TileGrid) -> BandTiles {
        let columns = grid.columns() as usize;
        let mut start = vec![0u32; columns + 1];
        // Bands above this one list photons that reach it: with each, its rows from there on.
        let above = SPAN.min(band + 1);
        let entries = || {
            let chunks = self.entries.iter().zip(0u32..);
            chunks.flat_map(move |(chunk, number)| {
                (0..above).rev().flat_map(move |up| {
                    let top = up * TILE;
                    chunk[(band - up) as usize]
                        .iter()
                        .filter(move |entry| u32::from(entry.rows[1]) >= top)
                        .map(move |entry| (number * CHUNK as u32, top, entry))
                })
            })
        };
        for (_, _, entry) in entries() {
            for column in entry.columns[0]..=entry.columns[1] {
                start[column as usize + 1] += 1;
            }
        }
        for column in 0..columns {
            start[column + 1] += start[column];
        }
        let mut next = start.clone();
        let mut photons = vec![(0u32, [0u8; 2]); start[columns] as usize];
        for (chunk, top, entry) in entries() {
            let [first, last] = entry.rows.map(u32::from);
            let rows = [first.max(top) - top, (last - top).min(TILE - 1)].map(|row| row as u8);
            for column in entry.columns[0]..=entry.columns[1] {
                let slot = &mut next[column as usize];
                photons[*slot as usize] = (chunk + u32::from(entry.photon), rows);
                *slot += 1;
            }
        }
        BandTiles { start, photons }
    }
}

/// Photons of the tiles of one band: index, and first and last row of pixels.
#[derive(Debug)]
pub struct BandTiles {
    start: Vec<u32>,
    photons: Vec<(u32, [u8; 2])>,
}

impl BandTiles {
    /// The photons of a tile.
    #[must_use]
    pub fn tile(&self, column: u32) -> &[(u32, [u8; 2])] {
        &self.photons
            [self.start[column as usize] as usize..self.start[column as usize + 1] as usize]
    }
}
