//! Named values of a file or grid: a u32 count, then per entry name, type name, u32 length, bytes.
//!
//! Unknown types are skipped by their length. A known type of fixed size must have that length.

use std::collections::BTreeMap;

use super::bytes::Cursor;
use super::error::Fault;

/// A value of the metadata.
#[derive(Debug, Clone, PartialEq)]
pub enum MetaValue {
    /// `string`
    String(String),
    /// `bool`
    Bool(bool),
    /// `int32`
    Int32(i32),
    /// `int64`
    Int64(i64),
    /// `float`
    Float(f32),
    /// `double`
    Double(f64),
    /// `vec3i`
    Vec3i([i32; 3]),
    /// `vec3s`
    Vec3s([f32; 3]),
    /// `vec3d`
    Vec3d([f64; 3]),
    /// Any other type: its name and its length in bytes.
    Other {
        /// Type name as stored.
        type_name: String,
        /// Length of the value in bytes.
        length: usize,
    },
}

/// The metadata of a file or grid by name; of equal names the last counts, as in OpenVDB.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metadata(pub BTreeMap<String, MetaValue>);

impl Metadata {
    /// The value of that name.
    pub fn get(&self, name: &str) -> Option<&MetaValue> {
        self.0.get(name)
    }

    /// A string value of that name.
    pub fn string(&self, name: &str) -> Option<&str> {
        match self.get(name) {
            Some(MetaValue::String(s)) => Some(s),
            _ => None,
        }
    }

    pub(crate) fn read(c: &mut Cursor<'_>) -> Result<Self, Fault> {
        let count = c.u32("metadata count")?;
        let mut entries = BTreeMap::new();
        for _ in 0..count {
            let name = c.string("metadata name")?;
            let type_name = c.string("metadata type")?;
            let length = c.u32("metadata length")? as usize;
            let at = c.at();
            let raw = c.take(length, "metadata value")?;
            let value = MetaValue::parse(&type_name, raw).ok_or_else(|| {
                Fault::damaged(
                    at,
                    format!("metadata `{name}` of type {type_name} has {length} bytes"),
                )
            })?;
            entries.insert(name, value);
        }
        Ok(Self(entries))
    }
}

impl MetaValue {
    /// `None` where a type of fixed size has another length.
    pub(crate) fn parse(type_name: &str, raw: &[u8]) -> Option<Self> {
        Some(match type_name {
            "string" => Self::String(String::from_utf8_lossy(raw).into_owned()),
            "bool" => Self::Bool(u8::from_le_bytes(raw.try_into().ok()?) != 0),
            "int32" => Self::Int32(i32::from_le_bytes(raw.try_into().ok()?)),
            "int64" => Self::Int64(i64::from_le_bytes(raw.try_into().ok()?)),
            "float" => Self::Float(f32::from_le_bytes(raw.try_into().ok()?)),
            "double" => Self::Double(f64::from_le_bytes(raw.try_into().ok()?)),
            "vec3i" => Self::Vec3i(triple(raw, i32::from_le_bytes)?),
            "vec3s" => Self::Vec3s(triple(raw, f32::from_le_bytes)?),
            "vec3d" => Self::Vec3d(triple(raw, f64::from_le_bytes)?),
            _ => Self::Other {
                type_name: type_name.to_owned(),
                length: raw.len(),
            },
        })
    }
}

fn triple<const N: usize, T>(raw: &[u8], load: fn([u8; N]) -> T) -> Option<[T; 3]> {
    let (parts, rest) = raw.as_chunks::<N>();
    match parts {
        &[x, y, z] if rest.is_empty() => Some([load(x), load(y), load(z)]),
        _ => None,
    }
}
