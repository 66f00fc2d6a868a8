//! Lights: what reaches a point from them, and photons that leave them; one kind a file.
//!
//! ```text
//! at a point      integral of L over the light's directions  ~  value(sample)      [W/m2]
//! photons         Phi = power / (probability of the light * photons emitted)       \[W\]
//! ```
//!
//! Photons are aimed at a target box (the media, and surfaces that can send light on): a photon
//! that cannot hit it would carry nothing. From a sun they start on the box's faces that it sees,
//! exactly the projected box; from a picture of the sky alike; from a plain sky on the whole surface
//! with a cosine distribution, so that the flux through a convex box is exact; from local lights inside the cone around the target's
//! sphere wherever that is the smaller set of directions.
//!
//! Sources: Jensen 2001 (photon emission); Arvo & Kirk 1990 (Russian roulette by power).

mod directions;
mod disk;
mod emitter;
mod glow;
mod gobo;
mod point;
mod quad;
mod sky;
mod sky_picture;
mod sphere;
mod spot;
mod sun;
mod target;

use std::f32::consts::PI;
use std::path::PathBuf;

use glam::{DVec3, Vec3};

pub use directions::cosine_hemisphere;
pub use disk::Disk;
pub use emitter::Emitter;
pub use glow::Glow;
use gobo::Gobo;
pub use point::Point;
pub use quad::Quad;
pub use sky::Sky;
pub use sky_picture::SkyPicture;
pub use sphere::Sphere;
pub use spot::Spot;
pub use sun::Sun;

use crate::ray::{Bounds, Ray};
use crate::rng::Rng;
use crate::scene;
use crate::spectrum::Spectrum;
use crate::surface::Surfaces;

/// A light that cannot be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LightError {
    /// The picture of a sky.
    #[error("sky light")]
    Sky(#[from] crate::image::ImageError),
    /// Pixels that are no radiance.
    #[error(
        "sky light: {count} of the {of} pixels of {} are negative or not finite; radiance has to \
         be finite and 0 or more", file.display()
    )]
    BadPixels {
        /// The picture.
        file: PathBuf,
        /// How many.
        count: usize,
        /// Of how many.
        of: usize,
    },
    /// The picture in a spot.
    #[error("spot light")]
    Gobo(#[from] crate::surface::TextureError),
}

/// A light in the renderer's world.
#[derive(Debug, Clone)]
pub enum Light<S> {
    /// A distant disc.
    Sun(Sun<S>),
    /// Uniform radiance from everywhere.
    Sky(Sky<S>),
    /// A picture of the sky.
    SkyPicture(SkyPicture<S>),
    /// A point.
    Point(Point<S>),
    /// A point that shines into a cone.
    Spot(Spot<S>),
    /// A one-sided parallelogram.
    Quad(Quad<S>),
    /// A one-sided disk.
    Disk(Disk<S>),
    /// A sphere.
    Sphere(Sphere<S>),
    /// A medium that shines; [`Glow::emit`] sends its photons.
    Glow(Glow<S>),
    /// An emissive object; [`World::sample_light`](crate::world::World::sample_light) knows its
    /// surface.
    Emitter(Emitter<S>),
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

impl<S: Spectrum> Light<S> {
    /// From the scene, in a world whose origin is at `origin`.
    ///
    /// # Errors
    /// [`LightError`]: a picture that cannot be read or used.
    pub fn from_scene(light: &scene::Light, origin: DVec3) -> Result<Self, LightError> {
        let place = |p: &DVec3| (*p - origin).as_vec3();
        Ok(match light {
            scene::Light::Sun {
                direction,
                irradiance,
                angular_diameter,
            } => Self::Sun(Sun::new(
                *direction,
                S::from_rgb(*irradiance),
                *angular_diameter,
            )),
            scene::Light::Sky { radiance } => Self::Sky(Sky {
                radiance: S::from_rgb(*radiance),
            }),
            scene::Light::SkyImage { file, scale } => {
                Self::SkyPicture(SkyPicture::load(file, *scale)?)
            }
            scene::Light::Point { position, power } => Self::Point(Point {
                position: place(position),
                power: S::from_rgb(*power),
            }),
            scene::Light::Spot {
                position,
                direction,
                power,
                cone_angle,
                penumbra,
                image,
            } => {
                let aim = (place(position), *direction);
                let gobo = image.as_deref().map(Gobo::load).transpose()?;
                Self::Spot(Spot::new(aim, *power, [*cone_angle, *penumbra], gobo))
            }
            scene::Light::Quad {
                corner,
                edge_u,
                edge_v,
                radiance,
            } => {
                let corner = place(corner);
                Self::Quad(Quad::new(corner, *edge_u, *edge_v, S::from_rgb(*radiance)))
            }
            scene::Light::Disk {
                center,
                normal,
                radius,
                radiance,
            } => {
                let center = place(center);
                Self::Disk(Disk::new(center, *normal, *radius, S::from_rgb(*radiance)))
            }
            scene::Light::Sphere {
                center,
                radius,
                radiance,
            } => Self::Sphere(Sphere {
                center: place(center),
                radius: *radius as f32,
                radiance: S::from_rgb(*radiance),
            }),
        })
    }

    /// The emissive objects.
    #[must_use]
    pub fn from_surfaces(surfaces: &Surfaces) -> Vec<Self> {
        (0..surfaces.emitters().len())
            .map(|index| Self::Emitter(Emitter::new(surfaces, index)))
            .collect()
    }

    /// Light at `p` from a sampled direction; none where the light does not shine. A plain sky is
    /// not sampled, rays that leave the scene meet it; nor is a glow, which photons bring.
    #[inline]
    #[must_use]
    pub fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<LightSample<S>> {
        match self {
            Self::Sun(sun) => Some(sun.sample(u)),
            Self::Sky(_) | Self::Glow(_) | Self::Emitter(_) => None,
            Self::SkyPicture(sky) => sky.sample(u),
            Self::Point(point) => point.sample(p),
            Self::Spot(spot) => spot.sample(p),
            Self::Quad(quad) => quad.sample(p, u),
            Self::Disk(disk) => disk.sample(p, u),
            Self::Sphere(sphere) => sphere.sample(p, u),
        }
    }

    /// Where a local light is, for sampling near it; none of distant ones. \[m\]
    #[must_use]
    pub fn position(&self) -> Option<Vec3> {
        match self {
            Self::Sun(_) | Self::Sky(_) | Self::SkyPicture(_) | Self::Glow(_) => None,
            Self::Point(point) => Some(point.position),
            Self::Spot(spot) => Some(spot.position),
            Self::Quad(quad) => Some(quad.middle()),
            Self::Disk(disk) => Some(disk.plane().0),
            Self::Sphere(sphere) => Some(sphere.center),
            Self::Emitter(emitter) => Some(emitter.center),
        }
    }

    /// True of a sky that nobody samples: rays that leave the scene meet it.
    #[must_use]
    pub fn is_sky(&self) -> bool {
        matches!(self, Self::Sky(_))
    }

    /// True of a light that points on it, or directions to it, are drawn from.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        match self {
            Self::Sun(sun) => sun.is_disc(),
            Self::Point(_) | Self::Spot(_) | Self::Sky(_) | Self::Glow(_) => false,
            Self::SkyPicture(_)
            | Self::Quad(_)
            | Self::Disk(_)
            | Self::Sphere(_)
            | Self::Emitter(_) => true,
        }
    }

    /// True of a light that points are joined to: its first order need not come from photons.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        !matches!(self, Self::Sky(_) | Self::Glow(_))
    }

    /// True of a light whose straight light on surfaces comes from photons too.
    #[must_use]
    pub fn is_glow(&self) -> bool {
        matches!(self, Self::Glow(_))
    }

    /// About the intensity of a local light \[W/sr\], or the irradiance by a distant one \[W/m2\]:
    /// how samples are shared out among lights. Above 0 for any light that shines.
    #[must_use]
    pub fn brightness(&self) -> f32 {
        match self {
            Self::Sun(sun) => sun.irradiance(),
            Self::Sky(sky) => sky.radiance.mean() * 4.0 * PI,
            Self::SkyPicture(sky) => sky.fluence(),
            Self::Point(point) => point.intensity(),
            Self::Spot(spot) => spot.intensity(),
            Self::Quad(quad) => quad.intensity(),
            Self::Disk(disk) => disk.intensity(),
            Self::Sphere(sphere) => sphere.intensity(),
            Self::Glow(glow) => glow.power.mean() * (0.25 / PI),
            Self::Emitter(emitter) => emitter.power.mean() * (0.25 / PI),
        }
    }

    /// The part of the stretch (a, b) of a ray outside of which the light cannot be seen; none
    /// where it cannot be seen at all.
    #[inline]
    #[must_use]
    pub fn shines_along(&self, ray: &Ray, (a, b): (f32, f32)) -> Option<(f32, f32)> {
        match self {
            Self::Spot(spot) => spot.shines_along(ray, (a, b)),
            Self::Quad(quad) => before(quad.plane(), ray, (a, b)),
            Self::Disk(disk) => before(disk.plane(), ray, (a, b)),
            _ => Some((a, b)),
        }
    }

    /// True where the light may be seen from `p`, blockers aside.
    #[inline]
    #[must_use]
    pub fn shines_on(&self, p: Vec3) -> bool {
        let front = |(q, normal): (Vec3, Vec3)| (p - q).dot(normal) > 0.0;
        match self {
            Self::Spot(spot) => spot.lights(p),
            Self::Quad(quad) => front(quad.plane()),
            Self::Disk(disk) => front(disk.plane()),
            _ => true,
        }
    }

    /// Power toward the target, about: how photons are shared out among the lights. \[W\]
    #[must_use]
    pub fn power_toward(&self, target: &Bounds) -> f32 {
        match self {
            Self::Sun(sun) => sun.power_toward(target),
            Self::Sky(sky) => sky.power_toward(target),
            Self::SkyPicture(sky) => sky.power_toward(target),
            Self::Point(point) => point.power_toward(target),
            Self::Spot(spot) => spot.power_toward(target),
            Self::Quad(quad) => quad.power_toward(target),
            Self::Disk(disk) => disk.power_toward(target),
            Self::Sphere(sphere) => sphere.power_toward(target),
            Self::Glow(glow) => glow.power.mean(),
            Self::Emitter(emitter) => emitter.power.mean(),
        }
    }

    /// A photon toward the target; none where it carries nothing, or from an emissive object or medium,
    /// which this page does not know. `u` places it on the light and aims it, `rng` draws what these four do not decide.
    #[must_use]
    pub fn emit(&self, target: &Bounds, u: [f32; 4], rng: &mut Rng) -> Option<Emitted<S>> {
        let (point, aim) = ([u[0], u[1]], [u[2], u[3]]);
        match self {
            Self::Sun(sun) => Some(sun.emit(target, point, aim, rng)),
            Self::Sky(sky) => Some(sky.emit(target, point, aim, rng)),
            Self::SkyPicture(sky) => sky.emit(target, point, aim, rng),
            Self::Point(point) => Some(point.emit(target, aim)),
            Self::Spot(spot) => spot.emit(target, aim),
            Self::Quad(quad) => quad.emit(target, point, aim),
            Self::Disk(disk) => disk.emit(target, point, aim),
            Self::Sphere(sphere) => sphere.emit(target, point, aim),
            Self::Glow(_) | Self::Emitter(_) => None,
        }
    }

    /// Where a camera ray meets the light's own surface, and its radiance.
    #[must_use]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(f32, S)> {
        match self {
            Self::Quad(quad) => quad.intersect(ray, t_max),
            Self::Disk(disk) => disk.intersect(ray, t_max),
            Self::Sphere(sphere) => sphere.intersect(ray, t_max),
            _ => None,
        }
    }

    /// Radiance of a distant light seen along a direction of view.
    #[must_use]
    pub fn background(&self, view: Vec3) -> S {
        match self {
            Self::Sky(sky) => sky.radiance,
            Self::SkyPicture(sky) => sky.radiance(view),
            Self::Sun(sun) => sun.background(view),
            _ => S::ZERO,
        }
    }
}

/// The part of a stretch of a ray that lies before a plane.
fn before((q, normal): (Vec3, Vec3), ray: &Ray, (a, b): (f32, f32)) -> Option<(f32, f32)> {
    let height = (ray.origin - q).dot(normal);
    let slope = ray.direction.dot(normal);
    let cut = -height / slope;
    let (start, end) = if slope > 0.0 {
        (cut.max(a), b)
    } else if slope < 0.0 {
        (a, cut.min(b))
    } else if height > 0.0 {
        (a, b)
    } else {
        return None;
    };
    (start < end).then_some((start, end))
}
