//! Pictures put on surfaces: reflectance as a function of texture coordinates; and before spots.
//!
//! Texels are decoded from sRGB (IEC 61966-2-1) to linear once, at load:
//! `c = s / 12.92` for `s <= 0.04045`, `((s + 0.055) / 1.055)^2.4` above.
//! Lookups are bilinear between texel centres and repeat outside the unit square; v points up, so
//! the picture's first row lies at v = 1. There is no filtering by distance: many samples a pixel
//! do that work.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};

use crate::scene::Rgb;

/// A picture in linear RGB.
#[derive(Debug)]
pub(crate) struct Texture {
    width: usize,
    height: usize,
    texels: Vec<Rgb>,
}

/// A picture that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// The file cannot be opened or read.
    #[error("texture {}: {source}", file.display())]
    Io {
        /// The picture.
        file: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Not a PNG, or a broken one.
    #[error("texture {}: {what}; PNG files can be read", file.display())]
    Malformed {
        /// The picture.
        file: PathBuf,
        /// What was found.
        what: String,
    },
}

impl Texture {
    /// Bytes that the texels take in memory.
    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&self.texels[..])
    }

    /// Reads a PNG of any kind.
    pub(crate) fn load(file: &Path) -> Result<Self, TextureError> {
        let opened = std::fs::File::open(file).map_err(|source| TextureError::Io {
            file: file.into(),
            source,
        })?;
        let malformed = |what: String| TextureError::Malformed {
            file: file.into(),
            what,
        };
        let mut decoder = png::Decoder::new(std::io::BufReader::new(opened));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
        let mut reader = decoder.read_info().map_err(|e| malformed(e.to_string()))?;
        let size = reader
            .output_buffer_size()
            .ok_or_else(|| malformed("is too large".into()))?;
        let mut bytes = vec![0; size];
        let info = reader
            .next_frame(&mut bytes)
            .map_err(|e| malformed(e.to_string()))?;
        let linear: Vec<f32> = (0..=255).map(|s| linear(s as f32 / 255.0)).collect();
        let samples = info.color_type.samples();
        let texels = bytes[..info.buffer_size()]
            .chunks_exact(samples)
            .map(|texel| {
                let channel = |i: usize| linear[usize::from(texel[i])];
                match info.color_type {
                    png::ColorType::Rgb | png::ColorType::Rgba => {
                        Vec3::new(channel(0), channel(1), channel(2))
                    }
                    _ => Vec3::splat(channel(0)),
                }
            })
            .collect();
        Ok(Self {
            width: info.width as usize,
            height: info.height as usize,
            texels,
        })
    }

    /// Bilinear value, repeating.
    pub(crate) fn at(&self, uv: Vec2) -> Rgb {
        let axis = |t: f32, n: usize| {
            let x = t.rem_euclid(1.0) * n as f32 - 0.5;
            let low = x.floor();
            let i = (low as isize).rem_euclid(n as isize) as usize;
            (i, (i + 1) % n, x - low)
        };
        let (x0, x1, fx) = axis(uv.x, self.width);
        let (y0, y1, fy) = axis(1.0 - uv.y, self.height);
        let texel = |x: usize, y: usize| self.texels[y * self.width + x];
        let upper = texel(x0, y0).lerp(texel(x1, y0), fx);
        let lower = texel(x0, y1).lerp(texel(x1, y1), fx);
        upper.lerp(lower, fy)
    }
}

fn linear(s: f32) -> f32 {
    if s <= 0.040_45 {
        s / 12.92
    } else {
        ((s + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookups_repeat_and_v_points_up() {
        let texture = Texture {
            width: 2,
            height: 2,
            texels: [0.0, 1.0, 2.0, 3.0].map(Vec3::splat).to_vec(),
        };
        assert_eq!(texture.at(Vec2::new(0.25, 0.75)).x, 0.0);
        assert_eq!(texture.at(Vec2::new(0.75, 0.25)).x, 3.0);
        assert_eq!(texture.at(Vec2::new(-0.25, 1.75)).x, 1.0);
        assert_eq!(texture.at(Vec2::new(0.5, 0.75)).x, 0.5);
    }

    #[test]
    fn srgb_ends_and_middle() {
        assert_eq!((linear(0.0), linear(1.0)), (0.0, 1.0));
        assert!((linear(0.5) - 0.214_041).abs() < 1e-6);
    }
}
