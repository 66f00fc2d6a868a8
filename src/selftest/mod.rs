//! The physics checks: what has to hold on every machine, each with a figure and a bound.
//!
//! ```text
//! passed  <=>  figure <= bound        a figure that is no number has not passed
//! ```
//!
//! A figure is a relative error against a closed form or an f64 computation, a count of
//! violations (bound 0), or the worst of n statistics: |z| or |t| against
//! 1 - (1 - ALPHA)^(1/n) (Sidak), chi-square per degree of freedom, the Kolmogorov-Smirnov
//! distance in units of its spread (`stats`). Seeds are fixed: a check always passes or always
//! fails on one machine. Everything is made in memory; no file is read.
//!
//! `vpm-vdb selftest` runs the families one after the other; the test suite calls the same ones,
//! and adds what needs files. docs/stability.md tells the bounds, and which deliberate error
//! makes each check fail.

pub mod bounds;
pub mod energy;
pub mod equivalence;
pub mod exact;
pub mod fields;
pub mod furnace;
pub mod grids;
pub mod lights;
pub mod long;
pub mod phase;
pub mod photons;
pub mod place;
pub mod rays;
pub mod thickness;

use serde::Serialize;
use thiserror::Error;

use crate::grid::build::BuildError;
use crate::render::RenderError;

/// How much is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effort {
    /// Half a minute for all families on two cores.
    Quick,
    /// Under two minutes.
    Full,
    /// As long as it takes: more points, rays and samples.
    Exhaustive,
}

/// One check and what came of it.
#[derive(Debug, Clone, Serialize)]
pub struct Check {
    /// What is checked.
    pub name: String,
    /// Which of [`FAMILIES`] it belongs to.
    pub family: &'static str,
    /// What was measured.
    pub figure: f64,
    /// The most that it may be.
    pub bound: f64,
    /// Did it stay within?
    pub passed: bool,
    /// Where the figure was found, if that is known.
    #[serde(skip)]
    pub place: String,
}

impl Check {
    /// What the columns of a printed check hold.
    pub const HEADINGS: &str = "family       figure      bound       verdict  check";
}

impl std::fmt::Display for Check {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verdict = if self.passed { "passed" } else { "FAILED" };
        write!(
            f,
            "{:12} {:<11.3e} {:<11.3e} {verdict:8} {}",
            self.family, self.figure, self.bound, self.name
        )?;
        if !self.passed && !self.place.is_empty() {
            write!(f, "\n             {}", self.place)?;
        }
        Ok(())
    }
}

/// The worst of many figures, and where it was found.
#[derive(Debug, Clone, Default)]
pub struct Worst {
    /// The largest so far; not a number once one was none.
    pub figure: f64,
    /// Where.
    pub place: String,
}

impl Worst {
    /// Takes in a figure.
    pub fn take(&mut self, figure: f64, place: impl FnOnce() -> String) {
        if figure > self.figure || (figure.is_nan() && !self.figure.is_nan()) {
            self.figure = figure;
            self.place = place();
        }
    }

    /// Counts a fault; the place is that of the first.
    pub fn count(&mut self, fault: bool, place: impl FnOnce() -> String) {
        if fault {
            if self.figure == 0.0 {
                self.place = place();
            }
            self.figure += 1.0;
        }
    }

    /// The worse of both.
    #[must_use]
    pub fn or(mut self, other: Self) -> Self {
        self.take(other.figure, || other.place);
        self
    }

    /// Faults of both.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        if self.figure == 0.0 {
            self.place = other.place;
        }
        self.figure += other.figure;
        self
    }
}

/// Why a check could not be made at all.
#[derive(Debug, Error)]
pub enum SelftestError {
    /// A field.
    #[error("a field of the self-test cannot be built")]
    Build(#[from] BuildError),
    /// A picture.
    #[error("a scene of the self-test cannot be rendered")]
    Render(#[from] RenderError),
}

/// The checks of a family as they are made.
#[derive(Debug)]
pub struct Suite {
    family: &'static str,
    effort: Effort,
    /// What came of them.
    pub checks: Vec<Check>,
}

impl Suite {
    /// No checks yet.
    #[must_use]
    pub fn new(family: &'static str, effort: Effort) -> Self {
        Self {
            family,
            effort,
            checks: Vec::new(),
        }
    }

    /// One of three numbers: quick, full, exhaustive.
    #[must_use]
    pub fn choose<T>(&self, [quick, full, exhaustive]: [T; 3]) -> T {
        match self.effort {
            Effort::Quick => quick,
            Effort::Full => full,
            Effort::Exhaustive => exhaustive,
        }
    }

    /// Adds a check: `figure` is at most `bound`.
    pub fn at_most(&mut self, name: impl Into<String>, figure: f64, bound: f64) {
        let place = String::new();
        self.worst(name, Worst { figure, place }, bound);
    }

    /// Adds a check: the worst figure is at most `bound`.
    pub fn worst(&mut self, name: impl Into<String>, worst: Worst, bound: f64) {
        self.checks.push(Check {
            name: name.into(),
            family: self.family,
            figure: worst.figure,
            bound,
            passed: worst.figure <= bound,
            place: worst.place,
        });
    }

    /// Adds a check: there are no faults.
    pub fn none(&mut self, name: impl Into<String>, faults: Worst) {
        self.worst(name, faults, 0.0);
    }
}

/// Makes the checks of one family.
pub type Family = fn(&mut Suite) -> Result<(), SelftestError>;

/// The families, in the order in which they are run.
pub const FAMILIES: [(&str, Family); 12] = [
    ("furnace", furnace::checks),
    ("thickness", thickness::checks),
    ("place", place::checks),
    ("rays", rays::checks),
    ("majorants", bounds::checks),
    ("photons", photons::checks),
    ("phase", phase::checks),
    ("grids", grids::checks),
    ("lights", lights::checks),
    ("energy", energy::checks),
    ("equivalence", equivalence::checks),
    ("long", long::checks),
];

/// Makes the checks of the family of a name; none of an unknown one.
///
/// # Errors
/// [`SelftestError`]: a check that could not be made.
pub fn run_family(name: &str, effort: Effort) -> Result<Vec<Check>, SelftestError> {
    let mut all = Vec::new();
    for (family, checks) in FAMILIES.iter().filter(|(family, _)| *family == name) {
        let mut suite = Suite::new(family, effort);
        checks(&mut suite)?;
        all.append(&mut suite.checks);
    }
    Ok(all)
}
