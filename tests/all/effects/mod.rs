//! The effect plan: what is pruned changes no picture, does no work, and follows the scene's keys.

mod agreement;
mod forecast;
mod keys;
mod plateau;
pub(crate) mod scenes;
