//! Photons that density estimates do not like, gathered by every road and by f64.
//!
//! ```text
//! L = sum over photons   T(t) sigma_s p P K(d, r)      fog of constant extinction, p = 1 / 4 pi
//! ```
//!
//! A photon's distance from the ray is known to delta = eps |v|, v from the camera to the
//! photon; its kernel, whose slope is at most 1.6 heights over a radius, to 1.6 delta / r of its
//! height. Figures are in units of that and of 1e-5 of the heights. A distance computed as
//! |v|^2 - t^2 would be off by eps |v|^2 instead, thousands of times more.
//!
//! Radii come from a pilot estimate: finite and within their limits for any pilots. Their schedule
//! over the passes follows gamma functions (Knaus & Zwicker 2011),
//!
//! ```text
//! r_N^d / r_0^d = prod (j - 1 + alpha) / j = Gamma(N + alpha) / (Gamma(alpha) Gamma(N + 1))
//! ```

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::fields::{render, rng, scene, unit};
use super::{SelftestError, Suite, Worst, furnace};
use crate::estimate::bands::{Bands, TILE_RAYS, TileGrid};
use crate::estimate::beam;
use crate::estimate::kernel::Kernel;
use crate::estimate::tiles::TileRays;
use crate::march::Profile;
use crate::photon::Photon;
use crate::photon::map::PhotonMap;
use crate::photon::radius::{RadiusField, radius_scale};
use crate::ray::Ray;
use crate::render::RenderError;
use crate::rng::Rng;
use crate::scene::{Fog, March, Optics, Phase, Rgb, Scene};
use crate::stats::{Welford, ln_gamma, t_bound};
use crate::tracking::Counters;
use crate::world::World;

/// Extinction of the fog. Thinner than the depth at which tiles play roulette. \[1/m\]
const SIGMA: f64 = 0.2;

pub(super) type Plain = Photon<f32, ()>;

/// Photons, and a camera before them.
struct Case {
    name: &'static str,
    photons: Vec<Plain>,
    /// Distance of the camera from the middle of the fog, whose edge is 2. \[m\]
    distance: f64,
    /// Where rays end, as at a surface. \[m\]
    t_max: f32,
}

pub(super) fn photon(position: Vec3, radius: f32, power: f32) -> Plain {
    let mut photon = Photon::new(position, power, ());
    photon.set_radius(radius);
    photon
}

/// Uniform in the fog.
fn anywhere(random: &mut Rng) -> Vec3 {
    2.0 * unit(random) - 1.0
}

fn cases() -> Vec<Case> {
    let mut random = rng(80);
    let mut many = |n: usize, make: &dyn Fn(Vec3, f32) -> Plain| -> Vec<Plain> {
        (0..n)
            .map(|_| make(anywhere(&mut random), random.uniform()))
            .collect()
    };
    let usual = many(400, &|p, u| photon(p, 0.1 + 0.2 * u, 1.0));
    let case = |name, photons, distance| Case {
        name,
        photons,
        distance,
        t_max: f32::INFINITY,
    };
    vec![
        case("none", Vec::new(), 4.0),
        case("one", vec![photon(Vec3::splat(0.1), 0.3, 1.0)], 4.0),
        case(
            "all at one point",
            vec![photon(Vec3::splat(0.1), 0.3, 1.0); 500],
            4.0,
        ),
        case(
            "powers over 1e12",
            many(400, &|p, u| photon(p, 0.3, 10f32.powf(12.0 * u - 6.0))),
            4.0,
        ),
        case(
            "radii larger than the scene",
            many(100, &|p, _| photon(p, 1e4, 1.0)),
            4.0,
        ),
        case(
            "radii smaller than f32 resolves",
            many(400, &|p, u| photon(p, 10f32.powf(-8.0 - 30.0 * u), 1.0)),
            4.0,
        ),
        case("camera in the medium and in spheres", usual.clone(), 0.3),
        case("camera 1e4 m away", usual.clone(), 1e4),
        case(
            "camera 1e6 m away",
            many(400, &|p, u| photon(p, 0.5 + 0.2 * u, 1.0)),
            1e6,
        ),
        Case {
            name: "rays that end before half of the photons",
            photons: usual,
            distance: 4.0,
            t_max: 4.0,
        },
    ]
}

/// Fog in a cube of edge 2, that fills the picture.
fn fog(distance: f64) -> Scene {
    let mut scene = scene(distance, [8, 8]);
    let width = if distance > 1.0 { 1.0 / distance } else { 1.0 };
    scene.camera.vertical_fov = 2.0 * width.atan().to_degrees();
    scene.fogs.push(Fog {
        bounds: Some([DVec3::splat(-1.0), DVec3::ONE]),
        optics: Optics {
            extinction: Rgb::splat(SIGMA as f32),
            albedo: Rgb::ONE,
            phase: Phase::Isotropic,
        },
    });
    scene
}

/// One photon in f64: what it adds, and what its kernel's height and its rounding are.
pub(super) fn exact(photon: &Plain, ray: &Ray, span: (f32, f32)) -> [f64; 2] {
    let v = (photon.position.as_dvec3()) - ray.origin.as_dvec3();
    let d = ray.direction.as_dvec3();
    // Directions are of length 1 to rounding only.
    let t = v.dot(d) / d.length_squared();
    let (t0, t1) = (f64::from(span.0), f64::from(span.1));
    let r = f64::from(photon.radius());
    let d2 = (v - t * d).length_squared();
    let resolved = f64::from(f32::EPSILON) * v.length();
    let height =
        (-SIGMA * (t - t0).max(0.0)).exp() * SIGMA * 0.25 / PI * f64::from(photon.power()) * 3.0
            / (PI * r * r);
    // A photon that f32 cannot place inside or outside its disc may count or not.
    let doubt = if d2.sqrt() > r + resolved {
        0.0
    } else {
        height * (1e-5 + (1.6 * resolved / r).min(1.0))
    };
    let counts = d2 < r * r && t > t0.max(0.0) && t < t1;
    let x = d2 / (r * r);
    let near_end = (t - t0).abs().min((t - t1).abs()) < 2.0 * resolved;
    let doubt = if near_end { height } else { doubt };
    [
        if counts {
            height * (1.0 - x) * (1.0 - x)
        } else {
            0.0
        },
        doubt,
    ]
}

/// What both roads find along each ray, and the rays with the span that their fog takes.
pub(super) struct Gathered {
    pub(super) rays: Vec<(Ray, (f32, f32))>,
    pub(super) by_map: [f32; TILE_RAYS],
    pub(super) by_tile: [f32; TILE_RAYS],
}

/// Gathers photons along the rays of a picture of one tile, seen from `distance`; `make` makes the
/// photons for the rays.
pub(super) fn gather(
    distance: f64,
    t_max: f32,
    make: impl FnOnce(&[Ray]) -> Vec<Plain>,
) -> Result<(Gathered, Vec<Plain>), SelftestError> {
    let world = World::<f32>::new(&fog(distance), Vec::new()).map_err(RenderError::from)?;
    let grid = TileGrid {
        low: [0; 2],
        high: [8; 2],
    };
    let mut tile = TileRays::<f32, ()>::default();
    let mut random = rng(81);
    let nothing = &mut Counters::default();
    for i in 0..TILE_RAYS {
        let pixel = Vec3::new((i % 8) as f32, (i / 8) as f32, 0.0) + unit(&mut random);
        tile.rays[i] = world.camera.ray([pixel.x, pixel.y], [0.0; 2]);
        let media = (0, &world.media[..]);
        tile.profiles[i].march(media, &tile.rays[i], t_max, March::Exact, nothing);
    }
    let photons = make(&tile.rays);
    let map = PhotonMap::new(photons.clone());
    let bands = Bands::new(photons.clone(), &world.camera, &grid);
    let by_map = std::array::from_fn(|i| {
        let (profile, ray) = (&tile.profiles[i], &tile.rays[i]);
        beam::radiance(
            Kernel::Biweight,
            &world.media,
            &map,
            &beam::Stretch {
                ray,
                profile,
                compartment: 0,
                walls: [crate::estimate::wall::Wall::NONE; 2],
            },
            nothing,
        )
    });
    tile.arrange(&[true; TILE_RAYS]);
    let mut by_tile = [0.0f32; TILE_RAYS];
    tile.gather(
        &world.media,
        (world.camera.position, 0),
        bands.tiles(0, 0).tile(0),
        &mut by_tile,
        nothing,
    );
    let span = |profile: &Profile<f32>| {
        let (start, end) = profile.extent();
        (start, end.min(t_max))
    };
    let rays = tile.rays.iter().copied();
    let gathered = Gathered {
        rays: rays.zip(tile.profiles.iter().map(span)).collect(),
        by_map,
        by_tile,
    };
    Ok((gathered, photons))
}

/// The worst of both gathers, in units of rounding.
fn gathers(case: Case) -> Result<Worst, SelftestError> {
    let Case {
        name,
        photons,
        distance,
        t_max,
    } = case;
    let (found, photons) = gather(distance, t_max, |_| photons)?;
    let mut worst = Worst::default();
    for (i, (ray, span)) in found.rays.iter().enumerate() {
        let (mut sum, mut allowed) = (0.0, f64::from(f32::MIN_POSITIVE));
        for photon in &photons {
            let [l, doubt] = exact(photon, ray, *span);
            sum += l;
            allowed += doubt;
        }
        // Sums of hundreds of terms in f32.
        allowed += 1e-6 * sum;
        for (road, found) in [("hierarchy", found.by_map[i]), ("tiles", found.by_tile[i])] {
            worst.take((f64::from(found) - sum).abs() / allowed, || {
                format!("{name}, {road}, ray {i}: {found:e}, exactly {sum:e}")
            });
        }
    }
    Ok(worst)
}

/// Radii outside their limits, or not finite, of degenerate pilots.
fn radii() -> Worst {
    let mut random = rng(82);
    let limits = [1e-4, 0.5];
    let mut faults = Worst::default();
    let line: Vec<Vec3> = (0..300).map(|i| Vec3::X * i as f32 * 1e-30).collect();
    for (name, pilots) in [
        ("none", Vec::new()),
        ("one", vec![Vec3::ONE]),
        ("fewer than asked for", vec![Vec3::ZERO, Vec3::X, Vec3::Y]),
        ("all at one point", vec![Vec3::ONE; 1000]),
        ("half at one point", {
            let mut all = vec![Vec3::ONE; 500];
            all.extend((0..500).map(|_| unit(&mut random)));
            all
        }),
        ("closer than f32 resolves", line),
        (
            "1e15 apart",
            vec![Vec3::ZERO, Vec3::splat(1e15), Vec3::splat(-1e15)],
        ),
    ] {
        let field = RadiusField::new(pilots, 50.0, 1e3, limits);
        for p in [
            Vec3::ZERO,
            Vec3::ONE,
            Vec3::splat(1e15),
            Vec3::splat(-1e-38),
        ] {
            let r = field.at(p);
            faults.count(!(limits[0]..=limits[1]).contains(&r), || {
                format!("{name}: radius {r} at {p}")
            });
        }
    }
    faults
}

/// Relative error of the schedule's radii against gamma functions.
fn schedule() -> Worst {
    let mut worst = Worst::default();
    for (dimension, alpha) in [(2, 2.0 / 3.0), (3, 4.0 / 7.0)] {
        for pass in [1u32, 2, 7, 100, 10_000, 100_000] {
            let n = f64::from(pass);
            let ln = ln_gamma(n + alpha) - ln_gamma(alpha) - ln_gamma(n + 1.0);
            let exact = (ln / f64::from(dimension)).exp();
            let found = f64::from(radius_scale(pass, dimension));
            worst.take((found / exact - 1.0).abs(), || {
                format!("{dimension}-D, pass {pass}: {found}, exactly {exact}")
            });
        }
    }
    worst
}

/// Furnaces with hardly any photons: radii at their cap, and the right mean over many passes.
fn few(seeds: u64) -> Result<Worst, SelftestError> {
    let mut worst = Worst::default();
    for photons in [1, 2, 30] {
        let mut scene = furnace::fog(4.0, 1.0, Phase::Isotropic);
        scene.camera.resolution = [8, 8];
        scene.settings.photons = photons;
        // The radii of the first pass throughout: renders are independent and alike.
        scene.settings.passes = 1;
        let mut mean = Welford::default();
        for seed in 0..seeds {
            scene.settings.seed = seed;
            let film = render(&scene, &[], Some(1))?.film;
            mean.add(film.image_mean().mean.x);
        }
        worst.take(mean.z(1.0, 0.0).abs(), || {
            format!("{photons}: {} +- {}", mean.mean(), mean.standard_error())
        });
    }
    Ok(worst)
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    for case in cases() {
        let what = format!("gather: {}, in roundings", case.name);
        suite.worst(what, gathers(case)?, 1.0);
    }
    suite.none("radii of degenerate pilots beyond their limits", radii());
    suite.worst(
        "schedule of radii against gamma functions",
        schedule(),
        1e-6,
    );
    let seeds = suite.choose([300, 600, 50_000]);
    let bound = t_bound(3, (seeds - 1) as f64);
    suite.worst("furnaces of 1, 2 and 30 photons, |t|", few(seeds)?, bound);
    Ok(())
}
