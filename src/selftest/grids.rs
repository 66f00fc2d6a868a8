//! Grids at the edge of what a grid is.
//!
//! ```text
//! depth along a line through voxel centres, parallel to an axis = sum of the values on it
//! ```
//!
//! (tents of width 2 and height v add up to v each, borders included). A background other than 0
//! counts inside the box of active voxels and nowhere else: an unbounded medium would hide every
//! light. Densities from 1e-38 to 1e38 with an extinction to match are one medium. Values that no
//! density can have become 0 and are counted.

use glam::{DAffine3, IVec3, Vec3};

use super::fields::{grid, medium, noise, render, rng};
use super::{SelftestError, Suite, Worst, furnace};
use crate::grid::Grid;
use crate::grid::build::{BuildError, Topology};
use crate::march::Profile;
use crate::medium::Medium;
use crate::ray::Ray;
use crate::scene::{March, Method, Phase};
use crate::stats::{Welford, ks_bound, ks_lambda, z_bound};
use crate::tracking::{Counters, Hero, Sampler, sample_free_flight, transmittance};
use crate::vdb::Cleaner;

/// Optical depth of a ray.
fn depth(media: &[Medium<f32>], ray: &Ray) -> f64 {
    let mut profile = Profile::default();
    let nothing = &mut Counters::default();
    profile.march((0, media), ray, f32::INFINITY, March::Exact, nothing);
    f64::from(profile.optical_depth(profile.t_end))
}

/// A ray parallel to x through the voxels with this y and z. \[index\]
fn along_x(y: i32, z: i32) -> Ray {
    Ray {
        origin: Vec3::new(-300.0, y as f32, z as f32),
        direction: Vec3::X,
    }
}

/// A background of 0.75 in a box of 10 x 20 x 30 active voxels, and nothing else.
fn background() -> Result<Grid, BuildError> {
    let topology = Topology {
        background: 0.75,
        tiles: Vec::new(),
        leaves: Vec::new(),
        active: Some([IVec3::new(-4, -9, 3), IVec3::new(5, 10, 32)]),
        index_to_world: DAffine3::IDENTITY,
    };
    Grid::build(&topology, |_| Ok(()))
}

/// Sums of values against marches along x.
fn sums() -> Result<Worst, SelftestError> {
    let one = |v: IVec3| f32::from(u8::from(v == IVec3::splat(3)));
    let cube = IVec3::splat(9);
    let rows: Vec<(&str, Grid, [i32; 2], f64)> = vec![
        ("one voxel", grid(-cube, cube, one)?, [3, 3], 1.0),
        ("constant", grid(-cube, cube, |_| 0.5)?, [0, 4], 9.5),
        ("background", background()?, [0, 20], 7.5),
        ("beside the background's box", background()?, [0, 34], 0.0),
        (
            "noise",
            grid(-cube, cube, |v| noise(v, 4))?,
            [2, -3],
            (-9..=9)
                .map(|x| f64::from(noise(IVec3::new(x, 2, -3), 4)))
                .sum(),
        ),
    ];
    let mut worst = Worst::default();
    for (name, grid, [y, z], exact) in &rows {
        let found = depth(&[medium(grid, 1.0)], &along_x(*y, *z));
        let off = (found - exact).abs() / exact.max(1.0);
        worst.take(off, || format!("{name}: {found}, exactly {exact}"));
    }
    Ok(worst)
}

/// Pixels that an empty grid hides or lights.
fn empty() -> Result<Worst, SelftestError> {
    let cube = IVec3::splat(9);
    let empty = grid(-cube, cube, |_| 0.0)?;
    let mut faults = Worst::default();
    for method in [Method::Path, Method::Beam] {
        let mut scene = furnace::furnace(20.0);
        let phase = Phase::Isotropic;
        scene.volumes = furnace::around(&empty, 2.0, 1.0, phase).volumes;
        scene.settings.method = method;
        scene.settings.photons = 100;
        scene.settings.passes = 2;
        let film = render(&scene, &[&empty], None)?.film;
        for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
            let mean = film.mean(x, y).x;
            faults.count(mean != 1.0, || format!("{method:?}: {mean} at {x}, {y}"));
        }
    }
    Ok(faults)
}

/// Figures of one medium whose densities are of the order of 10^exponent.
struct Extreme {
    depth: Worst,
    transmittance: Worst,
    flight: Worst,
}

/// Densities from 1e-38 to 1e38 against those of order 1.
fn extremes(suite: &Suite) -> Result<Extreme, SelftestError> {
    let cube = IVec3::splat(9);
    let shape = |v: IVec3| 0.5 + 0.5 * noise(v, 4);
    let exact: f64 = (-9..=9)
        .map(|x| f64::from(shape(IVec3::new(x, 2, -3))))
        .sum();
    let mut found = Extreme {
        depth: Worst::default(),
        transmittance: Worst::default(),
        flight: Worst::default(),
    };
    let ray = along_x(2, -3);
    for exponent in EXPONENTS {
        let scale = 10f64.powi(exponent);
        let grid = grid(-cube, cube, |v| (f64::from(shape(v)) * scale) as f32)?;
        // 1.4 optical depths.
        let media = [medium(&grid, (0.1 / scale) as f32)];
        let place = || format!("densities of 1e{exponent}");
        let tau = 0.1 * exact;
        let off = (depth(&media, &ray) / tau - 1.0).abs();
        found.depth.take(off, place);
        let mut sampler = Sampler::new(rng(90));
        let samples = suite.choose([5000, 20_000, 200_000]);
        let mean: Welford = (0..samples)
            .map(|_| f64::from(transmittance(&media, &ray, f32::INFINITY, &mut sampler)))
            .collect();
        found
            .transmittance
            .take(mean.z((-tau).exp(), 1e-6).abs(), place);
        // The distribution of distances is that of order 1, whose own is checked elsewhere: here
        // the share of flights that collide, and a distance for each.
        let mut hero = Hero::choose(&mut sampler.rng);
        let mut random = rng(91);
        let mut sure: Vec<f64> = (0..samples)
            .map(|_| {
                sample_free_flight(&media, &ray, f32::INFINITY, &mut hero, &mut sampler)
                    .map_or_else(
                        || 1.0 - (-tau).exp() * random.uniform_f64(),
                        |c| {
                            let before = Medium { ..media[0].clone() };
                            1.0 - (-cut(&before, &ray, c.t)).exp()
                        },
                    )
            })
            .collect();
        found.flight.take(ks_lambda(&mut sure), place);
    }
    Ok(found)
}

/// Optical depth of a ray up to t.
fn cut(medium: &Medium<f32>, ray: &Ray, t: f32) -> f64 {
    let mut profile = Profile::default();
    let nothing = &mut Counters::default();
    let media = std::slice::from_ref(medium);
    profile.march((0, media), ray, t, March::Exact, nothing);
    f64::from(profile.optical_depth(profile.t_end))
}

const EXPONENTS: [i32; 7] = [-38, -30, -8, 0, 8, 30, 38];

/// Values that no density can have are 0 and counted; others stay as they are.
fn cleaned() -> Worst {
    let cleaner = Cleaner::new();
    let mut values = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -1.0,
        -1e-38,
        -0.0,
        1e-45,
        f32::MAX,
    ];
    cleaner.clean(&mut values);
    let mut faults = Worst::default();
    faults.count(
        values != [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-45, f32::MAX],
        || format!("{values:?}"),
    );
    let counts = (cleaner.not_finite(), cleaner.negative());
    faults.count(counts != (3, 2), || format!("counted {counts:?}"));
    faults
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    suite.worst("depth along rows of voxels, relative error", sums()?, 2e-6);
    suite.none("pixels that an empty grid changes", empty()?);
    let found = extremes(suite)?;
    let n = EXPONENTS.len();
    suite.worst(
        "depth of densities 1e-38 to 1e38, relative error",
        found.depth,
        1e-5,
    );
    suite.worst(
        "ratio tracking through densities 1e-38 to 1e38, |z|",
        found.transmittance,
        z_bound(n),
    );
    suite.worst(
        "free flights through densities 1e-38 to 1e38, KS distance",
        found.flight,
        ks_bound(n),
    );
    suite.none("NaN, infinite and negative values not cleaned", cleaned());
    Ok(())
}
