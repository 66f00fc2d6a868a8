//! One pass of a photon estimate: photons, their radii, tiles or trees, camera rays.

use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;

use super::camera::{Lens, Sum, behind, camera_ray};
use super::job::Job;
use super::passes::{Gathered, Tally};
use super::pilot::Radii;
use crate::estimate::bands::{BandTiles, Bands, TILE, TILE_RAYS};
use crate::estimate::beam::Stretch;
use crate::estimate::chain::{Chain, Scratch};
use crate::estimate::gather::{BeamPhotons, MediaPhotons};
use crate::estimate::point::PointMap;
use crate::estimate::tiles::TileRays;
use crate::estimate::wall::Wall;
use crate::film::Sample;
use crate::light::Light;
use crate::march::Profile;
use crate::photon::radius::radius_scale;
use crate::photon::surface::{SurfaceGather, SurfaceMap};
use crate::photon::{Heading, Photons, TraceSettings, trace_photons};
use crate::rng::{Rng, Stage};
use crate::scene::Method;
use crate::spectrum::Spectrum;
use crate::tracking::{Counters, Sampler};
use crate::world::World;

/// One pass of the beam estimate or of the point estimate; with `second`, its photons are gathered
/// once more with all radii times that, along the same camera rays.
pub(super) fn pass<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    radii: Option<&Radii<S>>,
    pass: u32,
    second: Option<f32>,
    tally: &mut Tally,
) -> Gathered {
    let settings = &job.scene.settings;
    let mut traced = None;
    if let Some(radii) = radii {
        let clock = Instant::now();
        job.exec.progress.stage("photons", None);
        let photons = trace::<S, H>(job, radii, settings.photons, Stage::Photon, pass);
        tally.photons.emitted += photons.emitted;
        tally.photons.stored += photons.stored() as u64;
        tally.counters += photons.counters;
        tally.energy += photons.energy;
        let bytes = photons.memory_bytes() as u64;
        tally.memory.photons = tally.memory.photons.max(bytes);
        traced = Some((photons, radii));
        tally.times.photons += clock.elapsed().as_secs_f64();
    }
    let again = second.map(|factor| (factor, traced.clone()));
    let scale = radius_scale(pass, blur_dimension(settings.method));
    Gathered {
        samples: gathered(job, traced, [scale; 2], pass, tally),
        second: again
            .map(|(factor, traced)| gathered(job, traced, [scale * factor, scale], pass, tally)),
    }
}

/// Gathers the photons of a pass with radii and steps times `scales`.
fn gathered<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    traced: Option<(Photons<S, H>, &Radii<S>)>,
    scales: [f32; 2],
    pass: u32,
    tally: &mut Tally,
) -> Vec<Sample> {
    let clock = Instant::now();
    let gather = Gather::new(job, traced, scales, pass);
    tally.memory.map = tally.memory.map.max(gather.memory_bytes() as u64);
    tally.times.map += clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let height = u64::from(job.grid.high[1] - job.grid.low[1]);
    job.exec
        .progress
        .stage(&format!("pass {}", pass + 1), Some(height));
    let bands: Vec<(Vec<Sample>, Counters)> = (0..job.grid.bands())
        .into_par_iter()
        .map_init(TileRays::default, |rays, band| {
            let out = gather_band::<S, H>(job, &gather, band, pass, rays);
            job.exec.progress.advance(u64::from(TILE));
            out
        })
        .collect();
    let mut samples = Vec::with_capacity(bands.iter().map(|(s, _)| s.len()).sum());
    for (band, counters) in bands {
        samples.extend(band);
        tally.counters += counters;
    }
    tally.times.gather += clock.elapsed().as_secs_f64();
    samples
}

/// Traces `emit` photons of a pass.
pub(super) fn trace<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    radii: &Radii<S>,
    emit: u64,
    stage: Stage,
    pass: u32,
) -> Photons<S, H> {
    let settings = &job.scene.settings;
    let trace = TraceSettings {
        rate: &radii.rate,
        emit,
        seed: settings.seed,
        stage,
        pass: pass.into(),
        direct: settings.direct,
        surface_photons: job.plan.surface_photons,
    };
    trace_photons::<S, H>(job.world, &trace)
}

/// Radius of a photon of first order over its distance from a lamp that is a point: light falls off
/// as 1 / d^2 there, and beside the edge of a cone at once. Larger: lamps' cones are blurred at their
/// tips; smaller: noise around lamps.
const NEAR_LAMP: f32 = 0.2;

/// Where radii of first order end.
struct NearLamps {
    /// Lamps that are points.
    lamps: Vec<Vec3>,
    camera: Vec3,
    /// Width of a pixel a metre away. \[m\]
    pixel: f32,
}

impl NearLamps {
    fn new<S: Spectrum>(world: &World<S>) -> Self {
        let lamps = world.lights.iter();
        let lamps = lamps
            .filter(|light| matches!(light, Light::Point(_) | Light::Spot(_)))
            .filter_map(Light::position);
        Self {
            lamps: lamps.collect(),
            camera: world.camera.position,
            pixel: world.camera.pixels_per_slope()[1].recip(),
        }
    }

    /// Largest radius at a point. No less than a pixel: blur in it is not seen, and what one ray finds
    /// of discs smaller than it has a variance without bound, as there are ever brighter ones toward
    /// the lamp. \[m\]
    fn limit(&self, p: Vec3) -> f32 {
        let distance2 = |lamp: &Vec3| lamp.distance_squared(p);
        let nearest = self
            .lamps
            .iter()
            .map(distance2)
            .fold(f32::INFINITY, f32::min);
        (NEAR_LAMP * nearest.sqrt()).max(self.pixel * p.distance(self.camera))
    }
}

/// Dimension of what the kernels of a method blur.
pub(super) fn blur_dimension(method: Method) -> u32 {
    if method == Method::Point { 3 } else { 2 }
}

/// The photons of a pass, those in media of first order and of higher ones.
pub(super) struct Gather<'a, S: Spectrum, H> {
    /// For camera rays from one point, in tiles.
    tiles: Option<[Bands<S, H>; 2]>,
    /// For rays from anywhere, one by one: with a lens, beyond mirrors and lenses, and in spheres.
    alone: Option<MediaPhotons<'a, S, H>>,
    /// On surfaces.
    surface: Option<SurfaceGather<'a, S>>,
}

impl<'a, S: Spectrum, H: Heading> Gather<'a, S, H> {
    /// Gives photons their radii, those of the pilot times the first scale, and sorts them. The
    /// second one scales the steps of the point estimate.
    pub(super) fn new(
        job: &Job<'_, S>,
        traced: Option<(Photons<S, H>, &'a Radii<S>)>,
        [scale, steps]: [f32; 2],
        pass: u32,
    ) -> Self {
        let settings = &job.scene.settings;
        let mut spheres = None;
        let mut photons = [Vec::new(), Vec::new()];
        let mut surface = None;
        if let Some((traced, radii)) = traced {
            spheres = Some(radii);
            photons = [traced.first, traced.higher];
            let near_lamps = NearLamps::new(job.world);
            for (photons, near_lamps) in photons.iter_mut().zip([Some(&near_lamps), None]) {
                photons.par_iter_mut().for_each(|p| {
                    let radius = radii.media.at(p.position);
                    let radius = radius.min(radii.rate.reach(p.position));
                    let limit = near_lamps.map_or(f32::INFINITY, |near| near.limit(p.position));
                    p.set_radius(radius.min(limit) * scale);
                });
            }
            surface = radii.surfaces.as_ref().map(|radius| SurfaceGather {
                map: SurfaceMap::new(traced.surface),
                radius,
                scale,
            });
        }
        if settings.method == Method::Point {
            return Self {
                tiles: None,
                alone: spheres.map(|radii: &'a Radii<S>| {
                    let radii = (&radii.media, &radii.rate);
                    MediaPhotons::Point(PointMap::new(photons, radii, [scale, steps], settings))
                }),
                surface,
            };
        }
        // Tiles hold what lies before the first surface: nothing where the camera is in clear air.
        let (_, before) = job.world.media_for(&job.world.camera_inside);
        let tiled = !job.plan.lens && !before.is_empty();
        let bands = |photons| Bands::new(photons, &job.world.camera, &job.grid);
        let (tiles, alone) = match (tiled, job.plan.lens || job.plan.follow) {
            (true, true) => (Some(photons.clone().map(bands)), Some(photons)),
            (true, false) => (Some(photons.map(bands)), None),
            (false, _) => (None, Some(photons)),
        };
        Self {
            tiles,
            alone: alone.map(|photons| {
                let draws = || Rng::stream(settings.seed, Stage::Few, pass.into(), 0);
                let draws = job.plan.follow.then(draws);
                let photons = BeamPhotons::new(photons, settings.kernel, draws);
                MediaPhotons::Beam(Box::new(photons))
            }),
            surface,
        }
    }

    /// Bytes that sorting takes in memory, the photons that tiles hold left out.
    pub(super) fn memory_bytes(&self) -> usize {
        let tiles = self.tiles.iter().flatten();
        tiles.map(Bands::memory_bytes).sum::<usize>()
            + self.alone.as_ref().map_or(0, MediaPhotons::memory_bytes)
            + self.surface.as_ref().map_or(0, |s| s.map.memory_bytes())
    }
}

/// One band of eight rows of pixels.
fn gather_band<S: Spectrum, H: Heading>(
    job: &Job<'_, S>,
    gather: &Gather<'_, S, H>,
    band: u32,
    pass: u32,
    rays: &mut TileRays<S, H>,
) -> (Vec<Sample>, Counters) {
    let grid = &job.grid;
    let spp = job.scene.settings.spp;
    let width = grid.high[0] - grid.low[0];
    let rows = (grid.high[1] - grid.low[1] - band * TILE).min(TILE);
    let mut samples = vec![Sample::NOTHING; (width * rows) as usize];
    let mut counters = Counters::default();
    let mut band = Band::new(job, gather, band, pass);
    for column in 0..grid.columns() {
        let sums = band.tile(column, rays, &mut counters);
        for (i, sum) in sums.iter().enumerate() {
            let (x, y) = (column * TILE + i as u32 % TILE, i as u32 / TILE);
            if x < width && y < rows {
                samples[(y * width + x) as usize] = sum.mean(spp);
            }
        }
    }
    (samples, counters)
}

/// A band of eight rows of pixels at work.
pub(super) struct Band<'a, S: Spectrum, H> {
    job: &'a Job<'a, S>,
    gather: &'a Gather<'a, S, H>,
    band: u32,
    pass: u32,
    tiles: Option<[BandTiles; 2]>,
    chain: Option<Chain<'a, S, H>>,
    scratch: Scratch<S>,
    /// Of rays to what lies behind the media.
    beyond: Profile<S>,
}

impl<'a, S: Spectrum, H: Heading> Band<'a, S, H> {
    pub(super) fn new(
        job: &'a Job<'a, S>,
        gather: &'a Gather<'a, S, H>,
        band: u32,
        pass: u32,
    ) -> Self {
        let settings = &job.scene.settings;
        // Other classes in every pass.
        let salt = pass.wrapping_mul(0x9e37_79b9);
        Self {
            job,
            gather,
            band,
            pass,
            tiles: (gather.tiles.as_ref())
                .map(|maps| maps.each_ref().map(|bands| bands.tiles(band, salt))),
            chain: job.world.surfaces.as_ref().map(|surfaces| Chain {
                world: job.world,
                surfaces,
                lights: job.lights,
                media_photons: gather.alone.as_ref(),
                photons: gather.surface.as_ref(),
                march: settings.march,
                direct: job.plan.direct,
                emission: job.plan.emission,
            }),
            scratch: Scratch::default(),
            beyond: Profile::default(),
        }
    }

    /// The rays of one tile: a sum for each of its pixels, row by row.
    pub(super) fn tile(
        &mut self,
        column: u32,
        rays: &mut TileRays<S, H>,
        counters: &mut Counters,
    ) -> [Sum; TILE_RAYS] {
        let (job, gather, band) = (self.job, self.gather, self.band);
        let (grid, settings) = (&job.grid, &job.scene.settings);
        rays.kernel = settings.kernel;
        let width = grid.high[0] - grid.low[0];
        let rows = (grid.high[1] - grid.low[1] - band * TILE).min(TILE);
        let compartment = job.world.compartment(&job.world.camera_inside);
        let mut sum = [Sum::default(); TILE_RAYS];
        for s in 0..settings.spp {
            let mut used = [false; TILE_RAYS];
            let mut photon_sums = [[S::ZERO; TILE_RAYS]; 2];
            for i in 0..TILE_RAYS {
                let (x, y) = (column * TILE + i as u32 % TILE, i as u32 / TILE);
                if x >= width || y >= rows {
                    continue;
                }
                used[i] = true;
                let pixel = [grid.low[0] + x, grid.low[1] + band * TILE + y];
                let index = u64::from(pixel[1]) << 32 | u64::from(pixel[0]);
                let stream = u64::from(self.pass) * u64::from(settings.spp) + u64::from(s);
                let mut sampler =
                    Sampler::new(Rng::stream(settings.seed, Stage::Camera, stream, index));
                let lens =
                    (job.plan.lens).then(|| Rng::stream(settings.seed, Stage::Lens, stream, index));
                let mut lens = Lens(lens);
                let (ray, profile) = (&mut rays.rays[i], &mut rays.profiles[i]);
                let sum = &mut sum[i];
                let first = camera_ray(job, pixel, (ray, profile), sum, &mut lens, &mut sampler);
                rays.walls[i] = first
                    .hit
                    .map_or(Wall::NONE, |hit| Wall::new(ray, &hit, hit.t));
                sum.add(&behind(
                    job,
                    self.chain.as_ref(),
                    pixel,
                    (ray, profile, &first),
                    (&mut lens, &mut self.scratch, &mut self.beyond),
                    &mut sampler,
                ));
                if let (Some(photons), None) = (&gather.alone, &gather.tiles) {
                    let stretch = Stretch {
                        ray: &rays.rays[i],
                        profile: &rays.profiles[i],
                        compartment,
                        walls: [Wall::NONE, rays.walls[i]],
                    };
                    let found = photons.radiance(
                        job.world,
                        (&stretch, 1.0),
                        &mut self.scratch.sphere,
                        &mut sampler,
                    );
                    for (sums, found) in photon_sums.iter_mut().zip(found) {
                        sums[i] += found;
                    }
                }
                *counters += sampler.counters;
            }
            if let Some(tiles) = &self.tiles {
                rays.arrange(&used);
                for (tile, sums) in tiles.iter().zip(&mut photon_sums) {
                    rays.gather(
                        &job.world.media,
                        (job.world.camera.position, compartment),
                        tile.tile(column),
                        sums,
                        counters,
                    );
                }
            }
            for (sum, (first, higher)) in sum
                .iter_mut()
                .zip(photon_sums[0].iter().zip(&photon_sums[1]))
            {
                sum.sample.direct += first.to_rgb();
                sum.sample.indirect += higher.to_rgb();
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The nearest of the lamps that are points decides, a pixel is the least, and without lamps there
    /// is no limit.
    #[test]
    fn radii_are_small_near_lamps() {
        let near = |lamps: &[Vec3]| NearLamps {
            lamps: lamps.to_vec(),
            camera: Vec3::new(0.0, 0.0, 4.0),
            pixel: 0.01,
        };
        assert_eq!(near(&[]).limit(Vec3::ONE), f32::INFINITY);
        let two = near(&[Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0)]);
        for (x, limit) in [
            (1.0, NEAR_LAMP),
            (2.5, 0.5 * NEAR_LAMP),
            (0.0, 0.04),
            (3.0, 0.05),
        ] {
            let found = two.limit(Vec3::new(x, 0.0, 0.0));
            assert!((found - limit).abs() < 1e-6, "{found} at {x}");
        }
    }
}
