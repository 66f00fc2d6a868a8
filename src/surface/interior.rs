//! Which object's interior a point lies in, carried along a path.
//!
//! The rule for overlaps: of all enclosing objects that contain a point, the one that stands last
//! in the scene file owns it. What fills the point is that object's interior medium, or nothing if
//! it has none; points that no object owns lie in the volumes and fogs of the scene. The boundary
//! of an object that does not own the point on either side is hidden: light passes it unbent.
//!
//! The rule depends on the place alone and not on the way there, so photons and camera paths,
//! which come from opposite sides, agree about every overlap. (Owner = entered last, which some
//! renderers use, does not: two overlapping balls entered in either order would differ.)
//! Source: Schmidt & Budge 2002, "Simple nested dielectrics in ray traced images", with the file's
//! order as priority. Only glass and interfaces that are closed enclose anything.

/// How many objects may contain one point; of more, those first in the file are forgotten.
const DEPTH: usize = 8;

/// The enclosing objects that contain a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Inside {
    /// Sorted; an object whose own parts overlap occurs more than once.
    objects: [u32; DEPTH],
    len: u8,
}

impl Inside {
    /// In no object.
    pub const NOTHING: Self = Self {
        objects: [0; DEPTH],
        len: 0,
    };

    fn list(&self) -> &[u32] {
        &self.objects[..usize::from(self.len)]
    }

    /// The object that owns the point; `None` for the open scene.
    #[must_use]
    pub fn owner(&self) -> Option<u32> {
        self.list().last().copied()
    }

    /// The objects that contain the point, in the file's order.
    #[must_use]
    pub fn objects(&self) -> &[u32] {
        self.list()
    }

    /// True inside `object`, owner or not.
    #[must_use]
    pub fn contains(&self, object: u32) -> bool {
        self.list().contains(&object)
    }

    /// True when the boundary of an enclosing `object` is hidden here, inside an owner that stands
    /// later in the file.
    #[must_use]
    pub fn hides(&self, object: u32) -> bool {
        self.owner().is_some_and(|owner| owner > object)
    }

    /// The path passes the boundary of an enclosing object, inwards or outwards.
    pub fn cross(&mut self, object: u32, inwards: bool) {
        if inwards {
            self.enter(object);
        } else {
            self.leave(object);
        }
    }

    fn enter(&mut self, object: u32) {
        let mut len = usize::from(self.len);
        if len == DEPTH {
            if object < self.objects[0] {
                return;
            }
            self.objects.copy_within(1.., 0);
            len -= 1;
        }
        let at = self.objects[..len].partition_point(|&o| o <= object);
        self.objects.copy_within(at..len, at + 1);
        self.objects[at] = object;
        self.len = len as u8 + 1;
    }

    /// Leaving what was never entered (a path that started on the boundary) changes nothing.
    fn leave(&mut self, object: u32) {
        if let Some(at) = self.list().iter().position(|&o| o == object) {
            self.objects.copy_within(at + 1.., at);
            self.len -= 1;
            // Equal sets compare equal.
            self.objects[usize::from(self.len)..].fill(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(steps: &[(u32, bool)]) -> Inside {
        let mut inside = Inside::NOTHING;
        for &(object, inwards) in steps {
            inside.cross(object, inwards);
        }
        inside
    }

    #[test]
    fn the_last_in_the_file_owns_an_overlap_from_either_side() {
        let there = after(&[(1, true), (2, true)]);
        let back = after(&[(2, true), (1, true)]);
        assert_eq!(there, back);
        assert_eq!(there.owner(), Some(2));
        assert!(there.hides(1) && !there.hides(2) && there.contains(1));
    }

    #[test]
    fn leaving_restores() {
        assert_eq!(after(&[(3, true), (1, true), (3, false)]).owner(), Some(1));
        assert_eq!(after(&[(3, true), (3, false)]), Inside::NOTHING);
        assert_eq!(after(&[(5, false)]), Inside::NOTHING);
    }

    #[test]
    fn parts_of_one_object_may_overlap() {
        let inside = after(&[(4, true), (4, true), (4, false)]);
        assert_eq!(inside.owner(), Some(4));
    }

    #[test]
    fn too_deep_forgets_the_first_in_the_file() {
        let mut inside = Inside::NOTHING;
        for object in 0..10 {
            inside.cross(object, true);
        }
        assert_eq!(inside.owner(), Some(9));
        assert!(!inside.contains(1) && inside.contains(2));
    }
}
