//! The sun as directional lights: 16 for its disc (Hašan et al. 2008, section 5).

use crate::data::{LightKind, Lights};
use crate::kernel::sky::{Daylight, SUN_DIAMETER};
use crate::node::{Ctx, Error, Node, Problems};
use glam::{Vec2, Vec3};
use std::f64::consts::{PI, TAU};

crate::params! {
    /// The sun of `Sky` as directional lights of equal irradiance, spread over its disc.
    pub struct SunLights {
        /// Elevation of the sun over the horizon and its azimuth from +X towards +Z, degrees.
        sun: [f32; 2] = [35.0, 40.0];
        /// How hazy the air is: 2 is clear, 6 hazy (Preetham et al. 1999).
        turbidity: f32 = 2.5, 2.0..=10.0;
        /// Lights on the disc of 0.53 degrees (Hašan et al. 2008, section 5).
        count: u32 = 16, 1..=65_536;
        /// Irradiance of 1 klx.
        scale: f32 = 0.1, 0.0..=1e6;
    }
}

impl Node for SunLights {
    const KIND: &'static str = "SunLights";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Lights;

    fn check(&self, problems: &mut Problems) {
        if let Err(what) = Daylight::new(self.sun, self.turbidity) {
            problems.report("sun", what);
        }
    }

    fn run(&self, (): (), _: &Ctx) -> Result<Lights, Error> {
        let daylight = Daylight::new(self.sun, self.turbidity).map_err(Error::invalid)?;
        let count = self.count as usize;
        let centre = daylight.sun();
        let (side, up) = centre.any_orthonormal_pair();
        let golden = PI * (3.0 - 5_f64.sqrt());
        let least = libm::cos(SUN_DIAMETER / 2.0);
        // One direction in each of `count` rings of equal solid angle, turned by the golden angle.
        let direction = |i: usize| {
            let cosine = 1.0 - (i as f64 + 0.5) / count as f64 * (1.0 - least);
            let (sin, cos) = libm::sincos((i as f64 * golden) % TAU);
            let towards =
                centre * cosine + (side * cos + up * sin) * (1.0 - cosine * cosine).sqrt();
            -towards.normalize().as_vec3()
        };
        let emission = daylight.sun_irradiance() * self.scale / count as f32;
        Ok(Lights {
            kind: vec![LightKind::Directional as u8; count].into(),
            position: vec![Vec3::ZERO; count].into(),
            direction: (0..count).map(direction).collect(),
            emission: vec![emission; count].into(),
            cone: vec![Vec2::ZERO; count].into(),
            clamp: vec![0.0; count].into(),
            identity: 1,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_lights_together_are_the_sun() {
        for count in [1, 3, 16, 100] {
            let node = SunLights { count, scale: 0.5, ..SunLights::default() };
            let lights = node.run((), &Ctx::default()).unwrap();
            let daylight = Daylight::new(node.sun, node.turbidity).unwrap();
            let sum: Vec3 = lights.emission.iter().sum();
            assert!(sum.abs_diff_eq(daylight.sun_irradiance() * 0.5, 1e-4), "{sum}");
            let far = lights
                .direction
                .iter()
                .map(|d| d.as_dvec3().angle_between(-daylight.sun()))
                .fold(0.0, f64::max);
            // Rounding unit vectors to f32 moves them by up to about 1e-7.
            assert!(far <= SUN_DIAMETER / 2.0 + 2e-7, "{far}");
        }
    }

    #[test]
    fn sixteen_directions_fill_the_disc_evenly() {
        let lights = SunLights::default().run((), &Ctx::default()).unwrap();
        let SunLights { sun, turbidity, .. } = SunLights::default();
        let sun = Daylight::new(sun, turbidity).unwrap().sun();
        let (side, up) = sun.any_orthonormal_pair();
        let flat: Vec<_> = lights
            .direction
            .iter()
            .map(|d| d.as_dvec3())
            .map(|d: DVec3| (d.dot(side), d.dot(up)))
            .collect();
        for quarter in 0..4 {
            let inside = |&&(x, y): &&(f64, f64)| {
                (x > 0.0) == (quarter & 1 > 0) && (y > 0.0) == (quarter & 2 > 0)
            };
            assert!((3..=5).contains(&flat.iter().filter(inside).count()), "{flat:?}");
        }
        let nearest = |i: usize| {
            let others = (0..16).filter(|&j| j != i);
            others
                .map(|j| lights.direction[i].distance(lights.direction[j]))
                .fold(f32::MAX, f32::min)
        };
        assert!((0..16).map(nearest).fold(f32::MAX, f32::min) > 0.15 * SUN_DIAMETER as f32);
    }

    #[test]
    fn a_sun_below_the_horizon_is_refused() {
        assert!(
            SunLights { sun: [-1.0, 0.0], ..SunLights::default() }
                .run((), &Ctx::default())
                .is_err()
        );
    }
}
