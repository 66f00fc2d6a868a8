//! One corner of a cell in place of eight.
//!
//! ```text
//! voxel = floor(p) + (u < p - floor(p))      u uniform: each corner with its trilinear weight
//! ```

use wide::{f32x4, f32x8, i32x4, i32x8};

use crate::lanes::axes;

/// The voxel at one corner of p's cell, chosen with the probability of its trilinear weight: its
/// value is in expectation the field at p, for one fetch instead of eight (Hofmann et al. 2021).
/// Only for estimators linear in the field. `u` holds uniforms.
#[inline(always)]
pub(crate) fn tap(p: f32x4, u: f32x4) -> i32x4 {
    let floor = p.floor();
    // All bits set are -1.
    let next: i32x4 = bytemuck::cast(u.simd_lt(p - floor));
    floor.fast_trunc_int() - next
}

/// The same of eight points.
#[inline(always)]
pub(crate) fn eight_taps(p: [f32x8; 3], u: [f32x8; 3]) -> [i32x8; 3] {
    axes(|axis| {
        let floor = p[axis].floor();
        let next: i32x8 = bytemuck::cast(u[axis].simd_lt(p[axis] - floor));
        floor.fast_trunc_int() - next
    })
}
