//! What a photon remembers of its way: its direction, and the compartment of the world it is in.
//!
//! ```text
//! (x, y) = d_xy / (|d_x| + |d_y| + |d_z|)      folded over where d_z < 0      13 bits each
//! ```
//!
//! The octahedral map (Cigolle et al. 2014, "A survey of efficient representations for independent
//! unit vectors") in 26 bits. Rounding moves x and y by up to h = 1 / 8191, hence z by up to 2 h:
//! sqrt 6 h on the octahedron, and times sqrt 3 where it is nearest to the sphere's centre: below
//! 5.2e-4 rad. Media that scatter isotropically need neither, and keep nothing.

use glam::Vec3;

/// Direction of travel as a photon keeps it.
pub trait Heading: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// True where directions are kept.
    const KEPT: bool;
    /// Keeps a direction, and the compartment of the world ([`crate::world::World::compartment`]).
    fn keep(direction: Vec3, compartment: u8) -> Self;
    /// The direction.
    fn direction(self) -> Vec3;
    /// The compartment.
    fn compartment(self) -> u8;
}

/// No direction: for media that scatter isotropically, in worlds of one compartment.
impl Heading for () {
    const KEPT: bool = false;
    fn keep(_direction: Vec3, _compartment: u8) -> Self {}
    fn direction(self) -> Vec3 {
        Vec3::ZERO
    }
    fn compartment(self) -> u8 {
        0
    }
}

/// Direction in 2 x 13 bits and the compartment in 6.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packed(u32);

impl Heading for Packed {
    const KEPT: bool = true;

    #[inline]
    fn keep(direction: Vec3, compartment: u8) -> Self {
        let d = direction / direction.abs().element_sum();
        let (mut x, mut y) = (d.x, d.y);
        if d.z < 0.0 {
            (x, y) = (
                (1.0 - d.y.abs()).copysign(d.x),
                (1.0 - d.x.abs()).copysign(d.y),
            );
        }
        let quantise = |v: f32| ((v * 0.5 + 0.5) * 8191.0).round() as u32 & 8191;
        Self(quantise(x) << 19 | quantise(y) << 6 | (u32::from(compartment) & 63))
    }

    #[inline]
    fn direction(self) -> Vec3 {
        let open = |q: u32| (q & 8191) as f32 * (2.0 / 8191.0) - 1.0;
        let (x, y) = (open(self.0 >> 19), open(self.0 >> 6));
        let z = 1.0 - x.abs() - y.abs();
        let d = if z < 0.0 {
            Vec3::new((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y), z)
        } else {
            Vec3::new(x, y, z)
        };
        d.normalize()
    }

    #[inline]
    fn compartment(self) -> u8 {
        (self.0 & 63) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Rng, Stage};

    #[test]
    fn directions_and_compartments_come_back() {
        let mut rng = Rng::stream(1, Stage::Check, 0, 0);
        let mut worst = 0.0f32;
        for i in 0..100_000u32 {
            let mut d = Vec3::from_array(std::array::from_fn(|_| 2.0 * rng.uniform() - 1.0));
            // Poles, equator and seams of the map too.
            match i % 5 {
                0 => d.z = 0.0,
                1 => d.x = 0.0,
                2 => d = Vec3::new(0.0, 0.0, d.z),
                _ => {}
            }
            let d = d.normalize();
            let kept = Packed::keep(d, (i % 64) as u8);
            assert_eq!(u32::from(kept.compartment()), i % 64, "compartment");
            worst = worst.max(kept.direction().distance(d));
        }
        // sqrt 18 / 8191, and near it: coarser would mean bits lost.
        assert!((4e-4..5.2e-4).contains(&worst), "off by {worst} rad");
    }
}
