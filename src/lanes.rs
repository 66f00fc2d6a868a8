//! Numbers side by side: of three axes, of eight lanes.
//!
//! Written out: an array's own `map` is a loop that is not always unrolled, and then goes through memory.

use bytemuck::cast;
use glam::Vec3;
use wide::{f32x4, f32x8, i32x8};

/// Three axes, and 0.
#[inline(always)]
pub(crate) fn four(v: Vec3) -> f32x4 {
    f32x4::new([v.x, v.y, v.z, 0.0])
}

/// The lesser of two numbers, the second if one is not a number. One instruction, unlike `f32::min`.
#[inline(always)]
pub(crate) fn lesser<T: PartialOrd>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// The greater of two numbers, the second if one is not a number.
#[inline(always)]
pub(crate) fn greater<T: PartialOrd>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// What is made of each axis.
#[inline(always)]
pub(crate) fn axes<T>(mut of: impl FnMut(usize) -> T) -> [T; 3] {
    [of(0), of(1), of(2)]
}

/// What is made of each lane.
#[inline(always)]
pub(crate) fn lanes<T>(mut of: impl FnMut(usize) -> T) -> [T; 8] {
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

/// One of two, by lanes that are all 0 or all 1. As integers: floats that are put by a mask where they were
/// become a masked store, which takes dozens of steps on some machines.
#[inline(always)]
pub(crate) fn pick(lanes: i32x8, yes: f32x8, no: f32x8) -> f32x8 {
    let chosen: i32x8 = lanes.select(cast::<f32x8, i32x8>(yes), cast::<f32x8, i32x8>(no));
    cast(chosen)
}

/// The lesser of both; the second where one is not a number.
#[inline(always)]
pub(crate) fn least(a: f32x8, b: f32x8) -> f32x8 {
    a.simd_lt(b).select(a, b)
}

/// The greater of both; the second where one is not a number.
#[inline(always)]
pub(crate) fn most(a: f32x8, b: f32x8) -> f32x8 {
    a.simd_gt(b).select(a, b)
}

/// Lanes as a mask of floats.
#[inline(always)]
pub(crate) fn floats(lanes: i32x8) -> f32x8 {
    cast(lanes)
}

/// Lanes of a mask of floats.
#[inline(always)]
pub(crate) fn ints(lanes: f32x8) -> i32x8 {
    cast(lanes)
}
