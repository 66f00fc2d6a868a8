//! Scattering at a point of a surface, in directions of travel.
//!
//! `w_in` is the direction in which a path arrives, `w_out` the one in which it leaves; nothing
//! points back. With v = -w_in and l = w_out in a frame around the shading normal n_s (z), and the
//! geometric normal n_g, both turned to the side from which the path comes:
//!
//! | material | f(v, l) \[1/sr\] | source |
//! |---|---|---|
//! | diffuse | `rho / pi` | Lambert |
//! | mirror | `rho delta(l - reflect(v)) / l_z` | |
//! | glass | `F delta(reflect)`, `(1 - F) delta(refract)`, each `/ |l_z|` | Fresnel, Snell |
//! | conductor, rough | `F D G2 / (4 v_z l_z)`, m along v + l | Walter 2007, eq. 20 |
//! | glass, rough | that, and `(v.m)(l.m) eta^2 (1 - F) D G2 / (v_z l_z (v.m + eta l.m)^2)`, m along v + eta l | Walter 2007, eq. 21 |
//! | interface | `delta(l - w_in)`: goes on as if nothing were there | |
//! | emissive | 0 | |
//!
//! What a path carries decides one factor (Veach 1997, sections 5.2 and 5.3). eta = n_l / n_v.
//! * [`Transport::Power`]: photons. Crossing a boundary keeps their power. Shading normals are not
//!   symmetric, so the weight has the extra factor `|v.n_s| |l.n_g| / (|v.n_g| |l.n_s|)`.
//! * [`Transport::Radiance`]: camera paths. Radiance found in the medium of l is compressed by the
//!   boundary: transmission is divided by `eta^2`. No extra factor.
//!
//! Which side l is on is decided by n_g, how much goes there by n_s: where they disagree nothing
//! goes, so no light leaks through. Where n_s faces away from v (a coarse mesh at its silhouette),
//! n_g takes its place. Both are the standard departures from energy conservation that
//! interpolated normals ask for; without interpolated normals nothing is lost.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{Mat3, Vec3};

use super::fresnel;
use super::ggx::Ggx;
use super::hit::Hit;
use crate::scene::Rgb;

/// What the path carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    /// A camera path gathers radiance.
    Radiance,
    /// A photon carries power.
    Power,
}

/// How a sampled direction came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKind {
    /// From a lobe wide enough to gather photons in.
    Diffuse,
    /// From a rough mirror or rough glass.
    Glossy,
    /// The only direction there is: the density is a delta, `pdf` is the chance of choosing it.
    Specular,
    /// Straight through an interface: no scattering event.
    Passthrough,
}

/// A sampled continuation of a path.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Direction of travel from here on, unit length.
    pub direction: Vec3,
    /// `f |cos| / pdf`.
    pub weight: Rgb,
    /// Density \[1/sr\]; for [`SampleKind::Specular`] the probability of the choice.
    pub pdf: f32,
    /// Kind of event.
    pub kind: SampleKind,
    /// The path is now on the other side of the surface.
    pub transmitted: bool,
}

/// What a surface does at one point.
#[derive(Debug, Clone, Copy)]
pub(super) enum Lobe {
    /// Lambertian.
    Diffuse { reflectance: Rgb },
    /// Perfect mirror.
    Mirror { reflectance: Rgb },
    /// Dielectric; `ior` is inside over outside, no `ggx` when smooth.
    Glass { ior: f32, ggx: Option<Ggx> },
    /// Metal.
    Conductor { eta: Rgb, k: Rgb, ggx: Option<Ggx> },
    /// Absorbs everything.
    Black,
    /// Index-matched boundary.
    Interface,
}

/// Scattering at a hit.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf {
    lobe: Lobe,
    normal: Vec3,
    shading_normal: Vec3,
}

/// A path that arrives: everything seen from its side.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    /// Columns: tangent, bitangent, shading normal on the side of v.
    frame: Mat3,
    /// Geometric normal on the side of v.
    normal: Vec3,
    /// Towards where the path came from, in the frame; z > 0.
    v: Vec3,
    /// |v . n_g|
    v_g: f32,
    /// Index on the far side over this side.
    eta: f32,
}

impl Bsdf {
    pub(super) fn new(lobe: Lobe, hit: &Hit) -> Self {
        Self {
            lobe,
            normal: hit.normal,
            shading_normal: hit.shading_normal,
        }
    }

    /// True when every direction it scatters into is a delta: nothing to gather, nothing to join
    /// to a light.
    #[must_use]
    pub fn is_specular(&self) -> bool {
        match self.lobe {
            Lobe::Mirror { .. } | Lobe::Interface => true,
            Lobe::Glass { ggx, .. } | Lobe::Conductor { ggx, .. } => ggx.is_none(),
            Lobe::Diffuse { .. } | Lobe::Black => false,
        }
    }

    /// True for a Lambertian surface, the one on which photons are worth storing.
    #[must_use]
    pub fn is_diffuse(&self) -> bool {
        matches!(self.lobe, Lobe::Diffuse { .. })
    }

    /// True for a boundary that changes the medium and nothing else.
    #[must_use]
    pub fn is_interface(&self) -> bool {
        matches!(self.lobe, Lobe::Interface)
    }

    /// True when nothing leaves again.
    #[must_use]
    pub fn is_black(&self) -> bool {
        match self.lobe {
            Lobe::Black => true,
            Lobe::Diffuse { reflectance } | Lobe::Mirror { reflectance } => {
                reflectance == Rgb::ZERO
            }
            _ => false,
        }
    }

    /// The reflected and the refracted continuation at smooth glass, each weighted by its share;
    /// `None` where there is but one, and for other surfaces.
    #[must_use]
    pub fn split(&self, w_in: Vec3, transport: Transport) -> Option<[BsdfSample; 2]> {
        if !matches!(self.lobe, Lobe::Glass { ggx: None, .. }) {
            return None;
        }
        // The least and the greatest of the uniforms that choose.
        let [reflected, refracted] = [0.0, 1.0 - 0.5 * f32::EPSILON]
            .map(|choice| self.sample(w_in, [choice, 0.0, 0.0], transport));
        let (mut reflected, mut refracted) = (reflected?, refracted?);
        if reflected.transmitted || !refracted.transmitted {
            return None;
        }
        for sample in [&mut reflected, &mut refracted] {
            sample.weight *= sample.pdf;
            sample.pdf = 1.0;
        }
        Some([reflected, refracted])
    }

    /// Draws a continuation from three uniforms in [0, 1): one for the choice of lobe, two for the
    /// direction. `None`: the path ends here.
    #[must_use]
    pub fn sample(&self, w_in: Vec3, u: [f32; 3], transport: Transport) -> Option<BsdfSample> {
        if matches!(self.lobe, Lobe::Interface) {
            return Some(BsdfSample {
                direction: w_in,
                weight: Rgb::ONE,
                pdf: 1.0,
                kind: SampleKind::Passthrough,
                transmitted: true,
            });
        }
        let arrival = self.arrival(w_in)?;
        let v = arrival.v;
        let (l, weight, pdf, kind) = match self.lobe {
            Lobe::Diffuse { reflectance } => {
                let l = cosine_hemisphere([u[1], u[2]]);
                (l, reflectance, l.z * FRAC_1_PI, SampleKind::Diffuse)
            }
            Lobe::Mirror { reflectance } => (reflect(v), reflectance, 1.0, SampleKind::Specular),
            Lobe::Conductor { eta, k, ggx: None } => (
                reflect(v),
                fresnel::conductor(v.z.min(1.0), eta, k),
                1.0,
                SampleKind::Specular,
            ),
            Lobe::Conductor {
                eta,
                k,
                ggx: Some(ggx),
            } => {
                let m = ggx.sample(v, [u[1], u[2]]);
                let v_m = v.dot(m);
                let l = 2.0 * v_m * m - v;
                if l.z <= 0.0 || v_m <= 0.0 {
                    return None;
                }
                let weight = fresnel::conductor(v_m.min(1.0), eta, k) * (ggx.g2(v, l) / ggx.g1(v));
                (
                    l,
                    weight,
                    ggx.visible(v, m) / (4.0 * v_m),
                    SampleKind::Glossy,
                )
            }
            Lobe::Glass { ggx: None, .. } => {
                let (r, cos_t) = fresnel::dielectric(v.z.min(1.0), arrival.eta);
                if u[0] < r {
                    (reflect(v), Rgb::ONE, r, SampleKind::Specular)
                } else {
                    let l = refract(v, Vec3::Z, arrival.eta, cos_t);
                    (l, Rgb::ONE, 1.0 - r, SampleKind::Specular)
                }
            }
            Lobe::Glass { ggx: Some(ggx), .. } => {
                let m = ggx.sample(v, [u[1], u[2]]);
                let v_m = v.dot(m);
                if v_m <= 0.0 {
                    return None;
                }
                let (r, cos_t) = fresnel::dielectric(v_m.min(1.0), arrival.eta);
                let reflected = u[0] < r;
                let l = if reflected {
                    2.0 * v_m * m - v
                } else {
                    refract(v, m, arrival.eta, cos_t)
                };
                if reflected != (l.z > 0.0) || l.z == 0.0 {
                    return None;
                }
                let pdf = if reflected {
                    r * ggx.visible(v, m) / (4.0 * v_m)
                } else {
                    (1.0 - r) * ggx.visible(v, m) * refraction_jacobian(v_m, l.dot(m), arrival.eta)
                };
                (
                    l,
                    Rgb::splat(ggx.g2(v, l) / ggx.g1(v)),
                    pdf,
                    SampleKind::Glossy,
                )
            }
            Lobe::Black | Lobe::Interface => return None,
        };
        let direction = (arrival.frame * l).normalize();
        let transmitted = l.z < 0.0;
        // The geometric normal has the last word on sides.
        if (direction.dot(arrival.normal) < 0.0) != transmitted || pdf <= 0.0 {
            return None;
        }
        let factor = arrival.factor(l, direction, transport);
        Some(BsdfSample {
            direction,
            weight: weight * factor,
            pdf,
            kind,
            transmitted,
        })
    }

    /// `f |cos|` \[1/sr\] with every factor that `sample` puts into its weight; zero for deltas.
    #[must_use]
    pub fn eval(&self, w_in: Vec3, w_out: Vec3, transport: Transport) -> Rgb {
        let Some((arrival, l)) = self.pair(w_in, w_out) else {
            return Rgb::ZERO;
        };
        self.value(&arrival, l) * (l.z.abs() * arrival.factor(l, w_out, transport))
    }

    /// f itself \[1/sr\], without a cosine, for gathering stored photons: `w_in` is the photon's
    /// direction, `w_out` points along the light that leaves, against the camera ray. The photons
    /// were counted per area of the true surface, so the shading-normal factor
    /// `|v.n_s| / |v.n_g|` belongs here.
    #[must_use]
    pub fn gather(&self, w_in: Vec3, w_out: Vec3) -> Rgb {
        let Some((arrival, l)) = self.pair(w_in, w_out) else {
            return Rgb::ZERO;
        };
        self.value(&arrival, l) * (arrival.v.z / arrival.v_g)
    }

    /// Density with which `sample` draws `w_out` \[1/sr\]; zero for deltas.
    #[must_use]
    pub fn pdf(&self, w_in: Vec3, w_out: Vec3) -> f32 {
        let Some((arrival, l)) = self.pair(w_in, w_out) else {
            return 0.0;
        };
        let v = arrival.v;
        match self.lobe {
            Lobe::Diffuse { .. } if l.z > 0.0 => l.z * FRAC_1_PI,
            Lobe::Conductor { ggx: Some(ggx), .. } if l.z > 0.0 => {
                let m = (v + l).normalize();
                ggx.visible(v, m) / (4.0 * v.dot(m))
            }
            Lobe::Glass { ggx: Some(ggx), .. } => {
                let Some(m) = facet(v, l, arrival.eta) else {
                    return 0.0;
                };
                let v_m = v.dot(m);
                let r = facet_reflectance(v_m, l.dot(m), l.z, arrival.eta);
                if l.z > 0.0 {
                    r * ggx.visible(v, m) / (4.0 * v_m)
                } else {
                    (1.0 - r) * ggx.visible(v, m) * refraction_jacobian(v_m, l.dot(m), arrival.eta)
                }
            }
            _ => 0.0,
        }
    }

    /// f as power sees it, in the frame of the arrival. \[1/sr\]
    fn value(&self, arrival: &Arrival, l: Vec3) -> Rgb {
        let v = arrival.v;
        match self.lobe {
            Lobe::Diffuse { reflectance } if l.z > 0.0 => reflectance * FRAC_1_PI,
            Lobe::Conductor {
                eta,
                k,
                ggx: Some(ggx),
            } if l.z > 0.0 => {
                let m = (v + l).normalize();
                fresnel::conductor(v.dot(m).clamp(0.0, 1.0), eta, k)
                    * (ggx.d(m) * ggx.g2(v, l) / (4.0 * v.z * l.z))
            }
            Lobe::Glass { ggx: Some(ggx), .. } => {
                let Some(m) = facet(v, l, arrival.eta) else {
                    return Rgb::ZERO;
                };
                let (v_m, l_m) = (v.dot(m), l.dot(m));
                let r = facet_reflectance(v_m, l_m, l.z, arrival.eta);
                let facets = ggx.d(m) * ggx.g2(v, l) / (v.z * l.z.abs());
                Rgb::splat(if l.z > 0.0 {
                    0.25 * r * facets
                } else {
                    (1.0 - r) * facets * v_m * refraction_jacobian(v_m, l_m, arrival.eta)
                })
            }
            _ => Rgb::ZERO,
        }
    }

    /// Both directions in the frame, if the normals agree on their sides.
    fn pair(&self, w_in: Vec3, w_out: Vec3) -> Option<(Arrival, Vec3)> {
        let arrival = self.arrival(w_in)?;
        let l = arrival.frame.transpose() * w_out;
        let below = w_out.dot(arrival.normal) < 0.0;
        (below == (l.z < 0.0) && l.z != 0.0).then_some((arrival, l))
    }

    fn arrival(&self, w_in: Vec3) -> Option<Arrival> {
        let front = w_in.dot(self.normal) < 0.0;
        let side = if front { 1.0 } else { -1.0 };
        let normal = side * self.normal;
        let mut shading_normal = side * self.shading_normal;
        let v_g = -w_in.dot(normal);
        if v_g <= 0.0 {
            return None;
        }
        if -w_in.dot(shading_normal) <= 0.0 {
            shading_normal = normal;
        }
        let (x, y) = shading_normal.any_orthonormal_pair();
        let frame = Mat3::from_cols(x, y, shading_normal);
        let v = -(frame.transpose() * w_in);
        let eta = match self.lobe {
            Lobe::Glass { ior, .. } if front => ior,
            Lobe::Glass { ior, .. } => 1.0 / ior,
            _ => 1.0,
        };
        (v.z > 0.0).then_some(Arrival {
            frame,
            normal,
            v,
            v_g,
            eta,
        })
    }
}

impl Arrival {
    /// What sets radiance and power apart.
    fn factor(&self, l: Vec3, w_out: Vec3, transport: Transport) -> f32 {
        match transport {
            Transport::Radiance if l.z < 0.0 => 1.0 / (self.eta * self.eta),
            Transport::Radiance => 1.0,
            Transport::Power => {
                let l_g = w_out.dot(self.normal).abs();
                (self.v.z * l_g) / (self.v_g * l.z.abs())
            }
        }
    }
}

fn reflect(v: Vec3) -> Vec3 {
    Vec3::new(-v.x, -v.y, v.z)
}

/// Snell's law at a facet m: the direction on the far side, with cosine `cos_t`.
fn refract(v: Vec3, m: Vec3, eta: f32, cos_t: f32) -> Vec3 {
    (m * (v.dot(m) / eta - cos_t) - v / eta).normalize()
}

/// The facet that turns v into l, if both see its front.
fn facet(v: Vec3, l: Vec3, eta: f32) -> Option<Vec3> {
    let m = if l.z > 0.0 { v + l } else { v + eta * l };
    let m = m.try_normalize()?;
    let m = if m.z < 0.0 { -m } else { m };
    let seen = v.dot(m) > 0.0 && (l.dot(m) > 0.0) == (l.z > 0.0);
    (seen && m.z > 0.0).then_some(m)
}

/// Fresnel reflectance at a facet that turns v into l.
fn facet_reflectance(v_m: f32, l_m: f32, l_z: f32, eta: f32) -> f32 {
    if l_z > 0.0 {
        fresnel::dielectric(v_m.min(1.0), eta).0
    } else {
        fresnel::between(v_m.min(1.0), l_m.abs(), eta)
    }
}

/// d omega_m / d omega_l of refraction: Walter 2007, eq. 17.
fn refraction_jacobian(v_m: f32, l_m: f32, eta: f32) -> f32 {
    let s = v_m + eta * l_m;
    eta * eta * l_m.abs() / (s * s)
}

/// A direction with density `z / pi`.
fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let r = u[0].sqrt();
    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
    Vec3::new(r * cos, r * sin, (1.0 - u[0]).max(f32::MIN_POSITIVE).sqrt())
}
