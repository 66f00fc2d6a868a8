//! Does a mesh enclose a volume, and does it face outwards?
//!
//! Corners at the same place count as one. A mesh is closed when every directed edge (i, j) occurs
//! as often as its reverse (j, i): each crossing of the surface then has a side, even where more
//! than two triangles meet in an edge. Its signed volume is
//! `V = 1/6 sum (a x b) . c` \[m3\] over the triangles, by the divergence theorem; it faces outwards
//! when V > 0.

use std::collections::HashMap;

use glam::Vec3;

/// What the edges of a mesh say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::surface) struct Closure {
    /// Edges without a partner in the opposite direction.
    pub(in crate::surface) open_edges: usize,
    /// \[m3\]
    pub(in crate::surface) volume: f64,
}

/// Checks the edges of a mesh.
pub(in crate::surface) fn closure(positions: &[Vec3], triangles: &[[u32; 3]]) -> Closure {
    // Adding zero makes -0 and 0 the same place.
    let place = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut places: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let welded: Vec<u32> = positions
        .iter()
        .map(|&p| {
            let next = places.len() as u32;
            *places.entry(place(p)).or_insert(next)
        })
        .collect();
    let mut balance: HashMap<(u32, u32), i32> = HashMap::with_capacity(triangles.len() * 3 / 2);
    let mut volume = 0.0;
    let center = positions.first().map_or(Vec3::ZERO, |p| *p).as_dvec3();
    for corners in triangles {
        let [i, j, k] = corners.map(|c| welded[c as usize]);
        for (from, to) in [(i, j), (j, k), (k, i)] {
            // Corners that fell together leave no edge between them.
            if from == to {
                continue;
            }
            *balance.entry((from.min(to), from.max(to))).or_insert(0) +=
                if from < to { 1 } else { -1 };
        }
        let [a, b, c] = corners.map(|c| positions[c as usize].as_dvec3() - center);
        volume += a.cross(b).dot(c) / 6.0;
    }
    // The map's order differs from run to run; a count does not.
    let open_edges = balance.values().filter(|&&sum| sum != 0).count();
    Closure { open_edges, volume }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 4] = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    const OUTWARDS: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

    #[test]
    fn a_tetrahedron_is_closed_and_faces_outwards() {
        let found = closure(&CORNERS, &OUTWARDS);
        assert_eq!((found.open_edges, found.volume), (0, 1.0 / 6.0));
        let inwards = OUTWARDS.map(|[a, b, c]| [a, c, b]);
        assert_eq!(closure(&CORNERS, &inwards).volume, -1.0 / 6.0);
    }

    #[test]
    fn a_missing_or_turned_triangle_is_seen() {
        assert_eq!(closure(&CORNERS, &OUTWARDS[..3]).open_edges, 3);
        let mut turned = OUTWARDS;
        turned[0] = [0, 1, 2];
        assert_eq!(closure(&CORNERS, &turned).open_edges, 3);
    }

    #[test]
    fn collapsed_triangles_open_nothing() {
        let mut triangles = OUTWARDS.to_vec();
        triangles.extend([[0, 0, 1], [2, 2, 2]]);
        assert_eq!(closure(&CORNERS, &triangles).open_edges, 0);
    }

    #[test]
    fn seams_with_doubled_corners_are_welded() {
        let corners: Vec<Vec3> = OUTWARDS
            .iter()
            .flatten()
            .map(|&i| CORNERS[i as usize] * Vec3::new(-1.0, 1.0, 1.0))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..4).map(|t| [3 * t, 3 * t + 2, 3 * t + 1]).collect();
        assert_eq!(closure(&corners, &triangles).open_edges, 0);
    }
}
