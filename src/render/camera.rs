//! Camera rays: what each sees but for the photons along it.

use super::Job;
use super::bright::STRATA;
use crate::estimate::emission;
use crate::film::Sample;
use crate::march::Profile;
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

/// Everything of a camera ray up to the first surface but its photons: profile, background,
/// emission, first order. Returns the surface that it meets. `lens` draws points on the lens.
pub(super) fn camera_ray<S: Spectrum>(
    job: &Job<'_, S>,
    pixel: [u32; 2],
    (ray, profile): (&mut Ray, &mut Profile<S>),
    sum: &mut Sum,
    lens: Option<&mut Rng>,
    sampler: &mut Sampler,
) -> Option<Hit> {
    let world = job.world;
    let counts = &mut sampler.counters.effects;
    counts.coloured += u64::from(S::CHANNELS > 1);
    counts.surface_rays += u64::from(world.surfaces.is_some());
    counts.lens_points += u64::from(lens.is_some());
    let [jx, jy] = sampler.uniform2();
    let mut lens = lens;
    let mut aperture = || {
        let drawn = lens.as_mut().map(|rng| [rng.uniform(), rng.uniform()]);
        drawn.unwrap_or([0.0; 2])
    };
    *ray = world
        .camera
        .ray([pixel[0] as f32 + jx, pixel[1] as f32 + jy], aperture());
    let First { hit, light, t_max } = first_stretch(job, (ray, profile), sampler);
    let behind = match (&hit, light) {
        (Some(_), _) => S::ZERO,
        (None, Some((_, l))) => l,
        (None, None) => world.background(ray.direction),
    };
    let mut l = profile.transmittance * behind;
    let [emitted, first] = if job.bright.holds(pixel) {
        in_strata(job, pixel, aperture, sampler)
    } else {
        along(job, ray, profile, sampler)
    };
    l += emitted;
    sum.sample.emission += l.to_rgb();
    sum.sample.direct += first.to_rgb();
    let alpha = if light.is_some() || hit.is_some() {
        1.0
    } else {
        1.0 - profile.transmittance.mean()
    };
    sum.sample.alpha += alpha;
    if alpha > 0.0 {
        // Where half of what is seen lies in front.
        let half = if hit.is_some() {
            std::f32::consts::LN_2
        } else {
            -(-0.5 * (1.0 - profile.transmittance.channel(0))).ln_1p()
        };
        sum.sample.depth += if profile.is_clear() {
            t_max
        } else {
            profile.distance_at(half, 0)
        };
        sum.met += 1;
    }
    hit
}

/// What ends the first stretch of a camera ray.
struct First<S> {
    hit: Option<Hit>,
    /// A light that is seen, in place of a surface: distance \[m\] and radiance.
    light: Option<(f32, S)>,
    /// \[m\]
    t_max: f32,
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
    mut aperture: impl FnMut() -> [f32; 2],
    sampler: &mut Sampler,
) -> [S; 2] {
    let mut profile = Profile::default();
    let mut sums = [S::ZERO; 2];
    for i in 0..STRATA * STRATA {
        let cell = [i % STRATA, i / STRATA];
        let jitter = sampler.uniform2();
        let point = [0, 1].map(|axis| {
            pixel[axis] as f32 + (cell[axis] as f32 + jitter[axis]) * (1.0 / STRATA as f32)
        });
        let ray = job.world.camera.ray(point, aperture());
        first_stretch(job, (&ray, &mut profile), sampler);
        for (sum, found) in sums.iter_mut().zip(along(job, &ray, &profile, sampler)) {
            *sum += found;
        }
    }
    sums.map(|sum| sum * (1.0 / (STRATA * STRATA) as f32))
}
