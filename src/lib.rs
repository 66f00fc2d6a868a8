//! Volumetric photon mapping for smoke, clouds, fog and fire stored in OpenVDB files.

pub mod blackbody;
pub mod camera;
pub mod estimate;
pub mod grid;
pub mod light;
pub mod march;
pub mod medium;
pub mod phase;
pub mod photon;
pub mod ray;
pub mod rng;
pub mod scene;
pub mod spectrum;
pub mod tracking;
pub mod world;
