//! Ambient occlusion from a tree of surfels (Buchholz and Boubekeur 2012, section 1).

use crate::data::{DeepFramebuffer, Image, PbgiTree};
use crate::kernel::pbgi::gather::{Gather, MicroBuffer, Settings, Shape};
use crate::kernel::pbgi::stored::with_tree;
use crate::kernel::receivers::Receivers;
use crate::node::{Ctx, Error, Item, Node};
use glam::Vec3;

crate::choice! {
    /// What is shown.
    pub enum Openness {
        /// The cosine-weighted share of directions that are open, 0 to 1, as grey.
        Share = "share",
        /// Their cosine-weighted mean, a unit vector of the world as colour: each component halved and
        /// moved by a half. Black where nothing is open.
        Direction = "direction",
    }
}

crate::params! {
    /// How open the sky is over each pixel: ambient occlusion, or the direction that is open on average.
    /// Pixels without surface are open in all directions.
    pub struct AmbientOcclusion {
        /// What is shown.
        show: Openness = Openness::Share;
        /// Shape of the buffers.
        buffer: Shape = Shape::Cube;
        /// Their cells a side.
        resolution: u32 = 8, 1..=256;
        /// Solid angle below which a node is not opened, in cells; 0 opens every node.
        factor: f32 = 1.0, 0.0..=4.0;
    }
}

crate::inputs! {
    /// Inputs of [`AmbientOcclusion`].
    pub struct AmbientOcclusionIn {
        /// What occludes.
        tree: Item<PbgiTree>,
        /// What is occluded.
        framebuffer: Item<DeepFramebuffer>,
    }
}

impl Node for AmbientOcclusion {
    const KIND: &'static str = "AmbientOcclusion";
    const VERSION: u32 = 2;
    type In = AmbientOcclusionIn;
    type Out = Image;

    fn run(&self, input: AmbientOcclusionIn, ctx: &Ctx) -> Result<Image, Error> {
        let receivers = Receivers::of(&input.framebuffer);
        let buffer = MicroBuffer::new(self.buffer, self.resolution);
        let settings = Settings { factor: self.factor, ..Settings::default() };
        let background = |_: Vec3| Vec3::ZERO;
        let (gathered, _) = with_tree!(input.tree, hierarchy => {
            let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background };
            gather.all(&receivers.samples, |done, total| ctx.tick(done, total))?
        });
        let (width, height) = input.framebuffer.size();
        let open = if self.show == Openness::Share { Vec3::ONE } else { Vec3::ZERO };
        let mut shown = vec![open; width * height];
        for (pixel, gathered) in receivers.pixel.iter().zip(&gathered) {
            shown[*pixel as usize] = match self.show {
                Openness::Share => Vec3::splat(gathered.open),
                Openness::Direction if gathered.unoccluded == Vec3::ZERO => Vec3::ZERO,
                Openness::Direction => gathered.unoccluded * 0.5 + 0.5,
            };
        }
        Ok(Image::new(width, height, shown))
    }
}
