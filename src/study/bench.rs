//! The runs of a study: which comes next, how long is left, one after another to disk.
//!
//! Whatever the budget there are two parts of the reference and two seeds of every base; then, in
//! rounds of one seed of every setting, whatever fits into the time that is left, with parts of the
//! reference between them so that those have their share of the time.

use std::ops::ControlFlow;
use std::sync::atomic::Ordering;
use std::time::Instant;

use super::StudyError;
use super::clock::{self, Clock};
use super::figures::Reference;
use super::plan::{self, Setting, Sweep};
use super::reference;
use super::store::{Checkpoint, Header, Pixels, Run, Store};
use crate::film::Film;
use crate::progress::Silent;
use crate::render::{Exec, PassDone, Rendered, render_watched};
use crate::scene::{Method, Scene};
use crate::world::LoadedVolume;

/// Where runs are made.
#[derive(Debug)]
pub(super) struct Bench<'a> {
    scene: &'a Scene,
    sweep: &'a Sweep,
    store: &'a Store,
    volumes: Vec<LoadedVolume>,
    exec: &'a Exec<'a>,
    clock: Clock,
    /// The reference is a picture from elsewhere.
    pub(super) given: bool,
    /// Finished seeds of each setting: 0, 1, ... in order.
    pub(super) seeds: Vec<u64>,
    /// Finished parts of the reference.
    pub(super) parts: u64,
    /// Seconds of the sweep and of the reference.
    spent: [f64; 2],
}

/// What is rendered next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Next {
    Part(u64),
    Seed(usize, u64),
}

impl<'a> Bench<'a> {
    /// Nothing done yet, and no reference given.
    pub(super) fn new(
        scene: &'a Scene,
        sweep: &'a Sweep,
        store: &'a Store,
        volumes: Vec<LoadedVolume>,
        exec: &'a Exec<'a>,
    ) -> Self {
        Self {
            scene,
            sweep,
            store,
            volumes,
            exec,
            clock: Clock::default(),
            given: false,
            seeds: vec![0; sweep.settings.len()],
            parts: 0,
            spent: [0.0; 2],
        }
    }

    /// The setting of a part of the reference.
    fn part(&self) -> Setting {
        let mut settings = self.scene.settings.clone();
        settings.method = Method::Path;
        settings.spp = reference::PART_SPP;
        Setting {
            name: reference::NAME.to_owned(),
            knob: plan::Knob::Base,
            settings,
            checkpoints: vec![reference::PART_SPP / plan::PATHS_PER_PASS],
        }
    }

    /// Counts what is on disk.
    pub(super) fn recall(&mut self) -> Result<(), StudyError> {
        let part = self.part();
        while !self.given
            && let Some(run) = self
                .store
                .get(reference::NAME, reference::FIRST_SEED + self.parts)?
        {
            self.parts += 1;
            self.learn(&part, &run.header, 1);
        }
        for i in 0..self.sweep.settings.len() {
            let setting = &self.sweep.settings[i];
            while self.seeds[i] < self.sweep.seeds
                && let Some(run) = self.store.get(&setting.name, self.seeds[i])?
            {
                self.seeds[i] += 1;
                self.learn(setting, &run.header, 0);
            }
        }
        Ok(())
    }

    fn learn(&mut self, setting: &Setting, header: &Header, kind: usize) {
        let seconds = header.checkpoints.last().map_or(0.0, |c| c.seconds);
        self.spent[kind] += seconds;
        self.clock.learn(
            &setting.name,
            &setting.settings,
            self.sweep.resolution,
            seconds,
        );
    }

    fn expect(&self, setting: &Setting) -> f64 {
        self.clock
            .expect(&setting.name, &setting.settings, self.sweep.resolution)
    }

    fn most_parts(&self) -> u64 {
        u64::from(self.sweep.reference_spp / reference::PART_SPP)
    }

    /// The next run: two parts of the reference and two seeds of the bases come whatever the
    /// budget, for without them there is nothing to show.
    fn next(&self, left: f64) -> Option<Next> {
        let part = self.part();
        let must_part = !self.given && self.parts < 2;
        if must_part {
            return Some(Next::Part(self.parts));
        }
        let bases = self.sweep.settings.iter().enumerate();
        let must = bases
            .filter(|(_, s)| s.knob == plan::Knob::Base)
            .find(|(i, _)| self.seeds[*i] < 2);
        if let Some((i, _)) = must {
            return Some(Next::Seed(i, self.seeds[i]));
        }
        let share = self.sweep.reference_share;
        let behind = self.spent[1] < share / (1.0 - share) * self.spent[0];
        if !self.given && behind && self.parts < self.most_parts() && self.expect(&part) < left {
            return Some(Next::Part(self.parts));
        }
        let round = self.seeds.iter().copied().min().unwrap_or(0);
        (round..self.sweep.seeds).find_map(|seed| {
            let fits = |(i, s): (usize, &Setting)| {
                (self.seeds[i] == seed && self.expect(s) < left).then_some(Next::Seed(i, seed))
            };
            self.sweep.settings.iter().enumerate().find_map(fits)
        })
    }

    /// Seconds of what is still planned.
    fn ahead(&self) -> f64 {
        let sweep: f64 = self
            .sweep
            .settings
            .iter()
            .zip(&self.seeds)
            .map(|(s, done)| (self.sweep.seeds - done) as f64 * self.expect(s))
            .sum();
        let share = self.sweep.reference_share;
        let whole = share / (1.0 - share) * (sweep + self.spent[0]);
        let parts = (self.most_parts() - self.parts.min(self.most_parts())) as f64;
        let most = parts * self.expect(&self.part());
        sweep
            + if self.given {
                0.0
            } else {
                (whole - self.spent[1]).clamp(0.0, most)
            }
    }

    /// Renders until all is done or the time is up; true if it was interrupted.
    pub(super) fn render_all(&mut self, deadline: Instant) -> Result<bool, StudyError> {
        let began = Instant::now();
        loop {
            if self.exec.stop.load(Ordering::Relaxed) {
                return Ok(true);
            }
            let left = deadline
                .saturating_duration_since(Instant::now())
                .as_secs_f64();
            let Some(next) = self.next(left) else {
                return Ok(false);
            };
            let (setting, seed) = match next {
                Next::Part(k) => (self.part(), reference::FIRST_SEED + k),
                Next::Seed(i, seed) => (self.sweep.settings[i].clone(), seed),
            };
            let ahead = self.ahead().min(left.max(self.expect(&setting)));
            let gone = began.elapsed().as_secs_f64();
            let text = format!(
                "{} seed {}, {} to go",
                setting.name,
                seed % reference::FIRST_SEED,
                clock::words(ahead)
            );
            self.exec
                .progress
                .whole("study", gone / (gone + ahead).max(1e-9), &text);
            // A run may be there after one that is missing.
            let run = match self.store.get(&setting.name, seed)? {
                Some(run) => run,
                None => {
                    let Some(run) = self.render(&setting, seed)? else {
                        return Ok(true);
                    };
                    self.store.put(&run)?;
                    run
                }
            };
            match next {
                Next::Part(_) => self.parts += 1,
                Next::Seed(i, _) => self.seeds[i] += 1,
            }
            self.learn(
                &setting,
                &run.header,
                usize::from(matches!(next, Next::Part(_))),
            );
        }
    }

    /// One run; none if it was interrupted.
    fn render(&mut self, setting: &Setting, seed: u64) -> Result<Option<Run>, StudyError> {
        let mut scene = self.scene.clone();
        scene.settings = setting.settings.clone();
        scene.settings.seed = seed;
        let exec = Exec {
            progress: &Silent,
            time_limit: None,
            // What there is to warn of has been said while loading.
            warn: &|_| {},
            ..*self.exec
        };
        let mut checkpoints = Vec::new();
        let mut pictures = Vec::new();
        let mut keep = |done: &PassDone<'_>| {
            if setting.checkpoints.contains(&done.film.passes()) {
                checkpoints.push(Checkpoint {
                    passes: done.film.passes(),
                    seconds: done.seconds,
                    times: done.times,
                });
                pictures.push(pixels(done.film));
            }
            ControlFlow::Continue(())
        };
        let Rendered { film, report, .. } =
            render_watched(&scene, self.volumes.clone(), &exec, &mut keep)?;
        let whole = checkpoints.len() == setting.checkpoints.len();
        Ok(whole.then(|| Run {
            header: Header {
                name: setting.name.clone(),
                seed,
                resolution: self.sweep.resolution,
                checkpoints,
                nonfinite_pixels: film.nonfinite_pixels(),
                photons: report.photons,
                counters: report.counters,
            },
            pictures,
        }))
    }

    /// The reference from the parts on disk.
    pub(super) fn reference(&self) -> Result<Option<Reference>, StudyError> {
        let mut parts = reference::Parts::default();
        for k in 0..self.parts {
            if let Some(run) = self.store.get(reference::NAME, reference::FIRST_SEED + k)?
                && let Some(picture) = run.pictures.first()
            {
                parts.add(picture);
            }
        }
        Ok(parts.reference())
    }
}

/// The film's colours.
fn pixels(film: &Film) -> Pixels {
    let [x0, y0, x1, y1] = film.crop();
    (y0..y1)
        .flat_map(|y| (x0..x1).map(move |x| film.mean(x, y).as_vec3().to_array()))
        .collect()
}
