//! Volumetric photon mapping for smoke, clouds, fog and fire stored in OpenVDB files.

pub mod scene;
pub mod spectrum;
pub mod surface;
