//! Volumetric photon mapping for smoke, clouds, fog and fire stored in OpenVDB files.

pub mod atomic;
pub mod blackbody;
pub mod camera;
pub mod effects;
pub mod estimate;
pub mod film;
pub mod grid;
pub mod image;
pub mod light;
pub mod march;
pub mod medium;
pub mod phase;
pub mod photon;
pub mod progress;
pub mod ray;
pub mod reference;
pub mod render;
pub mod report;
pub mod rng;
pub mod scene;
pub mod spectrum;
pub mod tone;
pub mod tracking;
pub mod vdb;
pub mod world;
pub mod surface;
