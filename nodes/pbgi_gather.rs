//! Indirect light at every pixel, gathered from a tree of surfels (Buchholz and Boubekeur 2012, section 1.1).

use crate::data::{DeepFramebuffer, Environment, Image, PbgiTree};
use crate::kernel::pbgi::gather::{Gather, MicroBuffer, Settings, Shape};
use crate::kernel::pbgi::stored::with_tree;
use crate::kernel::primary::background;
use crate::kernel::receivers::Receivers;
use crate::node::{Ctx, Error, Item, Node};
use glam::Vec3;

crate::params! {
    /// What each pixel reflects of the light that surfels send to it, and of the environment between
    /// them. Every pixel sees the tree through a small buffer of its own, with a cut through the tree by
    /// solid angle and depth in every cell.
    pub struct PbgiGather {
        /// Shape of the buffers.
        buffer: Shape = Shape::Cube;
        /// Their cells a side.
        resolution: u32 = 8, 1..=256;
        /// Solid angle below which a node is not opened, in cells; 0 opens every node.
        factor: f32 = 1.0, 0.0..=4.0;
        /// Coverage from which a cell counts as full.
        full: f32 = 0.9, 0.75..=1.0;
    }
}

crate::inputs! {
    /// Inputs of [`PbgiGather`].
    pub struct PbgiGatherIn {
        /// What sends light.
        tree: Item<PbgiTree>,
        /// What receives it.
        framebuffer: Item<DeepFramebuffer>,
        /// Seen where no surfel is.
        environment: Option<Item<Environment>>,
    }
}

impl Node for PbgiGather {
    const KIND: &'static str = "PbgiGather";
    const VERSION: u32 = 3;
    type In = PbgiGatherIn;
    type Out = Image;

    fn run(&self, input: PbgiGatherIn, ctx: &Ctx) -> Result<Image, Error> {
        let receivers = Receivers::of(&input.framebuffer);
        let buffer = MicroBuffer::new(self.buffer, self.resolution);
        let settings = Settings { factor: self.factor, full: self.full };
        let sky = |direction: Vec3| match &input.environment {
            Some(environment) => background(environment, direction),
            None => Vec3::ZERO,
        };
        let (gathered, work) = with_tree!(input.tree, hierarchy => {
            let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background: sky };
            gather.all(&receivers.samples, |done, total| ctx.tick(done, total))?
        });
        let count = receivers.samples.len().max(1) as u64;
        ctx.note(format!(
            "{} nodes looked at and {} used for a pixel",
            work.visited / count,
            (work.splatted + work.cast) / count
        ));
        let (width, height) = input.framebuffer.size();
        let mut radiance = vec![Vec3::ZERO; width * height];
        for (pixel, gathered) in receivers.pixel.iter().zip(&gathered) {
            radiance[*pixel as usize] = gathered.radiance.min(Vec3::splat(f32::MAX));
        }
        Ok(Image::new(width, height, radiance))
    }
}
