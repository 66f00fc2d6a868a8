//! What a render did: the JSON of `--report`, and the effects that `plan` prints.
//!
//! Keys are an interface: scripts read them. They may grow in number, never change or go. Times
//! are wall-clock seconds; a figure that is not known is `null`.

use serde::{Deserialize, Serialize};

use crate::effects::Dropped;
use crate::render::error::ErrorEstimate;

/// One effect of light, and whether this scene calls for it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Effect {
    /// One of the fixed names, such as `multiple_scattering`.
    pub name: String,
    /// It is simulated.
    pub active: bool,
    /// The scene fact that decides, in one sentence.
    pub reason: String,
    /// The specialised form that simulates it; empty where nothing does.
    pub form: String,
    /// How often the renderer did what only this effect calls for; null before rendering. 0 where
    /// it is not active.
    pub count: Option<u64>,
}

/// A stage of a render, foretold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Name, as in `time_s`.
    pub name: String,
    /// Wall-clock time it should take; null if unknown. \[s\]
    pub seconds_estimate: Option<f64>,
    /// Memory it should hold; null if unknown. \[bytes\]
    pub memory_bytes: Option<u64>,
}

/// Seconds by stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// From the first stage to the last.
    pub total: f64,
    /// Reading files.
    pub load: f64,
    /// Grids, majorants and hierarchies.
    pub build: f64,
    /// Tracing photons.
    pub photons: f64,
    /// Photon maps and radii.
    pub map: f64,
    /// Camera rays.
    pub gather: f64,
    /// Writing files.
    pub output: f64,
}

/// Bytes that each stage holds, the most over the passes; what `plan` foretells.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Memory {
    /// Grids.
    pub load: u64,
    /// Bounds over grids, surfaces.
    pub build: u64,
    /// Photons as traced.
    pub photons: u64,
    /// Photon maps: what sorting adds.
    pub map: u64,
    /// The film.
    pub gather: u64,
}

/// Photons of all passes together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhotonCounts {
    /// Left a light.
    pub emitted: u64,
    /// Deposits in the maps.
    pub stored: u64,
}

/// How often the costly things were done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Distances sampled to a collision.
    pub free_flights: u64,
    /// Shadow rays through media.
    pub transmittance_rays: u64,
    /// Interpolated grid values.
    pub density_lookups: u64,
    /// Photons that contributed to a ray.
    pub gathered_photons: u64,
}

/// The picture in figures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ImageFigures {
    /// Mean over the pixels. \[W/(m2 sr)\]
    pub mean: [f64; 3],
    /// Standard error of that mean; null with fewer than two passes. \[W/(m2 sr)\]
    pub mean_standard_error: Option<[f64; 3]>,
    /// Pixels with NaN or an infinity in at least one pass.
    pub nonfinite_pixels: u64,
    /// Grain as a share of the light, as `film` defines it; null with fewer than two passes.
    pub mean_relative_standard_error: Option<f64>,
}

impl From<&crate::film::Film> for ImageFigures {
    fn from(film: &crate::film::Film) -> Self {
        let mean = film.image_mean();
        Self {
            mean: mean.mean.to_array(),
            mean_standard_error: mean.standard_error.map(|e| e.to_array()),
            nonfinite_pixels: film.nonfinite_pixels(),
            mean_relative_standard_error: film.mean_relative_standard_error(),
        }
    }
}

/// What a render did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Scene name.
    pub scene: String,
    /// `beam`, `point` or `path`.
    pub method: String,
    /// Width and height of the whole picture. \[px\]
    pub resolution: [u32; 2],
    /// Seed of every random stream.
    pub seed: u64,
    /// Threads that worked.
    pub threads: usize,
    /// Passes in the picture.
    pub passes: u32,
    /// Every effect, active or not.
    pub effects: Vec<Effect>,
    /// What of the scene cannot make a difference to the picture, and was left out.
    pub dropped: Vec<Dropped>,
    /// Seconds by stage.
    pub time_s: Times,
    /// Most memory held at once; 0 where the system does not tell. \[bytes\]
    pub peak_rss_bytes: u64,
    /// Bytes by stage.
    pub memory_bytes: Memory,
    /// Photons.
    pub photons: PhotonCounts,
    /// Counters.
    pub counters: Counters,
    /// The picture in figures.
    pub image: ImageFigures,
    /// Noise and bias together; null unless `--target-error` or `--time` asked for it,
    /// and with fewer than four passes.
    pub error: Option<ErrorEstimate>,
}

/// Most memory this process has held at once: VmHWM of Linux, 0 elsewhere. \[bytes\]
pub fn peak_rss_bytes() -> u64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| parse_peak(&status))
        .unwrap_or(0)
}

/// The line `VmHWM:     1234 kB`.
fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_is_read_from_the_status_text() {
        assert_eq!(
            parse_peak("Name:\tx\nVmHWM:\t   1234 kB\nVmRSS:\t 1 kB\n"),
            Some(1_263_616)
        );
        assert_eq!(parse_peak("Name:\tx\n"), None);
    }

    /// The keys that scripts rely on.
    #[test]
    fn report_has_the_fixed_keys() {
        let json = serde_json::to_value(Report::default()).unwrap();
        let keys = |v: &serde_json::Value| {
            let mut k: Vec<_> = v.as_object().unwrap().keys().cloned().collect();
            k.sort();
            k.join(" ")
        };
        assert_eq!(
            keys(&json),
            "counters dropped effects error image memory_bytes method passes peak_rss_bytes photons \
             resolution scene seed threads time_s"
        );
        assert_eq!(
            keys(&json["time_s"]),
            "build gather load map output photons total"
        );
        assert_eq!(keys(&json["photons"]), "emitted stored");
        assert_eq!(
            keys(&json["counters"]),
            "density_lookups free_flights gathered_photons transmittance_rays"
        );
        assert_eq!(
            keys(&json["image"]),
            "mean mean_relative_standard_error mean_standard_error nonfinite_pixels"
        );
    }
}
