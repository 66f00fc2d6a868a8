//! Pixels across which an edge of a surface runs: more camera rays for what lies behind the media.
//!
//! ```text
//! L of a pixel  ~  M(ray) + 1/n^2 sum over n x n strata of  T(ray') L(end of ray')
//! M             what the media send along a ray: photons, first order, emission
//! T, L(end)     transmittance, and radiance of the surface, lamp or sky at its end
//! ```
//!
//! What one ray a pass finds at an edge jumps from pass to pass: with thin smoke in a room that is
//! more noise than the photons make. Rays that gather no photons are cheap beside those that do, and
//! such pixels are few.
//!
//! Which pixels: those whose corners and middle do not see the same, be it in mirrors and through
//! glass: another object, another lamp, a surface turned by more than [`TURNED`] or set back. The
//! choice belongs to the pixel and not to what a ray of a pass finds, so it changes no expectation:
//! where an edge is missed, or a lens blurs it beyond, one ray is as right and noisier.

use glam::Vec3;
use rayon::prelude::*;

use crate::estimate::bands::TileGrid;
use crate::ray::Ray;
use crate::scene::Method;
use crate::spectrum::Spectrum;
use crate::surface::{Inside, Surfaces, Transport};
use crate::world::{World, passes};

/// Strata of a pixel along an edge, n. Fewer: grain along edges; more: rays.
pub(super) const STRATA: u32 = 2;

/// Difference of unit normals between which there is an edge.
const TURNED: f32 = 0.5;

/// Share of the way between two points by which one is off the other's plane, from which on there
/// is an edge. Less: bent surfaces at grazing angles are full of edges.
const SET_BACK: f32 = 0.5;

/// Specular events after which a sight ends.
const MOST_EVENTS: u32 = 6;

/// Events at which glass is seen both to reflect and to refract.
const SPLIT_EVENTS: u32 = 2;

/// The pixels of a crop, row by row; none without surfaces.
#[derive(Debug, Default)]
pub(super) struct EdgePixels {
    low: [u32; 2],
    width: usize,
    pixels: Vec<bool>,
}

impl EdgePixels {
    /// Of the pixels of `grid`. Paths look for surfaces in their own way.
    pub(super) fn new<S: Spectrum>(world: &World<S>, method: Method, grid: &TileGrid) -> Self {
        let Some(surfaces) = world.surfaces.as_ref().filter(|_| method != Method::Path) else {
            return Self::default();
        };
        let [x0, y0] = grid.low;
        let (width, height) = (grid.high[0] - x0, grid.high[1] - y0);
        let row = |y: f32, from: f32, count: u32| -> Vec<Sight> {
            (0..count)
                .map(|i| Sight::new(world, surfaces, [x0 as f32 + from + i as f32, y]))
                .collect()
        };
        let corners: Vec<Vec<Sight>> = (0..=height)
            .into_par_iter()
            .map(|y| row((y0 + y) as f32, 0.0, width + 1))
            .collect();
        let pixels = (0..height as usize)
            .into_par_iter()
            .flat_map_iter(|y| {
                let (above, below) = (&corners[y], &corners[y + 1]);
                let middles = row((y0 + y as u32) as f32 + 0.5, 0.5, width);
                let differ = move |(x, middle): (usize, Sight)| {
                    [&above[x], &above[x + 1], &below[x], &below[x + 1]]
                        .into_iter()
                        .any(|corner| corner.differs(&middle))
                };
                middles.into_iter().enumerate().map(differ)
            })
            .collect();
        Self {
            low: grid.low,
            width: width as usize,
            pixels,
        }
    }

    /// True where what is behind the media has rays of its own.
    #[inline]
    pub(super) fn holds(&self, [x, y]: [u32; 2]) -> bool {
        let at = (y - self.low[1]) as usize * self.width + (x - self.low[0]) as usize;
        self.pixels.get(at).copied().unwrap_or(false)
    }
}

/// What is seen at a point of the picture.
#[derive(Debug, Clone, Copy)]
struct Sight {
    /// Objects and lamps on the way, in one number.
    objects: u64,
    /// The surface at the end, 0 without one.
    position: Vec3,
    normal: Vec3,
}

impl Sight {
    fn new<S: Spectrum>(world: &World<S>, surfaces: &Surfaces, point: [f32; 2]) -> Self {
        let mut sight = Self {
            objects: 0,
            position: Vec3::ZERO,
            normal: Vec3::ZERO,
        };
        let ray = world.camera.ray(point, [0.0; 2]);
        sight.follow((world, surfaces), ray, world.camera_inside, 0);
        sight
    }

    /// Follows a ray to its ends.
    fn follow<S: Spectrum>(
        &mut self,
        (world, surfaces): (&World<S>, &Surfaces),
        mut ray: Ray,
        mut inside: Inside,
        mut events: u32,
    ) {
        while events <= MOST_EVENTS {
            let hit = surfaces.intersect(ray.origin, ray.direction, f32::INFINITY);
            let t_hit = hit.as_ref().map_or(f32::INFINITY, |hit| hit.t);
            if let Some((_, radiance)) = world.seen_light(&ray, t_hit) {
                // Lamps of one colour need not be told apart.
                let bits = radiance.to_rgb().to_array().map(f32::to_bits);
                bits.into_iter().for_each(|bits| self.meet(bits));
                return;
            }
            let Some(hit) = hit else {
                self.meet(u32::MAX);
                return;
            };
            if passes(surfaces, &hit, &inside) {
                surfaces.cross(&hit, ray.direction, &mut inside);
                ray.origin = hit.spawn_origin(ray.direction);
                events += 1;
                continue;
            }
            self.meet(hit.object);
            events += 1;
            let bsdf = surfaces.bsdf(&hit);
            let on = |direction| Ray {
                origin: hit.spawn_origin(direction),
                direction,
            };
            if events <= SPLIT_EVENTS
                && let Some([reflected, refracted]) = bsdf.split(ray.direction, Transport::Radiance)
            {
                let mirrored = on(reflected.direction);
                self.follow((world, surfaces), mirrored, inside, MOST_EVENTS);
                surfaces.cross(&hit, refracted.direction, &mut inside);
                ray = on(refracted.direction);
                continue;
            }
            let one = if bsdf.is_specular() {
                // Through glass rather than off it.
                bsdf.sample(ray.direction, [0.999_999, 0.0, 0.0], Transport::Radiance)
            } else {
                None
            };
            let Some(sample) = one else {
                (self.position, self.normal) = (hit.position, hit.facing());
                return;
            };
            if sample.transmitted {
                surfaces.cross(&hit, sample.direction, &mut inside);
            }
            ray = on(sample.direction);
        }
    }

    /// Adds an object.
    fn meet(&mut self, object: u32) {
        // Odd and without a pattern (Knuth 1998, section 6.4): the order counts.
        self.objects = (self.objects ^ u64::from(object)).wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1;
    }

    /// True if there is an edge between two sights.
    fn differs(&self, other: &Self) -> bool {
        let way = self.position - other.position;
        let off = way.dot(self.normal).abs().max(way.dot(other.normal).abs());
        self.objects != other.objects
            || self.normal.distance_squared(other.normal) > TURNED * TURNED
            || off > SET_BACK * way.length()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use crate::scene::{Material, Object, Rgb, Scene, Shape};
    use crate::selftest::fields::scene;

    const SIDE: u32 = 128;
    const RADIUS: f64 = 0.2;

    fn object(shape: Shape, material: Material) -> Object {
        Object {
            name: "object".to_owned(),
            shape,
            transform: DAffine3::IDENTITY,
            material,
            interior: None,
        }
    }

    /// A ball before a mirror that fills the picture, and where its image stands behind it.
    fn ball_before_a_mirror() -> (Scene, [DVec3; 2]) {
        let mut scene = scene(4.0, [SIDE, SIDE]);
        let center = DVec3::new(1.0, 0.1, 0.5);
        let mirror = Shape::Quad {
            corner: DVec3::new(-3.0, -3.0, -1.0),
            edge_u: DVec3::X * 6.0,
            edge_v: DVec3::Y * 6.0,
        };
        scene.objects = vec![
            object(
                Shape::Sphere {
                    center,
                    radius: RADIUS,
                },
                Material::Diffuse {
                    reflectance: Rgb::splat(0.5),
                    texture: None,
                },
            ),
            object(
                mirror,
                Material::Mirror {
                    reflectance: Rgb::ONE,
                },
            ),
        ];
        let image = center.with_z(-2.0 - center.z);
        (scene, [center, image])
    }

    /// Pixels across which the outline of a ball or of its mirror image runs have rays of their own, and
    /// none two pixels away; a crop has the same ones.
    #[test]
    fn outlines_are_found_and_nothing_else() {
        let (scene, balls) = ball_before_a_mirror();
        let world = World::<f32>::new(&scene, Vec::new()).expect("a world");
        let balls = balls.map(|ball| (ball - world.origin).as_vec3());
        let pixels = |low, high| EdgePixels::new(&world, Method::Beam, &TileGrid { low, high });
        let all = pixels([0; 2], [SIDE; 2]);
        let crop = pixels([60, 50], [128, 80]);
        // Distance of a point of the picture from an outline, over that of a pixel, roughly.
        let off = |point: [f32; 2]| {
            let ray = world.camera.ray(point, [0.0; 2]);
            let outline = |ball: Vec3| {
                let way = ball - ray.origin;
                let along = way.dot(ray.direction);
                let pixel = along / world.camera.pixels_per_slope()[1];
                ((way - along * ray.direction).length() - RADIUS as f32) / pixel
            };
            balls
                .map(outline)
                .into_iter()
                .map(f32::abs)
                .fold(f32::INFINITY, f32::min)
        };
        let (mut found, mut far) = (0, 0);
        for y in 0..SIDE {
            for x in 0..SIDE {
                let d = off([x as f32 + 0.5, y as f32 + 0.5]);
                let holds = all.holds([x, y]);
                assert!(holds || d > 0.3, "({x}, {y}) is {d} from an outline");
                assert!(!holds || d < 2.0, "({x}, {y}) is {d} from an outline");
                found += u32::from(holds);
                far += u32::from(!holds);
                if (60..128).contains(&x) && (50..80).contains(&y) {
                    assert_eq!(crop.holds([x, y]), holds, "({x}, {y}) in a crop");
                }
            }
        }
        assert!(found > 60 && far > 10_000, "{found} and {far} pixels");
        let paths = EdgePixels::new(
            &world,
            Method::Path,
            &TileGrid {
                low: [0; 2],
                high: [SIDE; 2],
            },
        );
        assert!(!paths.holds([0, 0]), "paths have none");
    }
}
