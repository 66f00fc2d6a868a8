//! Progress of long stages: a bar on a terminal, silence elsewhere.
//!
//! The renderer names a stage, advances it from any thread, and finishes it. Nothing here can
//! change an image.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// What the renderer tells while it works.
pub trait Progress: Sync {
    /// A stage begins; `total` units of work if that is known.
    fn stage(&self, name: &str, total: Option<u64>);
    /// `n` more units of the stage are done.
    fn advance(&self, n: u64);
    /// How far a long task of many stages is: its share done, and what to say of it.
    fn whole(&self, _name: &str, _share: f64, _text: &str) {}
    /// The stage is over.
    fn finish(&self);
    /// A line for people, clear of any bar.
    fn message(&self, text: &str) {
        eprintln!("{text}");
    }
}

/// Shows no progress.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _total: Option<u64>) {}
    fn advance(&self, _n: u64) {}
    fn finish(&self) {}
}

/// A bar on stderr with rate and time to go.
#[derive(Debug, Default)]
pub struct Terminal {
    bar: Mutex<Option<ProgressBar>>,
}

impl Terminal {
    fn with_bar(&self, f: impl FnOnce(&mut Option<ProgressBar>)) {
        // A panic elsewhere must not turn into a second one here.
        f(&mut self
            .bar
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner));
    }
}

/// indicatif's templates; they are tested, so the fallback is never seen.
const KNOWN: &str = "{prefix:>12} {wide_bar:.cyan/blue} {percent:>3}%  {per_sec}  {eta} to go";
const WHOLE: &str = "{prefix:>12} {wide_bar:.cyan/blue} {percent:>3}%  {msg}  {elapsed}";
const UNKNOWN: &str = "{prefix:>12} {spinner} {human_pos}  {per_sec}  {elapsed}";

impl Progress for Terminal {
    fn stage(&self, name: &str, total: Option<u64>) {
        let (bar, template) = match total {
            Some(n) => (ProgressBar::new(n), KNOWN),
            None => (ProgressBar::new_spinner(), UNKNOWN),
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(name.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        self.with_bar(|slot| {
            if let Some(old) = slot.replace(bar) {
                old.finish_and_clear();
            }
        });
    }

    fn advance(&self, n: u64) {
        self.with_bar(|slot| {
            if let Some(bar) = slot {
                bar.inc(n);
            }
        });
    }

    fn whole(&self, name: &str, share: f64, text: &str) {
        /// Steps of the bar.
        const STEPS: f64 = 1000.0;
        self.with_bar(|slot| {
            let same = slot.as_ref().is_some_and(|bar| bar.prefix() == name);
            if !same {
                let bar = ProgressBar::new(STEPS as u64);
                if let Ok(style) = ProgressStyle::with_template(WHOLE) {
                    bar.set_style(style);
                }
                bar.set_prefix(name.to_owned());
                bar.enable_steady_tick(Duration::from_millis(200));
                if let Some(old) = slot.replace(bar) {
                    old.finish_and_clear();
                }
            }
            if let Some(bar) = slot {
                bar.set_position((share.clamp(0.0, 1.0) * STEPS) as u64);
                bar.set_message(text.to_owned());
            }
        });
    }

    fn finish(&self) {
        self.with_bar(|slot| {
            if let Some(bar) = slot.take() {
                bar.finish_and_clear();
            }
        });
    }

    fn message(&self, text: &str) {
        self.with_bar(|slot| match slot {
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        });
    }
}

/// A bar if stderr is a terminal and nobody asked for quiet.
pub fn for_stderr(quiet: bool) -> Box<dyn Progress> {
    if !quiet && std::io::stderr().is_terminal() {
        Box::new(Terminal::default())
    } else {
        Box::new(Silent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_parse() {
        for template in [KNOWN, WHOLE, UNKNOWN] {
            ProgressStyle::with_template(template).unwrap();
        }
    }
}
