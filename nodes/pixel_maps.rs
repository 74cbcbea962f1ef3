//! Pixel mappings between neighbouring frames (Hašan et al. 2008, sections 4.4 and 5).

use crate::data::{self, Array, DeepFramebuffer, Geometry, NONE};
use crate::kernel::neighbours::{Map, Pyramid, map};
use crate::kernel::nine_vectors::nine_vectors;
use crate::node::{Ctx, Error, Item, Node, Sizes, Window};

crate::params! {
    /// Maps every pixel to its nearest neighbour in the frame before and in the frame after: exact,
    /// by position, normal and diffuse reflectance.
    pub struct PixelMaps {
        /// Weight of positions, which are counted in scene diagonals.
        position: f32 = 1.0, 0.0..=1000.0;
        /// Weight of unit normals.
        normal: f32 = 0.125, 0.0..=1000.0;
        /// Weight of diffuse reflectances.
        albedo: f32 = 0.125, 0.0..=1000.0;
        /// Weighted distance beyond which a neighbour counts as another place; where most pixels have
        /// none nearer, the camera cut.
        cut: f32 = 0.1, 0.0..=1000.0;
    }
}

crate::inputs! {
    /// Inputs of [`PixelMaps`].
    pub struct PixelMapsIn {
        /// Two neighbouring frames.
        framebuffer: Window<DeepFramebuffer>,
        /// Gives centre and diagonal.
        geometry: Item<Geometry>,
    }
}

impl Node for PixelMaps {
    const KIND: &'static str = "PixelMaps";
    const VERSION: u32 = 1;
    type In = PixelMapsIn;
    type Out = data::PixelMaps;

    fn memory(&self, inputs: &Sizes) -> u64 {
        2 * inputs.bytes("framebuffer")
    }

    fn run(&self, input: PixelMapsIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let weights = [self.position, self.normal, self.albedo];
        let (this, next) = (&input.framebuffer.this, &input.framebuffer.next);
        if this.digest() == next.digest() {
            return Ok(identity(this, weights));
        }
        let features = nine_vectors(ctx, this, &input.geometry, weights)?;
        let following = nine_vectors(ctx, next, &input.geometry, weights)?;
        ctx.tick(0, 2)?;
        let forward = map(&Pyramid::build(&features), &following, f32::INFINITY);
        ctx.tick(1, 2)?;
        let backward = map(&Pyramid::build(&following), &features, f32::INFINITY);
        let seen = |f: &DeepFramebuffer| f.triangle.iter().filter(|t| **t != NONE).count();
        let far = |m: &Map| m.distance.iter().filter(|d| d.is_finite() && **d > self.cut).count();
        // Pixels of a frame that sees something where the other sees nothing have no neighbour at all.
        let lost = |m: &Map, f: &DeepFramebuffer| seen(f) - m.pixel.iter().filter(|p| **p != NONE).count();
        let away = far(&forward) + far(&backward) + lost(&forward, next) + lost(&backward, this);
        let far = away as f32 / (seen(this) + seen(next)).max(1) as f32;
        let shape = this.triangle.shape().to_vec();
        Ok(data::PixelMaps {
            forward: Array::shaped(forward.pixel, next.triangle.shape()),
            backward: Array::shaped(backward.pixel, &shape),
            far,
            weights,
        })
    }
}

/// The maps between two equal frames.
fn identity(framebuffer: &DeepFramebuffer, weights: [f32; 3]) -> data::PixelMaps {
    let pixel = |(i, t): (usize, &u32)| if *t == NONE { NONE } else { i as u32 };
    let map: Vec<u32> = framebuffer.triangle.iter().enumerate().map(pixel).collect();
    let forward = Array::shaped(map, framebuffer.triangle.shape());
    data::PixelMaps { backward: forward.clone(), forward, far: 0.0, weights }
}
