//! Camera rays: what each sees but for the photons along it.
//!
//! What the media send along the first stretch, and what lies behind them, are estimates of their
//! own, each from the rays that it is worth: `bright`, `edges`.

use super::job::Job;
use super::{bright, edges};
use crate::estimate::chain::{Chain, Link, Scratch};
use crate::estimate::emission;
use crate::film::Sample;
use crate::march::Profile;
use crate::photon::Heading;
use crate::ray::Ray;
use crate::rng::Rng;
use crate::spectrum::Spectrum;
use crate::surface::Hit;
use crate::tracking::Sampler;

/// Sum of the camera rays of a pixel in a pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sum {
    pub(super) sample: Sample,
    /// Rays that met something.
    pub(super) met: u32,
}

impl Default for Sum {
    fn default() -> Self {
        Self {
            sample: Sample {
                depth: 0.0,
                ..Sample::NOTHING
            },
            met: 0,
        }
    }
}

impl Sum {
    /// Adds light and alpha.
    pub(super) fn add(&mut self, sample: &Sample) {
        self.sample.direct += sample.direct;
        self.sample.indirect += sample.indirect;
        self.sample.emission += sample.emission;
        self.sample.alpha += sample.alpha;
    }

    pub(super) fn mean(&self, rays: u32) -> Sample {
        let w = 1.0 / rays as f32;
        Sample {
            direct: self.sample.direct * w,
            indirect: self.sample.indirect * w,
            emission: self.sample.emission * w,
            alpha: self.sample.alpha * w,
            depth: if self.met > 0 {
                self.sample.depth / self.met as f32
            } else {
                f32::INFINITY
            },
        }
    }
}

/// Points on the lens; in its middle without a stream.
pub(super) struct Lens(pub(super) Option<Rng>);

impl Lens {
    fn point(&mut self) -> [f32; 2] {
        let drawn = self.0.as_mut().map(|rng| [rng.uniform(), rng.uniform()]);
        drawn.unwrap_or([0.0; 2])
    }
}

/// What the media send along the first stretch of a camera ray but for photons: emission, first
/// order. Leaves the ray and its profile, and returns what ends the stretch.
pub(super) fn camera_ray<S: Spectrum>(
    job: &Job<'_, S>,
    pixel: [u32; 2],
    (ray, profile): (&mut Ray, &mut Profile<S>),
    sum: &mut Sum,
    lens: &mut Lens,
    sampler: &mut Sampler,
) -> First<S> {
    let world = job.world;
    let counts = &mut sampler.counters.effects;
    counts.coloured += u64::from(S::CHANNELS > 1);
    counts.surface_rays += u64::from(world.surfaces.is_some());
    counts.lens_points += u64::from(lens.0.is_some());
    let [jx, jy] = sampler.uniform2();
    *ray = world
        .camera
        .ray([pixel[0] as f32 + jx, pixel[1] as f32 + jy], lens.point());
    let first = first_stretch(job, (ray, profile), sampler);
    let [emitted, scattered] = if job.bright.holds(pixel) {
        in_strata(job, pixel, lens, sampler)
    } else {
        along(job, ray, profile, sampler)
    };
    sum.sample.emission += emitted.to_rgb();
    sum.sample.direct += scattered.to_rgb();
    if first.alpha(profile) > 0.0 {
        // Where half of what is seen lies in front.
        let half = if first.hit.is_some() {
            std::f32::consts::LN_2
        } else {
            -(-0.5 * (1.0 - profile.transmittance.channel(0))).ln_1p()
        };
        sum.sample.depth += if profile.is_clear() {
            first.t_max
        } else {
            profile.distance_at(half, 0)
        };
        sum.met += 1;
    }
    first
}

/// What lies behind the media of a pixel, by the ray whose first stretch is known or by rays of its
/// own; `profile` is for theirs.
pub(super) fn behind<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    chain: Option<&Chain<'_, S, H>>,
    pixel: [u32; 2],
    known: (&Ray, &Profile<S>, &First<S>),
    (lens, scratch, profile): (&mut Lens, &mut Scratch<S>, &mut Profile<S>),
    sampler: &mut Sampler,
) -> Sample {
    if !job.edges.holds(pixel) {
        return behind_ray(job, chain, known, scratch, sampler);
    }
    let mut sum = Sum::default();
    let rays = edges::STRATA * edges::STRATA;
    for point in strata(pixel, edges::STRATA) {
        let ray = job.world.camera.ray(point(sampler), lens.point());
        let first = first_stretch(job, (&ray, profile), sampler);
        sampler.counters.effects.surface_rays += 1;
        let known = (&ray, &*profile, &first);
        sum.add(&behind_ray(job, chain, known, scratch, sampler));
    }
    sum.mean(rays)
}

/// What lies behind the media of a ray: surfaces, a lamp or the sky.
fn behind_ray<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    chain: Option<&Chain<'_, S, H>>,
    (ray, profile, first): (&Ray, &Profile<S>, &First<S>),
    scratch: &mut Scratch<S>,
    sampler: &mut Sampler,
) -> Sample {
    let mut sample = Sample {
        alpha: first.alpha(profile),
        ..Sample::NOTHING
    };
    let tr = profile.transmittance;
    match (first.hit, first.light, chain) {
        (Some(hit), _, Some(chain)) => {
            let link = Link::first(job.world, ray, hit, tr);
            chain.follow(link, scratch, sampler).add_to(&mut sample);
        }
        (Some(_), _, None) => {}
        (None, Some((_, l)), _) => sample.emission = (tr * l).to_rgb(),
        (None, None, _) => sample.emission = (tr * job.world.background(ray.direction)).to_rgb(),
    }
    sample
}

/// Points of a pixel, one in each of n x n strata, drawn when they are called for.
fn strata(pixel: [u32; 2], n: u32) -> impl Iterator<Item = impl FnOnce(&mut Sampler) -> [f32; 2]> {
    (0..n * n).map(move |i| {
        move |sampler: &mut Sampler| {
            let (cell, jitter) = ([i % n, i / n], sampler.uniform2());
            [0, 1].map(|axis| {
                pixel[axis] as f32 + (cell[axis] as f32 + jitter[axis]) * (1.0 / n as f32)
            })
        }
    })
}

/// What ends the first stretch of a camera ray.
pub(super) struct First<S> {
    /// A surface.
    pub(super) hit: Option<Hit>,
    /// A light that is seen, in place of a surface: distance \[m\] and radiance.
    light: Option<(f32, S)>,
    /// \[m\]
    t_max: f32,
}

impl<S: Spectrum> First<S> {
    /// What is seen of the media and of what ends them, against the background.
    fn alpha(&self, profile: &Profile<S>) -> f32 {
        if self.light.is_some() || self.hit.is_some() {
            1.0
        } else {
            1.0 - profile.transmittance.mean()
        }
    }
}

/// Marches a camera ray up to its first surface or light.
fn first_stretch<S: Spectrum>(
    job: &Job<'_, S>,
    (ray, profile): (&Ray, &mut Profile<S>),
    sampler: &mut Sampler,
) -> First<S> {
    let world = job.world;
    let hit = world
        .surfaces
        .as_ref()
        .and_then(|s| s.intersect(ray.origin, ray.direction, f32::INFINITY));
    let t_hit = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
    let light = world.seen_light(ray, t_hit);
    let t_max = light.map_or(t_hit, |(t, _)| t);
    profile.march(
        world.media_for(&world.camera_inside),
        ray,
        t_max,
        job.scene.settings.march,
        &mut sampler.counters,
    );
    First {
        hit: hit.filter(|_| light.is_none()),
        light,
        t_max,
    }
}

/// What the media emit along the first stretch, and what they scatter once of lights that are
/// sampled.
fn along<S: Spectrum>(
    job: &Job<'_, S>,
    ray: &Ray,
    profile: &Profile<S>,
    sampler: &mut Sampler,
) -> [S; 2] {
    let world = job.world;
    let mut sums = [S::ZERO; 2];
    if job.plan.emission {
        sums[0] = emission::radiance(world, ray, profile, &mut sampler.counters);
    }
    if job.plan.direct {
        let inside = &world.camera_inside;
        sums[1] = job.lights.radiance(world, ray, inside, profile, sampler);
    }
    sums
}

/// The same toward a pixel, from rays through its strata: `bright`.
fn in_strata<S: Spectrum>(
    job: &Job<'_, S>,
    pixel: [u32; 2],
    lens: &mut Lens,
    sampler: &mut Sampler,
) -> [S; 2] {
    let mut profile = Profile::default();
    let mut sums = [S::ZERO; 2];
    for point in strata(pixel, bright::STRATA) {
        let ray = job.world.camera.ray(point(sampler), lens.point());
        first_stretch(job, (&ray, &mut profile), sampler);
        for (sum, found) in sums.iter_mut().zip(along(job, &ray, &profile, sampler)) {
            *sum += found;
        }
    }
    sums.map(|sum| sum * (1.0 / (bright::STRATA * bright::STRATA) as f32))
}
