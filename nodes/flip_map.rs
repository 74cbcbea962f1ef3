//! The FLIP error map of an image against its reference (Andersson et al. 2020, 2021).

use crate::data::Image;
use crate::kernel::metrics::flip::{BYTES_PER_PIXEL, FlipRange, error_map, magma::coloured};
use crate::kernel::tone::checked;
use crate::node::{Ctx, Error, Item, Node, Sizes};

crate::params! {
    /// Where an image looks different from its reference to somebody who flips between the two: the
    /// FLIP error of each pixel in the colours of the magma map, from black (0) to pale yellow (1).
    /// The colours are those of the map where they are shown unexposed and with no tone curve
    /// (`clip`). What `range` means stands at `Flip`, whose number is the mean of these errors.
    pub struct FlipMap {
        /// What of the radiance is looked at: all of it, or what a display shows as it is.
        range: FlipRange = FlipRange::Hdr;
        /// Pixels of the picture per degree of the visual field. The default is that of the published
        /// tool: 3840 pixels on 0.7 m, seen from 0.7 m.
        pixels_per_degree: f32 = 67.0206, 1.0..=1000.0;
    }
}

crate::inputs! {
    /// Inputs of [`FlipMap`].
    pub struct FlipMapIn {
        /// What to judge; finite.
        image: Item<Image>,
        /// What it should be; of the same size.
        reference: Item<Image>,
    }
}

impl Node for FlipMap {
    const KIND: &'static str = "FlipMap";
    const VERSION: u32 = 1;
    type In = FlipMapIn;
    type Out = Image;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // An image, of which there are two and the output, has twelve bytes a pixel.
        inputs.total() / 24 * (BYTES_PER_PIXEL + 12)
    }

    fn run(&self, input: FlipMapIn, ctx: &Ctx) -> Result<Image, Error> {
        let (image, reference) = (&*input.image, &*input.reference);
        let (width, height) = checked(image, "the image")?;
        let (w, h) = checked(reference, "the reference")?;
        if (w, h) != (width, height) {
            return Err(Error::invalid(format!(
                "the image is {width}x{height} pixels but the reference is {w}x{h}"
            )));
        }
        let tick = |done, all| ctx.tick(done, all);
        let errors = error_map(image, reference, self.range, self.pixels_per_degree, tick)?;
        Ok(coloured(&errors, width, height))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn run(image: &Image, reference: &Image) -> Result<Image, Error> {
        let input = FlipMapIn { image: image.clone().into(), reference: reference.clone().into() };
        FlipMap::default().run(input, &Ctx::default())
    }

    #[test]
    fn errors_light_up_where_they_are() {
        let grey = Image::new(64, 2, vec![Vec3::splat(0.5); 128]);
        let mut spotted = vec![Vec3::splat(0.5); 128];
        spotted[8] = Vec3::new(3.0, 0.0, 0.0);
        let map = run(&Image::new(64, 2, spotted), &grey).unwrap();
        assert_eq!(map.size(), (64, 2));
        let light = |x: usize| map.radiance[x].element_sum();
        let none = run(&grey, &grey).unwrap().radiance[0];
        assert!(light(8) > 0.5 && light(8) > light(12) && light(12) > none.element_sum());
        assert_eq!(map.radiance[40], none);
    }

    #[test]
    fn refuses_other_sizes_and_what_is_not_finite() {
        let black = |w, h| Image::new(w, h, vec![Vec3::ZERO; w * h]);
        let error = |i: &Image, r: &Image| run(i, r).unwrap_err().to_string();
        assert_eq!(
            error(&black(2, 1), &black(1, 2)),
            "the image is 2x1 pixels but the reference is 1x2"
        );
        let holed = Image::new(1, 1, vec![Vec3::INFINITY]);
        assert!(error(&black(1, 1), &holed).starts_with("the reference is not finite"));
        assert!(error(&black(0, 0), &black(0, 0)).contains("no pixels"));
    }
}
