//! The sky as an environment: daylight without the sun's disc (Preetham et al. 1999).

use crate::data::{Array, Environment};
use crate::kernel::latlong;
use crate::kernel::sky::Daylight;
use crate::node::{Ctx, Error, Node, Problems, Sizes};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

crate::params! {
    /// A clear or hazy sky over a plain ground, as a latitude-longitude map; the sun itself comes from `SunLights`.
    pub struct Sky {
        /// Elevation of the sun over the horizon and its azimuth from +X towards +Z, degrees.
        sun: [f32; 2] = [35.0, 40.0];
        /// How hazy the air is: 2 is clear, 6 hazy (Preetham et al. 1999).
        turbidity: f32 = 2.5, 2.0..=10.0;
        /// Grey albedo of the ground below the horizon, lit by the sun and the sky.
        ground: f32 = 0.2, 0.0..=1.0;
        /// Width and height of the map, texels.
        size: [u32; 2] = [512, 256];
        /// Radiance of 1 kcd/m^2.
        scale: f32 = 0.1, 0.0..=1e6;
    }
}

impl Node for Sky {
    const KIND: &'static str = "Sky";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Environment;

    fn check(&self, problems: &mut Problems) {
        if let Err(what) = Daylight::new(self.sun, self.turbidity) {
            problems.report("sun", what);
        }
        if self.size.iter().any(|n| !(1..=8192).contains(n)) {
            problems.report("size", "expected 1 to 8192 texels each way");
        }
    }

    fn memory(&self, _: &Sizes) -> u64 {
        self.size.map(u64::from).iter().product::<u64>() * size_of::<Vec3>() as u64
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<Environment, Error> {
        let mut problems = Problems::default();
        self.check(&mut problems);
        if let Some((name, what)) = problems.0.pop() {
            return Err(Error::invalid(format!("{name}: {what}")));
        }
        let daylight = Daylight::new(self.sun, self.turbidity).map_err(Error::invalid)?;
        let [width, height] = self.size.map(|n| n as usize);
        let mut radiance = vec![Vec3::ZERO; width * height];
        let mut irradiance = daylight.sun_irradiance().as_dvec3() * daylight.sun().y;
        let mut rows = radiance.chunks_exact_mut(width).enumerate();
        // Rows whose centre is on the horizon belong to the sky.
        for (row, texels) in rows.by_ref().take(height.div_ceil(2)) {
            ctx.tick(row as u64, height as u64)?;
            let v = (row as f64 + 0.5) / height as f64;
            // Solid angle of a texel above the horizon, times its cosine to the ground's normal.
            let (top, bottom) =
                (latlong::edge(row, height), latlong::edge(row + 1, height).max(0.0));
            let weight = (top * top - bottom * bottom) * PI / width as f64;
            for (column, texel) in texels.iter_mut().enumerate() {
                let sky =
                    daylight.radiance(latlong::direction((column as f64 + 0.5) / width as f64, v));
                irradiance += sky.as_dvec3() * weight;
                *texel = sky * self.scale;
            }
        }
        let ground: DVec3 = irradiance * f64::from(self.ground * self.scale) / PI;
        for (_, texels) in rows {
            texels.fill(ground.as_vec3());
        }
        Ok(Environment { radiance: Array::shaped(radiance, &[height, width]) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(sky: &Sky) -> Environment {
        sky.run((), &Ctx::default()).unwrap()
    }

    fn luminance(rgb: DVec3) -> f64 {
        rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
    }

    #[test]
    fn the_sky_gives_a_plausible_share_of_the_light_on_the_ground() {
        let sky = Sky { ground: 0.0, scale: 1.0, ..Sky::default() };
        let environment = map(&sky);
        let (width, height) = (512, 256);
        let mut sum = DVec3::ZERO;
        for (i, texel) in environment.radiance.iter().enumerate() {
            let y = latlong::direction(0.0, ((i / width) as f64 + 0.5) / height as f64).y;
            sum += texel.as_dvec3() * latlong::solid_angle(i / width, width, height) * y.max(0.0);
        }
        let daylight = Daylight::new(sky.sun, sky.turbidity).unwrap();
        let sun = luminance(daylight.sun_irradiance().as_dvec3()) * daylight.sun().y;
        // Measured afternoons have 10 to 25 klx from the sky and 30 to 50 klx from the sun.
        assert!((10.0..28.0).contains(&luminance(sum)), "{sum}");
        assert!((30.0..50.0).contains(&sun), "{sun}");
    }

    #[test]
    fn the_ground_reflects_what_falls_on_it() {
        let bright = map(&Sky { ground: 1.0, scale: 1.0, ..Sky::default() });
        let dark = map(&Sky { ground: 0.0, scale: 1.0, ..Sky::default() });
        let last = |e: &Environment| *e.radiance.last().unwrap();
        assert_eq!(last(&dark), Vec3::ZERO);
        assert!((10.0..30.0).contains(&last(&bright).y), "{}", last(&bright));
        assert_eq!(bright.radiance[0], dark.radiance[0]);
    }

    #[test]
    fn maps_of_any_size_are_finite_and_not_negative() {
        for size in [[1, 1], [3, 1], [2, 2], [5, 7]] {
            for sun in [[0.0, 0.0], [90.0, -400.0]] {
                let environment = map(&Sky { size, sun, ..Sky::default() });
                assert_eq!(environment.radiance.shape(), [size[1] as usize, size[0] as usize]);
                assert!(
                    environment.radiance.iter().all(|l| l.is_finite() && l.min_element() >= 0.0)
                );
            }
        }
        assert!(Sky { size: [0, 4], ..Sky::default() }.run((), &Ctx::default()).is_err());
        assert!(Sky { sun: [-3.0, 4.0], ..Sky::default() }.run((), &Ctx::default()).is_err());
    }
}
