//! Photons through the scene: emitted by lights, reflected diffusely, handed over at every hit.

use super::element::Light;
use super::stage::{Stage, Surface};
use super::surface_sampling::uniform;
use crate::data::{LightKind, Lights};
use crate::node::{Ctx, Error};
use glam::Vec3;
use libm::{cbrtf, cosf, sinf};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// A photon that meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    /// How many surfaces it met before: 0 at the first.
    pub bounce: u32,
    /// The surface, on the side that was hit.
    pub surface: Surface,
    /// Direction of travel.
    pub direction: Vec3,
    /// Flux, W.
    pub power: Vec3,
}

/// No path is longer: with an albedo of 0.99 it carries a millionth of its power.
const LONGEST: u32 = 64;

/// Photons traced as one piece of work.
const BATCH: usize = 256;

/// Emits `count` photons from `lights`, each light as often as its power asks, and follows them with
/// Russian roulette by the albedo. Every landing for which `keep` answers comes out, in the order of
/// emission for any number of threads.
///
/// # Errors
/// Cancellation.
pub fn trace<T: Send>(
    stage: &Stage,
    lights: &Lights,
    count: u32,
    seed: u64,
    ctx: &Ctx,
    keep: impl Fn(&Landing) -> Option<T> + Sync,
) -> Result<Vec<T>, Error> {
    let lights: Vec<Light> = (0..lights.kind.len()).map(|j| Light::at(lights, j)).collect();
    let sphere = (stage.geometry().centre, stage.geometry().diagonal * 0.5);
    let mut sums = Vec::with_capacity(lights.len());
    let mut total = 0.0_f64;
    for light in &lights {
        total += f64::from(flux(light, sphere.1).element_sum());
        sums.push(total);
    }
    if !(total > 0.0 && total.is_finite()) {
        return Ok(Vec::new());
    }
    let indices: Vec<u32> = (0..count).collect();
    let batches: Vec<Vec<T>> = indices
        .par_chunks(BATCH)
        .map(|batch| {
            ctx.tick(u64::from(batch[0]), u64::from(count))?;
            let mut landed = Vec::new();
            for &i in batch {
                let [pick, rest @ ..] = uniform(i, 0, seed);
                // Strata in the order of the lights: every strong light has its photons.
                let at = (f64::from(i) + f64::from(pick)) / f64::from(count) * total;
                let j = sums.partition_point(|s| *s <= at).min(lights.len() - 1);
                let flux = flux(&lights[j], sphere.1);
                let (origin, direction) = emit(&lights[j], rest, uniform(i, 1, seed), sphere);
                let power =
                    flux * (total / (f64::from(flux.element_sum()) * f64::from(count))) as f32;
                follow(stage, origin, direction, power, (i, seed), |landing| {
                    landed.extend(keep(landing))
                });
            }
            Ok(landed)
        })
        .collect::<Result<_, Error>>()?;
    Ok(batches.into_iter().flatten().collect())
}

/// Flux of a light, W per channel; of a directional light, what enters the scene's bounding sphere.
fn flux(light: &Light, radius: f32) -> Vec3 {
    light.emission
        * match light.kind {
            LightKind::Omni => 4.0 * PI,
            LightKind::Cosine => PI,
            LightKind::Directional => PI * radius * radius,
            // The integral of the squared ramp between the cones, over the solid angle.
            LightKind::Spot => TAU * ((1.0 - light.cone.x) + (light.cone.x - light.cone.y) / 3.0),
        }
}

/// A ray that carries an equal part of the light's flux.
fn emit(
    light: &Light,
    [a, b, c]: [f32; 3],
    [d, ..]: [f32; 4],
    (centre, radius): (Vec3, f32),
) -> (Vec3, Vec3) {
    let azimuth = TAU * b;
    match light.kind {
        LightKind::Omni => (light.position, around(Vec3::Z, 1.0 - 2.0 * a, azimuth)),
        LightKind::Cosine => (light.position, around(light.direction, (1.0 - a).sqrt(), azimuth)),
        LightKind::Spot => {
            let (inner, outer) = (light.cone.x, light.cone.y);
            let core =
                (1.0 - inner) / ((1.0 - inner) + (inner - outer) / 3.0).max(f32::MIN_POSITIVE);
            let cosine =
                if d < core { 1.0 - (1.0 - inner) * a } else { outer + (inner - outer) * cbrtf(a) };
            (light.position, around(light.direction, cosine, azimuth))
        }
        LightKind::Directional => {
            let (u, v) = light.direction.any_orthonormal_pair();
            let disc = (u * cosf(azimuth) + v * sinf(azimuth)) * (a.sqrt() * radius);
            (centre + disc - light.direction * (radius * (1.0 + 1e-3 * c)), light.direction)
        }
    }
}

/// The direction at a given cosine and azimuth around a unit axis.
fn around(axis: Vec3, cosine: f32, azimuth: f32) -> Vec3 {
    let (u, v) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    axis * cosine + (u * cosf(azimuth) + v * sinf(azimuth)) * sine
}

fn follow(
    stage: &Stage,
    mut origin: Vec3,
    mut direction: Vec3,
    mut power: Vec3,
    (index, seed): (u32, u64),
    mut land: impl FnMut(&Landing),
) {
    let bias = stage.bias();
    // The first step leaves the light's own surface, if it lies on one.
    let mut near = bias;
    for bounce in 0..LONGEST {
        let Some(hit) = stage.closest(origin, direction, near, f32::MAX) else { return };
        let surface = stage.surface(hit.triangle, hit.u, hit.v).facing(-direction);
        land(&Landing { bounce, surface, direction, power });
        let [survive, a, b, _] = uniform(index, 2 + bounce, seed);
        let albedo = surface.reflectance.albedo;
        let chance = albedo.max_element().min(1.0);
        if survive >= chance {
            return;
        }
        power *= albedo / chance;
        origin = surface.position + surface.facet * bias;
        direction = around(surface.facet, (1.0 - a).sqrt(), TAU * b);
        near = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::{cosine_lights, room_stage};
    use glam::Vec2;

    fn light(kind: LightKind) -> Light {
        let cone = Vec2::new(0.9, 0.5);
        Light {
            kind,
            position: Vec3::splat(0.5),
            direction: Vec3::NEG_Y,
            emission: Vec3::ONE,
            cone,
            clamp: 0.0,
        }
    }

    #[test]
    fn emission_follows_the_intensity() {
        for kind in [LightKind::Omni, LightKind::Cosine, LightKind::Spot] {
            let light = light(kind);
            let n = 4096;
            let mean = (0..n)
                .map(|i| {
                    let [_, rest @ ..] = uniform(i, 0, 1);
                    -emit(&light, rest, uniform(i, 1, 1), (Vec3::ZERO, 1.0)).1.y
                })
                .sum::<f32>()
                / n as f32;
            // Mean cosine to the axis: integral of I cos over integral of I.
            let expected = match kind {
                LightKind::Cosine => 2.0 / 3.0,
                LightKind::Spot => {
                    let ramp = 0.4_f32;
                    let core = (1.0 - 0.81) / 2.0;
                    let rim = ramp * (0.5 / 3.0 + ramp / 4.0);
                    (core + rim) / (0.1 + ramp / 3.0)
                }
                _ => 0.0,
            };
            assert!((mean - expected).abs() < 0.01, "{kind:?}: {mean} {expected}");
        }
    }

    #[test]
    fn power_at_the_first_hit_is_that_of_the_lights() {
        let (stage, lights) = (room_stage(), cosine_lights(50, 3));
        let first = |l: &Landing| (l.bounce == 0).then_some(l.power);
        let landed = trace(&stage, &lights, 2000, 5, &Ctx::default(), first).unwrap();
        let emitted: Vec3 = lights.emission.iter().map(|e| *e * PI).sum();
        let sum: Vec3 = landed.iter().sum();
        assert!(
            (sum - emitted).abs().max_element() < 0.03 * emitted.max_element(),
            "{sum} {emitted}"
        );
    }

    #[test]
    fn dark_lights_emit_nothing() {
        let mut lights = cosine_lights(3, 3);
        lights.emission = vec![Vec3::ZERO; 3].into();
        let all =
            trace(&room_stage(), &lights, 100, 1, &Ctx::default(), |l| Some(l.power)).unwrap();
        assert!(all.is_empty());
    }
}
