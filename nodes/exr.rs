//! One image as an OpenEXR file.

use crate::data::{Image, Picture};
use crate::kernel::tone::checked;
use crate::node::{Ctx, Error, Item, Node, Sizes};
use ::exr::image::{Blocks, Encoding, IntoSample, SpecificChannels};
use ::exr::meta::attribute::{Compression, LineOrder};
use ::exr::prelude::{Vec2, WritableImage, f16};
use std::io::Cursor;

crate::choice! {
    /// Numbers of an OpenEXR file.
    pub enum Precision {
        /// 32 bits: the image to the bit.
        Float = "float",
        /// 16 bits: 11 significant bits, at most 65504.
        Half = "half",
    }
}

crate::params! {
    /// Encodes an image as OpenEXR: linear Rec. 709 RGB, scanlines in ZIP-compressed blocks of 16. The
    /// file holds nothing but the image, so equal images give equal files.
    pub struct Exr {
        /// `float` keeps the image to the bit; `half` takes half the space, rounds to 11 significant
        /// bits and sets what exceeds 65504 to that.
        precision: Precision = Precision::Float;
    }
}

crate::inputs! {
    /// Inputs of [`Exr`].
    pub struct ExrIn {
        /// What to encode; all of it finite.
        image: Item<Image>,
    }
}

impl Node for Exr {
    const KIND: &'static str = "Exr";
    const VERSION: u32 = 1;
    type In = ExrIn;
    type Out = Picture;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // The file, at worst uncompressed, while its vector grows by doubling.
        3 * inputs.total()
    }

    fn run(&self, input: ExrIn, ctx: &Ctx) -> Result<Picture, Error> {
        ctx.tick(0, 1)?;
        let image = &input.image;
        checked(image, "the image")?;
        let bytes = match self.precision {
            Precision::Float => encoded(image, |v| v),
            Precision::Half => {
                let most = f16::MAX.to_f32();
                let beyond = image
                    .radiance
                    .iter()
                    .flat_map(|c| c.to_array())
                    .filter(|v| v.abs() > most)
                    .count();
                if beyond > 0 {
                    ctx.note(format!("{beyond} numbers beyond half precision's {most} set to it"));
                }
                encoded(image, |v| f16::from_f32(v.clamp(-most, most)))
            }
        };
        Ok(Picture::new(bytes?, "exr"))
    }
}

/// The file of `image` with each number as `sample` makes it.
fn encoded<S: IntoSample>(
    image: &Image,
    sample: impl Fn(f32) -> S + Sync,
) -> Result<Vec<u8>, Error> {
    let size = image.size();
    let pixel = |Vec2(x, y): Vec2<usize>| {
        let colour = image.radiance[y * size.0 + x];
        (sample(colour.x), sample(colour.y), sample(colour.z))
    };
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let file =
        ::exr::image::Image::from_encoded_channels(size, encoding, SpecificChannels::rgb(pixel));
    let mut bytes = Cursor::new(Vec::new());
    // On this thread: the crate would otherwise start a pool of its own beside the run's threads.
    let written = file.write().non_parallel().to_buffered(&mut bytes);
    written.map_err(|e| Error::invalid(format!("the image does not fit into an EXR: {e}")))?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::exr::prelude::{ReadChannels, ReadLayers};
    use glam::Vec3;

    fn run(precision: Precision, image: &Image) -> Result<Picture, Error> {
        Exr { precision }.run(ExrIn { image: image.clone().into() }, &Ctx::default())
    }

    /// Colours over many magnitudes, none of which compresses well.
    fn varied(width: usize, height: usize) -> Image {
        let value =
            |i: usize| ((i * 7919 % 1009) as f32 - 100.0) * libm::exp2f((i % 19) as f32 - 13.0);
        let colour = |p: usize| Vec3::new(value(3 * p), value(3 * p + 1), value(3 * p + 2));
        Image::new(width, height, (0..width * height).map(colour).collect())
    }

    fn read(picture: &Picture) -> Image {
        let image = ::exr::image::read::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |Vec2(width, height), _| {
                    Image::new(width, height, vec![Vec3::ZERO; width * height])
                },
                |image: &mut Image, Vec2(x, y), (r, g, b): (f32, f32, f32)| {
                    let (width, height) = image.size();
                    let mut all = image.radiance.to_vec();
                    all[y * width + x] = Vec3::new(r, g, b);
                    *image = Image::new(width, height, all);
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(&picture.bytes[..]))
            .unwrap();
        let (width, height) = image.layer_data.channel_data.pixels.size();
        let window = image.attributes.display_window;
        assert_eq!((window.position, window.size), (Vec2(0, 0), Vec2(width, height)));
        assert_eq!(image.layer_data.attributes.layer_position, Vec2(0, 0));
        assert_eq!(image.layer_data.encoding.compression, Compression::ZIP16);
        assert_eq!(image.layer_data.encoding.blocks, Blocks::ScanLines);
        image.layer_data.channel_data.pixels
    }

    #[test]
    fn float_comes_back_to_the_bit() {
        for (width, height) in [(1, 1), (5, 3), (21, 37)] {
            let image = varied(width, height);
            let picture = run(Precision::Float, &image).unwrap();
            assert_eq!(&picture.extension[..], b"exr");
            let back = read(&picture);
            assert_eq!((back.size(), &back.radiance[..]), (image.size(), &image.radiance[..]));
        }
    }

    #[test]
    fn half_comes_back_within_half_a_unit_and_saturates() {
        let image = varied(21, 20);
        let back = read(&run(Precision::Half, &image).unwrap());
        for (a, b) in image.radiance.iter().zip(back.radiance.iter()) {
            let bound = a.abs() * 2.0_f32.powi(-11) + Vec3::splat(2.0_f32.powi(-25));
            assert!((a - b).abs().cmple(bound).all(), "{a} {b}");
        }
        let ctx = Ctx::default();
        let image = Image::new(1, 1, vec![Vec3::new(1e9, -1e9, 65504.0)]);
        let picture =
            Exr { precision: Precision::Half }.run(ExrIn { image: image.into() }, &ctx).unwrap();
        assert_eq!(read(&picture).radiance[0], Vec3::new(65504.0, -65504.0, 65504.0));
        assert_eq!(ctx.notes(), ["2 numbers beyond half precision's 65504 set to it"]);
    }

    #[test]
    fn equal_images_give_equal_files_on_any_number_of_threads() {
        let image = varied(40, 50);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(Precision::Float, &image)).unwrap().bytes.to_vec()
        };
        let one = on(1);
        assert!(one == on(2) && one == on(2));
    }

    #[test]
    fn the_header_holds_the_required_attributes_only() {
        let bytes = run(Precision::Float, &varied(4, 4)).unwrap().bytes.to_vec();
        let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), true).unwrap();
        let header = &meta.headers[0];
        let mut names: Vec<String> =
            header.all_named_attributes().map(|(name, _)| text(name)).collect();
        names.sort();
        let required = [
            "channels",
            "chunkCount",
            "compression",
            "dataWindow",
            "displayWindow",
            "lineOrder",
            "pixelAspectRatio",
            "screenWindowCenter",
            "screenWindowWidth",
            "type",
        ];
        assert_eq!(names, required);
    }

    fn text(name: &[u8]) -> String {
        String::from_utf8_lossy(name).into_owned()
    }

    #[test]
    fn what_has_no_value_is_refused() {
        for bad in [f32::NAN, f32::INFINITY] {
            let image =
                Image::new(2, 2, vec![Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::new(0.0, bad, 0.0)]);
            assert!(
                run(Precision::Half, &image)
                    .unwrap_err()
                    .to_string()
                    .contains("not finite at pixel (1, 1)")
            );
        }
        let empty = Image::new(0, 0, Vec::new());
        assert!(run(Precision::Float, &empty).unwrap_err().to_string().contains("no pixels"));
    }
}
