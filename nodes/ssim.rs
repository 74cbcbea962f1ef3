//! Structural similarity of images to their references (Wang et al. 2004).

use crate::data::{self, Image};
use crate::kernel::metrics::{Pair, count, ssim::ssim};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::params! {
    /// Structural similarity (Wang et al. 2004) of images to their references, in pairs of the same
    /// place in order: 11x11-pixel Gaussian windows with a standard deviation of 1.5, K1 = 0.01,
    /// K2 = 0.03, L = 1, the mean over all windows inside the picture.
    /// It judges what a display shows, without colour: radiance raised by the exposure and cut to
    /// [0, 1], in sRGB without rounding, as Rec. 709 luma (0.2126 R' + 0.7152 G' + 0.0722 B').
    /// Across a picture of fewer than 11 pixels the windows are centred on each pixel and weigh what is
    /// there.
    pub struct Ssim {
        /// Stops by which the radiance is raised first: 1 doubles it.
        exposure: f32 = 0.0, -64.0..=64.0;
    }
}

crate::inputs! {
    /// Inputs of [`Ssim`].
    pub struct SsimIn {
        /// What to judge; all of it finite.
        image: All<Image>,
        /// What it should be: as many images, each of the size of its image.
        reference: All<Image>,
    }
}

impl Node for Ssim {
    const KIND: &'static str = "Ssim";
    const VERSION: u32 = 1;
    type In = SsimIn;
    type Out = data::Ssim;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // The pair where it is not mapped, luma of both, and five doubles a pixel.
        7 * inputs.total() / (inputs.items("image") + inputs.items("reference")).max(1)
    }

    fn run(&self, input: SsimIn, ctx: &Ctx) -> Result<data::Ssim, Error> {
        let SsimIn { image, reference } = input;
        let count = count(&image, &reference)?;
        let gain = libm::exp2(self.exposure.into());
        let of = |k: usize| {
            ctx.tick(k as u64, count as u64)?;
            Ok(ssim(&Pair::get(&image, &reference, k)?, gain))
        };
        Ok(data::Ssim { ssim: (0..count).map(of).collect::<Result<_, Error>>()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::trial::{all, grey};
    use std::slice::from_ref;

    fn run(exposure: f32, images: &[Image], references: &[Image]) -> Result<data::Ssim, Error> {
        let input = SsimIn { image: all(images), reference: all(references) };
        Ssim { exposure }.run(input, &Ctx::default())
    }

    #[test]
    fn each_frame_has_its_own_and_exposure_is_in_stops() {
        let (dim, bright) = (grey(&[0.125, 0.5, 0.25]), grey(&[0.25, 1.0, 0.5]));
        let found = run(0.0, &[dim.clone(), bright.clone()], &[bright.clone(), bright.clone()]);
        let found = found.unwrap().ssim;
        assert!(found.len() == 2 && found[0] < 0.95 && found[1] == 1.0);
        let mirrored = grey(&[0.25, 0.5, 0.125]);
        let raised = grey(&[0.5, 1.0, 0.25]);
        let at = |exposure, image: &Image, reference: &Image| {
            run(exposure, from_ref(image), from_ref(reference)).unwrap().ssim[0]
        };
        assert_eq!(at(1.0, &dim, &mirrored), at(0.0, &bright, &raised));
        assert_eq!(at(64.0, &dim, &mirrored), 1.0);
        assert_eq!(
            at(-64.0, &grey(&[0.0]), &grey(&[f32::MAX])),
            at(0.0, &grey(&[0.0]), &grey(&[1.0]))
        );
    }

    #[test]
    fn bits_do_not_depend_on_threads() {
        let [first, second, ..] = crate::kernel::metrics::pairs::pairs();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (images, references) =
                ([first.1.clone(), second.1.clone()], [first.2.clone(), second.2.clone()]);
            let found = pool.install(|| run(0.0, &images, &references)).unwrap();
            found.ssim.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(on(1), on(2));
    }

    #[test]
    fn what_cannot_be_compared_is_named() {
        let error = |i: &[Image], r: &[Image]| run(0.0, i, r).unwrap_err().to_string();
        let (one, two) = ([grey(&[1.0])], [grey(&[1.0, 2.0])]);
        assert!(error(&[], &[]).contains("no image"));
        assert_eq!(error(&[], &one), "there are 0 images but 1 references");
        assert_eq!(error(&one, &two), "image 0 is 1x1 pixels but reference 0 is 2x1");
        assert!(error(&one, &[grey(&[f32::NAN])]).starts_with("reference 0 is not finite"));
        assert!(error(&[Image::new(0, 0, Vec::new())], &one).contains("image 0 has no pixels"));
    }
}
