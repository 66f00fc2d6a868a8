//! Gathering the photons of camera rays, on one thread, variants side by side.
//!
//! ```text
//! cargo bench --bench gather                      # 1 M photons
//! cargo bench --bench gather -- 0.25 1 4          # millions of photons
//! ```
//!
//! | column | what |
//! |---|---|
//! | `walk` | obvhs `CwBvh` any-hit walk of each ray (`photon::map`) |
//! | `cells` | photons listed in the cells of a grid that their spheres touch; a ray walks cells |
//! | `tiles` | 8 x 8 rays at a time (`estimate::tiles`), the default for camera rays |
//! | `re-march` | as `walk`, but the transmittance to each photon is marched anew, as Tungsten does |
//!
//! Radii are those of the pilot estimate times a factor that makes the mean ray through the medium
//! pierce 300 or 1800 photons. Times are of a pass over the rays of a sample of tiles, profiles
//! marched beforehand (their time is the column `march`), sorting and building on its own. Every
//! variant's sum over all rays has to be that of `walk`; of tiles, which play roulette with deep
//! photons, within its noise.

use std::path::Path;
use std::time::Instant;

use glam::{UVec3, Vec3};
use vpm_vdb::effects::EffectPlan;
use vpm_vdb::estimate::bands::{Bands, TILE, TILE_RAYS, TileGrid};
use vpm_vdb::estimate::beam::{self, Stretch};
use vpm_vdb::estimate::kernel::Kernel;
use vpm_vdb::estimate::tiles::TileRays;
use vpm_vdb::estimate::wall::Wall;
use vpm_vdb::grid::load::load_volumes;
use vpm_vdb::march::{Profile, transmittance};
use vpm_vdb::photon::deposit::DepositRate;
use vpm_vdb::photon::map::PhotonMap;
use vpm_vdb::photon::radius::RadiusField;
use vpm_vdb::photon::{Heading, Packed, Photon, TraceSettings, trace_photons};
use vpm_vdb::ray::Ray;
use vpm_vdb::rng::{Rng, Stage};
use vpm_vdb::scene::{Direct, March, Scene};
use vpm_vdb::spectrum::Spectrum;
use vpm_vdb::tracking::{Counters, Sampler};
use vpm_vdb::world::World;

/// Tiles of a picture that are gathered.
const TILES: usize = 48;
/// Rays whose transmittances are marched anew.
const REMARCHED: usize = 24;
/// Repetitions; the least time counts.
const ROUNDS: usize = 3;

fn main() {
    let mut millions: Vec<f64> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    if millions.is_empty() {
        millions.push(1.0);
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()
        .expect("a pool of one thread");
    println!(
        "{:<13} {:>8} {:>6} {:>6} | {:>7} {:>7} {:>7} | {:>8} {:>8} {:>8} {:>8} | {:>9} {:>9} | {:>7}",
        "scene",
        "photons",
        "/ray",
        "B/ph",
        "bvh s",
        "cells s",
        "bands s",
        "march",
        "walk",
        "cells",
        "tiles",
        "walk/til",
        "cell/til",
        "re/prof"
    );
    println!("{:>62} {:>35}", "", "us a ray");
    for name in ["rising_smoke", "cloud"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.toml"));
        let scene = Scene::load(&file).expect("a scene of the repository");
        let volumes = load_volumes(&scene, &|_| ()).expect("its volumes");
        let plan = EffectPlan::new(&scene, &volumes);
        for m in &millions {
            let volumes = load_volumes(&scene, &|_| ()).expect("its volumes");
            let photons = (m * 1e6) as usize;
            match (plan.chromatic, plan.headings) {
                (false, false) => bench::<f32, ()>(&scene, volumes, photons),
                (false, true) => bench::<f32, Packed>(&scene, volumes, photons),
                (true, false) => bench::<Vec3, ()>(&scene, volumes, photons),
                (true, true) => bench::<Vec3, Packed>(&scene, volumes, photons),
            }
        }
    }
}

/// Seconds of the fastest of some rounds, and the last result.
fn timed<T>(rounds: usize, mut run: impl FnMut() -> T) -> (f64, T) {
    let mut once = || {
        let clock = Instant::now();
        let out = run();
        (clock.elapsed().as_secs_f64(), out)
    };
    let mut best = once();
    for _ in 1..rounds {
        let next = once();
        best = (best.0.min(next.0), next.1);
    }
    best
}

/// Exactly `wanted` photons of the scene, with radii of the pilot.
fn photons<S: Spectrum, H: Heading>(world: &World<S>, wanted: usize) -> Vec<Photon<S, H>> {
    let mut rate = DepositRate::new(&world.media, &world.parts);
    let trace = |rate: &DepositRate, emit: u64, pass: u64| {
        trace_photons::<S, H>(
            world,
            &TraceSettings {
                rate,
                emit,
                seed: 1,
                stage: Stage::Check,
                pass,
                direct: Direct::Sampled,
                surface_photons: false,
            },
        )
    };
    let few = trace(&rate, 2000, 0);
    let per_path = |count: usize| count as f64 / 2000.0;
    let flights = few.counters.free_flights as usize;
    rate.settle(
        per_path(few.first.len() + few.higher.len()),
        per_path(flights),
    );
    let mut all = Vec::new();
    let mut pass = 1;
    while all.len() < wanted {
        let some = trace(&rate, 200_000, pass);
        all.extend(some.first);
        all.extend(some.higher);
        pass += 1;
    }
    // Deposits of a pass are in the order of their orders: a share of each.
    let mut random = Rng::stream(2, Stage::Check, 0, 0);
    for i in 0..wanted {
        let j = i + random.below((all.len() - i) as u32) as usize;
        all.swap(i, j);
    }
    all.truncate(wanted);
    let pilots = all.iter().take(60_000).map(|p| p.position).collect();
    let ratio = wanted as f32 / 60_000.0;
    let radii = RadiusField::new(pilots, 50.0, ratio, [0.0, f32::MAX]);
    for photon in &mut all {
        photon.set_radius(radii.at(photon.position).min(rate.reach(photon.position)));
    }
    all
}

/// A ray of the sample.
struct Sampled<S> {
    ray: Ray,
    profile: Profile<S>,
}

fn bench<S: Spectrum, H: Heading>(
    scene: &Scene,
    volumes: Vec<vpm_vdb::world::LoadedVolume>,
    wanted: usize,
) {
    let world = World::<S>::new(scene, volumes).expect("its objects");
    let grid = TileGrid {
        low: [0, 0],
        high: scene.camera.resolution,
    };
    let mut all = photons::<S, H>(&world, wanted);
    // Tiles spread over the picture whose rays meet the medium.
    let columns = grid.columns() as u64;
    let count = columns * u64::from(grid.bands());
    let mut random = Rng::stream(3, Stage::Check, 0, 0);
    let mut tiles: Vec<(u32, u32, Vec<Sampled<S>>)> = Vec::new();
    let mut march_time = 0.0;
    let mut k = 0u64;
    while tiles.len() < TILES && k < count {
        let at = (k.wrapping_mul(0x9e37_79b9) ^ 0x5bd1) % count;
        k += 1;
        let (band, column) = ((at / columns) as u32, (at % columns) as u32);
        let clock = Instant::now();
        let rays: Vec<Sampled<S>> = (0..TILE * TILE)
            .map(|i| {
                let x = (column * TILE + i % TILE) as f32 + random.uniform();
                let y = (band * TILE + i / TILE) as f32 + random.uniform();
                let ray = world.camera.ray([x, y], [0.0; 2]);
                let mut profile = Profile::default();
                let media = (0, &world.media[..]);
                let counters = &mut Counters::default();
                profile.march(media, &ray, f32::INFINITY, March::Exact, counters);
                Sampled { ray, profile }
            })
            .collect();
        if rays.iter().all(|r| !r.profile.is_clear()) {
            march_time += clock.elapsed().as_secs_f64();
            tiles.push((band, column, rays));
        }
    }
    let rays = (tiles.len() * TILE_RAYS) as f64;
    let each = || tiles.iter().flat_map(|t| &t.2);
    let walk = |map: &PhotonMap<S, H>| {
        let mut counters = Counters::default();
        let sum = each().fold(S::ZERO, |sum, r| {
            sum + beam::radiance(
                Kernel::Biweight,
                &world.media,
                map,
                &Stretch {
                    ray: &r.ray,
                    profile: &r.profile,
                    compartment: 0,
                    walls: [Wall::NONE; 2],
                },
                &mut counters,
            )
        });
        (sum.mean(), counters.gathered_photons)
    };
    // Photons pierced grow as the square of the radius.
    let (_, met) = walk(&PhotonMap::new(all.clone()));
    let mut density = met as f64 / rays;
    for per_ray in [300.0, 1800.0] {
        let scale = (per_ray / density).sqrt() as f32;
        density = per_ray;
        all.iter_mut()
            .for_each(|p| p.set_radius(p.radius() * scale));
        let (bvh_time, map) = timed(1, || PhotonMap::new(all.clone()));
        let (cells_time, cells) = timed(1, || Cells::new(&all));
        let (bands_time, bands) = timed(1, || Bands::new(all.clone(), &world.camera, &grid));
        let (walk_time, (walk_sum, met)) = timed(ROUNDS, || walk(&map));
        let (cell_time, cell_sum) = timed(ROUNDS, || {
            let sum = each().fold(S::ZERO, |sum, r| {
                // Of a ray first: a million terms would drown in one f32.
                let mut one = S::ZERO;
                cells.along(&all, &r.ray, r.profile.t_end, |photon, t, d2| {
                    let kernel = Kernel::Biweight;
                    let media = &world.media;
                    one += beam::contribution(kernel, media, &r.profile, &r.ray, photon, t, d2);
                });
                sum + one
            });
            sum.mean()
        });
        let mut counters = Counters::default();
        // The renderer marches its rays into place.
        let mut placed: Vec<TileRays<S, H>> = tiles
            .iter()
            .map(|(.., sampled)| {
                let mut rays = TileRays::default();
                for (i, r) in sampled.iter().enumerate() {
                    rays.rays[i] = r.ray;
                    rays.profiles[i].clone_from(&r.profile);
                }
                rays
            })
            .collect();
        // What sorting a band's photons into its tiles takes is shared by the band's columns.
        let (list_time, lists) = timed(ROUNDS, || {
            let bands = tiles.iter().map(|(band, ..)| bands.tiles(*band, 0));
            bands.collect::<Vec<_>>()
        });
        let (tile_time, tile_sum) = timed(ROUNDS, || {
            let tiles = tiles.iter().zip(&lists).zip(&mut placed);
            tiles.fold(0.0f32, |sum, (((_, column, _), lists), rays)| {
                rays.arrange(&[true; TILE_RAYS]);
                let mut sums = [S::ZERO; TILE_RAYS];
                let (camera, list) = ((world.camera.position, 0), lists.tile(*column));
                rays.gather(&world.media, camera, list, &mut sums, &mut counters);
                sum + sums.iter().fold(0.0, |s, v| s + v.mean())
            })
        });
        let tile_time = tile_time + list_time / columns as f64;
        let few: Vec<_> = each().step_by(rays as usize / REMARCHED).collect();
        let mut sampler = Sampler::new(Rng::stream(4, Stage::Check, 0, 0));
        let (again_time, _) = timed(1, || {
            few.iter().fold(0.0, |mut sum, r| {
                map.along(&r.ray, 0.0, r.profile.t_end, |_, t, _| {
                    sum += transmittance(&world.media, &r.ray, t, &mut sampler).mean();
                });
                sum
            })
        });
        // So short that whatever else the machine does would show.
        let (profile_time, _) = timed(3 * ROUNDS, || {
            few.iter().fold(0.0, |mut sum, r| {
                let mut profile = Profile::default();
                let media = (0, &world.media[..]);
                let counters = &mut Counters::default();
                profile.march(media, &r.ray, f32::INFINITY, March::Exact, counters);
                map.along(&r.ray, 0.0, profile.t_end, |_, t, _| {
                    sum += profile.transmittance(t).mean();
                });
                sum
            })
        });
        let off = |sum: f32| f64::from(sum / walk_sum - 1.0).abs();
        assert!(off(cell_sum) < 1e-4, "cells: {cell_sum}, walk {walk_sum}");
        assert!(off(tile_sum) < 0.05, "tiles: {tile_sum}, walk {walk_sum}");
        let us = |seconds: f64| 1e6 * seconds / rays;
        let bytes = size_of::<Photon<S, H>>() as f64 + bands.memory_bytes() as f64 / wanted as f64;
        println!(
            "{:<13} {wanted:>8} {:>6.0} {bytes:>6.1} | {bvh_time:>7.2} {cells_time:>7.2} {bands_time:>7.2} | {:>8.1} {:>8.1} {:>8.1} {:>8.1} | {:>9.2} {:>9.2} | {:>7.1}",
            scene.name,
            met as f64 / rays,
            us(march_time),
            us(walk_time),
            us(cell_time),
            us(tile_time),
            walk_time / tile_time,
            cell_time / tile_time,
            again_time / profile_time,
        );
    }
}

/// Cells along the longest edge of the photons' box.
const CELLS: f32 = 128.0;

/// Photons in the cells that the boxes of their spheres touch. The point of a ray nearest to a
/// photon that it pierces lies in its sphere, hence in one of its cells: counted there, once.
struct Cells {
    low: Vec3,
    edge: f32,
    dims: UVec3,
    start: Vec<u32>,
    entries: Vec<u32>,
}

impl Cells {
    fn new<S: Spectrum, H: Heading>(photons: &[Photon<S, H>]) -> Self {
        let radius = |p: &Photon<S, H>| Vec3::splat(p.radius());
        let (low, high) = photons
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), p| {
                (a.min(p.position - radius(p)), b.max(p.position + radius(p)))
            });
        let edge = (high - low).max_element() / CELLS;
        let dims = ((high - low) / edge).as_uvec3() + UVec3::ONE;
        let mut this = Self {
            low,
            edge,
            dims,
            start: vec![0; (dims.x * dims.y * dims.z) as usize + 1],
            entries: Vec::new(),
        };
        let visit = |this: &Self, p: &Photon<S, H>, mut then: Box<dyn FnMut(usize) + '_>| {
            let (a, b) = (
                this.cell(p.position - radius(p)),
                this.cell(p.position + radius(p)),
            );
            for x in a.x..=b.x {
                for y in a.y..=b.y {
                    for z in a.z..=b.z {
                        then(this.index(UVec3::new(x, y, z)));
                    }
                }
            }
        };
        let mut start = std::mem::take(&mut this.start);
        for p in photons {
            visit(&this, p, Box::new(|cell| start[cell + 1] += 1));
        }
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut next = start.clone();
        let mut entries = vec![0; start[start.len() - 1] as usize];
        for (i, p) in (0..).zip(photons) {
            visit(
                &this,
                p,
                Box::new(|cell| {
                    entries[next[cell] as usize] = i;
                    next[cell] += 1;
                }),
            );
        }
        this.start = start;
        this.entries = entries;
        this
    }

    fn cell(&self, p: Vec3) -> UVec3 {
        let q = ((p - self.low) / self.edge).max(Vec3::ZERO).as_uvec3();
        q.min(self.dims - UVec3::ONE)
    }

    fn index(&self, c: UVec3) -> usize {
        ((c.x * self.dims.y + c.y) * self.dims.z + c.z) as usize
    }

    fn along<S: Spectrum, H: Heading>(
        &self,
        photons: &[Photon<S, H>],
        ray: &Ray,
        t_end: f32,
        mut visit: impl FnMut(&Photon<S, H>, f32, f32),
    ) {
        let bounds = vpm_vdb::ray::Bounds {
            min: self.low,
            max: self.low + self.dims.as_vec3() * self.edge,
        };
        let Some((mut t, end)) = bounds.clip(ray, 0.0, t_end) else {
            return;
        };
        let mut cell = self.cell(ray.at(t)).as_ivec3();
        let inverse = ray.direction.recip();
        loop {
            let faces = (cell.as_vec3() + inverse.cmpgt(Vec3::ZERO).select_ones()) * self.edge;
            let exits = (faces + self.low - ray.origin) * inverse;
            let axis = exits.min_position();
            let out = exits[axis].clamp(t, end);
            let here = self.index(cell.as_uvec3());
            for i in &self.entries[self.start[here] as usize..self.start[here + 1] as usize] {
                let photon = &photons[*i as usize];
                let to = photon.position - ray.origin;
                let nearest = to.dot(ray.direction);
                let d2 = (to - ray.direction * nearest).length_squared();
                if nearest >= t && nearest < out && d2 < photon.radius() * photon.radius() {
                    visit(photon, nearest, d2);
                }
            }
            t = out;
            cell[axis] += if inverse[axis] > 0.0 { 1 } else { -1 };
            if t >= end || cell[axis] < 0 || cell[axis] >= self.dims[axis] as i32 {
                return;
            }
        }
    }
}

/// 1 where a mask is set, 0 elsewhere.
trait SelectOnes {
    fn select_ones(self) -> Vec3;
}

impl SelectOnes for glam::BVec3 {
    fn select_ones(self) -> Vec3 {
        Vec3::select(self, Vec3::ONE, Vec3::ZERO)
    }
}
