//! Grids as densities: values that no density can have, and level sets made into fog.
//!
//! A density is finite and not negative. Others are counted and become 0 (not finite, negative);
//! a strict caller refuses the grid instead.
//!
//! Level set to fog: with φ the signed distance, negative inside, and h the half width of its
//! band, which is its background: density = clamp(-φ/h, 0, 1). It is 1 deep inside, where tiles
//! hold -h, 0 at the surface and outside. φ and h have the same unit. \[m\]
//! (OpenVDB's `sdfToFogVolume` does the same, except that its cutoff may be chosen.)

use std::sync::atomic::{AtomicU64, Ordering};

use super::error::Fault;
use super::grid::ScalarGrid;

/// Cleans values on many threads and counts what it found.
#[derive(Debug, Default)]
pub struct Cleaner {
    not_finite: AtomicU64,
    negative: AtomicU64,
}

impl Cleaner {
    /// A counter at zero.
    pub fn new() -> Self {
        Self::default()
    }

    /// The value as a density.
    pub fn value(&self, v: f32) -> f32 {
        let mut v = [v];
        self.clean(&mut v);
        v[0]
    }

    /// Sets values that are not finite or negative to 0.
    pub fn clean(&self, values: &mut [f32]) {
        // Comparisons with NaN are false; -0.0 is no fault.
        if values.iter().all(|v| (0.0..f32::INFINITY).contains(v)) {
            return;
        }
        let (mut not_finite, mut negative) = (0, 0);
        for v in values {
            if !v.is_finite() {
                not_finite += 1;
                *v = 0.0;
            } else if *v < 0.0 {
                negative += 1;
                *v = 0.0;
            }
        }
        self.not_finite.fetch_add(not_finite, Ordering::Relaxed);
        self.negative.fetch_add(negative, Ordering::Relaxed);
    }

    /// Values so far that were NaN or infinite.
    pub fn not_finite(&self) -> u64 {
        self.not_finite.load(Ordering::Relaxed)
    }

    /// Values so far that were negative.
    pub fn negative(&self) -> u64 {
        self.negative.load(Ordering::Relaxed)
    }

    /// One sentence for the user, if anything was cleaned.
    pub fn warning(&self) -> Option<String> {
        let counts = match (self.not_finite(), self.negative()) {
            (0, 0) => return None,
            (n, 0) => format!("{n} values are not finite"),
            (0, n) => format!("{n} values are negative"),
            (n, m) => format!("{n} values are not finite and {m} are negative"),
        };
        Some(format!("{counts}; a density cannot be, they count as 0"))
    }

    /// For strict callers: a fault, if anything was cleaned.
    pub fn refuse(&self) -> Result<(), Fault> {
        match (self.not_finite(), self.negative()) {
            (0, 0) => Ok(()),
            (n, m) => Err(Fault::UnfitValues(format!(
                "{n} values are not finite and {m} are negative, which no density can be"
            ))),
        }
    }
}

/// How a level set becomes fog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelSetToFog {
    /// Half width of the band, \[m\] as the level set's values.
    half_width: f32,
}

impl LevelSetToFog {
    /// For that grid; `None` if its background is no half width (not positive and finite).
    pub fn new(grid: &ScalarGrid<'_>) -> Option<Self> {
        let half_width = grid.background;
        (half_width > 0.0 && half_width.is_finite()).then_some(Self { half_width })
    }

    /// Density at a signed distance; 0 where that is NaN. \[1\]
    pub fn density(self, distance: f32) -> f32 {
        let inside = -distance / self.half_width;
        if inside > 0.0 { inside.min(1.0) } else { 0.0 }
    }

    /// Turns the grid's background and tiles into densities and drops those outside; the caller
    /// does the same with the leaves' values in [`ScalarGrid::decode_leaves`]. Every value inside
    /// counts, so interior tiles become active.
    pub fn convert(self, grid: &mut ScalarGrid<'_>) {
        grid.background = 0.0;
        grid.tiles.retain_mut(|tile| {
            tile.value = self.density(tile.value);
            tile.active = tile.value > 0.0;
            tile.active
        });
    }
}

#[cfg(test)]
mod tests {
    use super::{Cleaner, LevelSetToFog};

    #[test]
    fn unfit_values_become_zero_and_are_counted() {
        let cleaner = Cleaner::new();
        let mut values = [0.5, -0.0, f32::NAN, f32::INFINITY, -1.0, f32::NEG_INFINITY];
        cleaner.clean(&mut values);
        assert_eq!(values, [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((cleaner.not_finite(), cleaner.negative()), (3, 1));
        assert!(
            cleaner.refuse().is_err() && cleaner.warning().is_some(),
            "both say so"
        );
        assert_eq!(Cleaner::new().warning(), None);
    }

    #[test]
    fn a_level_set_is_full_inside_and_empty_outside() {
        let fog = LevelSetToFog { half_width: 0.3 };
        let got = [-0.3f32, -0.15, 0.0, 0.3, -9.0, f32::NAN].map(|d| fog.density(d));
        assert_eq!(got, [1.0, 0.5, 0.0, 0.0, 1.0, 0.0]);
    }
}
