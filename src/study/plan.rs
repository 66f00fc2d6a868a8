//! The sweep: which settings a study renders, one knob at a time around the scene's own.
//!
//! ```text
//! base        every method, passes 1, 2, 4, ... as checkpoints of one progressive run
//! photons     n/16, n/4, 4n            at the scene's neighbours k: r ~ (k/n)^(1/3)
//! neighbours  k/64, k/16, k/4, 4k      radius alone
//! rays        4 times as many camera rays of a pixel in each pass
//! kernel      the other kernels
//! march       fixed steps of 32 ... 1/8 voxel against exact
//! direct      first order from photons, or sampled along the camera ray
//! orders      1, 4, 16, ... scattering orders
//! rate        n/16 photons and 4 times as many camera rays, through many passes: what is left of
//!             the error is more of the photons', whose rate the theory gives (`rate`)
//! ```
//!
//! All knobs but the turned one stay as in the base, so a row against the base row shows what that
//! knob costs and buys. A setting is rendered with several seeds; equal seeds give equal photons,
//! so pictures that differ in the march alone differ in nothing else.
//!
//! A quick study renders fewer pixels, an eighth of the photons, fewer passes and fewer values. A
//! study with a budget below half an hour has fewer photons in its passes too: n above is the
//! scene's own number over the power of two that the budget calls for, at most 8.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::scene::{Direct, Kernel, March, Method, Scene, Settings};

/// Methods that are compared, the first being the one whose knobs are turned.
pub const METHODS: [Method; 3] = [Method::Beam, Method::Point, Method::Path];

/// Pixels of a study's pictures, about, unless a resolution is given.
const PIXELS: [f64; 2] = [5_000.0, 10_000.0];

/// Largest number by which a study divides the scene's photons of a pass.
pub const MOST_FEWER: u64 = 8;

/// Camera rays of a pixel where there are more of them.
const RAYS: u32 = 4;

/// Paths in one pass of the path tracer.
pub(super) const PATHS_PER_PASS: u32 = crate::render::PATHS_PER_PASS;

/// What differs from the base.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Knob {
    /// Nothing.
    Base,
    /// Photons emitted in a pass.
    Photons,
    /// Photons within a radius.
    Neighbours,
    /// Camera rays of a pixel in a pass.
    Rays,
    /// Form of the kernel.
    Kernel,
    /// Optical depth of camera rays.
    March,
    /// First order.
    Direct,
    /// Highest scattering order.
    Orders,
    /// Few photons and many camera rays in each of many passes.
    Rate,
}

/// One setting of the sweep.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Unique; fit for a file name.
    pub name: String,
    /// What differs from the base.
    pub knob: Knob,
    /// The whole setting, at its last checkpoint.
    pub settings: Settings,
    /// Passes after which the picture is kept, rising.
    pub checkpoints: Vec<u32>,
}

/// Everything that a study renders but its reference.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Width and height. \[px\]
    pub resolution: [u32; 2],
    /// Settings, the most telling first.
    pub settings: Vec<Setting>,
    /// Seeds of each setting, at most.
    pub seeds: u64,
    /// Most paths of a pixel in the reference.
    pub reference_spp: u32,
    /// Share of the time that the reference takes.
    pub reference_share: f64,
}

/// The scene's shape with about so many pixels, never more than its own.
fn reduced([width, height]: [u32; 2], pixels: f64) -> [u32; 2] {
    let scale = (pixels / (f64::from(width) * f64::from(height)))
        .sqrt()
        .min(1.0);
    [width, height].map(|n| ((f64::from(n) * scale).round() as u32).max(1))
}

/// By what a study divides the scene's photons of a pass, so that about as many seeds of its
/// settings fit into `budget` as into `full` with all photons: a power of two.
#[must_use]
pub fn fewer_photons(budget: Duration, full: Duration) -> u64 {
    let ratio = full.as_secs_f64() / budget.as_secs_f64();
    (0..)
        .map(|power| 1 << power)
        .take_while(|n| *n <= MOST_FEWER && *n as f64 <= ratio)
        .last()
        .unwrap_or(1)
}

/// Doubling passes up to `last`.
fn doubling(last: u32) -> Vec<u32> {
    (0..32).map(|i| 1 << i).take_while(|n| *n <= last).collect()
}

impl Sweep {
    /// The sweep around a scene's own settings, with its photons of a pass divided by `fewer`.
    #[must_use]
    pub fn new(scene: &Scene, quick: bool, fewer: u64, resolution: Option<[u32; 2]>) -> Self {
        let own = &scene.settings;
        let base = Settings {
            spp: 1,
            crop: None,
            march: March::Exact,
            photons: (own.photons / fewer.max(1)).max(1),
            ..own.clone()
        };
        let pixels = PIXELS[usize::from(!quick)];
        let resolution = resolution.unwrap_or_else(|| reduced(scene.camera.resolution, pixels));
        let mut settings = Vec::new();
        for method in METHODS {
            settings.push(base_of(&base, method, quick));
        }
        settings.extend(knobs(&base, METHODS[0], quick));
        // The step is the point estimate's own knob.
        let point = knobs(&base, Method::Point, quick);
        let steps = point.into_iter().filter(|s| s.knob == Knob::March);
        settings.extend(steps.map(|s| Setting {
            name: format!("point-{}", s.name),
            ..s
        }));
        Self {
            resolution,
            settings,
            seeds: if quick { 3 } else { 5 },
            reference_spp: 1 << 16,
            reference_share: 0.4,
        }
    }

    /// The base of a method.
    #[must_use]
    pub fn base(&self, method: Method) -> Option<&Setting> {
        self.settings
            .iter()
            .find(|s| s.knob == Knob::Base && s.settings.method == method)
    }
}

/// A method at the scene's own settings, with checkpoints.
fn base_of(base: &Settings, method: Method, quick: bool) -> Setting {
    let mut settings = Settings {
        method,
        ..base.clone()
    };
    let checkpoints = if method == Method::Path {
        let passes: &[u32] = if quick { &[1, 4, 16] } else { &[1, 4, 16, 64] };
        settings.spp = PATHS_PER_PASS * passes.last().copied().unwrap_or(1);
        passes.to_vec()
    } else {
        // Spheres at the steps of a march cost several times a beam.
        let last = match (method, quick) {
            (Method::Point, _) | (_, true) => 4,
            (_, false) => 16,
        };
        let passes = doubling(last);
        settings.passes = passes.last().copied().unwrap_or(1);
        passes
    };
    Setting {
        name: method.name().to_owned(),
        knob: Knob::Base,
        settings,
        checkpoints,
    }
}

/// The base with one knob turned.
fn turned(
    (base, method, passes): (&Settings, Method, u32),
    (knob, name): (Knob, String),
    turn: &dyn Fn(&mut Settings),
) -> Setting {
    let mut settings = Settings {
        method,
        passes,
        ..base.clone()
    };
    turn(&mut settings);
    Setting {
        name,
        knob,
        settings,
        checkpoints: doubling(passes),
    }
}

/// One knob turned at a time.
fn knobs(base: &Settings, method: Method, quick: bool) -> Vec<Setting> {
    let passes = 2;
    let mut all = Vec::new();
    let mut add = |knob, name: String, turn: &dyn Fn(&mut Settings)| {
        all.push(turned((base, method, passes), (knob, name), turn));
    };
    let factors: &[f64] = if quick {
        &[1.0 / 16.0, 0.25, 4.0]
    } else {
        &[1.0 / 64.0, 1.0 / 16.0, 0.25, 4.0]
    };
    let k = base.neighbours;
    let counts = |n: f64| -> Vec<u64> {
        let mut counts: Vec<u64> = factors
            .iter()
            .map(|f| (f * n).round().max(1.0) as u64)
            .filter(|c| *c as f64 != n)
            .collect();
        counts.dedup();
        counts
    };
    for count in counts(f64::from(k)) {
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        add(Knob::Neighbours, format!("neighbours-{count}"), &|s| {
            s.neighbours = count;
        });
    }
    for count in counts(base.photons as f64) {
        add(Knob::Photons, format!("photons-{count}"), &|s| {
            s.photons = count;
        });
    }
    add(Knob::Rays, format!("rays-{RAYS}"), &|s| {
        s.spp = base.spp * RAYS;
    });
    let steps: &[f64] = if quick {
        &[16.0, 4.0, 1.0, 0.25]
    } else {
        &[32.0, 8.0, 2.0, 0.5, 0.125]
    };
    for step in steps {
        add(Knob::March, format!("step-{step}"), &|s| {
            s.march = March::Step(*step);
        });
    }
    for kernel in [Kernel::Constant, Kernel::Epanechnikov, Kernel::Biweight] {
        if kernel != base.kernel {
            let name = format!("kernel-{}", kernel_name(kernel));
            add(Knob::Kernel, name, &|s| s.kernel = kernel);
        }
    }
    let other = match base.direct {
        Direct::Sampled => Direct::Photons,
        Direct::Photons => Direct::Sampled,
    };
    add(
        Knob::Direct,
        format!("direct-{}", direct_name(other)),
        &|s| {
            s.direct = other;
        },
    );
    let last = if quick { 8 } else { 32 };
    all.push(Setting {
        name: "rate".to_owned(),
        knob: Knob::Rate,
        settings: Settings {
            method,
            photons: (base.photons / 16).max(1),
            spp: base.spp * RAYS,
            passes: last,
            ..base.clone()
        },
        checkpoints: doubling(last),
    });
    let mut add = |knob, name: String, turn: &dyn Fn(&mut Settings)| {
        all.push(turned((base, method, passes), (knob, name), turn));
    };
    for order in doubling(base.max_bounces).into_iter().step_by(2) {
        if order != base.max_bounces {
            add(Knob::Orders, format!("orders-{order}"), &|s| {
                s.max_bounces = order;
            });
        }
    }
    all
}

/// As in scene files.
#[must_use]
pub fn kernel_name(kernel: Kernel) -> &'static str {
    match kernel {
        Kernel::Constant => "constant",
        Kernel::Epanechnikov => "epanechnikov",
        Kernel::Biweight => "biweight",
    }
}

/// As in scene files.
#[must_use]
pub fn direct_name(direct: Direct) -> &'static str {
    match direct {
        Direct::Sampled => "sampled",
        Direct::Photons => "photons",
    }
}

/// `exact`, or the step in voxels.
#[must_use]
pub fn march_name(march: March) -> String {
    match march {
        March::Exact => "exact".to_owned(),
        March::Step(step) => format!("{step}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_budgets_mean_fewer_photons() {
        let full = Duration::from_secs(1800);
        for (seconds, fewer) in [
            (7200, 1),
            (1800, 1),
            (1799, 1),
            (900, 2),
            (300, 4),
            (150, 8),
            (1, 8),
        ] {
            let found = fewer_photons(Duration::from_secs(seconds), full);
            assert_eq!(found, fewer, "{seconds} s");
        }
    }
}
