//! Radiance along a camera ray.
//!
//! ```text
//! L = emission + first order (sampled) + photon estimate + T(end) * background
//! ```
//!
//! | file | part |
//! |---|---|
//! | `direct` | first order, sampled at points along the ray |
//! | `beam` | photons along the ray: beam radiance estimate, per ray |
//! | `point` | photons in spheres at the steps of a march |
//! | `gather` | the one or the other, for rays of any origin |
//! | `bands` | photons sorted into tiles of the picture |
//! | `tiles` | the beam estimate for 8 x 8 camera rays at a time |
//! | `eight` | what photons add to a ray, eight at a time |
//! | `emission` | light emitted along the ray |
//! | `chain` | beyond the first surface: what a hit sends back, mirrors and lenses |
//! | `kernel` | kernels |
//! | `spread` | points spread over lights |
//! | `wall` | kernels cut where surfaces end the ray |
//!
//! All read one optical-depth profile of the ray (`march`).

pub mod bands;
pub mod beam;
pub mod chain;
pub mod direct;
mod eight;
pub mod emission;
pub mod gather;
pub mod kernel;
pub mod point;
mod spread;
pub mod tiles;
pub mod wall;
