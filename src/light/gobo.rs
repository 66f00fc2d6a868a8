//! A picture in front of a spot: a slide, or the pattern cut into a gobo.
//!
//! ```text
//! x = (w . right) / (w . a) / tan(cone)      y = (w . up) / (w . a) / tan(cone)      in [-1, 1]
//! I(w) = I_0 falloff(w) picture(x, y)                                                [W/sr]
//! ```
//!
//! The picture's square is the one around the outer cone, seen upright from behind the light: its
//! left is left of the axis. It filters the light, so the power of the spot is that before it.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use crate::scene::Rgb;
use crate::surface::{Texture, TextureError};

/// See the module's page.
#[derive(Debug, Clone)]
pub(super) struct Gobo(Arc<Texture>);

/// A gobo before a spot.
#[derive(Debug, Clone)]
pub(super) struct Slide {
    gobo: Gobo,
    /// Right and up, over the tangent of the cone's angle.
    axes: [Vec3; 2],
}

impl Gobo {
    /// Reads a PNG.
    pub(super) fn load(file: &Path) -> Result<Self, TextureError> {
        Ok(Self(Arc::new(Texture::load(file)?)))
    }

    /// Put before a spot along `axis`, unit length; up is +y as far as it can be.
    pub(super) fn before(self, axis: DVec3, cone_angle: f64) -> Slide {
        let up = if axis.y.abs() < 0.999 {
            DVec3::Y
        } else {
            DVec3::Z
        };
        let right = axis.cross(up).normalize();
        let scale = cone_angle.min(89.0).to_radians().tan().recip();
        Slide {
            gobo: self,
            axes: [right, right.cross(axis)].map(|a| (a * scale).as_vec3()),
        }
    }
}

impl Slide {
    /// Share of the light that passes along `direction`.
    pub(super) fn filter(&self, axis: Vec3, direction: Vec3) -> Rgb {
        let depth = direction.dot(axis);
        if depth <= 0.0 {
            return Rgb::ZERO;
        }
        let at = Vec2::from(self.axes.map(|a| direction.dot(a))) / depth;
        // Repeating pictures: nothing beyond the square.
        if at.abs().max_element() >= 1.0 {
            return Rgb::ZERO;
        }
        self.gobo.0.at(at * 0.5 + 0.5)
    }
}
