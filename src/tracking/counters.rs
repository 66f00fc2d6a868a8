//! What was done, counted: the report's figures, and the proof that pruned effects cost nothing.

use crate::rng::Rng;

/// What was done, counted per unit of work and summed for the report.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Free flights sampled.
    pub free_flights: u64,
    /// Transmittances estimated.
    pub transmittance_rays: u64,
    /// Values of the field fetched.
    pub density_lookups: u64,
    /// Photons that a radiance estimate added.
    pub gathered_photons: u64,
    /// What only one effect calls for.
    pub effects: EffectCounts,
}

/// Declares the counts, once for the structure and both its forms.
macro_rules! counts {
    ($(#[$of:meta])* $name:ident, $length:ident: $($(#[$doc:meta])* $count:ident,)*) => {
        $(#[$of])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
        pub struct $name {
            $($(#[$doc])* pub $count: u64,)*
        }

        /// Counts of [`EffectCounts`].
        pub const $length: usize = [$(stringify!($count)),*].len();

        impl $name {
            /// All of them, in the order of their declaration.
            #[must_use]
            pub fn to_array(&self) -> [u64; $length] {
                [$(self.$count),*]
            }

            /// From [`to_array`](Self::to_array).
            #[must_use]
            pub fn from_array(counts: [u64; $length]) -> Self {
                let [$($count),*] = counts;
                Self { $($count),* }
            }
        }
    };
}

counts! {
    /// How often what only one effect calls for was done: 0 where the effect is pruned.
    EffectCounts, EFFECTS:
    /// Collisions with media that absorb.
    absorbing,
    /// Points of a ray joined to a light, and photons kept of the first order.
    first_order,
    /// Photons kept of higher orders in media, and collisions of paths beyond the first.
    higher_orders,
    /// Phase functions evaluated or sampled that depend on the direction.
    directions,
    /// Temperatures fetched.
    temperatures,
    /// Rays and photons of three channels.
    coloured,
    /// Rays through the hierarchy of surfaces.
    surface_rays,
    /// Reflections and refractions that are not diffuse.
    specular,
    /// Photons kept on surfaces.
    surface_photons,
    /// Straight lines followed from boundary to boundary, and boundaries passed.
    boundaries,
    /// Points drawn on lights.
    light_points,
    /// Photons from skies, and rays toward them from surfaces.
    sky,
    /// Points drawn on the lens.
    lens_points,
}

impl std::ops::AddAssign for EffectCounts {
    fn add_assign(&mut self, other: Self) {
        let (a, b) = (self.to_array(), other.to_array());
        *self = Self::from_array(std::array::from_fn(|i| a[i] + b[i]));
    }
}

impl Counters {
    /// How often what only one effect calls for was done, in the fixed order of the effects.
    #[must_use]
    pub fn by_effect(&self) -> [u64; 14] {
        let counts = &self.effects;
        [
            counts.absorbing,
            counts.first_order,
            counts.higher_orders,
            counts.directions,
            counts.temperatures,
            counts.coloured,
            self.density_lookups,
            counts.surface_rays,
            counts.specular,
            counts.surface_photons,
            counts.boundaries,
            counts.light_points,
            counts.sky,
            counts.lens_points,
        ]
    }
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.free_flights += other.free_flights;
        self.transmittance_rays += other.transmittance_rays;
        self.density_lookups += other.density_lookups;
        self.gathered_photons += other.gathered_photons;
        self.effects += other.effects;
    }
}

/// A random stream and the counters of its work.
#[derive(Debug, Clone)]
pub struct Sampler {
    /// Random numbers.
    pub rng: Rng,
    /// Work done.
    pub counters: Counters,
    /// Optical thickness left of a step of delta tracking: distributed as exp(-tau) whatever happened
    /// before, as a flight that ends without a collision forgets how far it came.
    pub(super) budget: f32,
}

impl Sampler {
    /// A sampler on a stream.
    #[must_use]
    pub fn new(mut rng: Rng) -> Self {
        Self {
            budget: rng.exponential(),
            rng,
            counters: Counters::default(),
        }
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        self.rng.uniform()
    }

    /// Optical thickness of a free flight, distributed as exp(-tau).
    #[inline]
    pub fn exponential(&mut self) -> f32 {
        self.rng.exponential()
    }

    /// Two uniforms.
    #[inline]
    pub fn uniform2(&mut self) -> [f32; 2] {
        [self.rng.uniform(), self.rng.uniform()]
    }
}
