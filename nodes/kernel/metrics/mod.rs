//! How far a picture is from its reference, as numbers.

pub mod display;
pub mod errors;
pub mod flip;
pub mod ssim;
pub mod steadiness;
pub mod yee;

#[cfg(test)]
pub mod pairs;
#[cfg(test)]
mod published;
#[cfg(test)]
pub mod published_flip;

use crate::data::Image;
use crate::kernel::tone::checked;
use crate::node::{All, Error, Item};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// An image and its reference: of equal size, with at least one pixel, all finite.
pub struct Pair {
    /// What is judged.
    pub image: Item<Image>,
    /// What it should be.
    pub reference: Item<Image>,
}

impl Pair {
    /// Pair `k` of two sequences.
    ///
    /// # Errors
    /// When the two differ in size, one has no pixel or is not finite, or cannot be read; the message
    /// names image and reference by `k`.
    pub fn get(image: &All<Image>, reference: &All<Image>, k: usize) -> Result<Pair, Error> {
        let (image, reference) = (image.get(k)?, reference.get(k)?);
        let size = checked(&image, format_args!("image {k}"))?;
        let (width, height) = checked(&reference, format_args!("reference {k}"))?;
        if (width, height) != size {
            let (w, h) = size;
            return Err(Error::invalid(format!(
                "image {k} is {w}x{h} pixels but reference {k} is {width}x{height}"
            )));
        }
        Ok(Pair { image, reference })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.image.size()
    }

    /// What the image has beyond the reference at pixel `p`.
    pub fn error(&self, p: usize) -> DVec3 {
        wide(self.image.radiance[p]) - wide(self.reference.radiance[p])
    }
}

/// How many pairs two sequences make.
///
/// # Errors
/// When they differ in length or are empty.
pub fn count(image: &All<Image>, reference: &All<Image>) -> Result<usize, Error> {
    let (count, references) = (image.len(), reference.len());
    if count != references {
        return Err(Error::invalid(format!(
            "there are {count} images but {references} references"
        )));
    }
    if count == 0 {
        return Err(Error::invalid("there is no image to compare"));
    }
    Ok(count)
}

/// Doubles hold differences, squares and sums of any finite radiance without overflow or underflow.
pub fn wide(radiance: Vec3) -> DVec3 {
    radiance.as_dvec3()
}

/// Sums of `of` over all pixels: rows side by side, then row after row, on any number of threads.
pub fn totals<const N: usize>(
    (width, height): (usize, usize),
    of: impl Fn(usize) -> [f64; N] + Sync,
) -> [f64; N] {
    let row = |y: usize| (y * width..(y + 1) * width).map(&of).fold([0.0; N], add);
    let rows: Vec<[f64; N]> = (0..height).into_par_iter().map(row).collect();
    rows.into_iter().fold([0.0; N], add)
}

fn add<const N: usize>(sum: [f64; N], more: [f64; N]) -> [f64; N] {
    std::array::from_fn(|i| sum[i] + more[i])
}

#[cfg(test)]
pub mod trial {
    //! What the tests of several metrics share.

    use super::*;

    /// Sequences of images.
    pub fn all(images: &[Image]) -> All<Image> {
        All::from(images.iter().cloned().map(Item::from).collect::<Vec<_>>())
    }

    /// A pair of two images that fit.
    pub fn pair(image: &Image, reference: &Image) -> Pair {
        let one = |image: &Image| all(std::slice::from_ref(image));
        Pair::get(&one(image), &one(reference), 0).expect("the images fit")
    }

    /// An image of one row of grey pixels.
    pub fn grey(values: &[f32]) -> Image {
        Image::new(values.len(), 1, values.iter().copied().map(Vec3::splat).collect())
    }

    /// An image of one colour.
    pub fn plain(width: usize, height: usize, radiance: Vec3) -> Image {
        Image::new(width, height, vec![radiance; width * height])
    }
}
