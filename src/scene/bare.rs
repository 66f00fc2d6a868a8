//! A scene around a lone .vdb: framed, lit, and as thick as it looks best.
//!
//! A file says where its voxels are and how dense, but neither how dense "1" is nor where to stand.
//! The view is from the front, a little from above and from the right, the volume's box just
//! inside the picture. The extinction makes the thicker parts of what is seen
//! `OPTICAL_THICKNESS` thick, whatever the unit of the file's lengths and densities. A sun from
//! the upper left and a sky light it. Up is z for files that Blender wrote, else y.

use std::path::Path;

use glam::{DAffine3, DVec3, Vec3};

use super::{Camera, Convert, Light, Optics, Phase, Scene, Settings, Volume};
use crate::grid::Grid;
use crate::grid::load::{LoadError, Taking, load_grid};
use crate::grid::majorant::MajorantGrid;
use crate::grid::walk::integral;
use crate::ray::ExactRay;
use crate::vdb::{Archive, MetaValue};

/// Optical thickness of the thicker parts: opaque, and light still finds its way through edges.
const OPTICAL_THICKNESS: f64 = 12.0;
/// Share of the rays through the volume that are thinner than that.
const THICK_QUANTILE: f64 = 0.9;
/// Rays across the volume's box, along each edge of the picture.
const PROBES: u32 = 48;
/// Longer edge of the picture. \[px\]
const LONGER_EDGE: f64 = 720.0;
/// Full angle across the picture's height. \[degrees\]
const VERTICAL_FOV: f64 = 30.0;
/// Room around the volume's box, as a share of it.
const MARGIN: f64 = 0.06;

/// A scene that shows the density grid of a file.
///
/// # Errors
/// [`LoadError`] where there is no density to show.
pub fn scene_for(vdb: &Path) -> Result<Scene, LoadError> {
    let archive = Archive::open(vdb)?;
    let taking = Taking {
        convert: Convert::LevelSet,
        strict: false,
    };
    let grid = load_grid(&archive, vdb, None, taking)?.grid;
    let up = if written_by_blender(&archive) {
        DVec3::Z
    } else {
        DVec3::Y
    };
    let camera = frame(&grid, up);
    let extinction = extinction(&grid, &camera);
    // The camera's right, as the sun is seen from it.
    let forward = (camera.look_at - camera.position).normalize();
    let right = forward.cross(up).normalize();
    let sun = (right * 0.75 - up * 0.8 + forward * 0.45).normalize();
    Ok(Scene {
        name: vdb
            .file_stem()
            .map_or_else(|| "volume".to_owned(), |s| s.to_string_lossy().into_owned()),
        camera,
        settings: Settings {
            photons: 350_000,
            passes: 7,
            neighbours: 250,
            ..Settings::default()
        },
        volumes: vec![Volume {
            file: vdb.to_owned(),
            density: None,
            optics: Optics {
                extinction: Vec3::splat(extinction as f32),
                albedo: Vec3::splat(0.95),
                phase: Phase::Isotropic,
            },
            emission: None,
            transform: DAffine3::IDENTITY,
            convert: Convert::LevelSet,
            strict: false,
        }],
        fogs: Vec::new(),
        lights: vec![
            Light::Sun {
                direction: sun,
                irradiance: Vec3::new(5.0, 4.6, 4.0),
                angular_diameter: 0.0,
            },
            Light::Sky {
                radiance: Vec3::new(0.16, 0.24, 0.36),
            },
        ],
        objects: Vec::new(),
    })
}

/// Blender names itself in the file's or a grid's metadata, and its world is z up.
fn written_by_blender(archive: &Archive) -> bool {
    let grids = archive.grids().iter().map(|g| &g.metadata);
    std::iter::once(archive.metadata())
        .chain(grids)
        .any(|metadata| {
            metadata.0.iter().any(|(key, value)| {
                let named = |s: &str| s.to_lowercase().contains("blender");
                named(key) || matches!(value, MetaValue::String(s) if named(s))
            })
        })
}

/// A camera that has the volume's box just inside its picture.
fn frame(grid: &Grid, up: DVec3) -> Camera {
    let corners = grid.world_corners();
    let (low, high) = corners
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), c| {
            (a.min(*c), b.max(*c))
        });
    let look_at = if low.is_finite() {
        0.5 * (low + high)
    } else {
        DVec3::ZERO
    };
    let radius = if low.is_finite() {
        0.5 * (high - low).length()
    } else {
        1.0
    };
    // Front: the viewer looks along -z in a y-up world, along +y in a z-up one.
    let front = if up == DVec3::Z {
        DVec3::NEG_Y
    } else {
        DVec3::Z
    };
    let side = up.cross(front);
    let toward = (front + 0.35 * side + 0.12 * up).normalize();
    let right = up.cross(toward).normalize();
    let above = toward.cross(right);
    // Half the picture's slopes that the box needs from a given distance.
    let slopes = |distance: f64| {
        corners
            .iter()
            .fold((0.0f64, 0.0f64), |(across, down), corner| {
                let to = *corner - look_at;
                let depth = distance - to.dot(toward);
                (
                    across.max((to.dot(right) / depth).abs()),
                    down.max((to.dot(above) / depth).abs()),
                )
            })
    };
    let tangent = (0.5 * VERTICAL_FOV.to_radians()).tan();
    let (across, down) = slopes(8.0 * radius);
    let aspect = (across / down).clamp(0.5, 2.0);
    let aspect = if aspect.is_finite() { aspect } else { 1.0 };
    // Bisection: from further away, everything is smaller.
    let (mut near, mut far) = (1.01 * radius, 100.0 * radius);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        let (across, down) = slopes(middle);
        if across * (1.0 + MARGIN) > tangent * aspect || down * (1.0 + MARGIN) > tangent {
            near = middle;
        } else {
            far = middle;
        }
    }
    let size = |share: f64| (LONGER_EDGE * share).round().max(1.0) as u32;
    let resolution = [size(aspect.min(1.0)), size((1.0 / aspect).min(1.0))];
    Camera {
        position: look_at + toward * far,
        look_at,
        up,
        vertical_fov: VERTICAL_FOV,
        resolution,
        lens: None,
    }
}

/// Extinction that makes the thicker parts of the picture as thick as they should be. \[1/m\]
fn extinction(grid: &Grid, camera: &Camera) -> f64 {
    let to_local = grid.local_to_world().inverse();
    let majorants = MajorantGrid::new(grid, 0.0, 1.0);
    let view = crate::camera::Camera::new(camera, camera.position);
    let mut depths = Vec::new();
    for y in 0..PROBES {
        for x in 0..PROBES {
            let at = |i: u32, edge: u32| (f64::from(i) + 0.5) / f64::from(PROBES) * f64::from(edge);
            let pixel = [
                at(x, camera.resolution[0]) as f32,
                at(y, camera.resolution[1]) as f32,
            ];
            let direction = view.ray(pixel, [0.0; 2]).direction.as_dvec3();
            let local = ExactRay {
                origin: to_local.transform_point3(camera.position),
                direction: to_local.transform_vector3(direction),
            };
            let (depth, _) = integral(
                grid,
                &majorants,
                &local,
                [0.0, f32::INFINITY],
                f64::INFINITY,
            );
            if depth > 0.0 {
                depths.push(depth);
            }
        }
    }
    depths.sort_by(f64::total_cmp);
    let index = (depths.len() as f64 * THICK_QUANTILE) as usize;
    depths
        .get(index.min(depths.len().saturating_sub(1)))
        .map_or(1.0, |d| OPTICAL_THICKNESS / d)
}
