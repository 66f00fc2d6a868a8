//! What of a scene can make a difference to the picture, and what cannot.
//!
//! A light without power makes none, unless it is a body that the camera sees: a black one. A
//! volume makes none where its density or its extinction is 0 everywhere. Another makes none if it
//! lies outside of every path of light that ends in the camera. Such a path has straight pieces:
//!
//! ```text
//! camera -> anywhere           the pyramid of the camera's rays
//! vertex -> vertex, light      the convex hull of everything else that scatters or shines
//! vertex -> sun                the hull, swept against the sun's direction
//! vertex -> sky                everywhere
//! ```
//!
//! and vertices in the volume itself, which matter as soon as light that it scatters or emits can be
//! scattered once more elsewhere. Boxes stand for hulls and pyramids are tested by their planes:
//! both err toward keeping. Nothing is left out that contributes little.

use glam::DVec3;

use super::facts::{acts, heat, light_colour};
use crate::scene::{Fog, Light, Material, Optics, Scene, Volume};
use crate::world::LoadedVolume;

/// Something of the scene that is not simulated.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Dropped {
    /// What, by its place in the scene: "volume 2 (smoke.vdb)".
    pub what: String,
    /// The fact that decides.
    pub reason: String,
}

/// See the module's page: which of a scene's volumes, fogs and lights are simulated.
#[derive(Debug, Clone, Default)]
pub struct Kept {
    volumes: Vec<bool>,
    fogs: Vec<bool>,
    lights: Vec<bool>,
}

/// The items that a mask keeps; all without one.
fn masked<'a, T>(items: &'a [T], mask: &'a [bool]) -> impl Iterator<Item = &'a T> {
    let keep = move |i: usize| mask.get(i).copied().unwrap_or(true);
    items
        .iter()
        .enumerate()
        .filter(move |(i, _)| keep(*i))
        .map(|(_, item)| item)
}

impl Kept {
    /// Everything.
    pub(super) fn all() -> Self {
        Self::default()
    }

    pub(super) fn volumes<'a>(
        &'a self,
        scene: &'a Scene,
        loaded: &'a [LoadedVolume],
    ) -> impl Iterator<Item = (&'a Volume, &'a LoadedVolume)> {
        masked(&scene.volumes, &self.volumes).zip(masked(loaded, &self.volumes))
    }

    pub(super) fn fogs<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = &'a Fog> {
        masked(&scene.fogs, &self.fogs)
    }

    pub(super) fn lights<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = &'a Light> {
        masked(&scene.lights, &self.lights)
    }

    /// The scene without what is dropped, and its volumes; grids of temperatures only if `emission`.
    pub(crate) fn take(
        &self,
        scene: &Scene,
        volumes: Vec<LoadedVolume>,
        emission: bool,
    ) -> (Scene, Vec<LoadedVolume>) {
        let mut scene = scene.clone();
        scene.volumes = masked(&scene.volumes, &self.volumes).cloned().collect();
        scene.fogs = self.fogs(&scene).cloned().collect();
        scene.lights = self.lights(&scene).cloned().collect();
        let keep = |i: usize| self.volumes.get(i).copied().unwrap_or(true);
        let mut volumes: Vec<_> = (0..)
            .zip(volumes)
            .filter(|(i, _)| keep(*i))
            .map(|(_, volume)| volume)
            .collect();
        if !emission {
            volumes.iter_mut().for_each(|v| v.temperature = None);
        }
        (scene, volumes)
    }
}

/// An axis-aligned box in the world. \[m\]
#[derive(Debug, Clone, Copy)]
struct Box3 {
    min: DVec3,
    max: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self {
            min: b.min.min(p),
            max: b.max.max(p),
        })
    }

    fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// With a margin of a thousandth of all there is: boxes stand for f32 arithmetic too.
    fn grown(self, by: f64) -> Self {
        Self {
            min: self.min - by,
            max: self.max + by,
        }
    }

    fn meets(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, a: f64, b: f64| if i >> bit & 1 == 0 { a } else { b };
            DVec3::new(
                pick(0, self.min.x, self.max.x),
                pick(1, self.min.y, self.max.y),
                pick(2, self.min.z, self.max.z),
            )
        })
    }
}

/// A medium as this page sees it.
#[derive(Debug, Clone, Copy)]
struct Body {
    around: Box3,
    scatters: bool,
    emits: bool,
}

impl Body {
    fn new(around: Box3, optics: &Optics, emits: bool) -> Self {
        Self {
            around,
            scatters: optics.albedo.max_element() > 0.0,
            emits,
        }
    }
}

/// Decides what is kept of a scene, and says what is not.
pub(super) fn decide(scene: &Scene, loaded: &[LoadedVolume]) -> (Kept, Vec<Dropped>) {
    let mut dropped = Vec::new();
    let mut kept = Kept {
        volumes: vec![true; scene.volumes.len()],
        fogs: vec![true; scene.fogs.len()],
        lights: vec![true; scene.lights.len()],
    };
    let view = View::new(scene);
    for (i, light) in scene.lights.iter().enumerate() {
        if light_colour(light).max_element() > 0.0 || matches!(light, Light::SkyImage { .. }) {
            continue;
        }
        let body = match light_place(light) {
            Some((around, true)) => view.sees(&around),
            _ => false,
        };
        if !body {
            kept.lights[i] = false;
            dropped.push(Dropped {
                what: format!("light {}", i + 1),
                reason: "its power is 0".to_owned(),
            });
        }
    }
    let name = |i: usize| {
        let file = scene.volumes[i].file.file_name();
        let file = file.map(|f| f.to_string_lossy().into_owned());
        format!("volume {} ({})", i + 1, file.unwrap_or_default())
    };
    for (i, (volume, grids)) in scene.volumes.iter().zip(loaded).enumerate() {
        if !acts(volume, grids) {
            kept.volumes[i] = false;
            let extinction = volume.optics.extinction.max_element();
            let reason = if extinction > 0.0 {
                "its highest density is 0".to_owned()
            } else {
                format!("its extinction is {extinction}")
            };
            dropped.push(Dropped {
                what: name(i),
                reason,
            });
        }
    }
    for (i, fog) in scene.fogs.iter().enumerate() {
        if fog.optics.extinction.max_element() <= 0.0 {
            kept.fogs[i] = false;
            dropped.push(Dropped {
                what: format!("fog {}", i + 1),
                reason: "its extinction is 0".to_owned(),
            });
        }
    }
    // A fog without a box fills the box around all volumes, whatever becomes of them.
    if scene.fogs.iter().any(|f| f.bounds.is_none()) {
        return (kept, dropped);
    }
    let bodies: Vec<Option<Body>> = scene
        .volumes
        .iter()
        .zip(loaded)
        .map(|(volume, grids)| {
            let corners = grids.density.world_corners();
            let around = corners.map(|c| volume.transform.transform_point3(c));
            let emits = heat(volume, grids).is_some_and(|h| h.emits);
            acts(volume, grids).then(|| Body::new(Box3::around(around), &volume.optics, emits))
        })
        .collect();
    let fogs: Vec<Option<Body>> = scene
        .fogs
        .iter()
        .map(|fog| Some(Body::new(Box3::around(fog.bounds?), &fog.optics, false)))
        .collect();
    // One that goes makes the hull of the others smaller: as often as there are any.
    let mut gone = true;
    while std::mem::take(&mut gone) {
        for i in 0..bodies.len() + fogs.len() {
            let (v, f) = (i, i.wrapping_sub(bodies.len()));
            let (body, is_kept) = if v < bodies.len() {
                (bodies[v], kept.volumes[v])
            } else {
                (fogs[f], kept.fogs[f])
            };
            let Some(body) = body.filter(|_| is_kept) else {
                continue;
            };
            let others: Vec<Body> = (bodies.iter().zip(&kept.volumes).enumerate())
                .filter(|(j, _)| *j != i)
                .map(|(_, pair)| pair)
                .chain(
                    (fogs.iter().zip(&kept.fogs).enumerate())
                        .filter(|(j, _)| bodies.len() + j != i)
                        .map(|(_, pair)| pair),
                )
                .filter_map(|(body, kept)| body.filter(|_| *kept))
                .collect();
            if view.sees(&body.around) || reaches(scene, &kept, &others, &body) {
                continue;
            }
            gone = true;
            let what = if v < bodies.len() {
                kept.volumes[v] = false;
                name(v)
            } else {
                kept.fogs[f] = false;
                format!("fog {}", f + 1)
            };
            let distance = body.around.corners().iter().fold(f64::INFINITY, |d, c| {
                d.min(c.distance(scene.camera.position))
            });
            dropped.push(Dropped {
                what,
                reason: format!(
                    "no camera ray and no light that is seen passes its box, {distance:.3} m away"
                ),
            });
        }
    }
    (kept, dropped)
}

/// Where a local light is, and whether the eye can meet it.
fn light_place(light: &Light) -> Option<(Box3, bool)> {
    match *light {
        Light::Point { position, .. } | Light::Spot { position, .. } => {
            Some((Box3::around([position]), false))
        }
        Light::Quad {
            corner,
            edge_u,
            edge_v,
            ..
        } => {
            let corners = [
                corner,
                corner + edge_u,
                corner + edge_v,
                corner + edge_u + edge_v,
            ];
            Some((Box3::around(corners), true))
        }
        Light::Disk { center, radius, .. } | Light::Sphere { center, radius, .. } => {
            Some((Box3::around([center - radius, center + radius]), true))
        }
        Light::Sun { .. } | Light::Sky { .. } | Light::SkyImage { .. } => None,
    }
}

/// Can light that the camera sees, camera rays themselves left out, pass through a body, or come
/// from it? `others` are the media that are kept beside it.
fn reaches(scene: &Scene, kept: &Kept, others: &[Body], body: &Body) -> bool {
    // Surfaces may send light anywhere, and camera rays too.
    if !scene.objects.is_empty() {
        return true;
    }
    let scatters = others.iter().any(|o| o.scatters) && scene.settings.max_bounces > 0;
    if !scatters {
        return false;
    }
    // Its own light, scattered by others: lit by them or by a light.
    if body.emits || body.scatters && scene.settings.max_bounces > 1 {
        return true;
    }
    let scatterers = others.iter().filter(|o| o.scatters);
    let mut hull = scatterers.fold(Box3::EMPTY, |b, o| b.union(o.around));
    let vertices = hull;
    for light in kept.lights(scene) {
        match light {
            Light::Sky { .. } | Light::SkyImage { .. } => return true,
            Light::Sun {
                direction,
                angular_diameter,
                ..
            } => {
                let away = vertices.corners().map(|c| {
                    body.around
                        .corners()
                        .iter()
                        .fold(0.0, |d: f64, b| d.max(b.distance(c)))
                });
                let far = away.into_iter().fold(0.0, f64::max) * 2.0;
                // A disc widens the swept hull by the sine of its half angle, at most.
                let widen = far * (0.5 * angular_diameter.to_radians()).sin();
                let swept = vertices.corners().map(|c| c - *direction * far);
                hull = hull.union(Box3::around(swept).grown(widen));
            }
            _ => {
                if let Some((place, _)) = light_place(light) {
                    hull = hull.union(place);
                }
            }
        }
    }
    let size = hull.max - hull.min;
    hull.grown(1e-3 * size.max_element()).meets(&body.around)
}

/// The camera's rays, or everywhere where surfaces may send them anywhere.
#[derive(Debug)]
struct View {
    /// Half spaces n . (x - o) >= -margin, as (o, n), whose intersection holds all rays.
    planes: Option<[(DVec3, DVec3); 5]>,
    /// \[m\]
    margin: f64,
}

impl View {
    fn new(scene: &Scene) -> Self {
        let bends = |material: &Material| {
            !matches!(
                material,
                Material::Diffuse { .. } | Material::Emissive { .. } | Material::Interface
            )
        };
        if scene.objects.iter().any(|o| bends(&o.material)) {
            return Self {
                planes: None,
                margin: 0.0,
            };
        }
        let camera = &scene.camera;
        let forward = (camera.look_at - camera.position).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let [width, height] = camera.resolution.map(f64::from);
        let half = (0.5 * camera.vertical_fov.to_radians()).tan();
        let [x0, y0, x1, y1] = scene
            .settings
            .crop
            .map_or([0.0, 0.0, width, height], |c| c.map(f64::from));
        let x = |p: f64| (2.0 * p / width - 1.0) * half * width / height;
        let y = |p: f64| (1.0 - 2.0 * p / height) * half;
        // Rounding of the rays' f32 directions, as a share of the picture.
        const SLACK: f64 = 1e-5;
        let (left, rightmost) = (x(x0) - SLACK, x(x1) + SLACK);
        let (top, bottom) = (y(y0) + SLACK, y(y1) - SLACK);
        // A lens moves the start by its radius; beyond the plane in focus the cone it opens is as
        // wide as one from a lens at that distance behind it.
        let lens = camera.lens.map_or(0.0, |l| l.radius);
        let spread = camera.lens.map_or(0.0, |l| l.radius / l.focus_distance);
        let start = camera.position;
        let planes = [
            (start, right - forward * (left - spread)),
            (start, forward * (rightmost + spread) - right),
            (start, up - forward * (bottom - spread)),
            (start, forward * (top + spread) - up),
            (start, forward),
        ];
        Self {
            planes: Some(planes.map(|(o, n)| (o, n.normalize()))),
            margin: lens,
        }
    }

    /// Can a ray meet the box?
    fn sees(&self, around: &Box3) -> bool {
        let corners = around.corners();
        self.planes.iter().flatten().all(|(origin, normal)| {
            let beyond = |c: &DVec3| (*c - *origin).dot(*normal) >= -self.margin;
            corners.iter().any(beyond)
        })
    }
}
