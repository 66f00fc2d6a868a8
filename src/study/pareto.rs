//! Which setting to take: the Pareto front, the cheapest setting for a target, equal times.
//!
//! A row is on the front if no other is both faster and better. The error of a target is
//! √relMSE, a relative error in per cent. Between the checkpoints of a photon method ln relMSE is
//! taken as linear in ln passes, seconds as linear in passes. Paths have no bias, so their law
//! relMSE = c / paths holds at any number. Photon methods are followed beyond their last checkpoint
//! by the rate at which both bias² and variance fall at last, up to `FURTHER` times the passes:
//!
//! ```text
//! relMSE(n) = relMSE(n_last) (n / n_last)^-alpha       alpha = 2/3 (beams), 4/7 (points)
//! ```
//!
//! (Knaus & Zwicker 2011; Kaplanyan & Dachsbacher 2013.) What was not rendered is said to be so.
//!
//! Times are compared at the scene's own resolution, where camera rays take longer than in the
//! study's smaller pictures, in proportion to the pixels, and photons do not; the error of a pixel
//! hardly depends on how many there are.

use serde::{Deserialize, Serialize};

use super::plan::{Knob, PATHS_PER_PASS};
use super::table::{Row, Study};

/// Targets. \[%\]
const TARGETS: [f64; 8] = [30.0, 20.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.5];

/// Passes to which a photon method is followed, over those rendered.
const FURTHER: f64 = 64.0;

/// The cheapest setting for an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// √relMSE asked for. \[%\]
    pub percent: f64,
    /// Null where no setting of the study reaches it.
    pub choice: Option<Choice>,
}

/// A setting, its cost, and the command for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Setting of the sweep.
    pub setting: String,
    /// Method.
    pub method: String,
    /// Passes (beam, point).
    pub passes: u32,
    /// Paths of a pixel (path).
    pub spp: u32,
    /// In the study's pictures. \[s\]
    pub seconds: f64,
    /// Estimated at the scene's own resolution. \[s\]
    pub seconds_own_resolution: f64,
    /// By the method's rate: not rendered.
    pub extrapolated: bool,
    /// Options of `render`.
    pub options: String,
}

/// Two methods after the same time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EqualTime {
    /// The first one.
    pub method: String,
    /// The other one.
    pub other: String,
    /// The time at the scene's own resolution. \[s\]
    pub seconds: f64,
    /// relMSE of the first.
    pub relmse: f64,
    /// relMSE of the other.
    pub other_relmse: f64,
    /// How many times as large the other's is.
    pub ratio: f64,
}

/// Marks the rows on the front.
pub(super) fn mark(rows: &mut [Row], eligible: fn(Knob) -> bool) {
    let points: Vec<(f64, f64, bool)> = rows
        .iter()
        .map(|r| {
            (
                r.seconds_own_resolution,
                r.figures.relmse.value,
                eligible(r.knob),
            )
        })
        .collect();
    for (row, (t, e, ok)) in rows.iter_mut().zip(&points) {
        row.pareto = *ok
            && !points
                .iter()
                .any(|(t2, e2, ok2)| *ok2 && t2 <= t && e2 <= e && (t2 < t || e2 < e));
    }
}

/// One setting's rows: error and cost as functions of the passes.
struct Curve<'a> {
    rows: Vec<&'a Row>,
    path: bool,
}

impl<'a> Curve<'a> {
    fn new(study: &'a Study, setting: &str) -> Self {
        let rows: Vec<&Row> = study.rows.iter().filter(|r| r.setting == setting).collect();
        let path = rows.iter().any(|r| r.method == "path");
        Self { rows, path }
    }

    /// c of relMSE = c / passes.
    fn path_constant(&self) -> f64 {
        let each = |r: &&Row| r.figures.relmse.value * f64::from(r.passes);
        self.rows.iter().map(each).sum::<f64>() / self.rows.len() as f64
    }

    /// Rate of bias² and variance in the end.
    fn alpha(&self) -> f64 {
        let point = self.rows.iter().any(|r| r.method == "point");
        if point { 4.0 / 7.0 } else { 2.0 / 3.0 }
    }

    /// Passes for a relMSE.
    fn passes(&self, relmse: f64) -> Option<f64> {
        if self.path {
            return Some((self.path_constant() / relmse).max(1.0));
        }
        let first = self.rows.first()?;
        if first.figures.relmse.value <= relmse {
            return Some(f64::from(first.passes));
        }
        let last = self.rows.last()?;
        let beyond = (last.figures.relmse.value / relmse).powf(1.0 / self.alpha());
        if beyond > 1.0 {
            return (beyond <= FURTHER).then(|| beyond * f64::from(last.passes));
        }
        self.rows.windows(2).find_map(|pair| {
            let [a, b] = pair else { return None };
            let (ea, eb) = (a.figures.relmse.value, b.figures.relmse.value);
            if eb > relmse {
                return None;
            }
            let (pa, pb) = (f64::from(a.passes).ln(), f64::from(b.passes).ln());
            let share = if eb > 0.0 {
                (ea / relmse).ln() / (ea / eb).ln()
            } else {
                1.0
            };
            Some((pa + share * (pb - pa)).exp())
        })
    }

    /// A figure that grows linearly with the passes, at so many of them.
    fn linear(&self, passes: f64, of: impl Fn(&Row) -> f64) -> f64 {
        let at = |r: &Row| (f64::from(r.passes), of(r));
        let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) else {
            return f64::NAN;
        };
        let pair = self
            .rows
            .windows(2)
            .find(|p| f64::from(p[1].passes) >= passes);
        let ((xa, ya), (xb, yb)) = match pair {
            Some(pair) => (at(pair[0]), at(pair[1])),
            None => (at(first), at(last)),
        };
        if xb > xa {
            ya + (passes - xa) / (xb - xa) * (yb - ya)
        } else {
            ya * passes / xa
        }
    }

    /// relMSE after so many passes, within what is known.
    fn relmse(&self, passes: f64) -> Option<f64> {
        if self.path {
            return Some(self.path_constant() / passes);
        }
        self.rows.windows(2).find_map(|pair| {
            let (a, b) = (pair[0], pair[1]);
            let (pa, pb) = (f64::from(a.passes), f64::from(b.passes));
            let (ea, eb) = (a.figures.relmse.value, b.figures.relmse.value);
            let inside = (pa..=pb).contains(&passes) && ea > 0.0 && eb > 0.0;
            inside.then(|| {
                let share = (passes / pa).ln() / (pb / pa).ln();
                (ea.ln() + share * (eb / ea).ln()).exp()
            })
        })
    }

    /// Passes that fit into a time.
    fn passes_in(&self, seconds: f64) -> Option<f64> {
        let (first, last) = (self.rows.first()?, self.rows.last()?);
        let (xa, xb) = (f64::from(first.passes), f64::from(last.passes));
        let (ta, tb) = (first.seconds_own_resolution, last.seconds_own_resolution);
        let each = (tb - ta) / (xb - xa);
        let passes = xa + (seconds - ta) / each;
        (each > 0.0 && passes >= 1.0).then_some(passes)
    }
}

/// Settings of the study, each once, in order.
fn settings(study: &Study, eligible: impl Fn(Knob) -> bool) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for row in study.rows.iter().filter(|r| eligible(r.knob)) {
        if !names.contains(&row.setting.as_str()) {
            names.push(&row.setting);
        }
    }
    names
}

/// The cheapest setting for each target.
pub(super) fn targets(study: &Study, eligible: fn(Knob) -> bool) -> Vec<Target> {
    TARGETS
        .iter()
        .map(|percent| {
            let relmse = (percent / 100.0).powi(2);
            let choices = settings(study, eligible).into_iter().filter_map(|name| {
                let curve = Curve::new(study, name);
                let row = *curve.rows.last()?;
                let passes = curve.passes(relmse)?.ceil();
                let seconds = curve.linear(passes, |r| r.seconds);
                let spp = passes as u32 * PATHS_PER_PASS;
                let options = if curve.path {
                    format!("--method path --spp {spp}")
                } else {
                    format!(
                        "--method {} --photons {} --neighbours {} --spp {} --passes {passes}",
                        row.method,
                        row.photons,
                        row.neighbours,
                        row.spp / row.passes
                    )
                };
                Some(Choice {
                    setting: name.to_owned(),
                    method: row.method.clone(),
                    passes: passes as u32,
                    spp: if curve.path { spp } else { 0 },
                    seconds,
                    seconds_own_resolution: curve.linear(passes, |r| r.seconds_own_resolution),
                    extrapolated: passes > f64::from(row.passes),
                    options,
                })
            });
            Target {
                percent: *percent,
                choice: choices.min_by(|a, b| {
                    a.seconds_own_resolution
                        .total_cmp(&b.seconds_own_resolution)
                }),
            }
        })
        .collect()
}

/// The first method against each other one, at its own checkpoints.
pub(super) fn equal_time(study: &Study) -> Vec<EqualTime> {
    let methods = study.methods();
    let Some((first, others)) = methods.split_first() else {
        return Vec::new();
    };
    let mut all = Vec::new();
    for other in others {
        let curve = Curve::new(study, other);
        for row in study.base(first) {
            let relmse = row.figures.relmse.value;
            if let Some(other_relmse) = curve
                .passes_in(row.seconds_own_resolution)
                .and_then(|passes| curve.relmse(passes))
                && relmse > 0.0
            {
                all.push(EqualTime {
                    method: (*first).to_owned(),
                    other: (*other).to_owned(),
                    seconds: row.seconds_own_resolution,
                    relmse,
                    other_relmse,
                    ratio: other_relmse / relmse,
                });
            }
        }
    }
    all
}
