//! Volumetric photon mapping for smoke, clouds, fog and fire stored in OpenVDB files.

pub mod info;
pub mod vdb;
