//! A sky from a lat-long picture, sampled in proportion to its radiance.
//!
//! ```text
//! theta = pi v (0 at +y, the first row),  phi = 2 pi u:   d = (-sin t sin p, cos t, sin t cos p)
//! pdf(w) = W_ij / (sum of W Omega)       W_ij = mean over pixel (i, j) of L bilinear      [1/sr]
//! Omega_j = (2 pi / width) (cos theta_j - cos theta_j+1)                                  \[sr\]
//! ```
//!
//! The middle of the picture is seen along -z, its right half toward +x, its top is +y. Radiance is
//! bilinear between pixel centres, around in u and held at the poles. A pixel is drawn from its
//! weight, a direction in it uniformly in solid angle; the weight is the mean of the bilinear
//! surface over the pixel, to first order the kernel (1 6 1)/8 along both axes, so it is above 0
//! wherever the radiance is. Photons take the same directions and start on the target's projected
//! box. Source: Pharr, Jakob & Humphreys 2023, section 12.5.2.

use std::f32::consts::PI;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::target::{on_faces, projected_faces};
use super::{Emitted, LightError, LightSample};
use crate::image::read_exr;
use crate::ray::{Bounds, Ray};
use crate::rng::Rng;
use crate::scene::Rgb;
use crate::spectrum::Spectrum;

/// See the module's page.
#[derive(Debug, Clone)]
pub struct SkyPicture<S> {
    width: usize,
    height: usize,
    /// \[W/(m2 sr)\]
    radiance: Arc<[S]>,
    /// Density of directions in each pixel. \[1/sr\]
    pdf: Arc<[f32]>,
    /// Upper ends of the rows' shares of [0, 1).
    rows: Arc<[f32]>,
    /// Upper ends of the pixels' shares of their row's [0, 1).
    columns: Arc<[f32]>,
    /// Mean radiance over all directions, of the mean channel. \[W/(m2 sr)\]
    mean: f32,
}

/// Upper ends of shares of [0, 1) in proportion to weights, the last exactly 1.
fn shares(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut upper: Vec<f32> = weights
        .iter()
        .map(|w| {
            sum += w;
            (sum / total) as f32
        })
        .collect();
    if let Some(last) = weights.iter().rposition(|w| *w > 0.0) {
        upper[last..].fill(1.0);
    }
    upper
}

/// Which share holds `u`, and where in it, in [0, 1).
fn find(upper: &[f32], u: f32) -> (usize, f32) {
    let i = upper.partition_point(|end| *end <= u).min(upper.len() - 1);
    let lower = if i == 0 { 0.0 } else { upper[i - 1] };
    let inside = (u - lower) / (upper[i] - lower).max(f32::MIN_POSITIVE);
    (i, inside.clamp(0.0, 1.0 - f32::EPSILON))
}

impl<S: Spectrum> SkyPicture<S> {
    /// Reads an EXR.
    pub(super) fn load(file: &Path, scale: f64) -> Result<Self, LightError> {
        let picture = read_exr(file)?;
        let bad = picture
            .rgb
            .iter()
            .filter(|p| !p.iter().all(|c| c.is_finite() && *c >= 0.0))
            .count();
        if bad > 0 {
            return Err(LightError::BadPixels {
                file: file.to_owned(),
                count: bad,
                of: picture.rgb.len(),
            });
        }
        let pixels = picture
            .rgb
            .iter()
            .map(|p| Rgb::from_array(*p) * scale as f32);
        let (width, height) = (picture.width as usize, picture.height as usize);
        Ok(Self::new(width, height, pixels.collect()))
    }

    /// From pixels, row by row from the top. \[W/(m2 sr)\]
    #[must_use]
    pub fn new(width: usize, height: usize, pixels: Vec<Rgb>) -> Self {
        let radiance: Vec<S> = pixels.into_iter().map(S::from_rgb).collect();
        let mean_of = |x: usize, y: usize| f64::from(radiance[y * width + x].mean());
        // Means of the bilinear surface over the pixels.
        let across = |x: usize, y: usize| {
            let (left, right) = ((x + width - 1) % width, (x + 1) % width);
            0.125 * (mean_of(left, y) + 6.0 * mean_of(x, y) + mean_of(right, y))
        };
        let weight = |x: usize, y: usize| {
            let (up, down) = (y.saturating_sub(1), (y + 1).min(height - 1));
            0.125 * (across(x, up) + 6.0 * across(x, y) + across(x, down))
        };
        let weights: Vec<f64> = (0..width * height)
            .map(|i| weight(i % width, i / width))
            .collect();
        let solid_angle = |y: usize| {
            let edge = |y: usize| (std::f64::consts::PI * y as f64 / height as f64).cos();
            std::f64::consts::TAU / width as f64 * (edge(y) - edge(y + 1))
        };
        let row_sums: Vec<f64> = weights
            .chunks(width)
            .enumerate()
            .map(|(y, row)| solid_angle(y) * row.iter().sum::<f64>())
            .collect();
        let total: f64 = row_sums.iter().sum();
        let pdf = weights.iter().map(|w| (w / total) as f32);
        Self {
            width,
            height,
            pdf: pdf.collect(),
            rows: shares(&row_sums).into(),
            columns: weights.chunks(width).flat_map(shares).collect(),
            mean: (total / (4.0 * std::f64::consts::PI)) as f32,
            radiance: radiance.into(),
        }
    }

    /// Column and row of a direction, not rounded.
    fn place(&self, d: Vec3) -> (f32, f32) {
        let theta = d.y.clamp(-1.0, 1.0).acos();
        let phi = (-d.x).atan2(d.z).rem_euclid(2.0 * PI);
        (
            phi * (0.5 / PI) * self.width as f32,
            theta * (1.0 / PI) * self.height as f32,
        )
    }

    /// Radiance from a direction of view. \[W/(m2 sr)\]
    #[must_use]
    pub fn radiance(&self, view: Vec3) -> S {
        let (x, y) = self.place(view);
        let (x, y) = (x - 0.5, (y - 0.5).clamp(0.0, (self.height - 1) as f32));
        let column = |x: f32| (x as isize).rem_euclid(self.width as isize) as usize;
        let (x0, x1, fx) = (column(x.floor()), column(x.floor() + 1.0), x - x.floor());
        let y0 = (y as usize).min(self.height - 1);
        let (y1, fy) = ((y0 + 1).min(self.height - 1), y - y0 as f32);
        let row = |y: usize| {
            let at = |x: usize| self.radiance[y * self.width + x];
            at(x0) * (1.0 - fx) + at(x1) * fx
        };
        row(y0) * (1.0 - fy) + row(y1) * fy
    }

    /// A direction toward the sky, and 1 over its density. \[sr\]
    fn direction(&self, u: [f32; 2]) -> (Vec3, f32) {
        let (j, v) = find(&self.rows, u[1]);
        let (i, h) = find(&self.columns[j * self.width..(j + 1) * self.width], u[0]);
        let edge = |j: usize| (PI * j as f32 / self.height as f32).cos();
        let cos = edge(j) + (edge(j + 1) - edge(j)) * v;
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (s, c) = (2.0 * PI * (i as f32 + h) / self.width as f32).sin_cos();
        let direction = Vec3::new(-sin * s, cos, sin * c);
        (direction, 1.0 / self.pdf[j * self.width + i])
    }

    pub(super) fn sample(&self, u: [f32; 2]) -> Option<LightSample<S>> {
        if self.mean <= 0.0 {
            return None;
        }
        let (direction, solid_angle) = self.direction(u);
        Some(LightSample {
            direction,
            distance: f32::INFINITY,
            value: self.radiance(direction) * solid_angle,
        })
    }

    /// Over all directions. \[W/m2\]
    pub(super) fn fluence(&self) -> f32 {
        4.0 * PI * self.mean
    }

    pub(super) fn power_toward(&self, target: &Bounds) -> f32 {
        // The mean projected area of a convex body is a quarter of its surface.
        0.25 * self.fluence() * super::target::surface(target)
    }

    pub(super) fn emit(
        &self,
        target: &Bounds,
        point: [f32; 2],
        aim: [f32; 2],
        rng: &mut Rng,
    ) -> Option<Emitted<S>> {
        let LightSample {
            direction, value, ..
        } = self.sample(aim)?;
        let direction = -direction;
        let (faces, area) = projected_faces(target, direction);
        let origin = on_faces(target, &faces, area, point, rng);
        Some(Emitted {
            ray: Ray { origin, direction },
            power: value * area,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture's middle, right, top and left edge look where the page says.
    #[test]
    fn pictures_look_where_they_should() {
        let mut pixels = vec![Rgb::ZERO; 16 * 8];
        pixels[4 * 16 + 8] = Rgb::ONE;
        let sky = SkyPicture::<f32>::new(16, 8, pixels);
        let (phi, theta) = (2.0 * PI * 8.5 / 16.0, PI * 4.5 / 8.0);
        let center = Vec3::new(
            -theta.sin() * phi.sin(),
            theta.cos(),
            theta.sin() * phi.cos(),
        );
        assert!((sky.radiance(center) - 1.0).abs() < 1e-5);
        assert!(center.z < -0.9 && center.x > 0.0, "{center}");
        assert_eq!(sky.radiance(Vec3::Y), 0.0);
        assert_eq!(sky.radiance(Vec3::Z), 0.0);
    }

    /// Radiance over density integrates to the fluence that a dense sum finds, and a sampled
    /// direction is as frequent as its density says.
    #[test]
    fn samples_integrate_to_the_fluence() {
        let (width, height) = (24, 12);
        let mut rng = Rng::stream(5, crate::rng::Stage::Check, 0, 0);
        let pixels: Vec<Rgb> = (0..width * height)
            .map(|_| Rgb::splat(rng.uniform().powi(8) * 40.0))
            .collect();
        let sky = SkyPicture::<f32>::new(width, height, pixels);
        let (nx, ny) = (720, 720);
        let (mut exact, mut moment) = (0.0f64, 0.0f64);
        for j in 0..ny {
            let cos = 1.0 - 2.0 * (f64::from(j) + 0.5) / f64::from(ny);
            for i in 0..nx {
                let phi = std::f64::consts::TAU * (f64::from(i) + 0.5) / f64::from(nx);
                let sin = (1.0 - cos * cos).sqrt();
                let d = Vec3::new(
                    (-sin * phi.sin()) as f32,
                    cos as f32,
                    (sin * phi.cos()) as f32,
                );
                let l =
                    f64::from(sky.radiance(d)) * 4.0 * std::f64::consts::PI / f64::from(nx * ny);
                exact += l;
                moment += l * f64::from(d.y + 0.5 * d.x);
            }
        }
        let mut sums = [
            crate::stats::Welford::default(),
            crate::stats::Welford::default(),
        ];
        for _ in 0..200_000 {
            let s = sky
                .sample([rng.uniform(), rng.uniform()])
                .expect("the sky shines");
            sums[0].add(f64::from(s.value));
            sums[1].add(f64::from(s.value * (s.direction.y + 0.5 * s.direction.x)));
        }
        for (sum, exact) in sums.iter().zip([exact, moment]) {
            let z = sum.z(exact, 2e-4 * exact.abs());
            assert!(z.abs() < 4.0, "{} for {exact}: z {z}", sum.mean());
        }
    }
}
