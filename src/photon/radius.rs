//! The radius of a photon's kernel, from a pilot estimate.
//!
//! ```text
//! r(x) = d_k'(x) * (k / k' * n' / n)^(1/3)
//! d_k'  distance to the k'-th nearest of n' pilot photons [m]
//! k     photons wanted within r among the n of a pass
//! ```
//!
//! A few pilot photons are traced once; a kd-tree over them gives each leaf the radius at its
//! middle pilots. A photon's radius is that of the leaf it falls into: a descent of a dozen
//! comparisons, a fixed function of position (so the density estimate stays linear in the
//! photons), and independent of the pass. Photons fill space, so distances extrapolate by the
//! 3-D law; Mitsuba 0.6 and Tungsten use a 2-D one and get discs 1.5 times too wide.
//!
//! Radii are finite for any number of pilots: fewer than k' are asked for all there are; none, or
//! all at one point, get the cap. Progressive passes scale all radii by
//!
//! ```text
//! r_(j+1)^2 / r_j^2 = (j + alpha) / (j + 1)        beams (2-D blur), alpha = 2/3
//! r_(j+1)^3 / r_j^3 = (j + alpha) / (j + 1)        points (3-D blur), alpha = 4/7
//! ```
//!
//! Sources: Jensen 2001 (nearest neighbours); Jarosz et al. 2008 section 4.1 (photon radii);
//! Knaus & Zwicker 2011 (schedule); Kaplanyan & Dachsbacher 2013 (alpha = 4 / (4 + d)).

use glam::Vec3;
use rayon::prelude::*;

use super::kdtree::{KdTree, Nearest, Plane};

/// Neighbours asked of the pilot photons. Fewer: radii that jump from leaf to leaf, which shows as
/// a faint lattice in smooth light; more: radii blind to fine density. Distances scatter by
/// 1 / (3 sqrt(k')), here 4 %.
pub const PILOT_NEIGHBOURS: usize = 64;

/// The radius at every point of the world.
#[derive(Debug, Clone)]
pub struct RadiusField {
    /// Split planes of a complete binary tree, root first: axis and coordinate.
    splits: Vec<Plane>,
    /// Radius of each leaf, left to right. \[m\]
    radii: Vec<f32>,
}

impl RadiusField {
    /// The field from the positions of `pilots`, for `wanted` neighbours among `ratio` times as
    /// many photons, no radius outside `limits` \[m\].
    #[must_use]
    pub fn new(pilots: Vec<Vec3>, wanted: f32, ratio: f32, limits: [f32; 2]) -> Self {
        let [low, high] = limits;
        let clamp = |r: f32| if r > 0.0 { r.clamp(low, high) } else { high };
        if pilots.is_empty() {
            return Self {
                splits: Vec::new(),
                radii: vec![high],
            };
        }
        let near = PILOT_NEIGHBOURS.min(pilots.len() - 1).max(1);
        let scale = (wanted / near as f32 / ratio).cbrt();
        let tree = KdTree::new(pilots);
        let radii = (0..tree.leaves())
            .into_par_iter()
            .map_init(Nearest::default, |nearest, leaf| {
                let points = tree.leaf(leaf);
                let Some(middle) = points.get(points.len() / 2) else {
                    return high;
                };
                // One more than asked: the point finds itself.
                nearest.begin(near + 1, f32::INFINITY);
                tree.search(*middle, nearest);
                let farthest = nearest.finish().iter().fold(0.0f32, |d2, f| d2.max(f.0));
                clamp(farthest.sqrt() * scale)
            })
            .collect();
        Self {
            splits: tree.planes,
            radii,
        }
    }

    /// The radius of a photon at `p`. \[m\]
    #[inline]
    #[must_use]
    pub fn at(&self, p: Vec3) -> f32 {
        let mut node = 0;
        while node < self.splits.len() {
            let (axis, plane) = self.splits[node];
            node = 2 * node + 1 + usize::from(p[axis as usize] >= plane);
        }
        self.radii[node - self.splits.len()]
    }

    /// Smallest and largest radius. \[m\]
    #[must_use]
    pub fn range(&self) -> [f32; 2] {
        self.radii
            .iter()
            .fold([f32::MAX, 0.0], |[a, b], r| [a.min(*r), b.max(*r)])
    }
}

/// Factor on all radii in pass `pass` (from 0), for a blur over `dimension` dimensions.
#[must_use]
pub fn radius_scale(pass: u32, dimension: u32) -> f32 {
    let alpha = 4.0 / (4.0 + f64::from(dimension));
    let ratio: f64 = (1..=pass)
        .map(|j| (f64::from(j) - 1.0 + alpha) / f64::from(j))
        .product();
    ratio.powf(1.0 / f64::from(dimension)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    fn cube(n: u32, edge: f32) -> Vec<Vec3> {
        let mut rng = Rng::stream(3, Stage::Check, 0, 0);
        (0..n)
            .map(|_| Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * edge)
            .collect()
    }

    /// In a uniform density, the ball of radius r holds k of n photons.
    #[test]
    fn uniform_density_gives_the_radius_of_the_law() {
        let n = 20_000;
        let field = RadiusField::new(cube(n, 2.0), 50.0, 10.0, [0.0, 1e9]);
        let density = 10.0 * n as f32 / 8.0;
        let expected = (50.0 / density * 0.75 / std::f32::consts::PI).cbrt();
        let mut rng = Rng::stream(4, Stage::Check, 0, 0);
        let count = 4000;
        let mean = (0..count)
            .map(|_| field.at(Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) + 0.5))
            .sum::<f32>()
            / count as f32;
        // d_k' scatters by 1 / (3 sqrt(k')) = 10 % per leaf; the mean of some 300 leaves by 0.6 %.
        assert!(
            (mean / expected - 1.0).abs() < 0.03,
            "mean radius {mean}, expected {expected}"
        );
    }

    #[test]
    fn radii_are_finite_for_any_pilots() {
        for pilots in [vec![], vec![Vec3::ONE], vec![Vec3::ONE; 100], cube(3, 1.0)] {
            let field = RadiusField::new(pilots.clone(), 50.0, 1.0, [1e-4, 0.5]);
            for p in [Vec3::ZERO, Vec3::ONE, Vec3::splat(1e6)] {
                let r = field.at(p);
                assert!(
                    (1e-4..=0.5).contains(&r),
                    "radius {r} of {} pilots",
                    pilots.len()
                );
            }
        }
    }

    /// Sum of 1/r^2 over N passes grows like N^(1 - (1 - alpha)): the schedule's own law.
    #[test]
    fn schedule_follows_its_exponent() {
        let n = 100_000;
        let rate = (radius_scale(n, 2) / radius_scale(n / 10, 2)).log10();
        assert!(
            (2.0 * rate + 1.0 / 3.0).abs() < 1e-3,
            "r^2 falls like N^(alpha - 1): {}",
            2.0 * rate
        );
        let rate = (radius_scale(n, 3) / radius_scale(n / 10, 3)).log10();
        assert!(
            (3.0 * rate + 3.0 / 7.0).abs() < 1e-3,
            "r^3 falls like N^(alpha - 1): {}",
            3.0 * rate
        );
    }
}
