//! Reading a TOML document key by key, gathering faults instead of stopping at the first.
//!
//! The `toml` crate parses the text and knows where each key and value stands. Serde would stop at
//! the first value it cannot take; here every reader notes its fault and goes on, so a file comes
//! back with all its faults at once. Three rules keep the schema in one place, the code of
//! `scene::file`:
//!
//! - asking for a key makes it known; what nobody asked for is an unknown key, reported with the
//!   nearest known name;
//! - a reader returns `None` only after it noted why, so a section is `Some` or has faults;
//! - a value is read with its range, and the range with its words (`item.rs`).

use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};

use strsim::osa_distance;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::item::Item;

/// Something wrong at a place in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Bytes it concerns.
    pub span: Range<usize>,
    /// What was found, and what is possible.
    pub message: String,
}

/// Faults of one document, as they come.
#[derive(Debug)]
pub(in crate::scene) struct Faults {
    /// Folder that relative paths start from.
    pub(in crate::scene) folder: PathBuf,
    list: RefCell<Vec<Fault>>,
}

impl Faults {
    pub(in crate::scene) fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            list: RefCell::default(),
        }
    }

    pub(in crate::scene) fn note(&self, span: Range<usize>, message: impl Into<String>) {
        let message = message.into();
        self.list.borrow_mut().push(Fault { span, message });
    }

    /// In the order of the text.
    pub(in crate::scene) fn into_sorted(self) -> Vec<Fault> {
        let mut list = self.list.into_inner();
        list.sort_by_key(|f| f.span.start);
        list
    }
}

/// A table being read.
pub(in crate::scene) struct Keys<'a> {
    table: &'a DeTable<'a>,
    /// Where to report what is missing.
    span: Range<usize>,
    /// As in "missing in ...".
    name: &'a str,
    known: RefCell<Vec<&'static str>>,
    pub(in crate::scene) faults: &'a Faults,
}

impl<'a> Keys<'a> {
    /// Reads a table with `read`, then reports the keys that were not asked for.
    pub(in crate::scene) fn read<T>(
        table: &'a DeTable<'a>,
        span: Range<usize>,
        name: &'a str,
        faults: &'a Faults,
        read: impl FnOnce(&Self) -> T,
    ) -> T {
        let keys = Self {
            table,
            span,
            name,
            known: RefCell::default(),
            faults,
        };
        let out = read(&keys);
        let known = keys.known.into_inner();
        for key in table.keys() {
            let found = key.get_ref().as_ref();
            if !known.contains(&found) {
                let possible = possible(found, &known);
                faults.note(key.span(), format!("unknown key `{found}`; {possible}"));
            }
        }
        out
    }

    fn mark_known(&self, key: &'static str) {
        let mut known = self.known.borrow_mut();
        if !known.contains(&key) {
            known.push(key);
        }
    }

    fn get(&self, key: &'static str) -> Option<Item<'a>> {
        self.mark_known(key);
        let value = self.table.get(key)?;
        Some(Item {
            value,
            key,
            faults: self.faults,
        })
    }

    /// Is the key there?
    pub(in crate::scene) fn has(&self, key: &'static str) -> bool {
        self.mark_known(key);
        self.table.contains_key(key)
    }

    /// Where the value of `key` stands; the table if it has none.
    pub(in crate::scene) fn span_of(&self, key: &str) -> Range<usize> {
        self.table
            .get(key)
            .map_or_else(|| self.span.clone(), Spanned::span)
    }

    /// A key that may be absent.
    pub(in crate::scene) fn may<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&Item<'a>) -> Option<T>,
    ) -> Option<T> {
        read(&self.get(key)?)
    }

    /// A key that has to be there.
    pub(in crate::scene) fn need<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&Item<'a>) -> Option<T>,
    ) -> Option<T> {
        let item = self.get(key);
        if item.is_none() {
            let message = format!("`{key}` is missing in {}", self.name);
            self.faults.note(self.span.clone(), message);
        }
        read(&item?)
    }

    /// All tables of `[[key]]`; those with faults are left out.
    pub(in crate::scene) fn each<T>(
        &self,
        key: &'static str,
        read: impl Fn(usize, &Item<'a>) -> Option<T>,
    ) -> Vec<T> {
        let Some(item) = self.get(key) else {
            return Vec::new();
        };
        let DeValue::Array(values) = item.value.get_ref() else {
            item.wrong::<()>(format!("a list: write [[{key}]]"));
            return Vec::new();
        };
        let items = values.iter().map(|value| Item { value, ..item });
        items.enumerate().filter_map(|(i, v)| read(i, &v)).collect()
    }
}

/// The nearest known name, or all of them.
pub(super) fn possible(found: &str, known: &[&str]) -> String {
    let near = known
        .iter()
        .map(|k| (osa_distance(found, k), k))
        .min_by_key(|(d, _)| *d)
        .filter(|(d, k)| *d <= 1 + k.len() / 4)
        .map(|(_, k)| k);
    // A part of a name, such as `fov`, is as good as a near one.
    let part = || known.iter().find(|k| found.len() >= 3 && k.contains(found));
    match near.or_else(part) {
        Some(name) => format!("did you mean `{name}`?"),
        None => format!("possible: {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_offered_and_far_ones_listed() {
        let known = ["extinction", "albedo", "phase"];
        assert_eq!(possible("extinctoin", &known), "did you mean `extinction`?");
        assert_eq!(
            possible("colour", &known),
            "possible: extinction, albedo, phase"
        );
        assert_eq!(
            possible("fov", &["position", "vertical_fov"]),
            "did you mean `vertical_fov`?"
        );
    }
}
