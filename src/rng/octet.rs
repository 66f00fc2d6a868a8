//! Eight random streams at a time.
//!
//! Lane k of eight is word k / 2 of one vector if k is even, of the other if it is odd: the upper halves of
//! both, one shifted, are then eight numbers of 32 bits in the order of the lanes.
//!
//! Every number is the one that its stream by itself would have given next ([`Rng`]).

use std::f32::consts::LN_2;

use bytemuck::cast;
use wide::{f32x8, i32x8, u64x4};

use super::{Draw, HALVINGS, REST, Rng, SERIES};

/// 64 bits of eight lanes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bits([u64x4; 2]);

/// The streams.
#[derive(Debug, Clone)]
pub(crate) struct RngOctet {
    state: [[u64x4; 2]; 4],
}

/// The lower halves of 64 bits.
const LOW: u64 = u32::MAX as u64;

impl Bits {
    /// Bits of each lane from `shift` on, 32 of them.
    #[inline(always)]
    fn word(self, shift: u32) -> i32x8 {
        let [even, odd] = self.0;
        let low = u64x4::splat(LOW);
        // What lies 32 higher in the odd lanes goes there.
        let odd = if shift < 32 {
            odd << (32 - shift)
        } else {
            odd >> (shift - 32)
        };
        cast(((even >> shift) & low) | (odd & !low))
    }

    /// As of one.
    #[inline(always)]
    fn fraction<const SHIFT: u32, const COUNT: u32>(self) -> f32x8 {
        let word = self.word(SHIFT) & i32x8::splat(((1u32 << COUNT) - 1) as i32);
        f32x8::from_i32x8(word) * f32x8::splat(1.0 / (1u32 << COUNT) as f32)
    }

    /// As of one.
    #[inline(always)]
    fn middle<const SHIFT: u32, const COUNT: u32>(self) -> f32x8 {
        self.fraction::<SHIFT, COUNT>() + f32x8::splat(0.5 / (1u32 << COUNT) as f32)
    }
}

/// Lanes, each all 0 or all 1, as those of [`Bits`].
#[inline(always)]
fn halves(lanes: i32x8) -> [u64x4; 2] {
    let lanes: u64x4 = cast(lanes);
    let low = u64x4::splat(LOW);
    [
        (lanes & low) | (lanes << 32u32),
        (lanes >> 32u32) | (lanes & !low),
    ]
}

#[inline(always)]
fn rotated<const BY: u32>(x: u64x4) -> u64x4 {
    (x << BY) | (x >> (64 - BY))
}

impl RngOctet {
    /// Streams that nothing is drawn from.
    pub(crate) const NONE: Self = Self {
        state: [[u64x4::ZERO; 2]; 4],
    };

    /// Puts a stream into a lane.
    #[inline]
    pub(crate) fn put(&mut self, lane: usize, rng: &Rng) {
        for (to, from) in self.state.iter_mut().zip(rng.state) {
            to[lane % 2].as_mut_array()[lane / 2 % 4] = from;
        }
    }

    /// The stream of a lane.
    #[inline]
    pub(crate) fn stream(&self, lane: usize) -> Rng {
        // Not the vectors: a word of them may just have been put.
        let word = |number: usize| self.state[number][lane % 2].as_array()[lane / 2 % 4];
        Rng {
            state: [word(0), word(1), word(2), word(3)],
        }
    }

    /// [`Rng::collision`]; only the streams of `lanes` go on.
    #[inline(always)]
    pub(crate) fn collision(&mut self, lanes: i32x8) -> Draw<f32x8> {
        let [even, odd] = halves(lanes);
        let (a, b) = (self.two(0, even), self.two(1, odd));
        let first = Bits([a[0], b[0]]);
        let second = Bits([a[1], b[1]]);
        Draw {
            bar: first.fraction::<40, 24>(),
            tap: [
                first.middle::<20, 20>(),
                first.middle::<0, 20>(),
                second.middle::<44, 20>(),
            ],
            tau: self.tau(lanes, second),
        }
    }

    /// Two times 64 bits of even or odd lanes.
    #[inline(always)]
    fn two(&mut self, half: usize, lanes: u64x4) -> [u64x4; 2] {
        let [a, b, c, d] = &mut self.state;
        let state = [&mut a[half], &mut b[half], &mut c[half], &mut d[half]];
        let (first, next) = step([*state[0], *state[1], *state[2], *state[3]]);
        let (second, next) = step(next);
        *state[0] = lanes.select(next[0], *state[0]);
        *state[1] = lanes.select(next[1], *state[1]);
        *state[2] = lanes.select(next[2], *state[2]);
        *state[3] = lanes.select(next[3], *state[3]);
        [first, second]
    }

    #[inline(always)]
    fn tau(&mut self, lanes: i32x8, bits: Bits) -> f32x8 {
        let high = bits.word(REST) & i32x8::splat((1 << HALVINGS) - 1);
        // The exponent of a float is its highest bit.
        let float: i32x8 = cast(f32x8::from_i32x8(high));
        let halvings = i32x8::splat(126 + HALVINGS as i32) - (float >> 23u32);
        let rest = bits.word(0) & i32x8::splat((1 << REST) - 1);
        let mut tau = f32x8::from_i32x8(halvings).mul_add(f32x8::splat(LN_2), minus_ln(rest));
        let more = lanes & high.simd_eq(i32x8::ZERO);
        if more.any() {
            self.add_halvings(more, rest, &mut tau);
        }
        tau
    }

    /// Where the bits for halvings are all 0.
    #[cold]
    fn add_halvings(&mut self, lanes: i32x8, rest: i32x8, tau: &mut f32x8) {
        for lane in (0..8).filter(|lane| lanes.as_array()[*lane] != 0) {
            let mut rng = self.stream(lane);
            let halvings = rng.more_halvings() as f32;
            self.put(lane, &rng);
            tau.as_mut_array()[lane] =
                halvings.mul_add(LN_2, super::minus_ln(rest.as_array()[lane]));
        }
    }
}

/// [`Rng::bits`] of a state, and the next state.
#[inline(always)]
fn step([a, b, c, d]: [u64x4; 4]) -> (u64x4, [u64x4; 4]) {
    let bits = rotated::<23>(a + d) + a;
    let (e, f) = (c ^ a, d ^ b);
    (bits, [a ^ f, b ^ e, e ^ (b << 17u32), rotated::<45>(f)])
}

/// The same as of one.
#[inline(always)]
fn minus_ln(k: i32x8) -> f32x8 {
    let w = (f32x8::from_i32x8(k) + f32x8::splat(0.5)) * f32x8::splat(0.5 / (1u32 << REST) as f32);
    let s = w / (f32x8::splat(2.0) - w);
    let q = s * s;
    let series = q.mul_add(f32x8::splat(SERIES[0]), f32x8::splat(SERIES[1]));
    let series = q.mul_add(series, f32x8::splat(SERIES[2]));
    let series = q.mul_add(series, f32x8::splat(SERIES[3]));
    (f32x8::splat(2.0) * s) * q.mul_add(series, f32x8::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Stage;

    /// Lanes are the streams, whichever of them are drawn from.
    #[test]
    fn lanes_are_streams() {
        let mut streams: [Rng; 8] =
            std::array::from_fn(|i| Rng::stream(1, Stage::Check, 0, i as u64));
        let mut octet = RngOctet::NONE;
        for (lane, rng) in streams.iter().enumerate() {
            octet.put(lane, rng);
        }
        let mut which = Rng::stream(1, Stage::Check, 1, 0);
        for round in 0..10_000 {
            let drawn: [bool; 8] = std::array::from_fn(|_| which.below(2) == 1);
            let lanes = i32x8::new(drawn.map(|d| -i32::from(d)));
            let all = octet.collision(lanes);
            for lane in (0..8).filter(|lane| drawn[*lane]) {
                let own = Draw {
                    bar: all.bar.as_array()[lane],
                    tap: all.tap.map(|u| u.as_array()[lane]),
                    tau: all.tau.as_array()[lane],
                };
                let alone = streams[lane].collision();
                assert_eq!(own, alone, "lane {lane} in round {round}");
            }
        }
        for (lane, rng) in streams.iter_mut().enumerate() {
            assert_eq!(octet.stream(lane).bits(), rng.bits(), "lane {lane}");
        }
    }

    /// Zeros where halvings are counted, in lanes beside others.
    #[test]
    fn halvings_go_on_in_lanes() {
        let none = (0..)
            .map(|i| Rng::stream(2, Stage::Check, 2, i))
            .find(|rng| {
                let mut rng = rng.clone();
                rng.bits();
                rng.bits() >> REST & ((1 << HALVINGS) - 1) == 0
            });
        let mut alone = none.expect("one in a million streams");
        let mut octet = RngOctet::NONE;
        for lane in 0..8 {
            octet.put(lane, &Rng::stream(1, Stage::Check, 3, lane as u64));
        }
        octet.put(5, &alone);
        let tau = octet.collision(i32x8::splat(-1)).tau.to_array()[5];
        assert!(tau > HALVINGS as f32 * LN_2, "{tau}");
        assert_eq!(tau, alone.collision().tau);
        assert_eq!(octet.stream(5).bits(), alone.bits());
    }
}
