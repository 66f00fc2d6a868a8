//! Reading a value of a TOML document, with its range and the words for it.
//!
//! Enumerations are a word (`phase = "isotropic"`) or a table with one key that names the choice
//! (`phase = { henyey_greenstein = { g = 0.8 } }`).

use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use glam::DVec3;
use toml::Spanned;
use toml::de::DeValue;

use super::Rgb;
use super::keys::{Faults, Keys, possible};

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

/// A value being read.
pub(in crate::scene) struct Item<'a> {
    pub(super) value: &'a Spanned<DeValue<'a>>,
    /// Name for messages: the key.
    pub(super) key: &'a str,
    pub(super) faults: &'a Faults,
}

impl<'a> Item<'a> {
    /// Notes a fault about this value.
    pub(in crate::scene) fn fault<T>(&self, message: impl Into<String>) -> Option<T> {
        self.faults.note(self.value.span(), message);
        None
    }

    /// Notes that the value is of the wrong kind.
    pub(super) fn wrong<T>(&self, wanted: impl fmt::Display) -> Option<T> {
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
