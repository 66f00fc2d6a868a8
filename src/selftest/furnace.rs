//! The furnace: media that absorb nothing, in a sky of radiance 1, cannot be seen.
//!
//! ```text
//! paths    every pixel is 1 to the last bit: a throughput of exactly 1 until the path leaves
//! photons  mean = 1                                    by Student's t over independent passes
//! R        = 1 + (mean - 1) / opacity                  scattered light over what is taken out
//! ```
//!
//! R asks the same of thin media as of thick ones: a pixel of 1 in a medium of optical thickness
//! 1e-4 would hide an error of everything that it scatters. What the t-test can tell is an error of
//! R beyond the bound times its standard error, which the checks list beside it. Rays are closer together than photons' discs are wide, so that each
//! photon is seen by several rays: noise comes from the photons, and few are wasted.
//!
//! Photons of a thick medium collide some 4 V / S sigma times each (mean chord, whatever the
//! scattering); their number is chosen for the work to stay the same. Forward peaks cost: the
//! variance of one photon's light grows with 4 pi times the integral of p^2, 5e5 for g = 0.999.

use glam::{DVec3, IVec3};

use super::fields::{generated, grid, render, scene, smoke, volume};
use super::{SelftestError, Suite, Worst};
use crate::grid::Grid;
use crate::scene::{Direct, Fog, Light, Method, Optics, Phase, Rgb, Scene};
use crate::stats::t_bound;

/// Phase functions of the paths.
const PHASES: [Phase; 5] = [
    Phase::Isotropic,
    Phase::HenyeyGreenstein(0.85),
    Phase::HenyeyGreenstein(0.999),
    Phase::HenyeyGreenstein(-0.95),
    Phase::Rayleigh,
];

/// A furnace around a camera at `distance`.
#[must_use]
pub fn furnace(distance: f64) -> Scene {
    let mut scene = scene(distance, [16, 16]);
    scene.lights.push(Light::Sky { radiance: Rgb::ONE });
    scene.settings.max_bounces = 100_000_000;
    scene
}

/// A furnace with fog in a cube of edge 2.
#[must_use]
pub fn fog(distance: f64, extinction: f32, phase: Phase) -> Scene {
    let mut scene = furnace(distance);
    scene.fogs.push(Fog {
        bounds: Some([DVec3::splat(-1.0), DVec3::ONE]),
        optics: Optics {
            extinction: Rgb::splat(extinction),
            albedo: Rgb::ONE,
            phase,
        },
    });
    scene
}

/// A furnace around a grid, seen from `distance` of its radii.
#[must_use]
pub fn around(grid: &Grid, distance: f64, extinction: f32, phase: Phase) -> Scene {
    let corners = grid.world_corners();
    let middle = corners.iter().sum::<DVec3>() / 8.0;
    let radius = (corners[0] - middle).length();
    let mut scene = furnace(0.0);
    scene.camera.position = middle + DVec3::new(0.3, 0.5, 1.0).normalize() * (radius * distance);
    scene.camera.look_at = middle;
    scene.camera.vertical_fov = 30.0;
    scene
        .volumes
        .push(volume(Rgb::splat(extinction), Rgb::ONE, phase));
    scene
}

/// An extinction that makes a grid's largest values `thickness` thick across.
#[must_use]
pub fn extinction_for(grid: &Grid, thickness: f64) -> f32 {
    let corners = grid.world_corners();
    let size = (corners[7] - corners[0]).length();
    (thickness / size / f64::from(grid.range()[1])) as f32
}

/// Pixels of a path-traced furnace that are not exactly 1.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn seen_by_paths(
    name: &str,
    mut scene: Scene,
    grids: &[&Grid],
) -> Result<Worst, SelftestError> {
    scene.settings.method = Method::Path;
    scene.settings.spp = 4;
    let film = render(&scene, grids, None)?.film;
    let [width, height] = film.resolution();
    let mut faults = Worst::default();
    for y in 0..height {
        for x in 0..width {
            let mean = film.mean(x, y);
            faults.count(mean != DVec3::ONE, || format!("{name}: {mean} at {x}, {y}"));
        }
    }
    Ok(faults)
}

/// Independent passes of a furnace by photons.
const PASSES: u32 = 24;

/// t-tests of furnaces by photons.
#[derive(Debug, Default)]
pub struct Beams {
    worst: Worst,
    error: Worst,
    cases: usize,
}

impl Beams {
    /// Takes in one furnace.
    ///
    /// # Errors
    /// [`SelftestError`]: what cannot be rendered.
    pub fn add(
        &mut self,
        name: &str,
        mut scene: Scene,
        grids: &[&Grid],
        photons: u64,
    ) -> Result<(), SelftestError> {
        scene.settings.passes = PASSES;
        scene.settings.photons = photons;
        scene.camera.resolution = [40, 40];
        let film = render(&scene, grids, None)?.film;
        let estimate = film.image_mean();
        let error = estimate.standard_error.map_or(f64::NAN, |e| e.x);
        let [width, height] = film.resolution();
        let opacity: f64 = (0..width * height)
            .map(|i| film.means(i % width, i / width).alpha)
            .sum::<f64>()
            / f64::from(width * height);
        let off = estimate.mean.x - 1.0;
        let (ratio, error) = (1.0 + off / opacity, error / opacity);
        let place = || format!("{name}: {ratio} +- {error}");
        // A pixel that is not finite is left out of a film: here it counts.
        let lost = film.nonfinite_pixels() > 0;
        let t = ((ratio - 1.0) / error).abs();
        self.worst.take(if lost { f64::NAN } else { t }, place);
        self.error.take(error, place);
        self.cases += 1;
        Ok(())
    }

    /// The checks: t, and how large an error may hide behind it.
    pub fn finish(self, suite: &mut Suite, what: &str, most_error: f64) {
        let bound = t_bound(self.cases, f64::from(PASSES - 1));
        suite.worst(format!("{what}, |t|"), self.worst, bound);
        suite.worst(format!("{what}, standard error"), self.error, most_error);
    }
}

/// Smoke of some ten optical depths at an extinction of 0.8.
///
/// # Errors
/// None in practice: the grid is small.
pub fn blob() -> Result<Grid, SelftestError> {
    Ok(grid(IVec3::splat(-24), IVec3::splat(24), smoke)?)
}

/// The checks of this family.
///
/// # Errors
/// [`SelftestError`]: what cannot be rendered.
pub fn checks(suite: &mut Suite) -> Result<(), SelftestError> {
    let thickest = suite.choose([2, 4, 4]);
    let mut faults = Worst::default();
    for exponent in -4..=thickest {
        for phase in PHASES {
            // The cube is two units across.
            let scene = fog(4.0, 0.5 * 10f32.powi(exponent), phase);
            let name = format!("fog 1e{exponent} {phase:?}");
            faults = faults.and(seen_by_paths(&name, scene, &[])?);
        }
    }
    suite.none("paths: pixels that differ from 1, fog 1e-4 and up", faults);
    let mut faults = Worst::default();
    let mut fields = generated()?;
    fields.push(("smoke", blob()?));
    for (name, grid) in &fields {
        for phase in PHASES {
            let scene = around(grid, 2.5, extinction_for(grid, 20.0), phase);
            let name = format!("{name} {phase:?}");
            faults = faults.and(seen_by_paths(&name, scene, &[grid])?);
        }
    }
    suite.none("paths: pixels that differ from 1, generated fields", faults);

    let most = suite.choose([5000, 12_000, 400_000]);
    // Of a thick medium, fewer: the work is photons times collisions.
    let photons = |extinction: f32| (3 * most).min((most as f32 * 60.0 / extinction) as u64);
    let (mut beams, mut thick) = (Beams::default(), Beams::default());
    for exponent in -4..=thickest {
        let extinction = 0.5 * 10f32.powi(exponent);
        let scene = fog(4.0, extinction, Phase::Isotropic);
        let n = photons(extinction).min(most);
        let name = format!("fog 1e{exponent}");
        let beams = if exponent > 2 { &mut thick } else { &mut beams };
        beams.add(&name, scene, &[], n)?;
    }
    let mut direct = fog(4.0, 3.0, Phase::Isotropic);
    direct.settings.direct = Direct::Photons;
    beams.add("fog, direct by photons", direct, &[], most)?;
    let mut points = fog(4.0, 3.0, Phase::Isotropic);
    points.settings.method = Method::Point;
    beams.add("fog, photons in spheres", points, &[], most)?;
    for g in [-0.5, 0.5] {
        let scene = fog(4.0, 3.0, Phase::HenyeyGreenstein(g));
        beams.add(&format!("fog, g = {g}"), scene, &[], 2 * most)?;
    }
    for (name, grid) in &fields {
        let scene = around(grid, 2.5, extinction_for(grid, 10.0), Phase::Isotropic);
        // Spikes are thin: few of their photons scatter, and few are enough work.
        let more = if *name == "spikes" { 8 } else { 1 };
        beams.add(name, scene, &[grid], more * most)?;
    }
    beams.finish(suite, "photons: scattered light over opacity", 0.02);
    if thickest > 2 {
        // Only the outermost mean free path is seen: few photons tell.
        thick.finish(suite, "photons, fog 1e3 and 1e4 thick", 0.5);
    }

    let mut beams = Beams::default();
    for g in [-0.95, 0.85] {
        let scene = fog(4.0, 3.0, Phase::HenyeyGreenstein(g));
        beams.add(&format!("fog, g = {g}"), scene, &[], 8 * most)?;
    }
    beams.finish(suite, "photons, peaked phase functions", 0.03);
    Ok(())
}
