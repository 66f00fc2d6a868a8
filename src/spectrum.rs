//! A spectrum is what light carries per channel: one grey channel or three of linear RGB.
//!
//! Hot loops are generic over it, so that a grey scene carries, multiplies and stores one
//! number where a chromatic one has three. Scene values are [`Rgb`]; a grey scene is one whose
//! every coefficient and light has three equal channels, so taking the first loses nothing.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Sub};

use glam::Vec3;

use crate::math::exp;
use crate::photon::kept::{Full, Kept, Short};
use crate::scene::Rgb;

/// One or three channels.
pub trait Spectrum:
    Copy
    + Debug
    + Default
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<f32, Output = Self>
    + MulAssign
    + MulAssign<f32>
    + Div<Output = Self>
{
    /// Number of channels.
    const CHANNELS: usize;
    /// What a photon keeps of its power and radius.
    type Kept: Kept<Self>;
    /// No light.
    const ZERO: Self;
    /// One in every channel.
    const ONE: Self;
    /// From the scene's three channels; a grey spectrum takes the first.
    fn from_rgb(rgb: Rgb) -> Self;
    /// Three channels, equal ones of a grey spectrum.
    fn to_rgb(self) -> Rgb;
    /// The same value in every channel.
    fn splat(value: f32) -> Self;
    /// Value of one channel.
    fn channel(self, index: usize) -> f32;
    /// The largest channel.
    fn max_channel(self) -> f32;
    /// Mean over the channels.
    fn mean(self) -> f32;
    /// exp(-tau) of each channel: once where all are equal, as in grey media under coloured light.
    fn transmittance(tau: Self) -> Self;
    /// Channel by channel.
    fn map(self, f: impl Fn(f32) -> f32) -> Self;
    /// True where every channel is finite.
    fn is_finite(self) -> bool;
    /// True where every channel is zero.
    fn is_zero(self) -> bool {
        self == Self::ZERO
    }
}

/// A running sum that carries along what rounding drops from it (Kahan 1965): a million terms are
/// summed as exactly as ten.
#[derive(Debug, Clone, Copy, Default)]
pub struct Compensated<S> {
    sum: S,
    excess: S,
}

impl<S: Spectrum> Compensated<S> {
    /// Adds a term.
    #[inline]
    pub fn add(&mut self, term: S) {
        let term = term - self.excess;
        let sum = self.sum + term;
        self.excess = (sum - self.sum) - term;
        self.sum = sum;
    }

    /// The sum so far.
    #[inline]
    #[must_use]
    pub fn sum(&self) -> S {
        self.sum
    }
}

impl Spectrum for f32 {
    type Kept = Short;
    const CHANNELS: usize = 1;
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    fn from_rgb(rgb: Rgb) -> Self {
        rgb.x
    }
    fn to_rgb(self) -> Rgb {
        Rgb::splat(self)
    }
    fn splat(value: f32) -> Self {
        value
    }
    fn channel(self, _index: usize) -> f32 {
        self
    }
    fn max_channel(self) -> f32 {
        self
    }
    fn mean(self) -> f32 {
        self
    }
    #[inline]
    fn transmittance(tau: Self) -> Self {
        exp(-tau)
    }
    fn map(self, f: impl Fn(Self) -> Self) -> Self {
        f(self)
    }
    fn is_finite(self) -> bool {
        self.is_finite()
    }
}

impl Spectrum for Vec3 {
    type Kept = Full;
    const CHANNELS: usize = 3;
    const ZERO: Self = Self::ZERO;
    const ONE: Self = Self::ONE;
    fn from_rgb(rgb: Rgb) -> Self {
        rgb
    }
    fn to_rgb(self) -> Rgb {
        self
    }
    fn splat(value: f32) -> Self {
        Self::splat(value)
    }
    fn channel(self, index: usize) -> f32 {
        self[index]
    }
    fn max_channel(self) -> f32 {
        self.max_element()
    }
    fn mean(self) -> f32 {
        // Exactly that of a grey spectrum where the channels are equal.
        if self.x == self.y && self.x == self.z {
            self.x
        } else {
            self.element_sum() * (1.0 / 3.0)
        }
    }
    #[inline]
    fn transmittance(tau: Self) -> Self {
        let x = exp(-tau.x);
        if tau.x == tau.y && tau.x == tau.z {
            Self::splat(x)
        } else {
            Self::new(x, exp(-tau.y), exp(-tau.z))
        }
    }
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self::new(f(self.x), f(self.y), f(self.z))
    }
    fn is_finite(self) -> bool {
        self.is_finite()
    }
}
