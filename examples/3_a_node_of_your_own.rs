//! A node from another crate, and a command line that knows it:
//! `cargo run --release --example 3_a_node_of_your_own -- nodes Vignette`.

use glam::Vec2;
use lightloom::nodes::data::Image;
use lightloom::nodes::node::{Ctx, Error, Item, Node};
use lightloom::registry::Registry;
use std::process::ExitCode;

lightloom::nodes::params! {
    /// Darkens a picture towards its corners, as a lens does.
    pub struct Vignette {
        /// Share of light that is lost in the corners.
        strength: f32 = 0.4, 0.0..=1.0;
    }
}

lightloom::nodes::inputs! {
    /// Inputs of [`Vignette`].
    pub struct VignetteIn {
        /// The picture.
        image: Item<Image>,
    }
}

impl Node for Vignette {
    const KIND: &'static str = "Vignette";
    const VERSION: u32 = 1;
    type In = VignetteIn;
    type Out = Image;

    fn run(&self, input: VignetteIn, _: &Ctx) -> Result<Image, Error> {
        let (width, height) = input.image.size();
        let half = Vec2::new(width as f32, height as f32) * 0.5;
        let darken = |(i, colour): (usize, &glam::Vec3)| {
            let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let corner = ((at - half) / half.length()).length_squared();
            *colour * (1.0 - self.strength * corner)
        };
        Ok(Image::new(width, height, input.image.radiance.iter().enumerate().map(darken).collect()))
    }
}

fn main() -> ExitCode {
    lightloom::commands::main(Registry::builtin().with::<Vignette>())
}
