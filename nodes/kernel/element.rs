//! One element of the lighting tensor: A(i, j, k), what light j adds to the radiance of surface
//! sample i (Hašan et al. 2008, section 4.2), and the shadow ray that decides whether it does.
//!
//! Rows, columns, the shading of gather samples and the brute-force reference all call the same `formula`,
//! so that an approximation is compared with exactly what it approximates.

mod formula;

pub use formula::{LightLanes, ReceiverLanes};

use super::brdf::Reflectance;
use crate::data::{DeepFramebuffer, LightKind, Lights, NONE};
use glam::{Vec2, Vec3};

/// A surface sample that is lit.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// World space, metres.
    pub position: Vec3,
    /// Unit shading normal, towards the eye.
    pub normal: Vec3,
    /// Unit normal of the triangle, towards the eye.
    pub facet: Vec3,
    /// Unit vector to the eye.
    pub to_eye: Vec3,
    /// How it reflects.
    pub reflectance: Reflectance,
}

impl Receiver {
    /// The receiver at a pixel of a deep framebuffer; none where no surface is seen.
    pub fn at(framebuffer: &DeepFramebuffer, pixel: usize) -> Option<Self> {
        if framebuffer.triangle[pixel] == NONE {
            return None;
        }
        let position = framebuffer.position[pixel];
        let normal = framebuffer.normal[pixel];
        let to_eye = match framebuffer.perspective {
            0 => -framebuffer.forward,
            _ => (framebuffer.eye - position).normalize_or(normal),
        };
        let reflectance = Reflectance {
            albedo: framebuffer.albedo[pixel],
            specular: framebuffer.specular[pixel],
            roughness: framebuffer.roughness[pixel],
        };
        Some(Receiver { position, normal, facet: framebuffer.facet[pixel], to_eye, reflectance })
    }

    /// A receiver that is seen along its normal and reflects only diffusely, as gather samples do.
    pub fn diffuse(position: Vec3, normal: Vec3, facet: Vec3, albedo: Vec3) -> Self {
        let reflectance = Reflectance { albedo, ..Reflectance::default() };
        Receiver { position, normal, facet, to_eye: normal, reflectance }
    }

    /// Where shadow rays start: `bias` metres off the surface, so that it does not shadow itself.
    pub fn lifted(&self, bias: f32) -> Vec3 {
        self.position + self.facet * bias
    }
}

/// One light of a [`Lights`] list.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    /// How it emits.
    pub kind: LightKind,
    /// World space, metres.
    pub position: Vec3,
    /// Unit vector along which it shines.
    pub direction: Vec3,
    /// Linear RGB in the unit of its kind.
    pub emission: Vec3,
    /// Cosines of a spot's inner and outer cone.
    pub cone: Vec2,
    /// Distance below which 1/r^2 is held constant, metres.
    pub clamp: f32,
}

impl Light {
    /// Light `j` of a list.
    pub fn at(lights: &Lights, j: usize) -> Self {
        Light {
            kind: LightKind::of(lights.kind[j]),
            position: lights.position[j],
            direction: lights.direction[j],
            emission: lights.emission[j],
            cone: lights.cone[j],
            clamp: lights.clamp[j],
        }
    }

    /// The end of a shadow ray: the light itself, lifted by `bias` metres off the surface that a
    /// cosine light lies on; none for a directional light.
    pub fn end(&self, bias: f32) -> Option<Vec3> {
        match self.kind {
            LightKind::Directional => None,
            LightKind::Cosine => Some(self.position + self.direction * bias),
            LightKind::Omni | LightKind::Spot => Some(self.position),
        }
    }
}

/// Whether `light` can add anything to `receiver` before visibility is asked: it emits, and each is
/// on the other's bright side.
pub fn faces(receiver: &Receiver, light: &Light) -> bool {
    ReceiverLanes::<f32>::splat(receiver).faces(&LightLanes::splat(light)) != 0
}

/// Radiance, W/(m^2 sr), that `light` adds to `receiver` in the direction of the eye if nothing is
/// between them: emission x falloff / max(r^2, clamp^2) x cosine x BRDF. Finite and not negative.
pub fn element(receiver: &Receiver, light: &Light) -> Vec3 {
    ReceiverLanes::<f32>::splat(receiver).elements(&LightLanes::splat(light)).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floor() -> Receiver {
        Receiver::diffuse(Vec3::ZERO, Vec3::Y, Vec3::Y, Vec3::splat(0.5))
    }

    fn light(kind: LightKind, position: Vec3) -> Light {
        let emission = Vec3::splat(10.0);
        Light {
            kind,
            position,
            direction: Vec3::NEG_Y,
            emission,
            cone: Vec2::new(0.9, 0.7),
            clamp: 0.0,
        }
    }

    #[test]
    fn known_radiance_of_each_kind() {
        let brdf = 0.5 / std::f32::consts::PI;
        let above = Vec3::new(0.0, 2.0, 0.0);
        let cases = [
            (light(LightKind::Omni, above), 10.0 / 4.0 * brdf),
            (light(LightKind::Spot, above), 10.0 / 4.0 * brdf),
            (light(LightKind::Cosine, above), 10.0 / 4.0 * brdf),
            (light(LightKind::Directional, above), 10.0 * brdf),
            (light(LightKind::Omni, Vec3::new(3.0, 4.0, 0.0)), 10.0 / 25.0 * 0.8 * brdf),
            (light(LightKind::Cosine, Vec3::new(3.0, 4.0, 0.0)), 10.0 / 25.0 * 0.8 * 0.8 * brdf),
            (light(LightKind::Spot, Vec3::new(3.0, 4.0, 0.0)), 10.0 / 25.0 * 0.25 * 0.8 * brdf),
            (light(LightKind::Spot, Vec3::new(4.0, 3.0, 0.0)), 0.0),
            (light(LightKind::Omni, -above), 0.0),
        ];
        for (light, expected) in cases {
            let found = element(&floor(), &light);
            assert!(
                (found - Vec3::splat(expected)).abs().max_element() <= 1e-6,
                "{light:?}: {found}"
            );
            assert_eq!(faces(&floor(), &light), expected > 0.0);
        }
    }

    #[test]
    fn finite_where_light_and_sample_meet() {
        for distance in [0.0, 1e-38, 1e-20, 1e-10] {
            for clamp in [0.0, 0.1] {
                let near = Light { clamp, ..light(LightKind::Cosine, Vec3::Y * distance) };
                assert!(element(&floor(), &near).is_finite(), "{distance} {clamp}");
            }
        }
        let shiny = Reflectance { specular: Vec3::ONE, roughness: 0.0, ..Reflectance::default() };
        let receiver = Receiver { reflectance: shiny, ..floor() };
        let red = Light { emission: Vec3::X, ..light(LightKind::Omni, Vec3::Y * 1e-17) };
        assert_eq!(element(&receiver, &red), Vec3::X * f32::MAX);
        let clamped = Light { clamp: 0.5, ..light(LightKind::Omni, Vec3::Y * 0.1) };
        let expected = 10.0 / 0.25 * 0.5 / std::f32::consts::PI;
        assert!((element(&floor(), &clamped).x - expected).abs() < 1e-4);
    }

    #[test]
    fn the_facet_guards_against_light_from_behind() {
        let tilted = Receiver { facet: Vec3::NEG_Y, ..floor() };
        assert_eq!(element(&tilted, &light(LightKind::Omni, Vec3::Y)), Vec3::ZERO);
    }
}
