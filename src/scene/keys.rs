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
//! - a value is read with its range, and the range with its words.
//!
//! Enumerations are a word (`phase = "isotropic"`) or a table with one key that names the choice
//! (`phase = { henyey_greenstein = { g = 0.8 } }`).

use std::cell::RefCell;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::DVec3;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Rgb;

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

/// A condition on a number, and its words: "it has to be ...".
#[derive(Debug, Clone, Copy)]
pub(in crate::scene) struct Limits(
    pub(in crate::scene) fn(f64) -> bool,
    pub(in crate::scene) &'static str,
);

/// Any number.
pub(in crate::scene) const ANY: Limits = Limits(|_| true, "a number");
/// Lengths, factors.
pub(in crate::scene) const ABOVE_0: Limits = Limits(|v| v > 0.0, "above 0");
/// Coefficients, powers, radiances.
pub(in crate::scene) const FROM_0: Limits = Limits(|v| v >= 0.0, "0 or more");
/// Shares.
pub(in crate::scene) const SHARE: Limits = Limits(|v| (0.0..=1.0).contains(&v), "from 0 to 1");

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

/// A value being read.
pub(in crate::scene) struct Item<'a> {
    value: &'a Spanned<DeValue<'a>>,
    /// Name for messages: the key.
    key: &'a str,
    faults: &'a Faults,
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

impl<'a> Item<'a> {
    /// Notes a fault about this value.
    pub(in crate::scene) fn fault<T>(&self, message: impl Into<String>) -> Option<T> {
        self.faults.note(self.value.span(), message);
        None
    }

    /// Notes that the value is of the wrong kind.
    fn wrong<T>(&self, wanted: impl fmt::Display) -> Option<T> {
        let kind = match self.value.get_ref() {
            DeValue::String(_) => "a string",
            DeValue::Integer(_) => "a whole number",
            DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "a list",
            DeValue::Table(_) => "a table",
        };
        self.fault(format!("`{}` is {kind}; it has to be {wanted}", self.key))
    }

    /// Is it a list?
    pub(in crate::scene) fn is_list(&self) -> bool {
        matches!(self.value.get_ref(), DeValue::Array(_))
    }

    /// A number if this is one, without any check.
    fn as_number(&self) -> Option<f64> {
        match self.value.get_ref() {
            DeValue::Float(f) => f.as_str().parse().ok(),
            DeValue::Integer(i) if i.radix() == 10 => i.as_str().parse().ok(),
            DeValue::Integer(i) => {
                let whole = i64::from_str_radix(i.as_str(), i.radix()).ok()?;
                Some(whole as f64)
            }
            _ => None,
        }
    }

    /// A finite number within limits.
    pub(in crate::scene) fn number(&self, limits: Limits) -> Option<f64> {
        let Some(v) = self.as_number() else {
            return self.wrong("a number");
        };
        if v.is_finite() && (limits.0)(v) {
            return Some(v);
        }
        let wanted = if v.is_finite() { limits.1 } else { "finite" };
        self.fault(format!("`{}` is {v}; it has to be {wanted}", self.key))
    }

    /// A whole number within `range`; 1e6 is one too.
    pub(in crate::scene) fn whole(&self, range: std::ops::RangeInclusive<u64>) -> Option<u64> {
        let exact = match self.value.get_ref() {
            DeValue::Integer(i) => u64::from_str_radix(i.as_str(), i.radix()).ok(),
            _ => None,
        };
        let v = match exact {
            Some(v) => v,
            None => match self.as_number() {
                // Every whole f64 up to 2^53 is itself.
                Some(v) if v.fract() == 0.0 && (0.0..=9e15).contains(&v) => v as u64,
                Some(v) => return self.out_of_range(v, &range),
                None => return self.wrong("a whole number"),
            },
        };
        if range.contains(&v) {
            Some(v)
        } else {
            self.out_of_range(v, &range)
        }
    }

    fn out_of_range<T>(
        &self,
        found: impl fmt::Display,
        range: &std::ops::RangeInclusive<u64>,
    ) -> Option<T> {
        let (low, high) = (range.start(), range.end());
        self.fault(format!(
            "`{}` is {found}; it has to be a whole number from {low} to {high}",
            self.key
        ))
    }

    /// A whole number that fits 32 bits.
    pub(in crate::scene) fn whole32(&self, range: std::ops::RangeInclusive<u32>) -> Option<u32> {
        let v = self.whole(u64::from(*range.start())..=u64::from(*range.end()))?;
        u32::try_from(v).ok()
    }

    /// true or false.
    pub(in crate::scene) fn flag(&self) -> Option<bool> {
        match self.value.get_ref() {
            DeValue::Boolean(b) => Some(*b),
            _ => self.wrong("true or false"),
        }
    }

    /// A string that is not empty.
    pub(in crate::scene) fn string(&self) -> Option<&'a str> {
        match self.value.get_ref() {
            DeValue::String(s) if s.is_empty() => self.fault(format!("`{}` is empty", self.key)),
            DeValue::String(s) => Some(s),
            _ => self.wrong("a string"),
        }
    }

    /// The `N` elements of a list, each read with `read`.
    pub(in crate::scene) fn list<const N: usize, T>(
        &self,
        wanted: &str,
        read: impl Fn(&Self) -> Option<T>,
    ) -> Option<[T; N]> {
        let DeValue::Array(values) = self.value.get_ref() else {
            return self.wrong(wanted);
        };
        if values.len() != N {
            let count = values.len();
            return self.fault(format!(
                "`{}` has {count} elements; it has to be {wanted}",
                self.key
            ));
        }
        // All elements are read before any fault ends it.
        let read: Vec<_> = values
            .iter()
            .map(|value| read(&Item { value, ..*self }))
            .collect();
        let all: Option<Vec<T>> = read.into_iter().collect();
        all?.try_into().ok()
    }

    /// A point or an offset, `[x, y, z]`.
    pub(in crate::scene) fn point(&self) -> Option<DVec3> {
        self.list("[x, y, z]", |v| v.number(ANY))
            .map(DVec3::from_array)
    }

    /// `[x, y, z]` that is not all zero; its length is kept.
    pub(in crate::scene) fn direction(&self) -> Option<DVec3> {
        let v = self.point()?;
        if v.length_squared().is_normal() {
            Some(v)
        } else {
            self.fault(format!("`{}` has no length, hence no direction", self.key))
        }
    }

    /// A number, or `[r, g, b]`.
    pub(in crate::scene) fn colour(&self, limits: Limits) -> Option<Rgb> {
        let wanted = "a number or [r, g, b]";
        match self.value.get_ref() {
            DeValue::Array(_) => self
                .list(wanted, |v| v.number32(limits))
                .map(Rgb::from_array),
            DeValue::Integer(_) | DeValue::Float(_) => self.number32(limits).map(Rgb::splat),
            _ => self.wrong(wanted),
        }
    }

    /// A number that stays finite with 32 bits.
    fn number32(&self, limits: Limits) -> Option<f32> {
        let v = self.number(limits)?;
        if (v as f32).is_finite() {
            Some(v as f32)
        } else {
            self.fault(format!("`{}` is {v:e}; that is too large", self.key))
        }
    }

    /// A path, relative to the folder of the document. The file need not be there.
    pub(in crate::scene) fn path(&self) -> Option<PathBuf> {
        Some(self.faults.folder.join(self.string()?))
    }

    /// A file that is there.
    pub(in crate::scene) fn file(&self) -> Option<PathBuf> {
        let path = self.path()?;
        if path.is_file() {
            return Some(path);
        }
        let why = if path.is_dir() {
            "is a folder, not a file"
        } else {
            "is not there"
        };
        self.fault(format!("{} {why}", path.display()))
    }

    /// A table, read with `read`.
    pub(in crate::scene) fn table<T>(
        &self,
        read: impl FnOnce(&Keys<'_>) -> Option<T>,
    ) -> Option<T> {
        let DeValue::Table(table) = self.value.get_ref() else {
            return self.wrong("a table");
        };
        let name = format!("`{}`", self.key);
        Keys::read(table, self.value.span(), &name, self.faults, read)
    }

    /// One of some words.
    pub(in crate::scene) fn word<T: Clone>(&self, words: &[(&'static str, T)]) -> Option<T> {
        let found = self.string()?;
        if let Some((_, v)) = words.iter().find(|(w, _)| *w == found) {
            return Some(v.clone());
        }
        let known: Vec<_> = words.iter().map(|(w, _)| *w).collect();
        self.unknown_choice(self.value.span(), found, &known)
    }

    /// One of some words, or a table with one key out of `tables`, whose value goes to `read`.
    pub(in crate::scene) fn choice<T: Clone>(
        &self,
        words: &[(&'static str, T)],
        tables: &[&'static str],
        read: impl FnOnce(&str, &Self) -> Option<T>,
    ) -> Option<T> {
        match self.value.get_ref() {
            DeValue::Table(_) => self.tagged(tables, read),
            DeValue::String(s) if tables.contains(&s.as_ref()) => self.fault(format!(
                "`{s}` needs values: {} = {{ {s} = {{ .. }} }}",
                self.key
            )),
            DeValue::String(s) if !words.iter().any(|(w, _)| w == s) => {
                let mut known: Vec<_> = words.iter().map(|(w, _)| *w).collect();
                known.extend(tables);
                self.unknown_choice(self.value.span(), s, &known)
            }
            _ => self.word(words),
        }
    }

    /// A table with one key out of `tables`, whose value goes to `read`.
    pub(in crate::scene) fn tagged<T>(
        &self,
        tables: &[&'static str],
        read: impl FnOnce(&str, &Self) -> Option<T>,
    ) -> Option<T> {
        let list = tables.join(", ");
        let DeValue::Table(table) = self.value.get_ref() else {
            return self.wrong(format!("a table with one of: {list}"));
        };
        let mut entries = table.iter();
        let (Some((tag, value)), None) = (entries.next(), entries.next()) else {
            let names: Vec<_> = table.keys().map(|k| k.get_ref().as_ref()).collect();
            let found = match names.as_slice() {
                [] => "nothing".to_owned(),
                names => names.join(", "),
            };
            return self.fault(format!(
                "`{}` takes exactly one of: {list}; found: {found}",
                self.key
            ));
        };
        let key = tag.get_ref().as_ref();
        if !tables.contains(&key) {
            return self.unknown_choice(tag.span(), key, tables);
        }
        let item = Item {
            value,
            key,
            faults: self.faults,
        };
        read(key, &item)
    }

    fn unknown_choice<T>(&self, span: Range<usize>, found: &str, known: &[&str]) -> Option<T> {
        let possible = possible(found, known);
        let message = format!("`{found}` is no choice for `{}`; {possible}", self.key);
        self.faults.note(span, message);
        None
    }
}

/// The nearest known name, or all of them.
fn possible(found: &str, known: &[&str]) -> String {
    let near = known
        .iter()
        .map(|k| (distance(found, k), k))
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

/// Letters to insert, delete, replace or swap with their neighbour, from `a` to `b` (optimal string
/// alignment).
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 0..a.len() {
        let mut row = vec![i + 1];
        for j in 0..b.len() {
            let replace = last[j] + usize::from(a[i] != b[j]);
            let mut d = replace.min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j] {
                d = d.min(before[j - 1] + 1);
            }
            row.push(d);
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances() {
        for (a, b, d) in [
            ("", "", 0),
            ("", "abc", 3),
            ("kitten", "sitting", 3),
            ("albdeo", "albedo", 1),
            ("photon", "photons", 1),
        ] {
            assert_eq!(distance(a, b), d, "{a} {b}");
            assert_eq!(distance(b, a), d, "{b} {a}");
        }
    }

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
