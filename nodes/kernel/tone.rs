//! From radiance to the numbers of a display: exposure, tone curve, sRGB, eight bits.

use crate::data::Image;
use crate::node::Error;
use glam::Vec3;
use rayon::prelude::*;
use std::fmt::Display;
use std::sync::LazyLock;

crate::choice! {
    /// How exposed radiance becomes display light between 0 and 1, each channel by itself.
    pub enum Tone {
        /// The curve x(2.51x + 0.03) / (x(2.43x + 0.59) + 0.14) that Narkowicz (2015) fitted to the
        /// ACES reference: a little contrast in the shadows, white from 7.2 on.
        Filmic = "filmic",
        /// None: radiance is display light, and what exceeds 1 is white.
        Clip = "clip",
    }
}

/// Eight-bit sRGB pixels, row after row from the top.
#[derive(Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Three bytes a pixel.
    pub rgb: Vec<u8>,
}

/// Width and height of an image that has pixels, all of them finite; `name` names it in errors.
///
/// # Errors
/// When the image has no pixel, is not `[height, width, 3]`, or holds an infinity or a NaN: the
/// first such pixel is named.
pub fn checked(image: &Image, name: impl Display) -> Result<(usize, usize), Error> {
    let (width, height) = image.size();
    if image.radiance.is_empty() || image.radiance.shape().len() != 2 {
        return Err(Error::invalid(format!("{name} has no pixels: it is {width}x{height}")));
    }
    match image.radiance.iter().position(|radiance| !radiance.is_finite()) {
        None => Ok((width, height)),
        Some(at) => {
            let (x, y, Vec3 { x: r, y: g, z: b }) = (at % width, at / width, image.radiance[at]);
            Err(Error::invalid(format!(
                "{name} is not finite at pixel ({x}, {y}): its radiance is ({r}, {g}, {b})"
            )))
        }
    }
}

/// The pixels of `image` on a display, raised by `exposure` stops and reduced by the integer `scale`
/// (at least 1): each box of `scale` x `scale` pixels, or what the image has of it at the right and
/// bottom edge, gives its mean. The mean is of display light, after the tone curve and before sRGB:
/// what a viewer from afar would see, so that one very bright pixel does not fill its whole box.
///
/// # Errors
/// Those of [`checked`].
pub fn pixels(
    image: &Image,
    exposure: f32,
    tone: Tone,
    scale: u32,
    name: impl Display,
) -> Result<Pixels, Error> {
    let (wide, high) = checked(image, name)?;
    let step = scale.max(1) as usize;
    let (width, height) = (wide.div_ceil(step), high.div_ceil(step));
    let gain = libm::exp2f(exposure);
    let mut rgb = vec![0; 3 * width * height];
    rgb.par_chunks_mut(3 * width).enumerate().for_each(|(row, bytes)| {
        let lines = row * step..((row + 1) * step).min(high);
        for (column, bytes) in bytes.chunks_exact_mut(3).enumerate() {
            let span = column * step..((column + 1) * step).min(wide);
            let inside = lines.clone().flat_map(|y| span.clone().map(move |x| y * wide + x));
            let count = lines.len() * span.len();
            let light: Vec3 = inside.map(|p| curve(tone, gain * image.radiance[p])).sum();
            bytes.copy_from_slice(&(light / count as f32).to_array().map(eight_bits));
        }
    });
    Ok(Pixels { width, height, rgb })
}

/// A PNG encoder for [`Pixels`] of this size that marks the file as sRGB.
///
/// # Errors
/// When the size is beyond what the format can say.
pub fn encoder<'a>(
    out: &'a mut Vec<u8>,
    pixels: &Pixels,
) -> Result<::png::Encoder<'a, &'a mut Vec<u8>>, Error> {
    let (Ok(width), Ok(height)) = (u32::try_from(pixels.width), u32::try_from(pixels.height))
    else {
        return Err(Error::invalid(format!(
            "{}x{} pixels are too many for PNG",
            pixels.width, pixels.height
        )));
    };
    let mut encoder = ::png::Encoder::new(out, width, height);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    // At 640x480 about a third of the default's time for 14 to 27 % more bytes.
    encoder.set_deflate_compression(::png::DeflateCompression::Level(3));
    encoder.set_source_srgb(::png::SrgbRenderingIntent::Perceptual);
    Ok(encoder)
}

/// Display light from 0 to 1 of exposed radiance; negative radiance is black.
fn curve(tone: Tone, radiance: Vec3) -> Vec3 {
    match tone {
        // White long before 8; the bound keeps the squares finite.
        Tone::Filmic => {
            let x = radiance.clamp(Vec3::ZERO, Vec3::splat(8.0));
            (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).min(Vec3::ONE)
        }
        Tone::Clip => radiance.clamp(Vec3::ZERO, Vec3::ONE),
    }
}

/// The sRGB code of display light from 0 to 1, to the nearest: how many borders lie below it.
fn eight_bits(light: f32) -> u8 {
    BORDERS.partition_point(|&border| border <= light) as u8
}

/// Border k is the display light half-way between the sRGB codes k and k + 1 (IEC 61966-2-1). Eight
/// comparisons with borders are several times faster than a power for every number.
static BORDERS: LazyLock<[f32; 255]> = LazyLock::new(|| {
    std::array::from_fn(|k| {
        let code = (k as f64 + 0.5) / 255.0;
        let light =
            if code <= 0.040_45 { code / 12.92 } else { libm::pow((code + 0.055) / 1.055, 2.4) };
        light as f32
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, values: &[f32]) -> Image {
        Image::new(
            width,
            values.len() / width.max(1),
            values.iter().copied().map(Vec3::splat).collect(),
        )
    }

    fn codes(image: &Image, exposure: f32, tone: Tone, scale: u32) -> Vec<u8> {
        pixels(image, exposure, tone, scale, "the image")
            .unwrap()
            .rgb
            .chunks(3)
            .map(|p| p[0])
            .collect()
    }

    #[test]
    fn srgb_has_the_known_codes() {
        let image = grey(6, &[0.0, 0.5, 1.0, 0.001, 0.214_041_14, -3.0]);
        assert_eq!(codes(&image, 0.0, Tone::Clip, 1), [0, 188, 255, 3, 128, 0]);
    }

    #[test]
    fn every_light_gets_the_nearest_code() {
        for i in 0..=20_000 {
            let light = i as f32 / 20_000.0;
            let l = f64::from(light);
            let exact =
                if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 };
            assert!((f64::from(eight_bits(light)) - 255.0 * exact).abs() < 0.5001, "{light}");
        }
    }

    #[test]
    fn exposure_is_in_stops() {
        assert_eq!(codes(&grey(2, &[0.25, 1.0]), 1.0, Tone::Clip, 1), [188, 255]);
        assert_eq!(codes(&grey(2, &[2.0, 0.0]), -2.0, Tone::Clip, 1), [188, 0]);
        assert_eq!(codes(&grey(2, &[f32::MAX, f32::MIN]), 64.0, Tone::Filmic, 1), [255, 0]);
    }

    #[test]
    fn filmic_rises_from_black_to_white() {
        let light = |x: f32| curve(Tone::Filmic, Vec3::splat(x)).x;
        assert_eq!((light(0.0), light(-1.0), light(7.3), light(f32::MAX)), (0.0, 0.0, 1.0, 1.0));
        assert!((light(1.0) - 2.54 / 3.16).abs() < 1e-6 && light(7.2) < 1.0);
        assert!((0..800).all(|i| light(i as f32 * 0.01) <= light(i as f32 * 0.01 + 0.01)));
    }

    #[test]
    fn channels_keep_their_order() {
        let image = Image::new(1, 1, vec![Vec3::new(1.0, 0.5, 0.0)]);
        assert_eq!(pixels(&image, 0.0, Tone::Clip, 1, "the image").unwrap().rgb, [255, 188, 0]);
    }

    #[test]
    fn boxes_average_display_light_and_edges_what_they_have() {
        // 5x3 by 2: three boxes across, two down; the last of each is narrower.
        let image =
            grey(5, &[0.0, 9.0, 0.5, 0.5, 0.0, 1.0, 0.0, 0.5, 0.5, 1.0, 0.0, 1.0, 1.0, 1.0, 0.5]);
        let small = pixels(&image, 0.0, Tone::Clip, 2, "the image").unwrap();
        assert_eq!((small.width, small.height), (3, 2));
        assert_eq!(codes(&image, 0.0, Tone::Clip, 2), [188, 188, 188, 188, 255, 188]);
        assert_eq!(codes(&image, 0.0, Tone::Clip, 64).len(), 1);
    }

    #[test]
    fn what_cannot_be_shown_is_named() {
        let error =
            |image: &Image| checked(image, format_args!("image {}", 4)).unwrap_err().to_string();
        assert!(
            error(&grey(2, &[0.0, 1.0, f32::NAN, 1.0]))
                .starts_with("image 4 is not finite at pixel (0, 1)")
        );
        assert!(
            error(&grey(2, &[0.0, f32::INFINITY]))
                .contains("pixel (1, 0): its radiance is (inf, inf, inf)")
        );
        assert!(error(&Image::new(0, 0, Vec::new())).contains("image 4 has no pixels: it is 0x0"));
        assert!(error(&Image { radiance: vec![Vec3::ZERO; 3].into() }).contains("no pixels"));
        assert_eq!(checked(&grey(2, &[0.0, -1.0]), "x").unwrap(), (2, 1));
    }
}
