//! An environment as directional lights: uniform stratified sampling of all directions
//! (Hašan et al. 2008, section 5).

use crate::data::{Environment, LightKind, Lights};
use crate::kernel::latlong;
use crate::node::{Ctx, Error, Item, Node, Sizes};
use glam::{DVec3, Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

crate::params! {
    /// Directional lights, one in each of `count` equal solid angles that divide the sphere. A light's
    /// direction is random in its solid angle; its emission is the mean of the map over it, so that
    /// the lights have exactly the energy of the map.
    pub struct EnvironmentLights {
        /// Number of lights.
        count: u32 = 16_384, 1..=4_194_304;
        /// Seed of the random directions.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`EnvironmentLights`].
    pub struct EnvironmentLightsIn {
        /// What shines from infinitely far away.
        environment: Item<Environment>,
    }
}

/// A row of strata: heights from `top` down to `bottom`, divided evenly in longitude.
struct Belt {
    top: f64,
    bottom: f64,
    strata: usize,
}

impl Node for EnvironmentLights {
    const KIND: &'static str = "EnvironmentLights";
    const VERSION: u32 = 1;
    type In = EnvironmentLightsIn;
    type Out = Lights;

    fn memory(&self, _: &Sizes) -> u64 {
        u64::from(self.count) * (3 * size_of::<Vec3>() + size_of::<Vec2>() + 5) as u64
    }

    fn run(&self, input: EnvironmentLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let count = self.count as usize;
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let mut direction = Vec::with_capacity(count);
        let mut emission = Vec::with_capacity(count);
        for belt in belts(count) {
            ctx.tick(direction.len() as u64, count as u64)?;
            let rows = rows_between(&input.environment, belt.top, belt.bottom);
            for i in 0..belt.strata {
                let share = |at: f64| (i as f64 + at) / belt.strata as f64;
                let height = belt.bottom + (belt.top - belt.bottom) * random.random::<f64>();
                let towards = latlong::around(share(random.random()), height);
                direction.push(-towards.normalize().as_vec3());
                let radiance = mean(&input.environment, &rows, share(0.0), share(1.0));
                emission.push((radiance * (4.0 * PI / count as f64)).as_vec3());
            }
        }
        Ok(Lights {
            kind: vec![LightKind::Directional as u8; count].into(),
            position: vec![Vec3::ZERO; count].into(),
            direction: direction.into(),
            emission: emission.into(),
            cone: vec![Vec2::ZERO; count].into(),
            clamp: vec![0.0; count].into(),
            identity: 1,
        })
    }
}

/// Divides the sphere into `count` strata of equal solid angle, about as wide as high.
fn belts(count: usize) -> Vec<Belt> {
    let rows = ((PI * count as f64).sqrt() / 2.0).round().max(1.0) as usize;
    // Strata above each edge between belts: the share of the sphere above that latitude.
    let above =
        |row: usize| ((1.0 - latlong::edge(row, rows)) / 2.0 * count as f64).round() as usize;
    let height = |strata: usize| 1.0 - 2.0 * strata as f64 / count as f64;
    let belt = |row: usize| {
        let (before, after) = (above(row), above(row + 1));
        Belt { top: height(before), bottom: height(after), strata: after - before }
    };
    (0..rows).map(belt).filter(|belt| belt.strata > 0).collect()
}

/// The map's rows that lie between two heights, each with the share it has of them; shares make 1.
fn rows_between(environment: &Environment, top: f64, bottom: f64) -> Vec<(usize, f64)> {
    let height = environment.radiance.shape()[0];
    let first = ((libm::acos(top) / PI * height as f64) as usize).saturating_sub(1);
    let share = |row: usize| {
        let overlap =
            latlong::edge(row, height).min(top) - latlong::edge(row + 1, height).max(bottom);
        (row, overlap / (top - bottom))
    };
    let touched = (first..height).take_while(|&row| latlong::edge(row, height) > bottom);
    touched.map(share).filter(|(_, share)| *share > 0.0).collect()
}

/// Mean radiance over `rows` between longitudes `left` and `right`, each texel a constant patch.
fn mean(environment: &Environment, rows: &[(usize, f64)], left: f64, right: f64) -> DVec3 {
    let width = environment.radiance.shape()[1];
    let (left, right) = (left * width as f64, (right * width as f64).min(width as f64));
    let columns = left as usize..(right.ceil() as usize).min(width);
    let mut sum = DVec3::ZERO;
    for &(row, share) in rows {
        for column in columns.clone() {
            let overlap = right.min(column as f64 + 1.0) - left.max(column as f64);
            sum +=
                environment.radiance[row * width + column].as_dvec3() * (share * overlap.max(0.0));
        }
    }
    sum / (right - left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Array;

    fn lights(width: usize, height: usize, radiance: Vec<Vec3>, count: u32, seed: u64) -> Lights {
        let environment =
            Environment { radiance: Array::shaped(radiance, &[height, width]) }.into();
        EnvironmentLights { count, seed }
            .run(EnvironmentLightsIn { environment }, &Ctx::default())
            .unwrap()
    }

    fn irradiance(lights: &Lights, normal: Vec3) -> f64 {
        let each = lights.direction.iter().zip(lights.emission.iter());
        each.map(|(d, e)| f64::from(e.x) * f64::from(-d.dot(normal)).max(0.0)).sum()
    }

    #[test]
    fn a_constant_environment_gives_pi_on_every_plane() {
        let lights = lights(1, 1, vec![Vec3::ONE], 16_384, 7);
        for normal in [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, -0.48, 0.64)] {
            let e = irradiance(&lights, normal);
            assert!((e / PI - 1.0).abs() < 2e-3, "{normal}: {e}");
        }
    }

    #[test]
    fn lights_have_the_energy_of_the_map() {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        for (width, height, count) in
            [(1, 1, 1), (64, 32, 777), (7, 5, 16_384), (300, 150, 1000), (2, 90, 3)]
        {
            let map: Vec<Vec3> = (0..width * height)
                .map(|_| Vec3::splat(random.random::<f32>().powi(8) * 1e3))
                .collect();
            let whole: f64 = map
                .iter()
                .enumerate()
                .map(|(i, l)| f64::from(l.y) * latlong::solid_angle(i / width, width, height))
                .sum();
            let lights = lights(width, height, map, count, 1);
            let sum: f64 = lights.emission.iter().map(|e| f64::from(e.y)).sum();
            assert_eq!(lights.direction.len(), count as usize);
            assert!((sum / whole - 1.0).abs() < 1e-6, "{width} x {height}, {count}: {sum} {whole}");
        }
    }

    #[test]
    fn light_comes_from_where_the_map_is_bright() {
        // One bright texel at u = 0.75, v = 0.25: half way up towards +Z.
        let mut map = vec![Vec3::ZERO; 32 * 16];
        map[4 * 32 + 24] = Vec3::ONE;
        let lights = lights(32, 16, map, 10_000, 1);
        let mean: Vec3 =
            lights.direction.iter().zip(lights.emission.iter()).map(|(d, e)| *d * e.x).sum();
        let towards = -mean.normalize();
        assert!(
            towards.dot(latlong::direction(24.5 / 32.0, 4.5 / 16.0).as_vec3()) > 0.999,
            "{towards}"
        );
        assert!(lights.direction.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn strata_have_equal_solid_angles_and_a_seed_moves_directions_only() {
        for count in [1, 2, 3, 10, 1000, 16_384] {
            let belts = belts(count);
            assert_eq!(belts.iter().map(|b| b.strata).sum::<usize>(), count);
            for b in &belts {
                assert!(((b.top - b.bottom) / b.strata as f64 * count as f64 - 2.0).abs() < 1e-9);
            }
        }
        let (a, b) = (lights(2, 2, vec![Vec3::X; 4], 50, 1), lights(2, 2, vec![Vec3::X; 4], 50, 2));
        assert!(a.direction[..] != b.direction[..] && a.emission[..] == b.emission[..]);
    }
}
