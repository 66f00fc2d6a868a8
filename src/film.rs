//! The film: per pixel, the mean over passes and how far that mean can be trusted.
//!
//! A *pass* is one independent picture of the whole crop: fresh photons, fresh camera rays. With
//! x_j the value of a pixel in pass j of n (Welford 1962, in f64):
//!
//! ```text
//! mean            x̄  = Σ x_j / n
//! second moment   M₂ = Σ (x_j - x̄)²
//! standard error  s  = √( M₂ / (n (n - 1)) )         of the mean; unknown for n < 2
//! ```
//!
//! Pixels of one pass share photons, hence are correlated, so the standard error of the mean of
//! the *image* does not follow from those of the pixels: it comes from the n image means.
//!
//! # One figure for the whole picture
//!
//! [`Film::mean_relative_standard_error`] is `Σ s_p / Σ Y_p`, s the standard error of the
//! luminance Y (Rec. 709), both sums over the pixels p that carry noise (s > 10⁻⁶ Y, which f32
//! rounding stays below). It reads as "the grain is 2 % of the light": a mean of s/Y weighted by
//! brightness, so a nearly black pixel with a huge relative error counts for as little as the eye
//! gives it, and neither a black background nor a flat sky, which are known exactly, flatters the
//! smoke in front of them.
//!
//! # Values that are not finite
//!
//! A sample with NaN or an infinity in it is never averaged in and never silently dropped: it is
//! counted for its pixel, and the pixel's other passes stand; a pixel without any is black. The
//! one infinity that means something is `depth`: nothing was there; depth is the mean over passes
//! that met something.

use glam::DVec3;

use crate::scene::Rgb;

/// One pixel of one pass. Its colour is `direct + indirect + emission`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Light scattered once. \[W/(m2 sr)\]
    pub direct: Rgb,
    /// Light scattered more than once. \[W/(m2 sr)\]
    pub indirect: Rgb,
    /// Emitted by media and surfaces, and the background seen through them. \[W/(m2 sr)\]
    pub emission: Rgb,
    /// 1 - transmittance to the background.
    pub alpha: f32,
    /// Distance from the camera to what is seen; infinite where there is nothing. \[m\]
    pub depth: f32,
}

impl Sample {
    /// No light from nothing.
    pub const NOTHING: Self = Self {
        direct: Rgb::ZERO,
        indirect: Rgb::ZERO,
        emission: Rgb::ZERO,
        alpha: 0.0,
        depth: f32::INFINITY,
    };

    /// The whole radiance. \[W/(m2 sr)\]
    pub fn colour(&self) -> Rgb {
        self.direct + self.indirect + self.emission
    }

    /// Depth may be infinite, nothing may be NaN.
    fn is_finite(&self) -> bool {
        self.colour().is_finite() && self.alpha.is_finite() && !self.depth.is_nan()
    }
}

/// Luminance of linear Rec. 709 RGB.
pub fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Means and second moments of one pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Pixel {
    /// Passes averaged in.
    n: u32,
    /// Passes that were not finite.
    nonfinite: u32,
    /// Passes that met something.
    n_depth: u32,
    direct: DVec3,
    indirect: DVec3,
    emission: DVec3,
    alpha: f64,
    depth: f64,
    /// M₂ of the colour, and of its luminance.
    m2: DVec3,
    m2_luminance: f64,
}

impl Pixel {
    fn mean(&self) -> DVec3 {
        self.direct + self.indirect + self.emission
    }

    fn add(&mut self, sample: &Sample) {
        if !sample.is_finite() {
            self.nonfinite += 1;
            return;
        }
        self.n += 1;
        let w = 1.0 / f64::from(self.n);
        let colour =
            sample.direct.as_dvec3() + sample.indirect.as_dvec3() + sample.emission.as_dvec3();
        let before = colour - self.mean();
        self.direct += (sample.direct.as_dvec3() - self.direct) * w;
        self.indirect += (sample.indirect.as_dvec3() - self.indirect) * w;
        self.emission += (sample.emission.as_dvec3() - self.emission) * w;
        self.alpha += (f64::from(sample.alpha) - self.alpha) * w;
        // (x - mean before)(x - mean after), the latter being (1 - 1/n) (x - mean before): never
        // negative, whatever the rounding.
        let rest = 1.0 - w;
        self.m2 += before * before * rest;
        self.m2_luminance += luminance(before).powi(2) * rest;
        if sample.depth.is_finite() {
            self.n_depth += 1;
            self.depth += (f64::from(sample.depth) - self.depth) / f64::from(self.n_depth);
        }
    }
}

/// 1 / (n (n - 1)), or nothing for n < 2.
fn error_factor(n: u32) -> Option<f64> {
    (n >= 2).then(|| 1.0 / (f64::from(n) * f64::from(n - 1)))
}

/// A value and the standard error of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub mean: DVec3,
    /// Its standard error; unknown with fewer than two passes.
    pub standard_error: Option<DVec3>,
}

/// Everything known of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelMeans {
    /// Light scattered once. \[W/(m2 sr)\]
    pub direct: DVec3,
    /// Light scattered more than once. \[W/(m2 sr)\]
    pub indirect: DVec3,
    /// Emission and background. \[W/(m2 sr)\]
    pub emission: DVec3,
    /// 1 - transmittance.
    pub alpha: f64,
    /// Infinite where nothing was met. \[m\]
    pub depth: f64,
}

/// The picture so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    width: u32,
    height: u32,
    crop: [u32; 4],
    passes: u32,
    /// Row-major over the crop.
    pixels: Vec<Pixel>,
    /// Mean over passes of the image means, and its M₂.
    image_mean: DVec3,
    image_m2: DVec3,
    image_passes: u32,
}

/// Bytes that are not a film.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("not a film of this version: {0}")]
pub struct FilmBytesError(&'static str);

/// Relative scatter of a pixel below which it is rounding, not noise: samples are f32, sums of a
/// few, so equal ones may differ by some 10⁻⁷. Well above that, well below any noise.
const ROUNDING: f64 = 1e-6;

/// First bytes of a stored film; the digit counts layouts.
const MAGIC: &[u8; 8] = b"vpmfilm1";

impl Film {
    /// An empty film for a picture of `width` x `height`, or for the pixels `x0, y0, x1, y1`
    /// (the last two exclusive) of it.
    pub fn new(width: u32, height: u32, crop: Option<[u32; 4]>) -> Self {
        let crop = crop.unwrap_or([0, 0, width, height]);
        let [x0, y0, x1, y1] = crop;
        assert!(
            x0 < x1 && y0 < y1 && x1 <= width && y1 <= height,
            "crop {crop:?} outside {width} x {height}"
        );
        Self {
            width,
            height,
            crop,
            passes: 0,
            pixels: vec![Pixel::default(); (x1 - x0) as usize * (y1 - y0) as usize],
            image_mean: DVec3::ZERO,
            image_m2: DVec3::ZERO,
            image_passes: 0,
        }
    }

    /// Bytes that the film takes in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.pixels.capacity() * size_of::<Pixel>()
    }

    /// Averages in one pass: a sample for each pixel of the crop, row-major.
    pub fn add_pass(&mut self, samples: &[Sample]) {
        assert_eq!(samples.len(), self.pixels.len(), "one sample a pixel");
        self.passes += 1;
        let mut sum = DVec3::ZERO;
        let mut finite = 0_u64;
        for (pixel, sample) in self.pixels.iter_mut().zip(samples) {
            pixel.add(sample);
            if sample.is_finite() {
                sum += sample.colour().as_dvec3();
                finite += 1;
            }
        }
        if finite > 0 {
            self.image_passes += 1;
            let before = sum / finite as f64 - self.image_mean;
            let w = 1.0 / f64::from(self.image_passes);
            self.image_mean += before * w;
            self.image_m2 += before * before * (1.0 - w);
        }
    }

    /// Passes added.
    pub fn passes(&self) -> u32 {
        self.passes
    }

    /// Width and height of the whole picture. \[px\]
    pub fn resolution(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Pixels held: x0, y0, x1, y1, the last two exclusive. \[px\]
    pub fn crop(&self) -> [u32; 4] {
        self.crop
    }

    /// `x`, `y` count from the corner of the whole picture and lie in the crop.
    fn pixel(&self, x: u32, y: u32) -> &Pixel {
        let [x0, y0, x1, y1] = self.crop;
        assert!(
            (x0..x1).contains(&x) && (y0..y1).contains(&y),
            "pixel {x}, {y} outside the crop {:?}",
            self.crop
        );
        &self.pixels[(y - y0) as usize * (x1 - x0) as usize + (x - x0) as usize]
    }

    /// Colour of a pixel of the crop, counted from the corner of the whole picture. \[W/(m2 sr)\]
    pub fn mean(&self, x: u32, y: u32) -> DVec3 {
        self.pixel(x, y).mean()
    }

    /// Standard error of the colour of a pixel; unknown with fewer than two finite passes.
    pub fn standard_error(&self, x: u32, y: u32) -> Option<DVec3> {
        let pixel = self.pixel(x, y);
        error_factor(pixel.n).map(|f| (pixel.m2 * f).map(f64::sqrt))
    }

    /// All means of a pixel.
    pub fn means(&self, x: u32, y: u32) -> PixelMeans {
        let p = self.pixel(x, y);
        PixelMeans {
            direct: p.direct,
            indirect: p.indirect,
            emission: p.emission,
            alpha: p.alpha,
            depth: if p.n_depth > 0 {
                p.depth
            } else {
                f64::INFINITY
            },
        }
    }

    /// Passes of a pixel that were not finite.
    pub fn nonfinite_passes(&self, x: u32, y: u32) -> u32 {
        self.pixel(x, y).nonfinite
    }

    /// Pixels that were not finite in at least one pass.
    pub fn nonfinite_pixels(&self) -> u64 {
        self.pixels.iter().filter(|p| p.nonfinite > 0).count() as u64
    }

    /// Mean of the picture, and its standard error from the means of the passes.
    pub fn image_mean(&self) -> Estimate {
        let n = self.pixels.iter().filter(|p| p.n > 0).count().max(1);
        let sum: DVec3 = self.pixels.iter().map(Pixel::mean).sum();
        Estimate {
            mean: sum / n as f64,
            standard_error: error_factor(self.image_passes)
                .map(|f| (self.image_m2 * f).map(f64::sqrt)),
        }
    }

    /// Standard error as a share of the light: see the page above. Unknown with fewer than two
    /// passes; 0 for a picture without noise.
    pub fn mean_relative_standard_error(&self) -> Option<f64> {
        if self.passes < 2 {
            return None;
        }
        let (mut error, mut light) = (0.0, 0.0);
        for pixel in &self.pixels {
            let Some(f) = error_factor(pixel.n) else {
                continue;
            };
            let (s, y) = ((pixel.m2_luminance * f).sqrt(), luminance(pixel.mean()));
            if s > ROUNDING * y.abs() {
                error += s;
                light += y;
            }
        }
        Some(if error > 0.0 { error / light } else { 0.0 })
    }

    /// The whole state, to go on from later.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(96 + self.pixels.len() * Pixel::BYTES);
        out.extend_from_slice(MAGIC);
        for v in [self.width, self.height].iter().chain(&self.crop) {
            out.extend_from_slice(&v.to_le_bytes());
        }
        out.extend_from_slice(&self.passes.to_le_bytes());
        out.extend_from_slice(&self.image_passes.to_le_bytes());
        put(&mut out, &self.image_mean.to_array());
        put(&mut out, &self.image_m2.to_array());
        for pixel in &self.pixels {
            for v in [pixel.n, pixel.nonfinite, pixel.n_depth] {
                out.extend_from_slice(&v.to_le_bytes());
            }
            put(&mut out, &pixel.numbers());
        }
        out
    }

    /// From [`Film::to_bytes`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FilmBytesError> {
        let mut bytes = Cursor(bytes);
        if bytes.take::<8>()? != *MAGIC {
            return Err(FilmBytesError("other first bytes"));
        }
        let [width, height] = [bytes.u32()?, bytes.u32()?];
        let crop = [bytes.u32()?, bytes.u32()?, bytes.u32()?, bytes.u32()?];
        let [x0, y0, x1, y1] = crop;
        if x0 >= x1 || y0 >= y1 || x1 > width || y1 > height {
            return Err(FilmBytesError("crop outside the picture"));
        }
        let [passes, image_passes] = [bytes.u32()?, bytes.u32()?];
        let [image_mean, image_m2] = [bytes.dvec3()?, bytes.dvec3()?];
        // Sizes are compared before anything is allocated.
        let count = u64::from(x1 - x0) * u64::from(y1 - y0);
        if count.checked_mul(Pixel::BYTES as u64) != Some(bytes.0.len() as u64) {
            return Err(FilmBytesError("length does not fit the crop"));
        }
        let pixels = (0..count)
            .map(|_| bytes.pixel())
            .collect::<Result<_, _>>()?;
        Ok(Self {
            width,
            height,
            crop,
            passes,
            pixels,
            image_mean,
            image_m2,
            image_passes,
        })
    }
}

fn put(out: &mut Vec<u8>, values: &[f64]) {
    for v in values {
        out.extend_from_slice(&v.to_le_bytes());
    }
}

impl Pixel {
    /// Stored size: three counts and fifteen numbers.
    const BYTES: usize = 3 * 4 + 15 * 8;

    fn numbers(&self) -> [f64; 15] {
        let ([a, b, c], [d, e, f]) = (self.direct.to_array(), self.indirect.to_array());
        let ([g, h, i], [j, k, l]) = (self.emission.to_array(), self.m2.to_array());
        [
            a,
            b,
            c,
            d,
            e,
            f,
            g,
            h,
            i,
            j,
            k,
            l,
            self.alpha,
            self.depth,
            self.m2_luminance,
        ]
    }
}

/// Reads a stored film front to back.
struct Cursor<'a>(&'a [u8]);

impl Cursor<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], FilmBytesError> {
        let (head, rest) = self
            .0
            .split_first_chunk()
            .ok_or(FilmBytesError("it ends early"))?;
        self.0 = rest;
        Ok(*head)
    }
    fn u32(&mut self) -> Result<u32, FilmBytesError> {
        self.take().map(u32::from_le_bytes)
    }
    fn f64(&mut self) -> Result<f64, FilmBytesError> {
        self.take().map(f64::from_le_bytes)
    }
    fn dvec3(&mut self) -> Result<DVec3, FilmBytesError> {
        Ok(DVec3::new(self.f64()?, self.f64()?, self.f64()?))
    }
    fn pixel(&mut self) -> Result<Pixel, FilmBytesError> {
        Ok(Pixel {
            n: self.u32()?,
            nonfinite: self.u32()?,
            n_depth: self.u32()?,
            direct: self.dvec3()?,
            indirect: self.dvec3()?,
            emission: self.dvec3()?,
            m2: self.dvec3()?,
            alpha: self.f64()?,
            depth: self.f64()?,
            m2_luminance: self.f64()?,
        })
    }
}
