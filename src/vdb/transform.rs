//! A grid's map from index to world space: its name, then the doubles of that kind of map.
//!
//! | map | doubles | used here |
//! |---|---|---|
//! | `UniformScaleMap`, `ScaleMap` | scale, voxel size, inverse, inverse², inverse/2 | scale |
//! | `UniformScaleTranslateMap`, `ScaleTranslateMap` | translation, then as above | translation, scale |
//! | `TranslationMap` | translation | translation |
//! | `AffineMap`, `UnitaryMap` | 4x4 matrix for row vectors, row by row | all |
//! | `NonlinearFrustumMap` | box, taper, depth, then an affine map | refused: no matrix says it |
//!
//! A row-vector matrix stored row by row is the column-vector matrix stored column by column,
//! which is what glam holds.

use glam::{DMat4, DVec3, DVec4};

use super::bytes::Cursor;
use super::error::Fault;

/// A grid's map as read.
#[derive(Debug, Clone)]
pub(crate) struct Map {
    /// The kind of map as stored.
    pub(crate) kind: String,
    /// Index to world for column vectors; `None` for a frustum.
    pub(crate) index_to_world: Option<DMat4>,
}

impl Map {
    pub(crate) fn read(c: &mut Cursor<'_>) -> Result<Self, Fault> {
        let kind = c.string("map name")?;
        if kind == "NonlinearFrustumMap" {
            c.take(48 + 8 + 8, "frustum")?;
            let second = c.string("second map of a frustum")?;
            affine(&second, c)?;
            return Ok(Self {
                kind,
                index_to_world: None,
            });
        }
        let index_to_world = Some(affine(&kind, c)?);
        Ok(Self {
            kind,
            index_to_world,
        })
    }

    /// Why no ray can be brought into this grid's index space, if so.
    pub(crate) fn refusal(&self) -> Option<String> {
        let Some(m) = self.index_to_world else {
            return Some(
                "its transform is a frustum, which is not affine; resample it into a box in the exporting program"
                    .to_owned(),
            );
        };
        let determinant = m.determinant();
        if !m.is_finite() || !determinant.is_finite() {
            return Some("its transform has entries that are not finite".to_owned());
        }
        let last_row = DVec4::new(m.x_axis.w, m.y_axis.w, m.z_axis.w, m.w_axis.w);
        if last_row != DVec4::W {
            return Some("its transform is projective, not affine".to_owned());
        }
        if determinant == 0.0 || !m.inverse().is_finite() {
            return Some("its transform flattens space: it has no inverse".to_owned());
        }
        None
    }
}

fn affine(kind: &str, c: &mut Cursor<'_>) -> Result<DMat4, Fault> {
    let at = c.at();
    Ok(match kind {
        "UniformScaleMap" | "ScaleMap" => {
            let scale = dvec3(c)?;
            c.take(96, "scale map")?;
            DMat4::from_scale(scale)
        }
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            let translation = dvec3(c)?;
            let scale = dvec3(c)?;
            c.take(96, "scale and translation map")?;
            let mut m = DMat4::from_scale(scale);
            m.w_axis = translation.extend(1.0);
            m
        }
        "TranslationMap" => DMat4::from_translation(dvec3(c)?),
        "AffineMap" | "UnitaryMap" => {
            let mut m = [0.0; 16];
            for v in &mut m {
                *v = c.f64("affine map")?;
            }
            DMat4::from_cols_array(&m)
        }
        other => return Err(Fault::damaged(at, format!("no such map: `{other}`"))),
    })
}

fn dvec3(c: &mut Cursor<'_>) -> Result<DVec3, Fault> {
    Ok(DVec3::new(c.f64("map")?, c.f64("map")?, c.f64("map")?))
}
