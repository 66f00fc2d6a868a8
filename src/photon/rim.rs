//! Where the flat piece of surface around a point ends: at walls that stand on it, at its own edges.
//!
//! ```text
//! x + 0.001 r n, along u_k     meets a wall          u_k: DIRECTIONS unit vectors at right angles to n
//! x - 0.001 r n, along u_k     leaves the body       r: how far to look [m]
//!
//! line: o.(q - x) = h          o = -m_t / |m_t| where a wall of normal m is met at t,
//!                              +m_t / |m_t| where the body ends there; m_t = m - (m.n) n
//!                              h = t (u_k.o)                                              [m]
//! kept: q with o.(q - x) <= h for every line
//! share = 1/(2 pi) int_0^(2 pi) F(min(1, rho(a) / r)) da,    rho(a) = min h / (o.u(a)) over o.u(a) > 0
//! ```
//! x point, n its normal, F share of a kernel's mass within a distance of its middle.
//!
//! A kernel on a surface that counts only what is kept, and divides by its share, is right to first
//! order wherever the light on the surface is constant (Jones 1993, the local constant form). What
//! is kept is convex and holds x, so a few lines say all of it. A small body's line cuts off what
//! lies beside it too, on both sides of the account: that costs photons, not truth.
//!
//! Surfaces whose normals lie within `FLAT` of n go on, as in a bowl. Glass and interfaces end
//! nothing: light gets to what lies under them. Open sheets end unnoticed.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::estimate::kernel::Kernel;
use crate::surface::{Hit, Surfaces};

/// Directions of a look-around. A straight wall at distance h is missed where it is seen under less
/// than 45 degrees, beyond 0.92 r: there it hides less than 0.2 % of a biweight.
const DIRECTIONS: usize = 8;
/// Height of a look-around over the radius. Lower: rounding and the mesh's own facets are met;
/// higher: low steps are overlooked.
const HEIGHT: f32 = 1e-3;
/// Largest cosine between the normals of two surfaces that meet at an edge.
pub(crate) const FLAT: f32 = 0.7;
/// Directions of the integral for more than one line.
const SPOKES: u32 = 64;

/// Crossings that are looked through for the end of a body: one that has more within the radius is
/// not cut.
const CROSSINGS: usize = 16;

/// A straight end of a piece of surface.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Unit, in the plane of the surface, outwards.
    out: Vec3,
    /// From the middle. \[m\]
    distance: f32,
}

/// The ends of the surface around a point.
#[derive(Debug, Clone)]
pub struct Rim {
    middle: Vec3,
    /// Along which angles are counted, unit, in the plane of the surface.
    axes: [Vec3; 2],
    lines: [Line; 2 * DIRECTIONS],
    count: usize,
}

impl Rim {
    /// The ends within `radius` \[m\] of a hit on the side of `normal`. The directions begin at
    /// `turn` of the angle between two of them, from 0 to 1.
    #[must_use]
    pub fn around(surfaces: &Surfaces, hit: &Hit, normal: Vec3, radius: f32, turn: f32) -> Self {
        let mut rim = Self::none(hit.position, normal);
        let [a, b] = rim.axes;
        let step = HEIGHT * radius * normal;
        let above = hit.spawn_origin(normal) + step;
        let below = hit.spawn_origin(-normal) - step;
        for i in 0..DIRECTIONS {
            let (sin, cos) = (TAU * (i as f32 + turn) / DIRECTIONS as f32).sin_cos();
            let direction = cos * a + sin * b;
            let mut nearest = None;
            surfaces.opaque_along(above, direction, radius, |met| {
                let toward = if met.inwards { met.normal } else { -met.normal };
                if toward.dot(normal) <= FLAT && nearest.is_none_or(|(t, _)| met.t < t) {
                    nearest = Some((met.t, toward));
                }
            });
            if let Some((t, toward)) = nearest {
                rim.add(direction, t, toward);
            }
            if let Some((t, outwards)) = body_end(surfaces, below, direction, radius)
                && outwards.dot(normal) <= FLAT
            {
                rim.add(direction, t, -outwards);
            }
        }
        rim
    }

    /// A surface without ends.
    #[must_use]
    pub fn none(middle: Vec3, normal: Vec3) -> Self {
        let (a, b) = normal.any_orthonormal_pair();
        let line = Line {
            out: Vec3::ZERO,
            distance: f32::INFINITY,
        };
        Self {
            middle,
            axes: [a, b],
            lines: [line; 2 * DIRECTIONS],
            count: 0,
        }
    }

    fn lines(&self) -> &[Line] {
        &self.lines[..self.count]
    }

    /// Adds an end that the ray along `direction` met at `t`, of a surface of that normal, turned
    /// toward the middle.
    fn add(&mut self, direction: Vec3, t: f32, toward: Vec3) {
        let [a, b] = self.axes;
        let flat = Vec2::new(toward.dot(a), toward.dot(b)).normalize_or_zero();
        let out = -(flat.x * a + flat.y * b);
        let distance = t * direction.dot(out);
        // Several directions meet one wall.
        let known = |line: &Line| {
            line.out.dot(out) > 0.9999 && (line.distance - distance).abs() <= 0.01 * distance
        };
        if distance > 0.0 && !self.lines().iter().any(known) {
            self.lines[self.count] = Line { out, distance };
            self.count += 1;
        }
    }

    /// Is a point before all ends?
    #[inline]
    #[must_use]
    pub fn holds(&self, point: Vec3) -> bool {
        let off = point - self.middle;
        self.lines()
            .iter()
            .all(|line| line.out.dot(off) <= line.distance)
    }

    /// Share of the mass of a kernel of that radius that lies before all ends. The integral starts
    /// at `turn` of a step, from 0 to 1.
    #[must_use]
    pub fn share(&self, kernel: Kernel, radius: f32, turn: f32) -> f32 {
        match self.lines() {
            [] => 1.0,
            [line] => kernel.mass_within((line.distance / radius).min(1.0)),
            lines => {
                let [a, b] = self.axes;
                let sum: f32 = (0..SPOKES)
                    .map(|i| {
                        let (sin, cos) = (TAU * (i as f32 + turn) / SPOKES as f32).sin_cos();
                        let spoke = cos * a + sin * b;
                        let reach = lines.iter().fold(radius, |reach, line| {
                            let toward = line.out.dot(spoke);
                            if toward * reach > line.distance {
                                line.distance / toward
                            } else {
                                reach
                            }
                        });
                        kernel.disc_within(reach / radius)
                    })
                    .sum();
                sum / SPOKES as f32
            }
        }
    }
}

/// Where the bodies around `origin`, in a line, end within `reach`, and their normal there. A body
/// that begins where another ends (columns of one wall, boxes side by side) goes on.
fn body_end(surfaces: &Surfaces, origin: Vec3, direction: Vec3, reach: f32) -> Option<(f32, Vec3)> {
    let mut met = [(0.0f32, false, Vec3::ZERO); CROSSINGS];
    let mut count = 0;
    surfaces.opaque_along(origin, direction, reach, |m| {
        if count < CROSSINGS {
            met[count] = (m.t, m.inwards, m.normal);
        }
        count += 1;
    });
    let met = met.get(..count)?;
    let ends = met.iter().filter(|(t, inwards, _)| {
        let entered =
            |(at, inwards, _): &&(f32, bool, Vec3)| *inwards && *at <= *t + HEIGHT * reach;
        let left = |(at, inwards, _): &&(f32, bool, Vec3)| !*inwards && *at <= *t;
        !*inwards && met.iter().filter(left).count() > met.iter().filter(entered).count()
    });
    ends.min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(t, _, normal)| (*t, *normal))
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::scene::{Material, Object, Rgb, Shape};

    fn block(min: [f64; 3], max: [f64; 3]) -> Object {
        Object {
            name: "block".to_owned(),
            shape: Shape::Box {
                min: DVec3::from(min),
                max: DVec3::from(max),
            },
            transform: DAffine3::IDENTITY,
            material: Material::Diffuse {
                reflectance: Rgb::ONE,
                texture: None,
            },
            interior: None,
        }
    }

    /// Two blocks that share a face are one floor; it ends at its own edge, and at a wall on it.
    #[test]
    fn a_floor_ends_at_its_edge_and_at_walls() {
        let floor = [
            block([0.0, -1.0, 0.0], [1.0, 0.0, 1.0]),
            block([1.0, -1.0, 0.0], [2.0, 0.0, 1.0]),
            block([1.5, 0.0, 0.0], [1.6, 1.0, 1.0]),
        ];
        let surfaces = Surfaces::build(&floor, DVec3::ZERO).expect("blocks");
        for (x, share) in [
            (0.95, 1.0),
            (0.1, Kernel::Biweight.mass_within(0.1 / 0.3)),
            (1.4, Kernel::Biweight.mass_within(0.1 / 0.3)),
            (1.9, Kernel::Biweight.mass_within(0.1 / 0.3)),
        ] {
            let hit = surfaces
                .intersect(Vec3::new(x, 0.5, 0.5), Vec3::NEG_Y, 1.0)
                .expect("the floor");
            for turn in [0.0, 0.2, 0.5, 0.9] {
                let rim = Rim::around(&surfaces, &hit, Vec3::Y, 0.3, turn);
                let found = rim.share(Kernel::Biweight, 0.3, turn);
                assert!((found - share).abs() < 1e-3, "x {x}: {found}, {share}");
            }
        }
    }

    /// Two walls at right angles: shares against a sum over the disc.
    #[test]
    fn the_share_of_a_corner_is_that_of_its_points() {
        for (x, y) in [(0.3, 0.5), (0.05, 0.9), (0.2, 0.01)] {
            let mut rim = Rim::none(Vec3::ZERO, Vec3::Z);
            rim.add(Vec3::X, x, Vec3::NEG_X);
            rim.add(Vec3::new(0.8, 0.6, 0.0), y / 0.6, Vec3::NEG_Y);
            // The same wall again, and one behind it.
            rim.add(Vec3::new(0.8, -0.6, 0.0), x / 0.8, Vec3::NEG_X);
            rim.add(Vec3::Y, 2.0, Vec3::NEG_Y);
            let n = 800;
            let (mut all, mut kept) = (0.0, 0.0);
            for i in 0..n * n {
                let at = |i: u32| (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
                let q = Vec3::new(at(i % n), at(i / n), 0.0);
                if q.length_squared() < 1.0 {
                    let k = f64::from(Kernel::Biweight.shape(q.length_squared()));
                    all += k;
                    kept += if rim.holds(q) { k } else { 0.0 };
                }
            }
            let turns = 16;
            let share = (0..turns)
                .map(|i| f64::from(rim.share(Kernel::Biweight, 1.0, i as f32 / turns as f32)))
                .sum::<f64>()
                / f64::from(turns);
            // The grid's own error: points near the lines, 2 / n of the disc.
            assert!((share - kept / all).abs() < 2e-3, "{share} {}", kept / all);
            assert_eq!(rim.count, 3, "two walls, and one out of reach");
        }
    }
}
