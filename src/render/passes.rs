//! Pass after pass into the film: until all are done, time is up, or somebody says stop.

use std::sync::atomic::Ordering;
use std::time::Instant;

use crate::film::{Film, Sample};
use crate::photon::{Energy, Heading};
use crate::report::{ImageFigures, Memory, PhotonCounts, Report, Times, peak_rss_bytes};
use crate::scene::{Method, Settings};
use crate::spectrum::Spectrum;
use crate::tracking::Counters;

use super::checkpoint::SAVE_EVERY;
use super::job::Job;
use super::path::{self, PATHS_PER_PASS};
use super::{Beside, PassDone, Rendered, photons, pilot};

/// What a pass gathers.
pub(super) struct Gathered {
    pub(super) samples: Vec<Sample>,
    pub(super) second: Option<Vec<Sample>>,
}

/// What has been done so far.
#[derive(Default)]
pub(super) struct Tally {
    pub(super) times: Times,
    pub(super) memory: Memory,
    pub(super) photons: PhotonCounts,
    pub(super) counters: Counters,
    pub(super) energy: Energy,
}

/// Passes of a render in all.
pub(super) fn pass_count(settings: &Settings) -> u32 {
    match settings.method {
        Method::Path => settings.spp.div_ceil(PATHS_PER_PASS),
        Method::Beam | Method::Point => settings.passes,
    }
}

/// Renders in one specialised form, in a world begun at `build`; the whole began at `start`.
pub(super) fn run<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    build: Instant,
    start: Instant,
    beside: Beside<'_>,
) -> Rendered {
    let Beside { mut keep, watch } = beside;
    let (scene, exec) = (job.scene, job.exec);
    let settings = &scene.settings;
    let [width, height] = scene.camera.resolution;
    let saved = keep.as_mut().and_then(|keep| keep.take());
    // The pilot of a render that goes on was counted before it was stopped.
    let mut pilot_tally = Tally::default();
    pilot_tally.times.build = build.elapsed().as_secs_f64();
    pilot_tally.memory.load = job.world.grid_bytes() as u64;
    pilot_tally.memory.build = job.world.structure_bytes() as u64;
    let radii = job
        .plan
        .photons
        .then(|| pilot::radii::<S, H>(job, &mut pilot_tally));
    let (mut film, mut tally) = match saved {
        Some((film, tally)) => (
            film,
            Tally {
                times: pilot_tally.times,
                memory: pilot_tally.memory,
                ..tally
            },
        ),
        None => (Film::new(width, height, settings.crop), pilot_tally),
    };
    tally.memory.gather = film.memory_bytes() as u64;
    let passes = pass_count(settings);
    let (first_pass, first) = (Instant::now(), film.passes());
    let mut save = |film: &Film, tally: &Tally| {
        if let Some(keep) = &mut keep
            && let Err(e) = keep.save(film, tally)
        {
            (exec.warn)(&format!("no checkpoint: {e}"));
        }
    };
    let mut last_save = first_pass;
    let mut pass = first;
    let stopped_early = loop {
        if pass >= passes {
            break false;
        }
        if pass > first {
            if exec.stop.load(Ordering::Relaxed) {
                save(&film, &tally);
                break true;
            }
            let each = first_pass.elapsed() / (pass - first);
            let late = |limit| start.elapsed() + each > limit;
            if exec.time_limit.is_some_and(late) {
                break false;
            }
            if last_save.elapsed() > SAVE_EVERY {
                save(&film, &tally);
                last_save = Instant::now();
            }
        }
        let gathered = match (&radii, settings.method) {
            (_, Method::Path) => Gathered {
                samples: path::pass(job, pass, &mut tally),
                second: None,
            },
            (radii, _) => {
                let second = watch.second_radius(pass);
                photons::pass::<S, H>(job, radii.as_ref(), pass, second, &mut tally)
            }
        };
        film.add_pass(&gathered.samples);
        pass += 1;
        let done = PassDone {
            pass: pass - 1,
            dimension: photons::blur_dimension(settings.method),
            film: &film,
            samples: &gathered.samples,
            second: gathered.second.as_deref(),
            seconds: start.elapsed().as_secs_f64(),
            times: tally.times,
        };
        if watch.pass_done(&done).is_break() {
            break false;
        }
    };

    let counters = tally.counters;
    let report = Report {
        scene: scene.name.clone(),
        method: settings.method.name().to_owned(),
        resolution: scene.camera.resolution,
        seed: settings.seed,
        passes: film.passes(),
        time_s: tally.times,
        peak_rss_bytes: peak_rss_bytes(),
        memory_bytes: tally.memory,
        photons: tally.photons,
        counters: crate::report::Counters {
            free_flights: counters.free_flights,
            transmittance_rays: counters.transmittance_rays,
            density_lookups: counters.density_lookups + counters.effects.temperatures,
            gathered_photons: counters.gathered_photons,
        },
        image: ImageFigures::from(&film),
        ..Report::default()
    };
    Rendered {
        film,
        report,
        energy: tally.energy,
        counters,
        stopped_early,
    }
}
