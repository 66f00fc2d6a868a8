//! Eight free flights at a time, in lanes.
//!
//! ```text
//! set out -> step -> collide -> arrive
//!            ^  |    ^  |  null
//!            +--+----+--+
//! ```
//!
//! A flight by itself is a chain of guesses: whether it collides in this cell, and whether that is real,
//! are known only after fetches, and guessed wrongly about every other time. Lanes guess nothing. In a
//! turn each of them takes a step if it is between cells, then collides if it has got that far, and
//! idles else; a density that is looked up is there in the next turn.
//!
//! Lanes of a group that do different things in turn by masks: Laine, Karras & Aila 2013 (Megakernels considered
//! harmful) sort them on GPUs, whose groups are wider.

use wide::{f32x8, i32x8};

use super::Sampler;
use crate::grid::eight_taps;
use crate::grid::octet::Octet;
use crate::lanes::{axes, ints, most, pick};
use crate::medium::GridField;
use crate::ray::Ray;
use crate::rng::RngOctet;

/// Eight free flights, under way or not.
#[derive(Debug, Clone)]
pub(super) struct FlightOctet<'a> {
    field: &'a GridField,
    /// \[1/m where the density is 1\]
    sigma_t: f32,
    segments: Octet<'a>,
    rng: RngOctet,
    /// Lanes between cells.
    walking: i32x8,
    /// Those at a collision.
    colliding: i32x8,
    /// Those at one that is open, whose density is being looked up.
    looking: i32x8,
    /// The last collision, or where the segment begins.
    t: f32x8,
    /// Optical thickness of the majorants from there to the next collision.
    budget: f32x8,
    /// Where the step begins and where the segment ends, and its bounds.
    t_min: f32x8,
    t_max: f32x8,
    majorant: f32x8,
    minorant: f32x8,
    /// Of collisions: the density that they are real above, the voxel of the tap, where its block is, and
    /// the budget after a null one.
    bar: f32x8,
    voxel: [i32x8; 3],
    block: i32x8,
    next: f32x8,
    /// Of those being looked up: the first and the last of these, and where the density is.
    open_bar: f32x8,
    open_next: f32x8,
    found: [usize; 8],
}

/// What came of a turn, a bit a lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    /// Flights that ended in a collision.
    pub(super) collided: u32,
    /// Flights that ended in none.
    pub(super) left: u32,
    /// Those that wait for a look-up.
    pub(super) looking: u32,
}

impl<'a> FlightOctet<'a> {
    /// No flights yet, through a field of this coefficient [1/m where the density is 1].
    pub(super) fn new(field: &'a GridField, sigma_t: f32) -> Self {
        Self {
            field,
            sigma_t,
            segments: Octet::new(&field.flights),
            rng: RngOctet::NONE,
            walking: i32x8::ZERO,
            colliding: i32x8::ZERO,
            looking: i32x8::ZERO,
            t: f32x8::ZERO,
            budget: f32x8::ZERO,
            t_min: f32x8::ZERO,
            t_max: f32x8::ZERO,
            majorant: f32x8::ZERO,
            minorant: f32x8::ZERO,
            bar: f32x8::ZERO,
            voxel: [i32x8::ZERO; 3],
            block: i32x8::ZERO,
            next: f32x8::ZERO,
            open_bar: f32x8::ZERO,
            open_next: f32x8::ZERO,
            found: [0; 8],
        }
    }

    /// Begins a flight as far as `t_max` in a lane; false if the ray misses the field.
    #[inline(always)]
    pub(super) fn set_out(&mut self, lane: usize, ray: &Ray, t_max: f32, of: &Sampler) -> bool {
        let local = self.field.placement.local_ray(ray);
        let segments = self.field.flights.segments(&local, 0.0, t_max);
        if segments.is_done() {
            return false;
        }
        self.segments.put(lane, &segments);
        self.rng.put(lane, &of.rng);
        self.budget.as_mut_array()[lane % 8] = of.budget;
        self.walking.as_mut_array()[lane % 8] = -1;
        true
    }

    /// Where the flight of a lane had its last collision; the random numbers go on in the sampler.
    #[inline(always)]
    pub(super) fn end(&self, lane: usize, of: &mut Sampler) -> f32 {
        of.rng = self.rng.stream(lane);
        of.budget = self.budget.as_array()[lane % 8];
        self.t.as_array()[lane % 8]
    }

    /// From t to a collision, or else across the segment, of some lanes.
    #[inline(always)]
    fn reach(&mut self, lanes: i32x8, t: f32x8) -> i32x8 {
        let sigma_maj = f32x8::splat(self.sigma_t) * self.majorant;
        let reach = (self.t_max - t) * sigma_maj;
        let collides = lanes & ints(self.budget.simd_lt(reach));
        let hit = self.budget.mul_add(f32x8::ONE / sigma_maj, t);
        self.t = pick(collides, hit, self.t);
        self.budget = pick(lanes, self.budget - reach, self.budget);
        collides
    }

    /// First part of a turn: the cells of steps.
    #[inline(always)]
    pub(super) fn fetch(&mut self) {
        self.segments.fetch(self.walking);
    }

    /// Second part: steps across them.
    #[inline(always)]
    pub(super) fn step(&mut self) {
        let walking = self.walking;
        let segments = self.segments.advance(walking);
        self.t_min = segments.t_min;
        self.t_max = pick(walking, segments.t_max, self.t_max);
        self.majorant = pick(walking, segments.majorant, self.majorant);
        self.minorant = pick(walking, segments.minorant, self.minorant);
    }

    /// Third part: who collides there, and what is drawn of collisions.
    #[inline(always)]
    pub(super) fn draw(&mut self) {
        let hits = self.reach(self.walking, self.t_min);
        self.walking &= !hits;
        self.colliding |= hits;
        let draw = self.rng.collision(self.colliding);
        self.bar = draw.bar * self.majorant;
        self.voxel = eight_taps(self.segments.at(self.t), draw.tap);
        self.next = draw.tau;
    }

    /// Fourth part: the blocks of collisions.
    #[inline(always)]
    pub(super) fn find_blocks(&mut self) {
        self.block = self.segments.find_blocks(self.voxel);
    }

    /// Last part: what comes of collisions.
    #[inline(always)]
    pub(super) fn collide(&mut self) -> Turn {
        let verdicts = self.segments.verdicts(self.bar, self.voxel, self.block);
        let (colliding, looked) = (self.colliding, self.looking);
        // Below the minorant or the density: a constant's are the same, and it is not looked up.
        let density = most(self.minorant, self.field.grid.found(self.found));
        let below = ints(self.open_bar.simd_lt(density));
        let real = (verdicts.real & colliding) | (below & looked);
        let null = (verdicts.null & colliding) | (!below & looked);
        self.looking = colliding & !verdicts.real & !verdicts.null;

        let next = pick(looked, self.open_next, self.next);
        self.budget = pick(real | null, next, self.budget);
        self.colliding = self.reach(null, self.t);
        let on = self.walking | (null & !self.colliding);
        let done = self.segments.done();
        self.walking = on & !done;
        (self.open_bar, self.open_next) = (self.bar, self.next);
        let certain = ints(self.open_bar.simd_lt(self.minorant));
        Turn {
            collided: real.to_bitmask(),
            left: (on & done).to_bitmask(),
            looking: (self.looking & !certain).to_bitmask(),
        }
    }

    /// Finds the density at the collision of a lane that is looking, for the next turn.
    #[inline(always)]
    pub(super) fn look_up(&mut self, lane: usize) {
        let lane = lane % 8;
        let voxel = axes(|axis| self.voxel[axis].as_array()[lane]);
        self.found[lane] = self.field.grid.find(voxel);
    }
}
