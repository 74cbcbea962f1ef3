//! Emitting meshes as cosine lights, sampled by area (Hašan et al. 2007: "area lights").

use crate::data::{Geometry, LightKind, Lights, Materials, Poses};
use crate::kernel::element::Light;
use crate::kernel::light_list::LightList;
use crate::kernel::stage::Stage;
use crate::kernel::surface_sampling::{Point, sample};
use crate::node::{Ctx, Error, Item, Node};
use glam::{Vec2, Vec3};

crate::params! {
    /// Turns emitting surfaces into lights of cosine emission, more of them where more power is.
    pub struct EmissiveLights {
        /// Number of lights.
        count: u32 = 4096, 1..=16_777_216;
        /// Distance below which the 1/r^2 of these lights is held constant, in scene diagonals.
        clamp: f32 = 0.0, 0.0..=10.0;
        /// Seed of their places.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`EmissiveLights`].
    pub struct EmissiveLightsIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// The pose whose areas decide where lights are: `Poses` without a time, so that light j is the
        /// same light in every frame. Without it, the pose of the frame.
        rest: Option<Item<Poses>>,
    }
}

/// Where a triangle's emission is looked up to weigh it: its centre, near its corners, and between.
const PLACES: [(f32, f32); 7] =
    [(0.33, 0.33), (0.1, 0.1), (0.8, 0.1), (0.1, 0.8), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45)];

impl Node for EmissiveLights {
    const KIND: &'static str = "EmissiveLights";
    const VERSION: u32 = 2;
    type In = EmissiveLightsIn;
    type Out = Lights;

    fn run(&self, input: EmissiveLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let rest = input.rest.as_ref().unwrap_or(&input.poses);
        let rest = Stage::of(ctx, &input.geometry, &input.materials, rest)?;
        let power = |t: u32| {
            if input.materials.emissive[rest.material(t)] == Vec3::ZERO {
                return 0.0;
            }
            let samples = PLACES.map(|(u, v)| rest.surface(t, u, v));
            let faces = if samples[0].double_sided { 2.0 } else { 1.0 };
            let mean = samples.iter().map(|s| s.emitted.element_sum()).sum::<f32>() / PLACES.len() as f32;
            f64::from(mean * faces * rest.area(t))
        };
        let weights: Vec<f64> = (0..stage.triangles()).map(power).collect();
        let points = sample(&weights, self.count, self.seed);
        if points.is_empty() {
            ctx.note("no surface emits light");
        }
        let clamp = self.clamp * input.geometry.diagonal;
        let mut list = LightList::new();
        points.iter().for_each(|p| list.push(&light(&stage, p, clamp)));
        Ok(list.finish(true))
    }
}

/// The light of one sample: the radiance at its place times the area it stands for.
fn light(stage: &Stage, point: &Point, clamp: f32) -> Light {
    let surface = stage.surface(point.triangle, point.barycentric.x, point.barycentric.y);
    let (surface, faces) = match surface.double_sided {
        true if point.spare < 0.5 => (surface.facing(-surface.facet), 2.0),
        true => (surface, 2.0),
        false => (surface, 1.0),
    };
    Light {
        kind: LightKind::Cosine,
        position: surface.position,
        direction: surface.facet,
        emission: surface.emitted * (stage.area(point.triangle) * point.share * faces),
        cone: Vec2::ZERO,
        clamp,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::{plain_materials, quad, soup, still};

    #[test]
    fn power_is_radiance_times_area_times_pi() {
        let mut triangles = quad(Vec3::ZERO, Vec3::Z, Vec3::X * 2.0, 1).to_vec();
        triangles.extend(quad(Vec3::Y, Vec3::Z, Vec3::X, 2));
        triangles.extend(quad(Vec3::Y * 2.0, Vec3::Z, Vec3::X, 0));
        let mut materials = plain_materials(&[Vec3::ONE; 3]);
        materials.emissive = vec![Vec3::ZERO, Vec3::splat(3.0), Vec3::new(5.0, 0.0, 0.0)].into();
        materials.double_sided = vec![0, 0, 1].into();
        let input = EmissiveLightsIn {
            geometry: soup(&triangles).into(),
            materials: materials.into(),
            poses: still().into(),
            rest: None,
        };
        let node = EmissiveLights { count: 999, clamp: 0.0, seed: 1 };
        let lights = node.run(input, &Ctx::default()).unwrap();
        let sum: Vec3 = lights.emission.iter().sum();
        // Front of two square metres, and both sides of one.
        let expected = Vec3::new(3.0 * 2.0 + 5.0 * 2.0, 6.0, 6.0);
        assert!((sum - expected).abs().max_element() < 0.02, "{sum}");
        let down = lights.direction.iter().filter(|d| d.y < 0.0).count();
        assert!(down > 150 && down < 400, "{down}");
    }
}
