//! The part of the world that a medium takes, and how far kernels in it reach.
//!
//! ```text
//! reach <= a tenth of the part's half diagonal, a brick's edge; inside objects some mean free paths
//! ```

use crate::medium::Medium;
use crate::ray::Bounds;
use crate::spectrum::Spectrum;

/// Radius of a kernel inside an object, at most, in mean free paths. More: photons beside the
/// object that few kernels need; fewer: noise in the shade.
const MOST_PATHS: f32 = 8.0;

/// The same at least, a share of the object's half diagonal.
const LEAST_REACH: f32 = 0.03;

/// A medium's part of the world.
#[derive(Debug, Clone)]
pub struct Part {
    /// Box around the medium.
    pub bounds: Bounds,
    /// Boxes that hold all of it, where it does not fill its own.
    pub filled: Vec<Bounds>,
    /// Largest radius of a kernel in it; 0 where it scatters nothing, and nothing is gathered. \[m\]
    pub reach: f32,
}

impl Part {
    /// The part that a medium takes, within `bounds` if it has none itself.
    ///
    /// A kernel is at most a tenth of the part's half diagonal wide, and in grids a brick's edge:
    /// beyond that it blurs what the grid resolves.
    pub fn new<S: Spectrum>(medium: &Medium<S>, bounds: Bounds) -> Self {
        let bounds = medium.bounds().unwrap_or(bounds);
        let voxel = medium.voxel_size().unwrap_or(f32::INFINITY);
        Self {
            bounds,
            filled: Vec::new(),
            reach: (0.1 * bounds.radius()).min(8.0 * voxel),
        }
    }

    /// The part of what fills an object, given boxes that hold all of it.
    ///
    /// Photons are of use within a kernel's reach of the object alone, and nothing is seen of what
    /// lies many mean free paths inside: kernels are no wider than `MOST_PATHS` of them, but for
    /// the darkest places of a medium so dense that kernels would be empty.
    pub fn inside<S: Spectrum>(medium: &Medium<S>, bounds: Bounds, filled: Vec<Bounds>) -> Self {
        let mut part = Self::new(medium, bounds);
        let path = 1.0 / medium.sigma_t.max_channel();
        part.reach = part
            .reach
            .min((MOST_PATHS * path).max(LEAST_REACH * bounds.radius()));
        part.filled = filled;
        part
    }

    /// The box that kernels over the part's media reach.
    #[must_use]
    pub fn reached(&self) -> Bounds {
        grown(&self.bounds, self.reach)
    }
}

/// A box with a margin.
pub(super) fn grown(bounds: &Bounds, margin: f32) -> Bounds {
    Bounds {
        min: bounds.min - margin,
        max: bounds.max + margin,
    }
}
