//! Where an enclosing object is: boxes that together hold all of its inside.
//!
//! ```text
//! filled = cells that a primitive's box touches + cells that no way from outside leads to but through those
//! ```
//!
//! On a coarse grid over the object, conservative: a cell too many is possible, none is missing. The
//! ways from outside are followed from cell to cell through their faces, from a layer of empty cells
//! around the grid; since the object is closed they cannot get in. Boxes are runs of filled cells
//! along x.

use glam::{IVec3, Vec3};

use super::Surfaces;
use super::hierarchy::Primitive;
use crate::ray::Bounds;

/// Cells along the longest edge. More: boxes that follow the object more closely, and more of them.
const CELLS: f32 = 64.0;

/// Share of a cell by which primitives are widened. Smaller: rounding opens a way in; larger: cells
/// beside the object.
const MARGIN: f32 = 1e-3;

/// A grid over an object with a layer of cells around it.
struct Cells {
    low: Vec3,
    edge: f32,
    count: IVec3,
    /// What each cell is, x fastest.
    kind: Vec<Kind>,
}

/// What is known of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Nothing: inside, in the end.
    Unknown,
    /// The boundary may pass.
    Boundary,
    /// Reached from outside.
    Outside,
}

impl Cells {
    fn new(bounds: &Bounds) -> Self {
        let size = bounds.size();
        let edge = (size.max_element() / CELLS).max(f32::MIN_POSITIVE);
        let count = (size / edge).ceil().as_ivec3().max(IVec3::ONE) + 2;
        Self {
            low: bounds.min - edge,
            edge,
            count,
            kind: vec![Kind::Unknown; count.as_usizevec3().element_product()],
        }
    }

    fn index(&self, c: IVec3) -> usize {
        ((c.z * self.count.y + c.y) * self.count.x + c.x) as usize
    }

    fn cell_of(&self, p: Vec3) -> IVec3 {
        let c = ((p - self.low) / self.edge).floor().as_ivec3();
        c.clamp(IVec3::ONE, self.count - 2)
    }

    /// The boundary may pass within a box.
    fn touch(&mut self, low: Vec3, high: Vec3) {
        let margin = MARGIN * self.edge;
        let (first, last) = (self.cell_of(low - margin), self.cell_of(high + margin));
        for z in first.z..=last.z {
            for y in first.y..=last.y {
                let row = self.index(IVec3::new(first.x, y, z));
                self.kind[row..=row + (last.x - first.x) as usize].fill(Kind::Boundary);
            }
        }
    }

    /// Follows all ways from a corner of the outer layer.
    fn flood(&mut self) {
        self.kind[0] = Kind::Outside;
        let mut open = vec![IVec3::ZERO];
        while let Some(c) = open.pop() {
            for step in [IVec3::X, IVec3::Y, IVec3::Z] {
                for next in [c - step, c + step] {
                    if next.cmpge(IVec3::ZERO).all() && next.cmplt(self.count).all() {
                        let at = self.index(next);
                        if self.kind[at] == Kind::Unknown {
                            self.kind[at] = Kind::Outside;
                            open.push(next);
                        }
                    }
                }
            }
        }
    }

    /// The runs of cells that are not outside.
    fn runs(&self) -> Vec<Bounds> {
        let mut runs = Vec::new();
        for z in 0..self.count.z {
            for y in 0..self.count.y {
                let mut start = None;
                for x in 0..self.count.x {
                    // The last of a row is of the outer layer, and ends every run.
                    let at = IVec3::new(x, y, z);
                    match (self.kind[self.index(at)] == Kind::Outside, start) {
                        (false, None) => start = Some(at),
                        (true, Some(first)) => {
                            runs.push(Bounds {
                                min: self.corner(first),
                                max: self.corner(at + IVec3::new(0, 1, 1)),
                            });
                            start = None;
                        }
                        _ => {}
                    }
                }
            }
        }
        runs
    }

    fn corner(&self, c: IVec3) -> Vec3 {
        c.as_vec3() * self.edge + self.low
    }
}

impl Surfaces {
    /// Boxes that hold all of the inside of an object that encloses one. \[m\]
    #[must_use]
    pub fn filled(&self, object: u32) -> Vec<Bounds> {
        let (min, max) = self.object_bounds(object);
        let mut cells = Cells::new(&Bounds { min, max });
        for (index, leaf) in (0..).zip(&self.leaves) {
            if leaf.object != object {
                continue;
            }
            match self.hierarchy.primitive(index) {
                Primitive::Triangle([a, b, c]) => cells.touch(a.min(b).min(c), a.max(b).max(c)),
                Primitive::Ellipsoid(e) => {
                    let (low, high) = self.hierarchy.ellipsoid(e).bounds();
                    cells.touch(low, high);
                }
            }
        }
        cells.flood();
        cells.runs()
    }
}
