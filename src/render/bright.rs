//! Pixels that look at a flame or at a lamp in the mist: more camera rays for what is bright there.
//!
//! ```text
//! L of a pixel  ~  1/n^2 sum over n x n strata of  (L_emission + L_first order)(ray through a point of the stratum)
//! ```
//!
//! Flames are brighter than all around them and thinner than a pixel; the light that a medium
//! scatters beside a lamp grows as 1 / d toward it. What one ray a pass finds there jumps from pass to
//! pass, however exact the sum along it: four fifths of the grain of a picture with a fire in it,
//! a fifth of a stage's in 75 pixels. Rays that gather no photons are cheap beside those that do, and
//! these pixels are few.
//!
//! Which pixels: those on which a block of a medium with some share of its power falls
//! (`light::Glow`), and those around a point or a spot. The choice belongs to the pixel and not to
//! what a ray finds, so it changes no expectation: where something bright is missed, or a lens blurs it
//! beyond, one ray is as right and noisier.

use glam::Vec3;

use crate::effects::EffectPlan;
use crate::estimate::bands::TileGrid;
use crate::light::Light;
use crate::scene::Method;
use crate::spectrum::Spectrum;
use crate::world::World;

/// Strata of a pixel along an edge, n. Fewer: grain along the edges of flames; more: marches.
pub(super) const STRATA: u32 = 4;

/// Pixels around a lamp that belong to it. Fewer: grain around lamps; more: rays for what is smooth.
const AROUND: f32 = 4.0;

/// The pixels of the whole picture, row by row; none without such lights.
#[derive(Debug, Default)]
pub(super) struct BrightPixels {
    width: u32,
    pixels: Vec<bool>,
}

impl BrightPixels {
    /// Of a picture of `width` x `height`: where rays look for emission, around flames; where they
    /// look for lights that are sampled, around lamps. Paths look for both in their own way.
    pub(super) fn new<S: Spectrum>(
        world: &World<S>,
        plan: &EffectPlan,
        method: Method,
        [width, height]: [u32; 2],
    ) -> Self {
        if method == Method::Path {
            return Self::default();
        }
        let grid = TileGrid {
            low: [0, 0],
            high: [width, height],
        };
        let mut this = Self {
            width,
            pixels: Vec::new(),
        };
        let frame = world.camera.frame();
        let (_, seen) = world.media_for(&world.camera_inside);
        let pixel = world.camera.pixels_per_slope()[1].recip();
        for light in &world.lights {
            let spheres: Vec<(Vec3, f32)> = match light {
                Light::Glow(glow) if plan.emission => glow.bright_blocks().collect(),
                Light::Point(_) | Light::Spot(_) if plan.direct && !seen.is_empty() => {
                    let around = |p: Vec3| {
                        let depth = (p - world.camera.position).dot(frame[2]);
                        (p, AROUND * pixel * depth.abs())
                    };
                    light.position().map(around).into_iter().collect()
                }
                _ => continue,
            };
            this.pixels.resize(width as usize * height as usize, false);
            for (center, radius) in spheres {
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

    /// True where a pixel's strata have rays of their own.
    #[inline]
    pub(super) fn holds(&self, [x, y]: [u32; 2]) -> bool {
        let at = y as usize * self.width as usize + x as usize;
        self.pixels.get(at).copied().unwrap_or(false)
    }
}
