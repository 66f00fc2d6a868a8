//! How long a study will take: what each run should cost, learnt as it goes.
//!
//! ```text
//! seconds(run) = mean of the finished runs of the same setting, else  guess * c
//! guess        = passes (n_photons a + pixels b)      or      paths d
//! c            = sum of measured / sum of guessed, over all finished runs
//! ```

use std::collections::HashMap;

use crate::scene::{Method, Settings};

/// Seconds of a photon, of a pixel of a photon pass, of a path, on some machine; the ratio to this
/// one is learnt.
const PHOTON: f64 = 1e-6;
const PIXEL: f64 = 8e-6;
const PATH: f64 = 1e-6;

/// Learns.
#[derive(Debug, Default)]
pub(super) struct Clock {
    measured: HashMap<String, (f64, f64)>,
    sums: (f64, f64),
}

/// Relative cost of a run.
fn guess(settings: &Settings, [width, height]: [u32; 2]) -> f64 {
    let pixels = f64::from(width) * f64::from(height);
    match settings.method {
        Method::Path => f64::from(settings.spp) * pixels * PATH,
        Method::Beam | Method::Point => {
            f64::from(settings.passes) * (settings.photons as f64 * PHOTON + pixels * PIXEL)
        }
    }
}

impl Clock {
    /// A run took so long.
    pub(super) fn learn(&mut self, name: &str, s: &Settings, size: [u32; 2], seconds: f64) {
        let (sum, count) = self.measured.entry(name.to_owned()).or_default();
        *sum += seconds;
        *count += 1.0;
        self.sums.0 += seconds;
        self.sums.1 += guess(s, size);
    }

    /// What a run should take. \[s\]
    pub(super) fn expect(&self, name: &str, settings: &Settings, size: [u32; 2]) -> f64 {
        match self.measured.get(name) {
            Some((sum, count)) => sum / count,
            None if self.sums.1 > 0.0 => guess(settings, size) * self.sums.0 / self.sums.1,
            None => guess(settings, size),
        }
    }
}

/// `95 s`, `12 min`, `1.5 h`.
pub(super) fn words(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}
