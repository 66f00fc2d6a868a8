//! Look-ups at places near one another.

use glam::Vec3;
use wide::i32x4;

use super::place::Opened;
use super::{Grid, cell_and_fraction};

/// Looks a field up at places near one another, as along a ray: the last brick is kept at hand, so
/// that only a new one is looked for in the index.
#[derive(Debug, Clone)]
pub struct Cursor<'a> {
    grid: &'a Grid,
    /// Coordinates of the brick.
    at: i32x4,
    brick: Opened,
}

impl Cursor<'_> {
    /// The field at a local point: [`Grid::lookup`].
    #[inline(always)]
    #[must_use]
    pub fn lookup(&mut self, p: Vec3) -> f32 {
        let (cell, f) = cell_and_fraction(p);
        let at = cell >> 3;
        if at != self.at {
            self.at = at;
            self.brick = self.grid.places.at(cell).open(self.grid.places.zero());
        }
        let spot = self.brick.spot(cell);
        self.grid.values.corners(spot).at(f)
    }
}

impl Grid {
    /// A look-up for places near one another.
    #[inline]
    #[must_use]
    pub fn cursor(&self) -> Cursor<'_> {
        let outside = i32x4::splat(i32::MIN);
        Cursor {
            grid: self,
            at: outside >> 3,
            brick: self.places.at(outside).open(self.places.zero()),
        }
    }
}
