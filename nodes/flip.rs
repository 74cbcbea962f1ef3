//! FLIP of images against their references (Andersson et al. 2020, 2021).

use crate::data::{Flip as FlipErrors, Image};
use crate::kernel::metrics::flip::{BYTES_PER_PIXEL, FlipRange, error_map, mean};
use crate::kernel::metrics::{Pair, count};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::params! {
    /// How different images look from their references to somebody who flips between the two: the
    /// mean FLIP error, from 0 (none) to 1, of pairs of the same place in order. `hdr` looks at all
    /// radiance (HDR-FLIP, Andersson et al. 2021): start, stop and number of exposures follow from
    /// the reference, the tone curve is ACES. `ldr` looks at radiance cut at 0 and 1 (LDR-FLIP,
    /// Andersson et al. 2020). Negative radiance is black. Where the median of a reference is black,
    /// its other pixels decide the exposures; where all of it is, those of the image.
    pub struct Flip {
        /// What of the radiance is looked at: all of it, or what a display shows as it is.
        range: FlipRange = FlipRange::Hdr;
        /// Pixels of the picture per degree of the visual field. The default is that of the published
        /// tool: 3840 pixels on 0.7 m, seen from 0.7 m.
        pixels_per_degree: f32 = 67.0206, 1.0..=1000.0;
    }
}

crate::inputs! {
    /// Inputs of [`Flip`].
    pub struct FlipIn {
        /// What to judge; finite.
        image: All<Image>,
        /// What it should be: as many images, each of the size of its image.
        reference: All<Image>,
    }
}

impl Node for Flip {
    const KIND: &'static str = "Flip";
    const VERSION: u32 = 1;
    type In = FlipIn;
    type Out = FlipErrors;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // One pair at a time; an image has twelve bytes a pixel.
        let pair = inputs.total() / inputs.items("image").max(1);
        pair + pair / 24 * BYTES_PER_PIXEL
    }

    fn run(&self, input: FlipIn, ctx: &Ctx) -> Result<FlipErrors, Error> {
        let count = count(&input.image, &input.reference)?;
        let judge = |k: usize| {
            let pair = Pair::get(&input.image, &input.reference, k)?;
            let tick = |_, _| ctx.tick(k as u64, count as u64);
            let (image, reference) = (&pair.image, &pair.reference);
            error_map(image, reference, self.range, self.pixels_per_degree, tick)
                .map(|errors| mean(&errors))
        };
        Ok(FlipErrors { flip: (0..count).map(judge).collect::<Result<Vec<_>, _>>()?.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::trial::{all, grey};

    fn run(images: &[Image], references: &[Image], range: FlipRange) -> Result<Vec<f64>, Error> {
        let input = FlipIn { image: all(images), reference: all(references) };
        let flip = Flip { range, ..Flip::default() };
        flip.run(input, &Ctx::default()).map(|found| found.flip.to_vec())
    }

    fn both(image: &Image, reference: &Image) -> [f64; 2] {
        [FlipRange::Hdr, FlipRange::Ldr].map(|range| {
            run(std::slice::from_ref(image), std::slice::from_ref(reference), range).unwrap()[0]
        })
    }

    #[test]
    fn identical_and_black_images_have_no_error() {
        let images =
            [grey(&[0.3, 1e30, f32::MAX]), grey(&[1e-30, 0.0]), grey(&[0.0, -2.0]), grey(&[0.5])];
        for image in &images {
            assert_eq!(both(image, image), [0.0; 2]);
        }
        let found = run(&images, &images, FlipRange::Hdr).unwrap();
        assert_eq!(found, [0.0; 4]);
    }

    #[test]
    fn one_pixel_and_extremes_have_a_value() {
        let (black, white) = (grey(&[0.0]), grey(&[1.0]));
        for errors in [both(&white, &black), both(&black, &white)] {
            assert!(errors.iter().all(|&e| e > 0.9 && e <= 1.0), "{errors:?}");
        }
        let pairs = [
            (grey(&[f32::MAX, 0.0]), grey(&[f32::from_bits(1), 1.0])),
            (grey(&[f32::MIN, 1.0]), grey(&[f32::MAX, f32::MAX])),
            (grey(&[1.0]), grey(&[f32::MIN])),
        ];
        for (image, reference) in &pairs {
            for error in both(image, reference) {
                assert!((0.5..=1.0).contains(&error), "{error}");
            }
        }
    }

    #[test]
    fn negative_radiance_is_black() {
        let (negative, black) = (grey(&[-1.0, 0.7, -0.1]), grey(&[0.0, 0.7, 0.0]));
        let other = grey(&[0.5, 0.6, 0.7]);
        assert_eq!(both(&negative, &other), both(&black, &other));
        assert_eq!(both(&other, &negative), both(&other, &black));
    }

    #[test]
    fn hdr_sees_what_a_clipping_display_does_not() {
        let [hdr, ldr] = both(&grey(&[8.0, 2.0, 3.0]), &grey(&[2.0, 2.0, 3.0]));
        assert!(hdr > 0.1 && ldr == 0.0, "{hdr} {ldr}");
        // All the same under any exposure.
        let scaled = |s: f32| both(&grey(&[8.0 * s, 2.0 * s]), &grey(&[2.0 * s, 3.0 * s]))[0];
        assert!((scaled(1.0) - scaled(2.0_f32.powi(60))).abs() < 1e-6);
    }

    #[test]
    fn what_has_no_number_is_refused() {
        let error = |i: &[Image], r: &[Image]| run(i, r, FlipRange::Hdr).unwrap_err().to_string();
        let whites = [grey(&[1.0]), grey(&[1.0])];
        assert_eq!(error(&whites, &whites[..1]), "there are 2 images but 1 references");
        assert!(error(&[], &[]).contains("no image"));
        let holed = [grey(&[1.0]), grey(&[f32::NAN])];
        assert!(error(&holed, &whites).starts_with("image 1 is not finite at pixel (0, 0)"));
        assert!(error(&whites, &holed).starts_with("reference 1 is not finite at pixel (0, 0)"));
        let wide = [grey(&[1.0]), grey(&[1.0, 1.0])];
        assert_eq!(error(&whites, &wide), "image 1 is 1x1 pixels but reference 1 is 2x1");
        assert!(error(&[Image::new(0, 0, Vec::new())], &whites[..1]).contains("no pixels"));
    }
}
