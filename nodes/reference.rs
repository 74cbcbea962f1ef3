//! The brute-force sum over all lights: S_A = sum(A, 2) (Hašan et al. 2008, section 4.2).

use crate::data::{DeepFramebuffer, Geometry, Image, Lights, Materials, Poses};
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::receivers::Receivers;
use crate::kernel::stage::Stage;
use crate::kernel::visibility::{Blocker, Ends};
use crate::node::{Ctx, Error, Item, Node};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Adds every light to every pixel, one shadow ray each: the truth that approximations are
    /// compared with.
    pub struct Reference {
    }
}

crate::inputs! {
    /// Inputs of [`Reference`].
    pub struct ReferenceIn {
        /// Surface samples.
        framebuffer: Item<DeepFramebuffer>,
        /// All lights; without any, the picture has what surfaces emit and what lies behind them.
        lights: Option<Item<Lights>>,
        /// Shapes that cast shadows.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
    }
}

impl Node for Reference {
    const KIND: &'static str = "Reference";
    const VERSION: u32 = 1;
    type In = ReferenceIn;
    type Out = Image;

    fn run(&self, input: ReferenceIn, ctx: &Ctx) -> Result<Image, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let (width, height) = input.framebuffer.size();
        let mut radiance = input.framebuffer.emitted.to_vec();
        let Some(lights) = &input.lights else { return Ok(Image::new(width, height, radiance)) };
        let tensor = RayTensor::new(&stage, lights);
        let receivers = Receivers::of(&input.framebuffer);
        let packets = receivers.samples.len().div_ceil(Ends::CAPACITY) as u64;
        ctx.evaluated(receivers.samples.len() as u64 * tensor.lights() as u64);
        let done = AtomicU64::new(0);
        let sums: Vec<Vec<DVec3>> = receivers
            .samples
            .par_chunks(Ends::CAPACITY)
            .map(|packet| {
                let mut sum = vec![DVec3::ZERO; packet.len()];
                let tile = tensor.tile(packet);
                let mut column = vec![Vec3::ZERO; packet.len()];
                let mut blocker = Blocker::default();
                for j in 0..tensor.lights() {
                    if tensor.column(j, &tile, &mut blocker, &mut column) != 0 {
                        sum.iter_mut().zip(&column).for_each(|(s, c)| *s += c.as_dvec3());
                    }
                }
                ctx.tick(done.fetch_add(1, Ordering::Relaxed), packets)?;
                Ok(sum)
            })
            .collect::<Result<_, Error>>()?;
        for (pixel, sum) in receivers.pixel.iter().zip(sums.iter().flatten()) {
            radiance[*pixel as usize] += sum.min(DVec3::splat(f64::from(f32::MAX))).as_vec3();
        }
        Ok(Image::new(width, height, radiance))
    }
}
