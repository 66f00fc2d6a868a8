//! The reference: long path tracing in independent parts, or a picture from elsewhere.
//!
//! ```text
//! R = mean of K parts of equal length      V = sample variance of the parts / K
//! ```
//!
//! Each part has a seed of its own, far from those of the sweep, and is kept on disk like any run.
//! A picture that the user brings carries its own standard errors in `stderr.R G B`; without them
//! its noise is not known, cannot be subtracted, and counts as everyone's error.

use std::path::Path;

use super::StudyError;
use super::figures::Reference;
use super::store::Pixels;
use crate::image;

/// Name of its parts in the store.
pub(super) const NAME: &str = "reference";
/// Seed of its first part, away from the sweep's 0, 1, 2, ...
pub(super) const FIRST_SEED: u64 = 1 << 32;
/// Paths of a pixel in one part.
pub(super) const PART_SPP: u32 = 64;

/// Mean and variance from parts.
#[derive(Debug, Default)]
pub(super) struct Parts {
    count: f64,
    mean: Vec<[f64; 3]>,
    m2: Vec<[f64; 3]>,
}

impl Parts {
    pub(super) fn add(&mut self, picture: &Pixels) {
        self.count += 1.0;
        self.mean.resize(picture.len(), [0.0; 3]);
        self.m2.resize(picture.len(), [0.0; 3]);
        for (pixel, (mean, m2)) in picture.iter().zip(self.mean.iter_mut().zip(&mut self.m2)) {
            for c in 0..3 {
                let before = f64::from(pixel[c]) - mean[c];
                mean[c] += before / self.count;
                m2[c] += before * (f64::from(pixel[c]) - mean[c]);
            }
        }
    }

    /// With two parts or more.
    pub(super) fn reference(&self) -> Option<Reference> {
        let k = self.count;
        (k >= 2.0).then(|| Reference {
            mean: self.mean.clone(),
            variance: self
                .m2
                .iter()
                .map(|m2| m2.map(|v| v / (k * (k - 1.0))))
                .collect(),
        })
    }
}

/// A picture from a file that fits a study of pictures of `asked`, of a scene whose own size is
/// `own`; and its size.
pub(super) fn fitting(
    file: &Path,
    asked: Option<[u32; 2]>,
    own: [u32; 2],
    warn: &dyn Fn(&str),
) -> Result<(Reference, [u32; 2]), StudyError> {
    let (picture, size) = read(file, warn)?;
    let refused = |reason: String| StudyError::Reference {
        file: file.to_owned(),
        reason,
    };
    let [w, h] = size;
    if asked.is_some_and(|asked| asked != size) {
        return Err(refused(format!(
            "it has {w}x{h} pixels; leave out --resolution, or give that"
        )));
    }
    let aspect = |[w, h]: [u32; 2]| f64::from(w) / f64::from(h);
    if (aspect(size) / aspect(own) - 1.0).abs() > 0.02 && asked.is_none() {
        let [ow, oh] = own;
        return Err(refused(format!(
            "its shape, {w}x{h}, is not that of the scene, {ow}x{oh}"
        )));
    }
    Ok((picture, size))
}

/// A picture from a file, and its size.
fn read(file: &Path, warn: &dyn Fn(&str)) -> Result<(Reference, [u32; 2]), StudyError> {
    let picture = image::read_exr(file)?;
    if picture.rgb.iter().flatten().any(|v| !v.is_finite()) {
        return Err(StudyError::Reference {
            file: file.to_owned(),
            reason: "it has pixels that are NaN or infinite".to_owned(),
        });
    }
    let variance = match &picture.standard_error {
        Some(errors) => errors
            .iter()
            .map(|e| e.map(|e| f64::from(e).powi(2)))
            .map(|v| v.map(|v| if v.is_finite() { v } else { 0.0 }))
            .collect(),
        None => {
            warn(&format!(
                "{} has no channels stderr.R G B: its own noise is not known and counts as error",
                file.display()
            ));
            vec![[0.0; 3]; picture.rgb.len()]
        }
    };
    let mean = picture.rgb.iter().map(|p| p.map(f64::from)).collect();
    Ok((
        Reference { mean, variance },
        [picture.width, picture.height],
    ))
}
