//! Photons on diffuse surfaces: the map, and the radiance that leaves a point of it.
//!
//! ```text
//! L(x, w) = sum_i f(w_i, w) Phi_i K(|x - x_i|, r(x))        [W/(m2 sr)]
//! K       = 3 / (pi r^2) (1 - d^2/r^2)^2                    2-D biweight [1/m2]
//! r(x)    = d_k'(x) (k / k' * n' / n)^(1/2)                 [m]
//! d_k'    distance from x to the k'-th nearest of n' pilot photons on the same side
//! ```
//!
//! The radius belongs to the point that is looked at and comes from pilots that were traced once,
//! so the estimate is linear in the photons of a pass and passes may shrink all radii by one
//! factor (`photon::radius`); photons lie on surfaces, so distances extrapolate by the 2-D law.
//! A photon counts if its normal is within `FLAT` of the point's, and if it lies no farther
//! from the tangent plane than half its distance allows: the other wall of a corner and the other
//! side of a thin plate are not mixed in. Sources: Jensen 2001, chapter 7; Silverman 1986.
//!
//! Beside a wall or an edge part of the disc holds no photons: only what lies before the ends of the
//! surface counts (`photon::rim`), divided by its share of the kernel,
//! ```text
//! L(x, w) = sum_(i kept) f Phi_i K / share
//! ```
//! Where light changes along the surface that leaves a bias of first order in r within r of an end,
//! and one of second order elsewhere; both vanish with r over the passes. Open sheets that end in
//! the air, and bodies thinner than r, stay too dark there.

use glam::Vec3;

use super::radius::PILOT_NEIGHBOURS;
use super::rim::{FLAT, Rim};
use crate::estimate::kernel::Kernel;
use crate::spectrum::Spectrum;
use crate::surface::{Bsdf, Hit, Surfaces};

/// A photon that arrives on a diffuse surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePhoton<S> {
    /// Where. \[m\]
    pub position: Vec3,
    /// Geometric normal on the side from which it came.
    pub normal: Vec3,
    /// Direction of travel.
    pub direction: Vec3,
    /// \[W\]
    pub power: S,
}

/// Photons in a kd-tree: the middle of each run splits it along its longest axis.
#[derive(Debug)]
pub struct SurfaceMap<S> {
    photons: Vec<SurfacePhoton<S>>,
    axes: Vec<u8>,
}

impl<S: Spectrum> SurfaceMap<S> {
    /// Sorts photons into the tree.
    #[must_use]
    pub fn new(mut photons: Vec<SurfacePhoton<S>>) -> Self {
        let mut axes = vec![0; photons.len()];
        split(&mut photons, &mut axes);
        Self { photons, axes }
    }

    /// Bytes that the map takes in memory, as allocated.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        self.photons.capacity() * size_of::<SurfacePhoton<S>>() + self.axes.capacity()
    }

    /// Number of photons.
    #[must_use]
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// True without photons.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// Visits the photons nearer to `p` than the squared distance that `visit` returns, with their
    /// own squared distance; `reach2` is where it starts. \[m2\]
    fn near(&self, p: Vec3, reach2: f32, mut visit: impl FnMut(&SurfacePhoton<S>, f32) -> f32) {
        let mut reach2 = reach2;
        // Runs still to be looked at, and the squared distance of the plane before them.
        let mut stack = [(0usize, 0usize, 0.0f32); 64];
        stack[0] = (0, self.photons.len(), 0.0);
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (mut start, mut end, gap2) = stack[depth];
            if gap2 >= reach2 {
                continue;
            }
            while start < end {
                let middle = start + (end - start) / 2;
                let photon = &self.photons[middle];
                let axis = usize::from(self.axes[middle]);
                let gap = p[axis] - photon.position[axis];
                let d2 = photon.position.distance_squared(p);
                if d2 < reach2 {
                    reach2 = visit(photon, d2);
                }
                let (near, far) = if gap < 0.0 {
                    ((start, middle), (middle + 1, end))
                } else {
                    ((middle + 1, end), (start, middle))
                };
                if far.0 < far.1 && depth < stack.len() {
                    stack[depth] = (far.0, far.1, gap * gap);
                    depth += 1;
                }
                (start, end) = near;
            }
        }
    }

    /// Squared distance from `p` to its `count`-th nearest photon on the side of `normal`, at most
    /// `reach2`. \[m2\]
    fn neighbour2(&self, p: Vec3, normal: Vec3, count: usize, reach2: f32) -> f32 {
        let mut nearest = [f32::INFINITY; PILOT_NEIGHBOURS];
        let count = count.clamp(1, PILOT_NEIGHBOURS);
        let mut found = 0;
        self.near(p, reach2, |photon, d2| {
            if one_surface(photon, p, normal, d2) {
                let at = nearest[..found].partition_point(|d| *d <= d2);
                if at < count {
                    nearest.copy_within(at..count - 1, at + 1);
                    nearest[at] = d2;
                    found = (found + 1).min(count);
                }
            }
            if found == count {
                nearest[count - 1].min(reach2)
            } else {
                reach2
            }
        });
        if found == count {
            nearest[count - 1]
        } else {
            reach2
        }
    }
}

/// True where a photon lies on the surface through `p` with that normal.
#[inline]
fn one_surface<S>(photon: &SurfacePhoton<S>, p: Vec3, normal: Vec3, d2: f32) -> bool {
    let off = (photon.position - p).dot(normal);
    photon.normal.dot(normal) > FLAT && off * off <= 0.25 * d2
}

/// Sorts a run into the tree.
fn split<S: Spectrum>(photons: &mut [SurfacePhoton<S>], axes: &mut [u8]) {
    if photons.is_empty() {
        return;
    }
    let (low, high) = photons
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| {
            (a.min(p.position), b.max(p.position))
        });
    let axis = (high - low).max_position();
    let middle = photons.len() / 2;
    photons.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    axes[middle] = axis as u8;
    let (left, right) = photons.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    let (right, right_axes) = (&mut right[1..], &mut right_axes[1..]);
    if left.len() > 1 << 12 {
        rayon::join(|| split(left, left_axes), || split(right, right_axes));
    } else {
        split(left, left_axes);
        split(right, right_axes);
    }
}

/// The radius at every point of the surfaces.
#[derive(Debug)]
pub struct SurfaceRadius<S> {
    pilots: SurfaceMap<S>,
    /// Neighbours asked of the pilots.
    near: usize,
    /// From their distance to the radius.
    scale: f32,
    /// Smallest and largest. \[m\]
    limits: [f32; 2],
}

impl<S: Spectrum> SurfaceRadius<S> {
    /// Radii for `wanted` neighbours among `ratio` times as many photons as there are pilots.
    #[must_use]
    pub fn new(pilots: Vec<SurfacePhoton<S>>, wanted: f32, ratio: f32, limits: [f32; 2]) -> Self {
        let near = PILOT_NEIGHBOURS.min(pilots.len()).max(1);
        Self {
            near,
            scale: (wanted / near as f32 / ratio).sqrt(),
            limits,
            pilots: SurfaceMap::new(pilots),
        }
    }

    /// The radius at a point. \[m\]
    #[must_use]
    pub fn at(&self, p: Vec3, normal: Vec3) -> f32 {
        let [low, high] = self.limits;
        let reach = high / self.scale;
        let d2 = self.pilots.neighbour2(p, normal, self.near, reach * reach);
        (d2.sqrt() * self.scale).clamp(low, high)
    }
}

/// The surface photons of a pass, with their radii.
#[derive(Debug)]
pub struct SurfaceGather<'a, S> {
    /// Photons.
    pub map: SurfaceMap<S>,
    /// Radii of the first pass.
    pub radius: &'a SurfaceRadius<S>,
    /// Factor on them.
    pub scale: f32,
}

impl<S: Spectrum> SurfaceGather<'_, S> {
    /// Radiance that leaves a hit along `w_out`; also the number of photons that were added. `turn`
    /// from 0 to 1 turns the look-around for the surface's ends. \[W/(m2 sr)\]
    #[must_use]
    pub fn radiance(
        &self,
        (surfaces, hit): (&Surfaces, &Hit),
        bsdf: &Bsdf,
        w_out: Vec3,
        turn: f32,
    ) -> (S, u64) {
        if self.map.is_empty() {
            return (S::ZERO, 0);
        }
        let (p, normal) = (hit.position, hit.facing());
        let r = self.radius.at(p, normal) * self.scale;
        let rim = Rim::around(surfaces, hit, normal, r, turn);
        let (mut sum, mut count) = (S::ZERO, 0);
        let inverse = 1.0 / (r * r);
        self.map.near(p, r * r, |photon, d2| {
            if one_surface(photon, p, normal, d2) && rim.holds(photon.position) {
                let f = S::from_rgb(bsdf.gather(photon.direction, w_out));
                sum += f * photon.power * Kernel::Biweight.shape(d2 * inverse);
                count += 1;
            }
            r * r
        });
        let share = rim.share(Kernel::Biweight, r, turn);
        (sum * (Kernel::Biweight.disc() * inverse / share), count)
    }
}
