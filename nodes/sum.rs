//! Images added up: light that was computed apart.

use crate::data::Image;
use crate::kernel::tone::checked;
use crate::node::{Ctx, Error, Many, Node};

crate::params! {
    /// The sum of images of one size at each pixel: direct light and indirect, for instance.
    pub struct Sum {}
}

crate::inputs! {
    /// Inputs of [`Sum`].
    pub struct SumIn {
        /// What to add up.
        images: Many<Image>,
    }
}

impl Node for Sum {
    const KIND: &'static str = "Sum";
    const VERSION: u32 = 1;
    type In = SumIn;
    type Out = Image;

    fn run(&self, input: SumIn, ctx: &Ctx) -> Result<Image, Error> {
        ctx.tick(0, 1)?;
        let Some(first) = input.images.first() else {
            return Err(Error::invalid("there is no image to add"));
        };
        let size = checked(first, "image 0")?;
        let mut sum = first.radiance.to_vec();
        for (k, image) in input.images.iter().enumerate().skip(1) {
            let (width, height) = checked(image, format_args!("image {k}"))?;
            if (width, height) != size {
                let (w, h) = size;
                return Err(Error::invalid(format!(
                    "image 0 is {w}x{h} pixels but image {k} is {width}x{height}"
                )));
            }
            sum.iter_mut().zip(image.radiance.iter()).for_each(|(sum, more)| *sum += *more);
        }
        let finite = |pixel: glam::Vec3| pixel.min(glam::Vec3::splat(f32::MAX));
        Ok(Image::new(size.0, size.1, sum.into_iter().map(finite).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn run(images: Vec<Image>) -> Result<Image, Error> {
        let images = Many(images.into_iter().map(Into::into).collect());
        Sum {}.run(SumIn { images }, &Ctx::default())
    }

    #[test]
    fn pixels_add_up_and_stay_finite() {
        let a = Image::new(2, 1, vec![Vec3::X, Vec3::splat(f32::MAX)]);
        let b = Image::new(2, 1, vec![Vec3::Y, Vec3::splat(f32::MAX)]);
        let sum = run(vec![a, b]).unwrap();
        assert_eq!(sum.radiance[..], [Vec3::new(1.0, 1.0, 0.0), Vec3::splat(f32::MAX)]);
    }

    #[test]
    fn other_sizes_and_none_are_refused() {
        let of = |w: usize| Image::new(w, 1, vec![Vec3::ONE; w]);
        let error = run(vec![of(2), of(3)]).unwrap_err().to_string();
        assert_eq!(error, "image 0 is 2x1 pixels but image 1 is 3x1");
        assert!(run(Vec::new()).is_err());
    }
}
