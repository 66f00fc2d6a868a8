//! Volumetric photon mapping for smoke, clouds, fog and fire stored in OpenVDB files.

pub mod atomic;
pub mod film;
pub mod image;
pub mod progress;
pub mod report;
pub mod scene;
pub mod spectrum;
pub mod tone;
