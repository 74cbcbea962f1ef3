//! Gather samples: points spread over all surfaces, tied to their triangles
//! (Hašan et al. 2008, section 5, "Creating the lights").

use crate::data::{self, Geometry, Materials, Poses};
use crate::kernel::stage::Stage;
use crate::kernel::surface_sampling::sample;
use crate::node::{Ctx, Error, Item, Node};

crate::choice! {
    /// Which faces of surfaces reflect indirect light.
    pub enum Sides {
        /// Both: every sample is on one of them.
        Both = "both",
        /// Front faces only, for scenes of closed solids, whose insides are dark.
        Front = "front",
    }
}

crate::params! {
    /// Covers all surfaces uniformly with samples that move and deform with their triangles. Each becomes
    /// one virtual light, the same light in every frame.
    pub struct GatherSamples {
        /// Number of samples.
        count: u32 = 65_536, 1..=16_777_216;
        /// Which faces they are on.
        sides: Sides = Sides::Both;
        /// Seed of their places.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`GatherSamples`].
    pub struct GatherSamplesIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Materials: what is absent has no samples.
        materials: Item<Materials>,
        /// The pose whose areas decide: `Poses` without a time, or samples are others in every frame.
        rest: Item<Poses>,
    }
}

impl Node for GatherSamples {
    const KIND: &'static str = "GatherSamples";
    const VERSION: u32 = 1;
    type In = GatherSamplesIn;
    type Out = data::GatherSamples;

    fn run(&self, input: GatherSamplesIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.rest)?;
        let areas: Vec<f64> = (0..stage.triangles()).map(|t| f64::from(stage.area(t))).collect();
        let points = sample(&areas, self.count, self.seed);
        if points.is_empty() {
            return Err(Error::invalid("there is no surface to put gather samples on"));
        }
        // A sample on one of two sides stands for twice the area.
        let (faces, front): (f32, fn(f32) -> bool) = match self.sides {
            Sides::Both => (2.0, |spare| spare < 0.5),
            Sides::Front => (1.0, |_| true),
        };
        Ok(data::GatherSamples {
            triangle: points.iter().map(|p| p.triangle).collect(),
            barycentric: points.iter().map(|p| p.barycentric).collect(),
            front: points.iter().map(|p| u8::from(front(p.spare))).collect(),
            share: points.iter().map(|p| p.share * faces).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::{plain_materials, quad, soup, still};
    use glam::Vec3;

    #[test]
    fn areas_add_up_and_degenerate_triangles_have_no_samples() {
        let mut triangles = quad(Vec3::ZERO, Vec3::X * 2.0, Vec3::Z * 3.0, 0).to_vec();
        triangles.push(([Vec3::ZERO, Vec3::X, Vec3::X * 2.0], 0));
        triangles.push(([Vec3::NAN, Vec3::X, Vec3::Y], 0));
        let geometry = soup(&triangles);
        let input = GatherSamplesIn {
            geometry: Geometry { diagonal: 4.0, bias: 1e-3, ..geometry }.into(),
            materials: plain_materials(&[Vec3::ONE]).into(),
            rest: still().into(),
        };
        let node = GatherSamples { count: 1000, sides: Sides::Both, seed: 3 };
        let samples = node.run(input, &Ctx::default()).unwrap();
        assert!(samples.triangle.iter().all(|t| *t < 2));
        let area: f32 = samples.share.iter().map(|s| s * 3.0).sum();
        assert!((area - 12.0).abs() < 1e-2, "{area}");
        let front = samples.front.iter().filter(|f| **f == 1).count();
        assert!((480..520).contains(&front), "{front}");
    }
}
