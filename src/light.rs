//! Lights: what reaches a point from them, and photons that leave them.
//!
//! ```text
//! at a point      integral of L over the light's directions  ~  value(sample)      [W/m2]
//! photons         Phi = power / (probability of the light * photons emitted)       \[W\]
//! ```
//!
//! Photons are aimed at a target box (the media, and surfaces that can send light on): a photon
//! that cannot hit it would carry nothing. From a sun they start on the box's faces that it sees,
//! exactly the projected box; from a sky on the whole surface with a cosine distribution, so that
//! the flux through a convex box is exact; from local lights inside the cone around the target's
//! sphere wherever that is the smaller set of directions.
//!
//! Sources: Jensen 2001 (photon emission); Arvo & Kirk 1990 (Russian roulette by power); cone
//! sampling of spheres as in Pharr, Jakob & Humphreys 2023, section 6.2.4.

use std::f32::consts::PI;

use glam::{DVec3, Vec3};

use crate::ray::{Bounds, Ray};
use crate::rng::{Rng, Stage};
use crate::scene;
use crate::spectrum::Spectrum;
use crate::surface::Surfaces;

/// A light in the renderer's world.
#[derive(Debug, Clone)]
pub enum Light<S> {
    /// A distant disc.
    Sun {
        /// Direction of travel.
        direction: Vec3,
        /// On a facing surface. \[W/m2\]
        irradiance: S,
        /// 1 - cosine of half the apparent diameter.
        spread: f32,
    },
    /// Uniform radiance from everywhere.
    Sky {
        /// \[W/(m2 sr)\]
        radiance: S,
    },
    /// A point.
    Point {
        /// \[m\]
        position: Vec3,
        /// \[W\]
        power: S,
    },
    /// A point that shines into a cone.
    Spot {
        /// \[m\]
        position: Vec3,
        /// Axis.
        direction: Vec3,
        /// On the axis. \[W/sr\]
        intensity: S,
        /// 1 - cosine at which the light has gone, and within which it is full.
        cone: [f32; 2],
    },
    /// A one-sided parallelogram.
    Quad {
        /// \[m\]
        corner: Vec3,
        /// \[m\]
        edges: [Vec3; 2],
        /// Of the side that emits.
        normal: Vec3,
        /// \[m2\]
        area: f32,
        /// \[W/(m2 sr)\]
        radiance: S,
    },
    /// A sphere.
    Sphere {
        /// \[m\]
        center: Vec3,
        /// \[m\]
        radius: f32,
        /// \[W/(m2 sr)\]
        radiance: S,
    },
    /// An emissive object; [`World::sample_light`](crate::world::World::sample_light) knows its
    /// surface.
    Emitter {
        /// Index in the surfaces' list of emitters.
        index: usize,
        /// About its middle. \[m\]
        center: Vec3,
        /// Of the whole surface. \[W\]
        power: S,
    },
}

/// Light that arrives at a point from one direction.
#[derive(Debug, Clone, Copy)]
pub struct LightSample<S> {
    /// Towards the light, unit length.
    pub direction: Vec3,
    /// To the light; infinite for distant ones. \[m\]
    pub distance: f32,
    /// Radiance over the density of the direction: irradiance on a facing surface. \[W/m2\]
    pub value: S,
}

/// A photon that leaves a light.
#[derive(Debug, Clone, Copy)]
pub struct Emitted<S> {
    /// Start and direction.
    pub ray: Ray,
    /// Over the density of this photon: the mean over photons is the light's power toward the target. \[W\]
    pub power: S,
}

/// A direction within 1 - cosine `spread` of `axis`, uniform in solid angle.
fn in_cone(axis: Vec3, spread: f32, u: [f32; 2]) -> Vec3 {
    let gap = spread * u[0];
    crate::phase::around(axis, gap, 2.0 - gap, 2.0 * PI * u[1])
}

/// A cosine-distributed direction around a normal.
#[must_use]
pub fn cosine_hemisphere(normal: Vec3, u: [f32; 2]) -> Vec3 {
    let cos = (1.0 - u[0]).sqrt();
    crate::phase::around(normal, 1.0 - cos, 1.0 + cos, 2.0 * PI * u[1])
}

/// Axis, and 1 - cosine of the half angle, under which a sphere is seen; none from inside.
fn sphere_cone(from: Vec3, center: Vec3, radius: f32) -> Option<(Vec3, f32)> {
    let to = center - from;
    let distance2 = to.length_squared();
    if distance2 <= radius * radius {
        return None;
    }
    // 1 - cos by sin^2 / (1 + cos): no cancellation for small, far spheres.
    let sin2 = radius * radius / distance2;
    let cos = (1.0 - sin2).sqrt();
    Some((to * distance2.sqrt().recip(), sin2 / (1.0 + cos)))
}

impl<S: Spectrum> Light<S> {
    /// From the scene, in a world whose origin is at `origin`; none for lights of another kind.
    #[must_use]
    pub fn from_scene(light: &scene::Light, origin: DVec3) -> Option<Self> {
        let place = |p: &DVec3| (*p - origin).as_vec3();
        Some(match light {
            scene::Light::Sun {
                direction,
                irradiance,
                angular_diameter,
            } => {
                let half = (0.5 * angular_diameter).to_radians();
                Self::Sun {
                    direction: direction.normalize().as_vec3(),
                    irradiance: S::from_rgb(*irradiance),
                    spread: (2.0 * (0.5 * half).sin().powi(2)) as f32,
                }
            }
            scene::Light::Sky { radiance } => Self::Sky {
                radiance: S::from_rgb(*radiance),
            },
            scene::Light::SkyImage { .. } => return None,
            scene::Light::Point { position, power } => Self::Point {
                position: place(position),
                power: S::from_rgb(*power),
            },
            scene::Light::Spot {
                position,
                direction,
                power,
                cone_angle,
                penumbra,
            } => {
                let gap = |degrees: f64| 2.0 * (0.5 * degrees.to_radians()).sin().powi(2);
                let cone = [gap(*cone_angle), gap((cone_angle - penumbra).max(0.0))];
                // The falloff is linear in 1 - cos, so its integral is the mean of both cones.
                let solid_angle = std::f64::consts::PI * (cone[0] + cone[1]);
                Self::Spot {
                    position: place(position),
                    direction: direction.normalize().as_vec3(),
                    intensity: S::from_rgb(*power * (1.0 / solid_angle) as f32),
                    cone: cone.map(|c| c as f32),
                }
            }
            scene::Light::Quad {
                corner,
                edge_u,
                edge_v,
                radiance,
            } => {
                let cross = edge_u.cross(*edge_v);
                Self::Quad {
                    corner: place(corner),
                    edges: [edge_u.as_vec3(), edge_v.as_vec3()],
                    normal: cross.normalize().as_vec3(),
                    area: cross.length() as f32,
                    radiance: S::from_rgb(*radiance),
                }
            }
            scene::Light::Sphere {
                center,
                radius,
                radiance,
            } => Self::Sphere {
                center: place(center),
                radius: *radius as f32,
                radiance: S::from_rgb(*radiance),
            },
        })
    }

    /// The emissive objects.
    #[must_use]
    pub fn from_surfaces(surfaces: &Surfaces) -> Vec<Self> {
        /// Points on an emitter that are averaged for its middle.
        const POINTS: u32 = 64;
        let middle = |emitter| {
            let mut sum = Vec3::ZERO;
            let mut rng = Rng::stream(0, Stage::Check, 0, 0);
            for _ in 0..POINTS {
                let u = [rng.uniform(), rng.uniform(), rng.uniform()];
                if let Some(point) = surfaces.sample_emitter(emitter, u) {
                    sum += point.position * (1.0 / POINTS as f32);
                }
            }
            sum
        };
        let emitters = surfaces.emitters().iter().enumerate();
        emitters
            .map(|(index, emitter)| Self::Emitter {
                index,
                center: middle(emitter),
                power: S::from_rgb(emitter.power()),
            })
            .collect()
    }

    /// Light at `p` from a sampled direction; none where the light does not shine. A sky is not
    /// sampled: rays that leave the scene meet it.
    #[inline]
    #[must_use]
    pub fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<LightSample<S>> {
        match *self {
            Self::Sun {
                direction,
                irradiance,
                spread,
            } => {
                let direction = if spread > 0.0 {
                    in_cone(-direction, spread, u)
                } else {
                    -direction
                };
                Some(LightSample {
                    direction,
                    distance: f32::INFINITY,
                    value: irradiance,
                })
            }
            Self::Sky { .. } | Self::Emitter { .. } => None,
            Self::Point { position, power } => {
                let (direction, distance) = toward(p, position)?;
                let value = power * (1.0 / (4.0 * PI * distance * distance));
                Some(LightSample {
                    direction,
                    distance,
                    value,
                })
            }
            Self::Spot {
                position,
                direction: axis,
                intensity,
                cone,
            } => {
                let (direction, distance) = toward(p, position)?;
                let share = falloff(cone, axis, -direction);
                let value = intensity * (share / (distance * distance));
                (share > 0.0).then_some(LightSample {
                    direction,
                    distance,
                    value,
                })
            }
            Self::Quad {
                corner,
                edges,
                normal,
                area,
                radiance,
            } => {
                let (direction, distance) = toward(p, corner + edges[0] * u[0] + edges[1] * u[1])?;
                let cos = -direction.dot(normal);
                let value = radiance * (area * cos / (distance * distance));
                (cos > 0.0).then_some(LightSample {
                    direction,
                    distance,
                    value,
                })
            }
            Self::Sphere {
                center,
                radius,
                radiance,
            } => {
                let (axis, spread) = sphere_cone(p, center, radius)?;
                let direction = in_cone(axis, spread, u);
                let along = (center - p).dot(direction);
                let off = (center - p - direction * along).length_squared();
                let distance = along - (radius * radius - off).max(0.0).sqrt();
                Some(LightSample {
                    direction,
                    distance,
                    value: radiance * (2.0 * PI * spread),
                })
            }
        }
    }

    /// Where a local light is, for sampling near it; none of distant ones. \[m\]
    #[must_use]
    pub fn position(&self) -> Option<Vec3> {
        match *self {
            Self::Sun { .. } | Self::Sky { .. } => None,
            Self::Point { position, .. } | Self::Spot { position, .. } => Some(position),
            Self::Quad { corner, edges, .. } => Some(corner + 0.5 * (edges[0] + edges[1])),
            Self::Sphere { center, .. } | Self::Emitter { center, .. } => Some(center),
        }
    }

    /// True of a light that rays meet when they leave the scene.
    #[must_use]
    pub fn is_sky(&self) -> bool {
        matches!(self, Self::Sky { .. })
    }

    /// Power toward the target, about: how photons are shared out among the lights. \[W\]
    #[must_use]
    pub fn power_toward(&self, target: &Bounds) -> f32 {
        let size = target.size();
        let surface = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        let inside = |position: Vec3| {
            sphere_cone(position, target.center(), target.radius()).map_or(1.0, |(_, s)| 0.5 * s)
        };
        match *self {
            Self::Sun {
                direction,
                irradiance,
                ..
            } => irradiance.mean() * projected_faces(target, direction).1,
            Self::Sky { radiance } => radiance.mean() * PI * surface,
            Self::Point { position, power } => power.mean() * inside(position),
            Self::Spot {
                position,
                intensity,
                cone,
                ..
            } => {
                let solid_angle = (4.0 * PI * inside(position)).min(PI * (cone[0] + cone[1]));
                intensity.mean() * solid_angle
            }
            Self::Quad {
                corner,
                edges,
                area,
                radiance,
                ..
            } => {
                let middle = corner + 0.5 * (edges[0] + edges[1]);
                radiance.mean() * area * PI * (4.0 * inside(middle)).min(1.0)
            }
            Self::Sphere {
                center,
                radius,
                radiance,
            } => radiance.mean() * 4.0 * PI * PI * radius * radius * inside(center),
            Self::Emitter { power, .. } => power.mean(),
        }
    }

    /// A photon from an emissive object; see [`emit`](Self::emit).
    #[must_use]
    pub fn emit_from_object(
        surfaces: &Surfaces,
        emitter: usize,
        target: &Bounds,
        u: [f32; 4],
        rng: &mut Rng,
    ) -> Option<Emitted<S>> {
        let emitter = &surfaces.emitters()[emitter];
        let point = surfaces.sample_emitter(emitter, [rng.uniform(), u[0], u[1]])?;
        let radiance = S::from_rgb(point.radiance);
        let aim = [u[2], u[3]];
        let mut emitted = emit_from_surface(
            point.position,
            point.normal,
            1.0 / point.pdf,
            radiance,
            target,
            aim,
        )?;
        emitted.ray.origin = point.spawn_origin(emitted.ray.direction);
        Some(emitted)
    }

    /// A photon toward the target; none where it carries nothing, or from an emissive object, which
    /// this page does not know. `u` places it on the light and
    /// aims it, `rng` draws what these four do not decide.
    #[must_use]
    pub fn emit(&self, target: &Bounds, u: [f32; 4], rng: &mut Rng) -> Option<Emitted<S>> {
        let (point, aim) = ([u[0], u[1]], [u[2], u[3]]);
        match *self {
            Self::Sun {
                direction,
                irradiance,
                spread,
            } => {
                let direction = if spread > 0.0 {
                    in_cone(direction, spread, aim)
                } else {
                    direction
                };
                let (faces, area) = projected_faces(target, direction);
                let origin = on_faces(target, &faces, area, point, rng);
                Some(Emitted {
                    ray: Ray { origin, direction },
                    power: irradiance * area,
                })
            }
            Self::Sky { radiance } => {
                let size = target.size();
                let half = [size.y * size.z, size.z * size.x, size.x * size.y];
                let surface = 2.0 * (half[0] + half[1] + half[2]);
                let faces = [-half[0], -half[1], -half[2]];
                let mut origin = on_faces(target, &faces, 0.5 * surface, point, rng);
                // Half of the faces: mirrored through the middle with even odds.
                let mut inward = face_normal(target, origin);
                if rng.below(2) == 1 {
                    origin = target.min + target.max - origin;
                    inward = -inward;
                }
                let direction = cosine_hemisphere(inward, aim);
                Some(Emitted {
                    ray: Ray { origin, direction },
                    power: radiance * (PI * surface),
                })
            }
            Self::Point { position, power } => {
                let (direction, share) =
                    match sphere_cone(position, target.center(), target.radius()) {
                        Some((axis, spread)) => (in_cone(axis, spread, aim), 0.5 * spread),
                        None => (in_cone(Vec3::Z, 2.0, aim), 1.0),
                    };
                Some(Emitted {
                    ray: Ray {
                        origin: position,
                        direction,
                    },
                    power: power * share,
                })
            }
            Self::Spot {
                position,
                direction: axis,
                intensity,
                cone,
            } => {
                let around = sphere_cone(position, target.center(), target.radius());
                let (aim_axis, spread) = around
                    .filter(|(_, s)| *s < cone[0])
                    .unwrap_or((axis, cone[0]));
                let direction = in_cone(aim_axis, spread, aim);
                let share = falloff(cone, axis, direction);
                let power = intensity * (share * 2.0 * PI * spread);
                (share > 0.0).then_some(Emitted {
                    ray: Ray {
                        origin: position,
                        direction,
                    },
                    power,
                })
            }
            Self::Quad {
                corner,
                edges,
                normal,
                area,
                radiance,
            } => {
                let origin = corner + edges[0] * point[0] + edges[1] * point[1];
                emit_from_surface(origin, normal, area, radiance, target, aim)
            }
            Self::Sphere {
                center,
                radius,
                radiance,
            } => {
                let normal = in_cone(Vec3::Z, 2.0, point);
                let area = 4.0 * PI * radius * radius;
                emit_from_surface(
                    center + normal * radius,
                    normal,
                    area,
                    radiance,
                    target,
                    aim,
                )
            }
            Self::Emitter { .. } => None,
        }
    }

    /// Where a camera ray meets the light's own surface, and its radiance.
    #[must_use]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        match *self {
            Self::Quad {
                corner,
                edges,
                normal,
                radiance,
                ..
            } => {
                let cos = ray.direction.dot(normal);
                if cos >= 0.0 {
                    return None;
                }
                let t = (corner - ray.origin).dot(normal) / cos;
                let p = ray.at(t) - corner;
                // Barycentric in the parallelogram's own, perhaps oblique, axes.
                let cross = edges[0].cross(edges[1]);
                let scale = 1.0 / cross.length_squared();
                let a = p.cross(edges[1]).dot(cross) * scale;
                let b = edges[0].cross(p).dot(cross) * scale;
                let inside = (0.0..=1.0).contains(&a) && (0.0..=1.0).contains(&b);
                (inside && t > 0.0 && t < t_max).then_some((t, radiance))
            }
            Self::Sphere {
                center,
                radius,
                radiance,
            } => {
                let to = center - ray.origin;
                let along = to.dot(ray.direction);
                let half2 = radius * radius - (to - ray.direction * along).length_squared();
                let t = along - half2.max(0.0).sqrt();
                (half2 > 0.0 && t > 0.0 && t < t_max).then_some((t, radiance))
            }
            _ => None,
        }
    }

    /// Radiance of a distant light seen along a direction of view.
    #[must_use]
    pub fn background(&self, view: Vec3) -> S {
        match *self {
            Self::Sky { radiance } => radiance,
            Self::Sun {
                direction,
                irradiance,
                spread,
            } if spread > 0.0 => {
                let gap = 0.5 * (view + direction).length_squared();
                // The disc's projected solid angle is pi sin^2 = pi spread (2 - spread).
                if gap <= spread {
                    irradiance * (1.0 / (PI * spread * (2.0 - spread)))
                } else {
                    S::ZERO
                }
            }
            _ => S::ZERO,
        }
    }
}

/// Unit direction and distance from `p` to `q`; none where they coincide.
#[inline]
fn toward(p: Vec3, q: Vec3) -> Option<(Vec3, f32)> {
    let to = q - p;
    let distance = to.length();
    (distance > 0.0).then(|| (to / distance, distance))
}

/// Share of a spot's intensity in a direction: 1 inside the inner cone, linear in 1 - cos beyond.
#[inline]
fn falloff(cone: [f32; 2], axis: Vec3, direction: Vec3) -> f32 {
    let gap = 0.5 * (axis - direction).length_squared();
    if gap <= cone[1] {
        1.0
    } else if gap >= cone[0] {
        0.0
    } else {
        (cone[0] - gap) / (cone[0] - cone[1])
    }
}

/// A photon from a point of a Lambertian surface.
fn emit_from_surface<S: Spectrum>(
    origin: Vec3,
    normal: Vec3,
    area: f32,
    radiance: S,
    target: &Bounds,
    aim: [f32; 2],
) -> Option<Emitted<S>> {
    // A cone of a quarter hemisphere or more: cosine sampling wastes less than its weights vary.
    if let Some((axis, spread)) = sphere_cone(origin, target.center(), target.radius())
        && spread < 0.25
    {
        let direction = in_cone(axis, spread, aim);
        let cos = direction.dot(normal);
        let power = radiance * (area * cos * 2.0 * PI * spread);
        return (cos > 0.0).then_some(Emitted {
            ray: Ray { origin, direction },
            power,
        });
    }
    let direction = cosine_hemisphere(normal, aim);
    Some(Emitted {
        ray: Ray { origin, direction },
        power: radiance * (PI * area),
    })
}

/// Signed projected areas of the box's faces that light along `direction` enters by (one per
/// axis; the sign is the direction's), and their sum.
fn projected_faces(target: &Bounds, direction: Vec3) -> ([f32; 3], f32) {
    let size = target.size();
    let faces = [
        direction.x * size.y * size.z,
        direction.y * size.z * size.x,
        direction.z * size.x * size.y,
    ];
    (faces, faces.iter().map(|f| f.abs()).sum())
}

/// A point on the entered faces, uniform in projected area.
fn on_faces(target: &Bounds, faces: &[f32; 3], area: f32, u: [f32; 2], rng: &mut Rng) -> Vec3 {
    let mut pick = rng.uniform() * area;
    let mut axis = 2;
    for (a, face) in faces.iter().enumerate() {
        if pick < face.abs() {
            axis = a;
            break;
        }
        pick -= face.abs();
    }
    let mut s = Vec3::ZERO;
    s[(axis + 1) % 3] = u[0];
    s[(axis + 2) % 3] = u[1];
    s[axis] = if faces[axis] > 0.0 { 0.0 } else { 1.0 };
    target.min + target.size() * s
}

/// Inward normal of the face that a point of the upper faces lies on.
fn face_normal(target: &Bounds, p: Vec3) -> Vec3 {
    let gap = (target.max - p).abs();
    if gap.x <= gap.y && gap.x <= gap.z {
        Vec3::NEG_X
    } else if gap.y <= gap.z {
        Vec3::NEG_Y
    } else {
        Vec3::NEG_Z
    }
}
