//! The share of unpolarised light that an ideal boundary reflects.
//!
//! Dielectric, relative index eta = n_t / n_i, cosines c_i and c_t, `c_t^2 = 1 - (1 - c_i^2) / eta^2`:
//! `R = 1/2 [ ((eta c_i - c_t) / (eta c_i + c_t))^2 + ((c_i - eta c_t) / (c_i + eta c_t))^2 ]`,
//! and 1 when `c_t^2 <= 0` (total internal reflection).
//! Conductor, complex index eta + i k, with `t = eta^2 - k^2 - sin^2`, `p = sqrt(t^2 + 4 eta^2 k^2)`,
//! `a^2 = (p + t) / 2`:
//! `R_s = (p - 2 a c + c^2) / (p + 2 a c + c^2)`,
//! `R_p = R_s (p c^2 - 2 a c sin^2 + sin^4) / (p c^2 + 2 a c sin^2 + sin^4)`, `R = (R_s + R_p) / 2`.
//!
//! Source: Born & Wolf, Principles of Optics, sections 1.5.2 and 14.2. No approximation (Schlick).

use crate::scene::Rgb;

/// Reflectance of a dielectric and the cosine of the refracted direction, which is 0 under total
/// internal reflection. `cos_i` in 0 to 1.
#[inline]
pub(super) fn dielectric(cos_i: f32, eta: f32) -> (f32, f32) {
    let cos_t_squared = 1.0 - (1.0 - cos_i * cos_i) / (eta * eta);
    if cos_t_squared <= 0.0 {
        return (1.0, 0.0);
    }
    let cos_t = cos_t_squared.sqrt();
    (between(cos_i, cos_t, eta), cos_t)
}

/// Reflectance of a dielectric where both cosines are known: close to the critical angle this is
/// far more exact than finding one from the other.
#[inline]
pub(super) fn between(cos_i: f32, cos_t: f32, eta: f32) -> f32 {
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    0.5 * (perpendicular * perpendicular + parallel * parallel)
}

/// Reflectance of a conductor, channel by channel.
#[inline]
pub(super) fn conductor(cos_i: f32, eta: Rgb, k: Rgb) -> Rgb {
    let channel = |eta: f32, k: f32| {
        let cos2 = cos_i * cos_i;
        let sin2 = 1.0 - cos2;
        let t = eta * eta - k * k - sin2;
        let p = (t * t + 4.0 * eta * eta * k * k).sqrt();
        let a2 = 2.0 * (0.5 * (p + t)).max(0.0).sqrt() * cos_i;
        let r_s = (p + cos2 - a2) / (p + cos2 + a2);
        let r_p = r_s * (p * cos2 - a2 * sin2 + sin2 * sin2) / (p * cos2 + a2 * sin2 + sin2 * sin2);
        0.5 * (r_s + r_p)
    };
    Rgb::new(
        channel(eta.x, k.x),
        channel(eta.y, k.y),
        channel(eta.z, k.z),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        // Normal incidence on glass, ((n - 1) / (n + 1))^2, either way.
        assert!((dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-7);
        assert!((dielectric(1.0, 1.0 / 1.5).0 - 0.04).abs() < 1e-7);
        // Grazing incidence reflects all.
        assert_eq!(dielectric(0.0, 1.5).0, 1.0);
        // Brewster's angle, tan = n: the parallel part vanishes, R = ((n^2 - 1) / (n^2 + 1))^2 / 2.
        let brewster = 1.0 / (1.0_f32 + 1.5 * 1.5).sqrt();
        let expected = 0.5 * (1.25_f32 / 3.25).powi(2);
        assert!((dielectric(brewster, 1.5).0 - expected).abs() < 1e-6);
        // Glass to air at 45 degrees: beyond the critical angle of 41.8.
        assert_eq!(dielectric(0.5_f32.sqrt(), 1.0 / 1.5), (1.0, 0.0));
    }

    #[test]
    fn conductors() {
        // Normal incidence: ((eta - 1)^2 + k^2) / ((eta + 1)^2 + k^2).
        let (eta, k) = (Rgb::new(0.2, 1.1, 1.5), Rgb::new(3.9, 2.3, 0.0));
        let expected =
            (((eta - 1.0) * (eta - 1.0)) + k * k) / (((eta + 1.0) * (eta + 1.0)) + k * k);
        assert!(conductor(1.0, eta, k).abs_diff_eq(expected, 1e-6));
        assert!(conductor(0.0, eta, k).abs_diff_eq(Rgb::ONE, 1e-6));
        // Without absorption it is the dielectric.
        for cos in [0.1, 0.5, 0.9] {
            let exact = dielectric(cos, 1.5).0;
            assert!((conductor(cos, eta, k).z - exact).abs() < 1e-6);
        }
    }
}
