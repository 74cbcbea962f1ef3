//! One image as an 8-bit sRGB PNG.

use crate::data::{Image, Picture};
use crate::kernel::tone::{self, Tone};
use crate::node::{Ctx, Error, Item, Node, Sizes};

crate::params! {
    /// Encodes an image as a PNG to look at: exposure, tone curve, sRGB, 8 bits to the nearest.
    pub struct Png {
        /// Stops by which the radiance is raised first: 1 doubles it.
        exposure: f32 = 0.0, -64.0..=64.0;
        /// How radiance becomes display light: `filmic` is the ACES fit of Narkowicz (2015) on each
        /// channel, `clip` keeps radiance as it is and cuts at 1.
        tone: Tone = Tone::Filmic;
    }
}

crate::inputs! {
    /// Inputs of [`Png`].
    pub struct PngIn {
        /// What to encode; all of it finite.
        image: Item<Image>,
    }
}

impl Node for Png {
    const KIND: &'static str = "Png";
    const VERSION: u32 = 1;
    type In = PngIn;
    type Out = Picture;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A quarter for the pixels, and at most about as much for each of two copies of the file.
        inputs.total()
    }

    fn run(&self, input: PngIn, ctx: &Ctx) -> Result<Picture, Error> {
        ctx.tick(0, 1)?;
        let pixels = tone::pixels(&input.image, self.exposure, self.tone, 1, "the image")?;
        let mut bytes = Vec::new();
        let failed = |e: ::png::EncodingError| {
            Error::invalid(format!("the image does not fit into a PNG: {e}"))
        };
        let mut writer = tone::encoder(&mut bytes, &pixels)?.write_header().map_err(failed)?;
        writer.write_image_data(&pixels.rgb).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(Picture::new(bytes, "png"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn run(node: &Png, image: Image) -> Result<Picture, Error> {
        node.run(PngIn { image: image.into() }, &Ctx::default())
    }

    #[test]
    fn decodes_to_the_known_codes() {
        let image = Image::new(
            2,
            2,
            vec![Vec3::ZERO, Vec3::ONE, Vec3::splat(0.5), Vec3::new(4.0, 0.5, -1.0)],
        );
        let picture = run(&Png { tone: Tone::Clip, ..Png::default() }, image).unwrap();
        assert_eq!(&picture.extension[..], b"png");
        let mut reader =
            ::png::Decoder::new(std::io::Cursor::new(&picture.bytes[..])).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut rgb).unwrap();
        assert_eq!((info.width, info.height, info.color_type), (2, 2, ::png::ColorType::Rgb));
        assert_eq!(rgb, [0, 0, 0, 255, 255, 255, 188, 188, 188, 255, 188, 0]);
        assert!(reader.info().srgb.is_some() && reader.info().animation_control.is_none());
    }

    #[test]
    fn one_pixel_is_enough_and_none_is_not() {
        assert!(run(&Png::default(), Image::new(1, 1, vec![Vec3::ONE])).is_ok());
        assert!(
            run(&Png::default(), Image::new(0, 0, Vec::new()))
                .unwrap_err()
                .to_string()
                .contains("no pixels")
        );
        let holed = Image::new(1, 2, vec![Vec3::ONE, Vec3::NAN]);
        assert!(run(&Png::default(), holed).unwrap_err().to_string().contains("pixel (0, 1)"));
    }
}
