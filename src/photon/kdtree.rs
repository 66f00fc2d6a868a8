//! A balanced kd-tree: points sorted in place, found near a place.
//!
//! ```text
//! a node's cell is cut where half of its points lie below, along the longest edge of their box
//! gap_a   distance to the cell along axis a, 0 inside     |gap|^2 <= squared distance of its points
//! ```
//!
//! Nodes are a complete binary tree, numbered root first, so a node is a plane and nothing else:
//! 8 bytes for each [`LEAF`] points. A query walks the nearer child first and leaves out every
//! cell whose squared gap is not below its bound (Arya & Mount 1993: the gap is carried along, one
//! axis at a time). [`Nearest`] keeps the k points nearest to a place.

use glam::Vec3;

use super::Photon;
use crate::spectrum::Spectrum;

/// Points in a leaf, at most. More: distances in vain; fewer: more nodes to walk.
pub(crate) const LEAF: usize = 8;

/// Points below which a tree is not worth two threads.
const ALONE: usize = 1 << 14;

/// What a tree sorts.
pub(crate) trait Place: Send {
    /// Where it is. \[m\]
    fn place(&self) -> Vec3;
}

impl Place for Vec3 {
    #[inline]
    fn place(&self) -> Vec3 {
        *self
    }
}

impl<S: Spectrum, H: Send> Place for Photon<S, H> {
    #[inline]
    fn place(&self) -> Vec3 {
        self.position
    }
}

/// A split plane: axis and coordinate.
pub(crate) type Plane = (u8, f32);

/// Points in the order of a tree.
#[derive(Debug)]
pub(crate) struct KdTree<P> {
    /// Split planes, root first.
    pub(crate) planes: Vec<Plane>,
    /// Points, leaf after leaf.
    pub(crate) points: Vec<P>,
    levels: u32,
}

/// A query: which cells it looks into, and what it does with their points.
pub(crate) trait Query<P> {
    /// Cells whose squared gap is not below this are left out; asked on entering a node. \[m2\]
    fn bound(&self, node: usize) -> f32;
    /// Takes a point with its index in the tree's order and its squared distance. \[m2\]
    fn offer(&mut self, index: usize, point: &P, d2: f32);
}

/// Points of the left child of a node of `count`.
fn half(count: usize) -> usize {
    count / 2
}

impl<P: Place> KdTree<P> {
    /// Sorts points into a tree; the same whatever the number of threads.
    pub(crate) fn new(mut points: Vec<P>) -> Self {
        let levels = points
            .len()
            .div_ceil(LEAF)
            .max(1)
            .next_power_of_two()
            .ilog2();
        // One subtree's planes side by side, so that two threads can fill them.
        let mut planes = vec![(0u8, 0.0f32); (1 << levels) - 1];
        split(&mut points, &mut planes);
        Self {
            planes: breadth_first(&planes),
            points,
            levels,
        }
    }

    /// Bytes that it takes in memory, as allocated.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.points.capacity() * size_of::<P>() + self.planes.capacity() * size_of::<Plane>()
    }

    /// Leaves.
    pub(crate) fn leaves(&self) -> usize {
        1 << self.levels
    }

    /// Points of a leaf.
    pub(crate) fn leaf(&self, leaf: usize) -> &[P] {
        let (mut start, mut count) = (0, self.points.len());
        for level in (0..self.levels).rev() {
            let left = half(count);
            if leaf >> level & 1 == 0 {
                count = left;
            } else {
                start += left;
                count -= left;
            }
        }
        &self.points[start..start + count]
    }

    /// Offers a query every point near `p` that its bound does not leave out.
    #[inline]
    pub(crate) fn search(&self, p: Vec3, query: &mut impl Query<P>) {
        self.descend(p, 0, [0, self.points.len()], Vec3::ZERO, query);
    }

    /// The part of a search below a node, which holds `count` points from `start` on.
    fn descend(
        &self,
        p: Vec3,
        node: usize,
        [start, count]: [usize; 2],
        gap: Vec3,
        query: &mut impl Query<P>,
    ) {
        if gap.length_squared() >= query.bound(node) {
            return;
        }
        let Some((axis, plane)) = self.planes.get(node) else {
            for (i, point) in (start..).zip(&self.points[start..start + count]) {
                query.offer(i, point, point.place().distance_squared(p));
            }
            return;
        };
        let left = half(count);
        let beyond = p[*axis as usize] - plane;
        let mut children = [
            (2 * node + 1, [start, left]),
            (2 * node + 2, [start + left, count - left]),
        ];
        if beyond >= 0.0 {
            children.swap(0, 1);
        }
        let mut far = gap;
        far[*axis as usize] = beyond;
        self.descend(p, children[0].0, children[0].1, gap, query);
        self.descend(p, children[1].0, children[1].1, far, query);
    }

    /// For each node, leaves included, the largest of a value over its points.
    pub(crate) fn largest(&self, of: impl Fn(&P) -> f32) -> Vec<f32> {
        let inner = self.planes.len();
        let mut largest = vec![0.0f32; inner + self.leaves()];
        for leaf in 0..self.leaves() {
            largest[inner + leaf] = self.leaf(leaf).iter().map(&of).fold(0.0, f32::max);
        }
        for node in (0..inner).rev() {
            largest[node] = largest[2 * node + 1].max(largest[2 * node + 2]);
        }
        largest
    }
}

/// Sorts points and notes the planes in depth-first order: node, left subtree, right subtree.
fn split<P: Place>(points: &mut [P], planes: &mut [Plane]) {
    let Some((plane, below)) = planes.split_first_mut() else {
        return;
    };
    let (low, high) = points
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| {
            (a.min(p.place()), b.max(p.place()))
        });
    let size = high - low;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else {
        usize::from(size.z > size.y) + 1
    };
    let middle = half(points.len());
    if middle < points.len() {
        points.select_nth_unstable_by(middle, |a, b| a.place()[axis].total_cmp(&b.place()[axis]));
        *plane = (axis as u8, points[middle].place()[axis]);
    }
    let alone = points.len() < ALONE;
    let (left, right) = points.split_at_mut(middle);
    let (left_planes, right_planes) = below.split_at_mut(below.len() / 2);
    if alone {
        split(left, left_planes);
        split(right, right_planes);
    } else {
        rayon::join(|| split(left, left_planes), || split(right, right_planes));
    }
}

/// Planes of a complete tree in breadth-first order, from depth-first order.
fn breadth_first(depth_first: &[Plane]) -> Vec<Plane> {
    fn place(from: &[Plane], node: usize, to: &mut [Plane]) {
        if let Some((plane, below)) = from.split_first() {
            to[node] = *plane;
            let (left, right) = below.split_at(below.len() / 2);
            place(left, 2 * node + 1, to);
            place(right, 2 * node + 2, to);
        }
    }
    let mut planes = vec![(0, 0.0); depth_first.len()];
    place(depth_first, 0, &mut planes);
    planes
}

/// The points nearest to a place. Candidates gather up to twice the number wanted before the
/// farther half is dropped: a constant cost each, where a sorted list costs k / 2 moves.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nearest {
    /// How many are kept.
    wanted: usize,
    /// No point at or beyond this squared distance is wanted. \[m2\]
    pub(crate) bound: f32,
    /// Added to the indices of points.
    pub(crate) first: usize,
    /// Squared distance and index.
    found: Vec<(f32, usize)>,
}

impl Nearest {
    /// Begins anew: the `wanted` nearest ones that are nearer than `within` \[m\].
    pub(crate) fn begin(&mut self, wanted: usize, within: f32) {
        self.wanted = wanted;
        self.bound = within * within;
        self.first = 0;
        self.found.clear();
    }

    /// Keeps the nearest ones only.
    fn trim(&mut self) {
        if self.found.len() > self.wanted {
            self.found
                .select_nth_unstable_by(self.wanted, |a, b| a.0.total_cmp(&b.0));
            self.found.truncate(self.wanted);
        }
    }

    /// Takes a point.
    #[inline]
    pub(crate) fn take(&mut self, index: usize, d2: f32) {
        if d2 < self.bound {
            self.found.push((d2, self.first + index));
            if self.found.len() >= 2 * self.wanted {
                self.trim();
                self.bound = self.found.iter().fold(0.0, |worst, f| worst.max(f.0));
            }
        }
    }

    /// What was found, at most the number wanted, in no particular order.
    pub(crate) fn finish(&mut self) -> &[(f32, usize)] {
        self.trim();
        &self.found
    }
}

impl Query<Vec3> for Nearest {
    #[inline]
    fn bound(&self, _node: usize) -> f32 {
        self.bound
    }
    #[inline]
    fn offer(&mut self, index: usize, _point: &Vec3, d2: f32) {
        self.take(index, d2);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    fn points(n: u32) -> Vec<Vec3> {
        let mut rng = Rng::stream(3, Stage::Check, 0, 0);
        (0..n)
            .map(|_| Vec3::new(rng.uniform(), rng.uniform() * rng.uniform(), rng.uniform()))
            .collect()
    }

    #[test]
    fn the_nearest_equal_brute_force() {
        // 40 000 are split by two threads.
        for n in [0, 1, 7, 8, 9, 500, 40_000] {
            let points = points(n);
            let tree = KdTree::new(points.clone());
            let mut nearest = Nearest::default();
            let mut rng = Rng::stream(4, Stage::Check, 0, 0);
            for wanted in [1, 2, 13, 50] {
                for within in [0.01, 0.3, f32::INFINITY] {
                    let p = Vec3::new(rng.uniform(), rng.uniform(), 1.2 * rng.uniform());
                    let mut all: Vec<f32> = points.iter().map(|q| q.distance_squared(p)).collect();
                    all.sort_by(f32::total_cmp);
                    all.retain(|d2| *d2 < within * within);
                    all.truncate(wanted);
                    nearest.begin(wanted, within);
                    tree.search(p, &mut nearest);
                    let mut found = nearest.finish().to_vec();
                    found.sort_by(|a, b| a.0.total_cmp(&b.0));
                    for (d2, index) in &found {
                        assert_eq!(*d2, tree.points[*index].distance_squared(p), "its index");
                    }
                    let found: Vec<f32> = found.iter().map(|f| f.0).collect();
                    assert_eq!(found, all, "{wanted} of {n} within {within} of {p}");
                }
            }
        }
    }

    #[test]
    fn leaves_tile_the_points_in_order() {
        for n in [0, 1, 8, 9, 1000] {
            let tree = KdTree::new(points(n));
            let leaves: Vec<Vec3> = (0..tree.leaves())
                .flat_map(|leaf| tree.leaf(leaf).to_vec())
                .collect();
            assert_eq!(leaves, tree.points, "{n} points");
            let largest = tree.largest(|p| p.y);
            let highest = tree.points.iter().map(|p| p.y).fold(0.0, f32::max);
            assert_eq!(largest[0], highest, "the root's largest of {n}");
        }
    }
}
