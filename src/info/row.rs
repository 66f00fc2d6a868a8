//! One grid and what is known of it; its JSON object.

use glam::{DMat4, DVec3};
use serde_json::{Map, Value as Json, json};

use super::memory::Memory;
use crate::vdb::{Archive, GridHeader, Refusal, Statistics, Value, ValueType};

/// Percentiles printed. [%]
pub(super) const PERCENTILES: [f64; 7] = [1.0, 10.0, 25.0, 50.0, 75.0, 90.0, 99.0];

/// One grid.
pub(super) struct Row<'a> {
    pub(super) header: &'a GridHeader,
    pub(super) stats: Option<Statistics>,
    pub(super) refused: Option<Refusal>,
    /// None of what cannot be rendered: vectors, points, frustums.
    pub(super) memory: Option<Memory>,
}

impl<'a> Row<'a> {
    /// Reads all of grid `index`.
    pub(super) fn new(archive: &'a Archive, index: usize) -> Self {
        let header = &archive.grids()[index];
        let stats = archive.statistics(index);
        let refused = match (&stats, &header.refused) {
            (Ok(_), refused) => refused.clone(),
            (Err(_), Some(refused)) => Some(refused.clone()),
            (Err(e), None) => Some(Refusal::Damaged(e.fault.to_string())),
        };
        let memory = match (&stats, &refused) {
            (Ok(stats), None) => Memory::of(archive, header, stats),
            _ => None,
        };
        Self {
            header,
            stats: stats.ok(),
            refused,
            memory,
        }
    }

    /// The grid's object.
    pub(super) fn json(&self) -> Json {
        let h = self.header;
        let mut o = Map::new();
        let mut put = |key: &str, value: Json| o.insert(key.to_owned(), value);
        put("name", json!(h.name));
        put("label", json!(h.label()));
        put("type", json!(type_name(h)));
        put("stored_as_half", json!(h.half && h.value_type.is_real()));
        put("grid_class", json!(h.class.name()));
        put("map", json!(h.map));
        put(
            "voxel_size",
            json!(h.index_to_world.map(|m| voxel_size(m).to_array())),
        );
        put("transform", json!(h.index_to_world.map(rows)));
        put("compression", json!(h.compression.to_string()));
        put("instance_of", json!(h.instance_of));
        put("refused", json!(self.refused.as_ref().map(Refusal::reason)));
        let Some(s) = &self.stats else {
            for key in [
                "active_voxels",
                "bbox_min",
                "bbox_max",
                "min",
                "max",
                "mean",
                "std",
            ] {
                put(key, Json::Null);
            }
            return Json::Object(o);
        };
        let filled = s.active_voxels > s.not_finite;
        let list = |f: fn(&crate::vdb::Moments) -> f64| {
            let v: Vec<f64> = s.components.iter().map(f).collect();
            match (filled, v.as_slice()) {
                (false, _) => Json::Null,
                (true, &[v]) => json!(v),
                (true, v) => json!(v),
            }
        };
        put("active_voxels", json!(s.active_voxels));
        put("bbox_min", json!(s.bbox.map(|b| b[0].to_array())));
        put("bbox_max", json!(s.bbox.map(|b| b[1].to_array())));
        put("min", list(|m| m.min));
        put("max", list(|m| m.max));
        put("mean", list(|m| m.mean));
        put("std", list(|m| m.std));
        let percentiles: Map<String, Json> = PERCENTILES
            .iter()
            .filter_map(|&p| Some((p.to_string(), json!(s.percentile(p / 100.0)?))))
            .collect();
        put("percentiles", Json::Object(percentiles));
        put("not_finite", json!(s.not_finite));
        put("negative", json!(s.negative));
        put("background", value_json(s.background));
        put("leaves", json!(s.leaves));
        put("tiles", json!(s.tiles));
        let memory = |f: fn(&Memory) -> Json| self.memory.as_ref().map_or(Json::Null, f);
        put("bricks", memory(|m| json!(m.bricks)));
        put("brick_value_bits", memory(|m| json!(m.value_bits)));
        put("memory_bytes", memory(|m| json!(m.grid)));
        put("bounds_bytes_at_most", memory(|m| json!(m.bounds)));
        put("memory_per_leaf_value", memory(|m| json!(m.per_leaf_value)));
        put(
            "memory_per_active_value",
            memory(|m| json!(m.per_active_value)),
        );
        Json::Object(o)
    }
}

/// A float's exact value; every f32 is an f64.
pub(super) fn value_json(value: Value) -> Json {
    match value {
        Value::Float(v) => json!(f64::from(v)),
        Value::Double(v) => json!(v),
        Value::Int(v) => json!(v),
        Value::Bool(v) => json!(v),
        Value::Vec3s(v) => json!(v.map(f64::from)),
        Value::Vec3d(v) => json!(v),
        Value::Vec3i(v) => json!(v),
    }
}

pub(super) fn type_name(h: &GridHeader) -> &str {
    if h.value_type == ValueType::Other {
        &h.type_name
    } else {
        h.value_type.name()
    }
}

pub(super) fn shown_name(h: &GridHeader) -> String {
    if h.name.is_empty() {
        format!("(unnamed){}", h.label())
    } else {
        h.label()
    }
}

pub(super) fn voxel_size(m: DMat4) -> DVec3 {
    DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length())
}

/// Row by row, for column vectors: the translation is the last column.
fn rows(m: DMat4) -> [[f64; 4]; 4] {
    m.transpose().to_cols_array_2d()
}
