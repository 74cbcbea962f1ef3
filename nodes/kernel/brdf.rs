//! How surfaces reflect: glTF 2.0's metallic-roughness model, appendix B.3.5.

use super::lanes::{Real, Triple};
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
        let [normal, to_eye, to_light] = [normal, to_eye, to_light].map(Triple::splat);
        ReflectanceLanes::<f32>::splat(self).brdf(normal, to_eye, to_light).into()
    }
}

/// A [`Reflectance`], or one a lane.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReflectanceLanes<R> {
    /// Diffuse reflectance, linear RGB.
    pub albedo: Triple<R>,
    /// Specular reflectance at normal incidence, linear RGB.
    pub specular: Triple<R>,
    /// Perceptual roughness.
    pub roughness: R,
}

impl<R: Real> ReflectanceLanes<R> {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat(of: &Reflectance) -> Self {
        let [albedo, specular] = [of.albedo, of.specular].map(Triple::splat);
        ReflectanceLanes { albedo, specular, roughness: R::splat(of.roughness) }
    }

    /// What [`Reflectance::brdf`] says, lane by lane.
    #[inline(always)]
    pub fn brdf(&self, normal: Triple<R>, to_eye: Triple<R>, to_light: Triple<R>) -> Triple<R> {
        let [zero, one] = [0.0, 1.0].map(R::splat);
        let cos_light = normal.dot(to_light);
        let cos_eye = normal.dot(to_eye);
        let above = cos_light.gt(zero) & cos_eye.gt(zero);
        let dark = Triple::splat(Vec3::ZERO);
        let matte = self.albedo.over(R::splat(PI));
        let strongest = self.specular.x.max(self.specular.y.max(self.specular.z));
        let shiny = strongest.gt(zero);
        if shiny & above == 0 {
            return matte.or(above, dark);
        }
        let half = to_eye.plus(to_light).normalized_or(normal);
        let grazing = (one - to_eye.dot(half)).max(zero).min(one);
        let schlick = grazing * grazing * grazing * grazing * grazing;
        // Reflectance at grazing angles is 1 for every real surface and fades with the dielectric's
        // strength, whose normal incidence is 4 % of it.
        let edge = (strongest * R::splat(25.0)).min(one);
        let rise = Triple { x: edge, y: edge, z: edge }.minus(self.specular).at_least(zero);
        let fresnel = self.specular.plus(rise.times(schlick));
        let dielectric = edge * (R::splat(0.04) + R::splat(0.96) * schlick);
        let diffuse = self.albedo.times((one - dielectric) / R::splat(PI));
        let lobe = lobe(self.roughness, normal.dot(half), cos_eye, cos_light);
        diffuse.plus(fresnel.times(lobe)).or(shiny, matte).or(above, dark)
    }
}

/// Trowbridge-Reitz distribution times the height-correlated Smith visibility.
#[inline(always)]
fn lobe<R: Real>(roughness: R, cos_half: R, cos_eye: R, cos_light: R) -> R {
    let [zero, one, least] = [0.0, 1.0, f32::MIN_POSITIVE].map(R::splat);
    let alpha = (roughness * roughness).max(R::splat(MIN_ALPHA));
    let a2 = alpha * alpha;
    // 1 - cos^2 (1 - a^2), written so that the peak keeps its precision.
    let sin2 = (one - cos_half * cos_half).max(zero);
    let base = sin2 + cos_half * cos_half * a2;
    let distribution = a2 / (R::splat(PI) * base * base).max(least);
    let light = cos_eye * (cos_light * cos_light * (one - a2) + a2).sqrt();
    let eye = cos_light * (cos_eye * cos_eye * (one - a2) + a2).sqrt();
    distribution * R::splat(0.5) / (light + eye).max(least)
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
        let alpha: f64 = 0.36;
        let steps = 20_000;
        let mut sum = 0.0_f64;
        for i in 0..steps {
            let cos = (f64::from(i) + 0.5) / f64::from(steps);
            let masking = 0.5 / (2.0 * (1.0 - alpha * alpha + alpha * alpha).sqrt());
            sum +=
                f64::from(lobe(0.6_f32, cos as f32, 1.0, 1.0)) / masking * cos / f64::from(steps);
        }
        assert!((2.0 * std::f64::consts::PI * sum - 1.0).abs() < 1e-3, "{sum}");
    }
}
