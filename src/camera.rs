//! The camera: pixel and sample to world ray.
//!
//! A pinhole sends rays through a plane at distance 1; a thin lens of radius R moves the start
//! over its aperture and aims at the point in focus, at the distance of the focal plane along the
//! view direction. The vertical field of view spans the picture's height. Pixel (0, 0) is top
//! left. Rays have unit length.

use glam::{DVec3, Vec3};

use crate::ray::Ray;
use crate::scene;

/// A camera in the renderer's world.
#[derive(Debug, Clone)]
pub struct Camera {
    /// \[m\]
    pub position: Vec3,
    /// Right, up, forward.
    frame: [DVec3; 3],
    /// Half the picture at distance 1, width and height.
    half: [f64; 2],
    resolution: [f64; 2],
    lens: Option<scene::Lens>,
}

impl Camera {
    /// From the scene, in a world whose origin is at `origin`.
    #[must_use]
    pub fn new(camera: &scene::Camera, origin: DVec3) -> Self {
        let forward = (camera.look_at - camera.position).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let resolution = camera.resolution.map(f64::from);
        let height = (0.5 * camera.vertical_fov.to_radians()).tan();
        Self {
            position: (camera.position - origin).as_vec3(),
            frame: [right, up, forward],
            half: [height * resolution[0] / resolution[1], height],
            resolution,
            lens: camera.lens,
        }
    }

    /// The ray through a point of the picture \[px\], from a point of the lens.
    #[must_use]
    pub fn ray(&self, pixel: [f32; 2], lens: [f32; 2]) -> Ray {
        let [right, up, forward] = self.frame;
        let x = (2.0 * f64::from(pixel[0]) / self.resolution[0] - 1.0) * self.half[0];
        let y = (1.0 - 2.0 * f64::from(pixel[1]) / self.resolution[1]) * self.half[1];
        let direction = right * x + up * y + forward;
        let Some(thin) = self.lens else {
            return Ray {
                origin: self.position,
                direction: direction.normalize().as_vec3(),
            };
        };
        // Uniform on the disc.
        let radius = thin.radius * f64::from(lens[0]).sqrt();
        let (s, c) = (std::f64::consts::TAU * f64::from(lens[1])).sin_cos();
        let start = right * (radius * c) + up * (radius * s);
        let aim = direction * thin.focus_distance - start;
        Ray {
            origin: self.position + start.as_vec3(),
            direction: aim.normalize().as_vec3(),
        }
    }

    /// True where all rays start at one point.
    #[must_use]
    pub fn is_pinhole(&self) -> bool {
        self.lens.is_none()
    }

    /// The picture point \[px\] and view depth \[m\] of a world point in front of a pinhole.
    #[must_use]
    pub fn project(&self, p: Vec3) -> Option<([f32; 2], f32)> {
        let to = (p - self.position).as_dvec3();
        let [right, up, forward] = self.frame;
        let depth = to.dot(forward);
        if depth <= 0.0 {
            return None;
        }
        let x = (to.dot(right) / depth / self.half[0] + 1.0) * 0.5 * self.resolution[0];
        let y = (1.0 - to.dot(up) / depth / self.half[1]) * 0.5 * self.resolution[1];
        Some(([x as f32, y as f32], depth as f32))
    }

    /// Right, up and forward; unit vectors.
    #[must_use]
    pub fn frame(&self) -> [Vec3; 3] {
        self.frame.map(|v| v.as_vec3())
    }

    /// The picture point straight ahead. \[px\]
    #[must_use]
    pub fn principal_point(&self) -> [f32; 2] {
        self.resolution.map(|r| (0.5 * r) as f32)
    }

    /// Pixels per unit of slope (offset over view depth), across and down.
    #[must_use]
    pub fn pixels_per_slope(&self) -> [f32; 2] {
        [
            (0.5 * self.resolution[0] / self.half[0]) as f32,
            (0.5 * self.resolution[1] / self.half[1]) as f32,
        ]
    }
}
