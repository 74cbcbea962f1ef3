//! A sequence of images as one animated PNG.

use crate::data::{Image, Picture};
use crate::kernel::tone::{self, Pixels, Tone};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::params! {
    /// Encodes a sequence as an animated PNG that repeats for ever: a lossless preview that browsers
    /// play. One image gives a plain PNG.
    pub struct Apng {
        /// Frames per second.
        fps: f32 = 20.0, 0.01..=1000.0;
        /// Stops by which the radiance is raised first: 1 doubles it.
        exposure: f32 = 0.0, -64.0..=64.0;
        /// How radiance becomes display light: `filmic` is the ACES fit of Narkowicz (2015) on each
        /// channel, `clip` keeps radiance as it is and cuts at 1.
        tone: Tone = Tone::Filmic;
        /// Reduces the size: boxes of this many pixels across and down become one.
        scale: u32 = 1, 1..=64;
    }
}

crate::inputs! {
    /// Inputs of [`Apng`].
    pub struct ApngIn {
        /// The frames in order; all of one size and finite.
        images: All<Image>,
    }
}

impl Node for Apng {
    const KIND: &'static str = "Apng";
    const VERSION: u32 = 1;
    type In = ApngIn;
    type Out = Picture;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // Pixels of one frame, and the file, which grows by doubling: a quarter of the images each.
        let scale = u64::from(self.scale.max(1));
        inputs.total() / (scale * scale) + inputs.total() / inputs.items("images").max(1)
    }

    fn run(&self, input: ApngIn, ctx: &Ctx) -> Result<Picture, Error> {
        let images = input.images;
        let count = u32::try_from(images.len())
            .map_err(|_| Error::invalid("too many images for an animated PNG"))?;
        if count == 0 {
            return Err(Error::invalid("there is no image to encode"));
        }
        let failed = |e: ::png::EncodingError| {
            Error::invalid(format!("the images do not fit into a PNG: {e}"))
        };
        let (first, size) = self.frame(&images, 0)?;
        let mut bytes = Vec::new();
        let mut encoder = tone::encoder(&mut bytes, &first)?;
        if count > 1 {
            let (numerator, denominator) = delay(self.fps);
            encoder.set_animated(count, 0).map_err(failed)?;
            encoder.set_frame_delay(numerator, denominator).map_err(failed)?;
        }
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&first.rgb).map_err(failed)?;
        for k in 1..images.len() {
            ctx.tick(k as u64, u64::from(count))?;
            let (pixels, (width, height)) = self.frame(&images, k)?;
            if (width, height) != size {
                let (w, h) = size;
                return Err(Error::invalid(format!(
                    "image {k} is {width}x{height} pixels but image 0 is {w}x{h}"
                )));
            }
            writer.write_image_data(&pixels.rgb).map_err(failed)?;
        }
        writer.finish().map_err(failed)?;
        Ok(Picture::new(bytes, "png"))
    }
}

impl Apng {
    /// Pixels of item `k`, and the size it had before the reduction.
    fn frame(&self, images: &All<Image>, k: usize) -> Result<(Pixels, (usize, usize)), Error> {
        let image = images.get(k)?;
        let pixels =
            tone::pixels(&image, self.exposure, self.tone, self.scale, format_args!("image {k}"))?;
        Ok((pixels, image.size()))
    }
}

/// The fraction of a second that a frame stays: the last convergent of the continued fraction of
/// 1 / `fps` whose terms fit into the format.
fn delay(fps: f32) -> (u16, u16) {
    let mut rest = 1.0 / f64::from(fps);
    let (mut before, mut last) = ((0, 1), (1, 0));
    while rest < 65_536.0 {
        let whole = rest as u32;
        let next = |a: u16, b: u16| u16::try_from(u64::from(whole) * u64::from(b) + u64::from(a));
        let (Ok(numerator), Ok(denominator)) = (next(before.0, last.0), next(before.1, last.1))
        else {
            break;
        };
        (before, last) = (last, (numerator, denominator));
        // Infinite for a fraction without rest, which ends the loop.
        rest = 1.0 / (rest - f64::from(whole));
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Item;
    use glam::Vec3;

    fn grey(width: usize, height: usize, value: f32) -> Image {
        Image::new(width, height, vec![Vec3::splat(value); width * height])
    }

    fn run(node: &Apng, images: Vec<Image>) -> Result<Picture, Error> {
        let images: Vec<Item<Image>> = images.into_iter().map(Item::from).collect();
        node.run(ApngIn { images: images.into() }, &Ctx::default())
    }

    fn reader(picture: &Picture) -> ::png::Reader<std::io::Cursor<&[u8]>> {
        ::png::Decoder::new(std::io::Cursor::new(&picture.bytes[..])).read_info().unwrap()
    }

    #[test]
    fn decodes_to_every_frame_with_its_delay() {
        let node = Apng { tone: Tone::Clip, ..Apng::default() };
        let picture = run(&node, vec![grey(3, 2, 0.0), grey(3, 2, 0.5), grey(3, 2, 1.0)]).unwrap();
        let mut reader = reader(&picture);
        let animation = reader.info().animation_control.unwrap();
        assert_eq!((animation.num_frames, animation.num_plays), (3, 0));
        for code in [0, 188, 255] {
            let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut rgb).unwrap();
            let control = reader.info().frame_control.unwrap();
            assert_eq!((control.delay_num, control.delay_den), (1, 20));
            assert_eq!((control.width, control.height, rgb), (3, 2, vec![code; 18]));
        }
    }

    #[test]
    fn one_image_is_a_plain_png_reduced_by_the_scale() {
        let picture = run(&Apng { scale: 2, ..Apng::default() }, vec![grey(5, 4, 0.5)]).unwrap();
        let reader = reader(&picture);
        assert!(reader.info().animation_control.is_none());
        assert_eq!(reader.info().size(), (3, 2));
    }

    #[test]
    fn delays_are_known_fractions_or_close_ones() {
        assert_eq!([20.0, 24.0, 1000.0].map(delay), [(1, 20), (1, 24), (1, 1000)]);
        assert_eq!(
            [0.01, 0.1, 29.97, 23.976].map(delay),
            [(100, 1), (10, 1), (100, 2997), (125, 2997)]
        );
        for fps in (1..4000).map(|i| i as f32 * 0.247) {
            let (numerator, denominator) = delay(fps);
            let found = f64::from(numerator) / f64::from(denominator);
            assert!(
                (found * f64::from(fps) - 1.0).abs() < 2e-5,
                "{fps}: {numerator}/{denominator}"
            );
        }
    }

    #[test]
    fn refuses_what_cannot_be_one_animation() {
        let error =
            |images| run(&Apng { scale: 4, ..Apng::default() }, images).unwrap_err().to_string();
        assert_eq!(
            error(vec![grey(3, 2, 0.0), grey(2, 2, 0.0)]),
            "image 1 is 2x2 pixels but image 0 is 3x2"
        );
        assert!(
            error(vec![grey(1, 1, 0.0), grey(1, 1, f32::NAN)])
                .starts_with("image 1 is not finite at pixel (0, 0)")
        );
        assert!(error(vec![grey(0, 0, 0.0)]).contains("image 0 has no pixels"));
        assert!(error(Vec::new()).contains("no image"));
    }
}
