//! The difference image of the papers' figures.

use crate::data::Image;
use crate::kernel::tone::checked;
use crate::node::{Ctx, Error, Item, Node};
use glam::Vec3;

crate::params! {
    /// The distance of an image from its reference at each pixel and channel, magnified: |I - R| times
    /// the factor (the 5x difference images of Hašan et al. 2007).
    pub struct Difference {
        /// What the distance is multiplied by.
        factor: f32 = 5.0, 0.0..=1e9;
    }
}

crate::inputs! {
    /// Inputs of [`Difference`].
    pub struct DifferenceIn {
        /// What to judge.
        image: Item<Image>,
        /// What it should be; of the same size.
        reference: Item<Image>,
    }
}

impl Node for Difference {
    const KIND: &'static str = "Difference";
    const VERSION: u32 = 1;
    type In = DifferenceIn;
    type Out = Image;

    fn run(&self, input: DifferenceIn, ctx: &Ctx) -> Result<Image, Error> {
        ctx.tick(0, 1)?;
        let (width, height) = checked(&input.image, "the image")?;
        let (w, h) = checked(&input.reference, "the reference")?;
        if (w, h) != (width, height) {
            return Err(Error::invalid(format!(
                "the image is {width}x{height} pixels but the reference is {w}x{h}"
            )));
        }
        let magnified = |i: f32, r: f32| {
            let distance = (f64::from(i) - f64::from(r)).abs() * f64::from(self.factor);
            distance.min(f64::from(f32::MAX)) as f32
        };
        let pairs = input.image.radiance.iter().zip(input.reference.radiance.iter());
        let distance = pairs
            .map(|(i, r)| Vec3::new(magnified(i.x, r.x), magnified(i.y, r.y), magnified(i.z, r.z)));
        Ok(Image::new(width, height, distance.collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(image: Image, reference: Image) -> Result<Image, Error> {
        let input = DifferenceIn { image: image.into(), reference: reference.into() };
        Difference::default().run(input, &Ctx::default())
    }

    #[test]
    fn magnifies_the_distance_either_way() {
        let image = Image::new(2, 1, vec![Vec3::new(1.0, 2.0, 0.5), Vec3::splat(f32::MAX)]);
        let reference = Image::new(2, 1, vec![Vec3::new(2.0, 1.0, 0.5), Vec3::splat(f32::MIN)]);
        let found = run(image, reference).unwrap();
        assert_eq!(
            (found.size(), &found.radiance[..]),
            ((2, 1), &[Vec3::new(5.0, 5.0, 0.0), Vec3::MAX][..])
        );
    }

    #[test]
    fn refuses_other_sizes_and_what_is_not_finite() {
        let black = |w, h| Image::new(w, h, vec![Vec3::ZERO; w * h]);
        let error = |i, r| run(i, r).unwrap_err().to_string();
        assert_eq!(
            error(black(2, 1), black(1, 2)),
            "the image is 2x1 pixels but the reference is 1x2"
        );
        let holed = Image::new(2, 1, vec![Vec3::ZERO, Vec3::NAN]);
        assert!(
            error(black(2, 1), holed).starts_with("the reference is not finite at pixel (1, 0)")
        );
        assert!(error(black(0, 0), black(0, 0)).contains("no pixels"));
    }
}
