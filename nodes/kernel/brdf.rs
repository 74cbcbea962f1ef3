//! How surfaces reflect: glTF 2.0's metallic-roughness model, appendix B.3.5.

use glam::Vec3;
use std::f32::consts::PI;

/// The reflecting part of a surface point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reflectance {
    /// Diffuse reflectance, linear RGB.
    pub albedo: Vec3,
    /// Specular reflectance at normal incidence, linear RGB; zero is exactly Lambertian.
    pub specular: Vec3,
    /// Perceptual roughness; the lobe's alpha is its square.
    pub roughness: f32,
}

/// Smallest alpha of the specular lobe: below it `D` overflows at the peak.
const MIN_ALPHA: f32 = 1e-3;

impl Reflectance {
    /// The BRDF, 1/sr, for unit directions `to_eye` and `to_light` and unit `normal`, both on the
    /// normal's side. Zero for directions below the surface.
    #[inline]
    pub fn brdf(&self, normal: Vec3, to_eye: Vec3, to_light: Vec3) -> Vec3 {
        let cos_light = normal.dot(to_light);
        let cos_eye = normal.dot(to_eye);
        if cos_light <= 0.0 || cos_eye <= 0.0 {
            return Vec3::ZERO;
        }
        if self.specular == Vec3::ZERO {
            return self.albedo / PI;
        }
        let half = (to_eye + to_light).normalize_or(normal);
        let grazing = (1.0 - to_eye.dot(half)).clamp(0.0, 1.0);
        let schlick = grazing * grazing * grazing * grazing * grazing;
        // Reflectance at grazing angles is 1 for every real surface and fades with the dielectric's
        // strength, whose normal incidence is 4 % of it.
        let edge = (self.specular.max_element() * 25.0).min(1.0);
        let fresnel = self.specular + (Vec3::splat(edge) - self.specular).max(Vec3::ZERO) * schlick;
        let dielectric = edge * (0.04 + 0.96 * schlick);
        self.albedo * ((1.0 - dielectric) / PI)
            + fresnel * self.lobe(normal.dot(half), cos_eye, cos_light)
    }

    /// Trowbridge-Reitz distribution times the height-correlated Smith visibility.
    #[inline]
    fn lobe(&self, cos_half: f32, cos_eye: f32, cos_light: f32) -> f32 {
        let alpha = (self.roughness * self.roughness).max(MIN_ALPHA);
        let a2 = alpha * alpha;
        // 1 - cos^2 (1 - a^2), written so that the peak keeps its precision.
        let sin2 = (1.0 - cos_half * cos_half).max(0.0);
        let base = sin2 + cos_half * cos_half * a2;
        let distribution = a2 / (PI * base * base).max(f32::MIN_POSITIVE);
        let light = cos_eye * (cos_light * cos_light * (1.0 - a2) + a2).sqrt();
        let eye = cos_light * (cos_eye * cos_eye * (1.0 - a2) + a2).sqrt();
        distribution * 0.5 / (light + eye).max(f32::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dielectric_without_specular_is_lambertian() {
        let matte =
            Reflectance { albedo: Vec3::new(0.8, 0.5, 0.1), specular: Vec3::ZERO, roughness: 0.3 };
        let f = matte.brdf(Vec3::Z, Vec3::Z, Vec3::new(0.6, 0.0, 0.8));
        assert!((f - matte.albedo / PI).abs().max_element() < 1e-7);
        assert_eq!(matte.brdf(Vec3::Z, Vec3::Z, -Vec3::Z), Vec3::ZERO);
    }

    #[test]
    fn is_reciprocal_and_finite_at_the_extremes() {
        let eye = Vec3::new(0.3, 0.1, 0.9).normalize();
        for roughness in [0.0, 0.05, 0.5, 1.0] {
            let shiny =
                Reflectance { albedo: Vec3::splat(0.5), specular: Vec3::splat(0.04), roughness };
            for z in [1e-6, 1e-3, 0.5, 1.0] {
                let light = Vec3::new(1.0 - z, 0.2, z).normalize();
                let (a, b) = (shiny.brdf(Vec3::Z, eye, light), shiny.brdf(Vec3::Z, light, eye));
                assert!(
                    a.is_finite() && (a - b).abs().max_element() <= 1e-4 * a.max_element(),
                    "{a} {b}"
                );
            }
            let mirror = shiny.brdf(Vec3::Z, eye, Vec3::new(-eye.x, -eye.y, eye.z));
            assert!(mirror.is_finite());
        }
    }

    #[test]
    fn the_distribution_projects_to_one() {
        // The integral of D cos over the hemisphere is 1 by definition; `lobe` holds D and the
        // masking, so divide the masking out at normal incidence by its known value.
        let surface = Reflectance { specular: Vec3::ONE, roughness: 0.6, ..Reflectance::default() };
        let alpha: f64 = 0.36;
        let steps = 20_000;
        let mut sum = 0.0_f64;
        for i in 0..steps {
            let cos = (f64::from(i) + 0.5) / f64::from(steps);
            let masking = 0.5 / (2.0 * (1.0 - alpha * alpha + alpha * alpha).sqrt());
            sum += f64::from(surface.lobe(cos as f32, 1.0, 1.0)) / masking * cos / f64::from(steps);
        }
        assert!((2.0 * std::f64::consts::PI * sum - 1.0).abs() < 1e-3, "{sum}");
    }
}
