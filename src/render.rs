//! Passes over the picture: photons, map, camera rays, film.
//!
//! A beam pass traces fresh photons, gives each its radius, sorts them into tiles and walks the
//! tiles in parallel; passes are independent and their average is consistent, since radii shrink
//! from pass to pass (`photon::radius`). A path pass traces a few paths through every pixel. The
//! streams of random numbers belong to photons and pixels, and every sum has one order: the
//! number of threads changes nothing.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use thiserror::Error;

use crate::effects::EffectPlan;
use crate::estimate::chain::{Chain, Link};
use crate::estimate::direct::DirectLights;
use crate::estimate::kernel::KernelShape;
use crate::estimate::tiles::{Bands, TILE, TILE_RAYS, TileGrid, TileRays};
use crate::estimate::{beam, emission};
use crate::film::{Film, Sample};
use crate::grid::load::load_volumes;
use crate::march::Profile;
use crate::photon::deposit::DepositRate;
use crate::photon::map::PhotonMap;
use crate::photon::radius::{RadiusField, radius_scale};
use crate::photon::surface::{SurfaceGather, SurfaceMap, SurfaceRadius};
use crate::photon::{Energy, Heading, Packed, Photon, Photons, TraceSettings, trace_photons};
use crate::progress::Progress;
use crate::ray::Ray;
use crate::reference::trace_path;
use crate::report::{ImageFigures, PhotonCounts, Report, Times, peak_rss_bytes};
use crate::rng::{Rng, Stage};
use crate::scene::{Method, Scene};
use crate::spectrum::Spectrum;
use crate::surface::{Hit, Surfaces};
use crate::tracking::{Counters, Sampler};
use crate::with_kernel;
use crate::world::{LoadedVolume, World};

/// How to render; changes nothing in the picture.
#[derive(Clone, Copy)]
pub struct Exec<'a> {
    /// Threads; all without it.
    pub threads: Option<usize>,
    /// Who is told.
    pub progress: &'a dyn Progress,
    /// No pass begins that would probably end later than this.
    pub time_limit: Option<Duration>,
    /// Hears of what was cleaned or chosen while loading.
    pub warn: &'a (dyn Fn(&str) + Sync),
    /// Set to stop after the pass in hand.
    pub stop: &'a AtomicBool,
}

impl std::fmt::Debug for Exec<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Exec")
            .field("threads", &self.threads)
            .field("time_limit", &self.time_limit)
            .finish_non_exhaustive()
    }
}

/// A rendered picture.
#[derive(Debug)]
pub struct Rendered {
    /// Pixels.
    pub film: Film,
    /// What was done.
    pub report: Report,
    /// Where the photons' power went, all passes together.
    pub energy: Energy,
    /// Fewer passes than asked for.
    pub stopped_early: bool,
}

/// Why a scene cannot be rendered.
#[derive(Debug, Error)]
pub enum RenderError {
    /// A volume cannot be loaded.
    #[error(transparent)]
    Volume(#[from] crate::grid::load::LoadError),
    /// An object cannot be loaded.
    #[error(transparent)]
    Surface(#[from] crate::surface::SurfaceError),
    /// No thread pool.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// Threads asked for.
        threads: usize,
        /// Why not.
        reason: String,
    },
    /// Something that this version does not render.
    #[error("{0}")]
    Unsupported(String),
}

/// Photons of a pilot estimate that are emitted, at most: twice as many are stored.
const PILOT_EMITTED: u64 = 30_000;
/// Photons that set the rate of deposits.
const FEW: u64 = 2000;
/// Paths through a pixel in one pass of the path tracer.
const PATHS_PER_PASS: u32 = 4;

/// Renders a scene.
///
/// # Errors
/// [`RenderError`]: a volume that cannot be read, or what this version does not render.
pub fn render(scene: &Scene, exec: &Exec<'_>) -> Result<Rendered, RenderError> {
    pool(exec)?.install(|| {
        let start = Instant::now();
        check_supported(scene)?;
        exec.progress.stage("load", None);
        let volumes = load_volumes(scene, exec.warn)?;
        let load = start.elapsed().as_secs_f64();
        let mut rendered = planned(scene, volumes, exec, start)?;
        rendered.report.time_s.load = load;
        Ok(rendered)
    })
}

/// Renders a scene whose volumes, one for each of the scene's in order, are in memory already;
/// their files are not looked at.
///
/// # Errors
/// [`RenderError`]: what this version does not render.
pub fn render_loaded(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
) -> Result<Rendered, RenderError> {
    pool(exec)?.install(|| {
        check_supported(scene)?;
        planned(scene, volumes, exec, Instant::now())
    })
}

/// The threads of a render.
fn pool(exec: &Exec<'_>) -> Result<rayon::ThreadPool, RenderError> {
    let threads = exec.threads.unwrap_or(0);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| RenderError::Threads {
            threads,
            reason: e.to_string(),
        })
}

/// Renders in the form that the effect plan chooses.
fn planned(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    exec: &Exec<'_>,
    start: Instant,
) -> Result<Rendered, RenderError> {
    let plan = EffectPlan::new(scene, &volumes);
    let mut rendered = match (plan.chromatic, plan.headings) {
        (false, false) => run::<f32, ()>(scene, volumes, &plan, exec, start),
        (false, true) => run::<f32, Packed>(scene, volumes, &plan, exec, start),
        (true, false) => run::<glam::Vec3, ()>(scene, volumes, &plan, exec, start),
        (true, true) => run::<glam::Vec3, Packed>(scene, volumes, &plan, exec, start),
    }?;
    exec.progress.finish();
    rendered.report.threads = rayon::current_num_threads();
    rendered.report.effects = plan.effects;
    rendered.report.time_s.total = start.elapsed().as_secs_f64();
    Ok(rendered)
}

/// The effect plan of a scene, without rendering it.
///
/// # Errors
/// [`RenderError`] where a volume cannot be read.
pub fn plan(scene: &Scene, warn: &dyn Fn(&str)) -> Result<EffectPlan, RenderError> {
    check_supported(scene)?;
    let volumes = load_volumes(scene, warn)?;
    Ok(EffectPlan::new(scene, &volumes))
}

/// Refuses, by name, what this version does not render.
fn check_supported(scene: &Scene) -> Result<(), RenderError> {
    if scene
        .lights
        .iter()
        .any(|l| matches!(l, crate::scene::Light::SkyImage { .. }))
    {
        return Err(RenderError::Unsupported(
            "sky light: pictures of the sky are not rendered yet".to_owned(),
        ));
    }
    if scene.settings.method == Method::Point {
        return Err(RenderError::Unsupported(
            "method 'point' is not rendered yet".to_owned(),
        ));
    }
    Ok(())
}

/// What the passes share.
struct Job<'a, S> {
    scene: &'a Scene,
    world: World<S>,
    plan: &'a EffectPlan,
    exec: &'a Exec<'a>,
    grid: TileGrid,
    lights: DirectLights,
}

/// What has been done so far.
#[derive(Default)]
struct Tally {
    times: Times,
    photons: PhotonCounts,
    counters: Counters,
    energy: Energy,
}

/// Renders in one specialised form.
fn run<S: Spectrum, H: Heading>(
    scene: &Scene,
    volumes: Vec<LoadedVolume>,
    plan: &EffectPlan,
    exec: &Exec<'_>,
    start: Instant,
) -> Result<Rendered, RenderError> {
    let settings = &scene.settings;
    let [width, height] = scene.camera.resolution;
    let [x0, y0, x1, y1] = settings.crop.unwrap_or([0, 0, width, height]);
    let mut tally = Tally::default();
    let clock = Instant::now();
    let world = World::new(scene, volumes)?;
    for warning in world.surfaces.iter().flat_map(Surfaces::warnings) {
        (exec.warn)(&warning.to_string());
    }
    tally.times.build = clock.elapsed().as_secs_f64();
    let lights = DirectLights::new(&world);
    let grid = TileGrid {
        low: [x0, y0],
        high: [x1, y1],
    };
    let job = Job {
        scene,
        world,
        plan,
        exec,
        grid,
        lights,
    };
    let mut film = Film::new(width, height, settings.crop);

    let radii = if plan.photons {
        Some(pilot::<S, H>(&job, &mut tally))
    } else {
        None
    };
    let passes = match settings.method {
        Method::Path => settings.spp.div_ceil(PATHS_PER_PASS),
        Method::Beam | Method::Point => settings.passes,
    };
    let first_pass = Instant::now();
    let mut pass = 0;
    let stopped_early = loop {
        if pass > 0 && exec.stop.load(Ordering::Relaxed) {
            break pass < passes;
        }
        match exec.time_limit {
            None if pass == passes => break false,
            Some(limit) if pass > 0 => {
                let each = first_pass.elapsed() / pass;
                if start.elapsed() + each > limit {
                    break false;
                }
            }
            _ => {}
        }
        let samples = match (&radii, settings.method) {
            (_, Method::Path) => path_pass(&job, pass, &mut tally),
            (radii, _) => {
                with_kernel!(settings.kernel, K => beam_pass::<S, H, K>(&job, radii.as_ref(), pass, &mut tally))
            }
        };
        film.add_pass(&samples);
        pass += 1;
    };

    let counters = tally.counters;
    let report = Report {
        scene: scene.name.clone(),
        method: match settings.method {
            Method::Beam => "beam",
            Method::Point => "point",
            Method::Path => "path",
        }
        .to_owned(),
        resolution: scene.camera.resolution,
        seed: settings.seed,
        passes: film.passes(),
        time_s: tally.times,
        peak_rss_bytes: peak_rss_bytes(),
        photons: tally.photons,
        counters: crate::report::Counters {
            free_flights: counters.free_flights,
            transmittance_rays: counters.transmittance_rays,
            density_lookups: counters.density_lookups,
            gathered_photons: counters.gathered_photons,
        },
        image: ImageFigures::from(&film),
        ..Report::default()
    };
    Ok(Rendered {
        film,
        report,
        energy: tally.energy,
        stopped_early,
    })
}

/// Radii from the pilots: of photons in media, and of points on surfaces.
struct Radii<S> {
    rate: DepositRate,
    media: RadiusField,
    surfaces: Option<SurfaceRadius<S>>,
}

/// Radii from a pilot estimate.
fn pilot<S: Spectrum, H: Heading>(job: &Job<'_, S>, tally: &mut Tally) -> Radii<S> {
    let clock = Instant::now();
    job.exec.progress.stage("pilot", None);
    let settings = &job.scene.settings;
    let rate = DepositRate::new(&job.world.media, &job.world.parts);
    let mut trace = TraceSettings {
        rate: &rate,
        emit: FEW.min(settings.photons),
        seed: settings.seed,
        stage: Stage::Pilot,
        pass: 0,
        direct: settings.direct,
        surface_photons: job.plan.surface_photons,
    };
    let few = trace_photons::<S, H>(&job.world, &trace);
    let deposits = few.first.len() + few.higher.len();
    let mut rate = rate.clone();
    rate.settle(deposits as f64 / trace.emit as f64);
    trace.rate = &rate;
    trace.emit = PILOT_EMITTED.clamp(1, settings.photons);
    let Photons {
        first,
        higher,
        surface,
        counters,
        ..
    } = trace_photons::<S, H>(&job.world, &trace);
    tally.counters += few.counters;
    tally.counters += counters;
    let positions = first.iter().chain(&higher).map(|p| p.position).collect();
    let ratio = settings.photons as f32 / trace.emit as f32;
    let widest = job.world.parts.iter().map(|p| p.reach).fold(0.0, f32::max);
    let limits = [(1e-5 * job.world.bounds.radius()).min(widest), widest];
    let field = RadiusField::new(positions, settings.neighbours as f32, ratio, limits);
    let surfaces = job.plan.surface_photons.then(|| {
        let extent = job.world.target.radius();
        let limits = [1e-5 * extent, 0.1 * extent];
        SurfaceRadius::new(surface, settings.neighbours as f32, ratio, limits)
    });
    tally.times.map += clock.elapsed().as_secs_f64();
    Radii {
        rate,
        media: field,
        surfaces,
    }
}

/// One pass of the beam estimate.
fn beam_pass<S: Spectrum, H: Heading, K: KernelShape>(
    job: &Job<'_, S>,
    radii: Option<&Radii<S>>,
    pass: u32,
    tally: &mut Tally,
) -> Vec<Sample> {
    let settings = &job.scene.settings;
    let mut photons = [Vec::new(), Vec::new()];
    let mut on_surfaces = None;
    if let Some(radii) = radii {
        let clock = Instant::now();
        job.exec.progress.stage("photons", None);
        let trace = TraceSettings {
            rate: &radii.rate,
            emit: settings.photons,
            seed: settings.seed,
            stage: Stage::Photon,
            pass: pass.into(),
            direct: settings.direct,
            surface_photons: job.plan.surface_photons,
        };
        let traced = trace_photons::<S, H>(&job.world, &trace);
        tally.photons.emitted += traced.emitted;
        tally.photons.stored += traced.stored() as u64;
        tally.counters += traced.counters;
        tally.energy += traced.energy;
        tally.times.photons += clock.elapsed().as_secs_f64();

        let clock = Instant::now();
        let scale = radius_scale(pass, 2);
        photons = [traced.first, traced.higher];
        on_surfaces = radii.surfaces.as_ref().map(|radius| SurfaceGather {
            map: SurfaceMap::new(traced.surface),
            radius,
            scale,
        });
        for photon in &mut photons {
            photon.par_iter_mut().for_each(|p| {
                let radius = radii.media.at(p.position);
                p.radius = radius.min(radii.rate.reach(p.position)) * scale;
            });
        }
        tally.times.map += clock.elapsed().as_secs_f64();
    }
    let clock = Instant::now();
    let pinhole = job.world.camera.is_pinhole();
    let maps = (!pinhole || job.plan.follow).then(|| photons.clone().map(PhotonMap::new));
    let tiles = pinhole.then(|| {
        photons.map(|photons| {
            let bands = Bands::new(&photons, &job.world.camera, &job.grid);
            (photons, bands)
        })
    });
    let gather = Gather {
        tiles,
        maps,
        surface: on_surfaces,
    };
    tally.times.map += clock.elapsed().as_secs_f64();

    let clock = Instant::now();
    let height = u64::from(job.grid.high[1] - job.grid.low[1]);
    job.exec
        .progress
        .stage(&format!("pass {}", pass + 1), Some(height));
    let bands: Vec<(Vec<Sample>, Counters)> = (0..job.grid.bands())
        .into_par_iter()
        .map_init(TileRays::default, |rays, band| {
            let out = beam_band::<S, H, K>(job, &gather, band, pass, rays);
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

/// Photons, and the bands of the picture that they fall into.
type Banded<S, H> = (Vec<Photon<S, H>>, Bands);

/// The photons of a pass, those in media of first order and of higher ones.
struct Gather<'a, S, H> {
    /// For camera rays from one point, in tiles.
    tiles: Option<[Banded<S, H>; 2]>,
    /// For rays from anywhere, one by one: with a lens, and beyond mirrors and lenses.
    maps: Option<[PhotonMap<S, H>; 2]>,
    /// On surfaces.
    surface: Option<SurfaceGather<'a, S>>,
}

/// One band of eight rows of pixels.
fn beam_band<S: Spectrum, H: Heading, K: KernelShape>(
    job: &Job<'_, S>,
    gather: &Gather<'_, S, H>,
    band: u32,
    pass: u32,
    rays: &mut TileRays<S, H>,
) -> (Vec<Sample>, Counters) {
    let grid = &job.grid;
    rays.salt = pass.wrapping_mul(0x9e37_79b9);
    let spp = job.scene.settings.spp;
    let width = grid.high[0] - grid.low[0];
    let rows = (grid.high[1] - grid.low[1] - band * TILE).min(TILE);
    let mut samples = vec![Sample::NOTHING; (width * rows) as usize];
    let mut counters = Counters::default();
    let tiles = gather
        .tiles
        .as_ref()
        .map(|maps| maps.each_ref().map(|(_, bands)| bands.tiles(band, grid)));
    let chain = job.world.surfaces.as_ref().map(|surfaces| Chain {
        world: &job.world,
        surfaces,
        lights: &job.lights,
        maps: gather.maps.as_ref(),
        photons: gather.surface.as_ref(),
        march: job.scene.settings.march,
        direct: job.plan.direct,
        emission: job.plan.emission,
    });
    let mut scratch = Profile::default();
    let compartment = job.world.compartment(&job.world.camera_inside);
    for column in 0..grid.columns() {
        let mut sum = [Sum::default(); TILE_RAYS];
        for s in 0..spp {
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
                let stream = u64::from(pass) * u64::from(spp) + u64::from(s);
                let mut sampler = Sampler::new(Rng::stream(
                    job.scene.settings.seed,
                    Stage::Camera,
                    stream,
                    index,
                ));
                let (ray, profile) = (&mut rays.rays[i], &mut rays.profiles[i]);
                let hit = camera_ray(job, pixel, ray, profile, &mut sum[i], &mut sampler);
                if let (Some(chain), Some(hit)) = (&chain, hit) {
                    let tr = rays.profiles[i].transmittance;
                    let link = Link::first(&job.world, &rays.rays[i], hit, tr);
                    chain
                        .follow::<K>(link, &mut scratch, &mut sampler)
                        .add_to(&mut sum[i].sample);
                }
                if let (Some(maps), None) = (&gather.maps, &gather.tiles) {
                    for (map, photons) in maps.iter().zip(&mut photon_sums) {
                        photons[i] += beam::radiance::<S, H, K>(
                            &job.world.media,
                            map,
                            &rays.profiles[i],
                            &rays.rays[i],
                            compartment,
                            &mut sampler.counters,
                        );
                    }
                }
                counters += sampler.counters;
            }
            if let (Some(maps), Some(tiles)) = (&gather.tiles, &tiles) {
                rays.arrange(&used);
                for ((photons, _), (tile, sums)) in
                    maps.iter().zip(tiles.iter().zip(&mut photon_sums))
                {
                    rays.gather::<K>(
                        &job.world.media,
                        (job.world.camera.position, compartment),
                        photons,
                        tile.tile(column),
                        sums,
                        &mut counters,
                    );
                }
            }
            for i in 0..TILE_RAYS {
                sum[i].sample.direct += photon_sums[0][i].to_rgb();
                sum[i].sample.indirect += photon_sums[1][i].to_rgb();
            }
        }
        for (i, sum) in sum.iter().enumerate() {
            let (x, y) = (column * TILE + i as u32 % TILE, i as u32 / TILE);
            if x < width && y < rows {
                samples[(y * width + x) as usize] = sum.mean(spp);
            }
        }
    }
    (samples, counters)
}

/// Sum of the camera rays of a pixel in a pass.
#[derive(Debug, Clone, Copy)]
struct Sum {
    sample: Sample,
    /// Rays that met something.
    met: u32,
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
    fn mean(&self, rays: u32) -> Sample {
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
/// emission, first order. Returns the surface that it meets.
fn camera_ray<S: Spectrum>(
    job: &Job<'_, S>,
    pixel: [u32; 2],
    ray: &mut Ray,
    profile: &mut Profile<S>,
    sum: &mut Sum,
    sampler: &mut Sampler,
) -> Option<Hit> {
    let world = &job.world;
    let [jx, jy] = sampler.uniform2();
    let lens = if world.camera.is_pinhole() {
        [0.0; 2]
    } else {
        sampler.uniform2()
    };
    *ray = world
        .camera
        .ray([pixel[0] as f32 + jx, pixel[1] as f32 + jy], lens);
    let hit = world
        .surfaces
        .as_ref()
        .and_then(|s| s.intersect(ray.origin, ray.direction, f32::INFINITY));
    let t_hit = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
    let light = world.seen_light(ray, t_hit);
    let hit = if light.is_some() { None } else { hit };
    let t_max = light.map_or(t_hit, |(t, _)| t);
    profile.march(
        world.media_for(&world.camera_inside),
        ray,
        t_max,
        job.scene.settings.march,
        &mut sampler.counters,
    );
    let behind = match (&hit, light) {
        (Some(_), _) => S::ZERO,
        (None, Some((_, l))) => l,
        (None, None) => world.background(ray.direction),
    };
    let mut l = profile.transmittance * behind;
    if job.plan.emission {
        l += emission::radiance(world, ray, profile, &mut sampler.counters);
    }
    sum.sample.emission += l.to_rgb();
    if job.plan.direct {
        sum.sample.direct += job
            .lights
            .radiance(world, ray, &world.camera_inside, profile, sampler)
            .to_rgb();
    }
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

/// One pass of the path tracer.
fn path_pass<S: Spectrum>(job: &Job<'_, S>, pass: u32, tally: &mut Tally) -> Vec<Sample> {
    let clock = Instant::now();
    let ([x0, y0], [x1, y1]) = (job.grid.low, job.grid.high);
    job.exec
        .progress
        .stage(&format!("pass {}", pass + 1), Some(u64::from(y1 - y0)));
    let rows: Vec<(Vec<Sample>, Counters)> = (y0..y1)
        .into_par_iter()
        .map(|y| {
            let mut counters = Counters::default();
            let row = (x0..x1)
                .map(|x| {
                    let index = u64::from(y) << 32 | u64::from(x);
                    let mut sampler = Sampler::new(Rng::stream(
                        job.scene.settings.seed,
                        Stage::Path,
                        pass.into(),
                        index,
                    ));
                    let mut sum = Sum::default();
                    for _ in 0..PATHS_PER_PASS {
                        let [jx, jy] = sampler.uniform2();
                        let lens = if job.world.camera.is_pinhole() {
                            [0.0; 2]
                        } else {
                            sampler.uniform2()
                        };
                        let ray = job.world.camera.ray([x as f32 + jx, y as f32 + jy], lens);
                        let path = trace_path(&job.world, ray, &mut sampler);
                        sum.sample.direct += path.direct;
                        sum.sample.indirect += path.indirect;
                        sum.sample.emission += path.emission;
                        sum.sample.alpha += path.alpha;
                        if path.depth.is_finite() {
                            sum.sample.depth += path.depth;
                            sum.met += 1;
                        }
                    }
                    counters += sampler.counters;
                    sum.mean(PATHS_PER_PASS)
                })
                .collect();
            job.exec.progress.advance(1);
            (row, counters)
        })
        .collect();
    let mut samples = Vec::with_capacity(rows.len() * (x1 - x0) as usize);
    for (row, counters) in rows {
        samples.extend(row);
        tally.counters += counters;
    }
    tally.times.gather += clock.elapsed().as_secs_f64();
    samples
}
