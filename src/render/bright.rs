//! Pixels that look at a medium that shines: its light has camera rays of its own.
//!
//! ```text
//! L_emission of a pixel  ~  1/n^2 sum over n x n strata of  L_e(ray through a point of the stratum)
//! ```
//!
//! Flames are brighter than all around them and thinner than a pixel. What one ray a pass finds
//! there jumps from pass to pass, though each ray's sum is exact; it was four fifths of the grain of
//! a picture with a fire in it. Rays that ask for nothing but the emission up to the first surface are cheap beside
//! those that gather photons.
//!
//! Which pixels: those on which a block of the medium with some share of its power falls
//! (`light::Glow`). The choice belongs to the pixel and not to what a ray finds, so it changes no expectation:
//! where a block is missed, or a lens blurs it beyond, one ray is as right and noisier.

use crate::estimate::bands::TileGrid;
use crate::light::Light;
use crate::spectrum::Spectrum;
use crate::world::World;

/// Strata of a pixel along an edge, n. Fewer: grain along the edges of flames; more: marches.
pub(super) const STRATA: u32 = 4;

/// The pixels of the whole picture, row by row; none without a medium that shines.
#[derive(Debug, Default)]
pub(super) struct BrightPixels {
    width: u32,
    pixels: Vec<bool>,
}

impl BrightPixels {
    /// Of a picture of `width` x `height`.
    pub(super) fn new<S: Spectrum>(world: &World<S>, [width, height]: [u32; 2]) -> Self {
        let grid = TileGrid {
            low: [0, 0],
            high: [width, height],
        };
        let mut this = Self {
            width,
            pixels: Vec::new(),
        };
        let frame = world.camera.frame();
        for light in &world.lights {
            let Light::Glow(glow) = light else {
                continue;
            };
            let count = width as usize * height as usize;
            this.pixels.resize(count, false);
            for (center, radius) in glow.bright_blocks() {
                let Some([[x0, x1], [y0, y1]]) =
                    grid.footprint(&world.camera, &frame, center, radius)
                else {
                    continue;
                };
                for y in y0..=y1 {
                    let row = y as usize * width as usize;
                    this.pixels[row + x0 as usize..=row + x1 as usize].fill(true);
                }
            }
        }
        this
    }

    /// True where the emission has rays of its own.
    #[inline]
    pub(super) fn holds(&self, [x, y]: [u32; 2]) -> bool {
        let at = y as usize * self.width as usize + x as usize;
        self.pixels.get(at).copied().unwrap_or(false)
    }
}
