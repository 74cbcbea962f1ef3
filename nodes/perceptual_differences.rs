//! Pixels in which an observer sees a difference to the reference (Yee 2004).

use crate::data::{self, Image};
use crate::kernel::metrics::yee::{View, different};
use crate::kernel::metrics::{Pair, count};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::params! {
    /// The share of pixels that look different from those of the references (Yee 2004), in pairs of the
    /// same place in order. A pixel differs if its luminance does by more than the visible threshold at
    /// the luminance around it (Ward Larson et al. 1997), or its CIE a and b by more in square; both
    /// thresholds are raised 1 to 10 times by the contrast around it (Barten 1989, Daly 1993).
    /// Constants, levels and borders are those of `idiff -p` of OpenImageIO, which takes linear RGB for
    /// Adobe RGB primaries, does not cut radiance above 1, and below 10 cd/m^2 counts colour one
    /// hundredth; the arithmetic is of double precision.
    pub struct PerceptualDifferences {
        /// Angle that the picture's width fills in the observer's view, degrees.
        fov: f32 = 45.0, 0.1..=179.0;
        /// Luminance of white, radiance 1, in cd/m^2: that of the display.
        luminance: f32 = 100.0, 1e-3..=1e6;
    }
}

crate::inputs! {
    /// Inputs of [`PerceptualDifferences`].
    pub struct PerceptualDifferencesIn {
        /// What to judge; all of it finite.
        image: All<Image>,
        /// What it should be: as many images, each of the size of its image.
        reference: All<Image>,
    }
}

impl Node for PerceptualDifferences {
    const KIND: &'static str = "PerceptualDifferences";
    const VERSION: u32 = 1;
    type In = PerceptualDifferencesIn;
    type Out = data::PerceptualDifferences;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // The pair where it is not mapped, and a double a pixel for eight levels of each and half of
        // the next.
        14 * inputs.total() / (inputs.items("image") + inputs.items("reference")).max(1)
    }

    fn run(
        &self,
        input: PerceptualDifferencesIn,
        ctx: &Ctx,
    ) -> Result<data::PerceptualDifferences, Error> {
        let PerceptualDifferencesIn { image, reference } = input;
        let count = count(&image, &reference)?;
        let view = View { fov: self.fov.into(), luminance: self.luminance.into() };
        let of = |k: usize| {
            ctx.tick(k as u64, count as u64)?;
            let pair = Pair::get(&image, &reference, k)?;
            let (width, height) = pair.size();
            Ok(different(&pair, view) as f64 / (width * height) as f64)
        };
        let different = (0..count).map(of).collect::<Result<_, Error>>()?;
        Ok(data::PerceptualDifferences { different })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::pairs::pairs;
    use crate::kernel::metrics::trial::{all, grey, plain};
    use glam::Vec3;
    use std::slice::from_ref;

    fn run(
        node: &PerceptualDifferences,
        images: &[Image],
        references: &[Image],
    ) -> Result<Vec<f64>, Error> {
        let input = PerceptualDifferencesIn { image: all(images), reference: all(references) };
        Ok(node.run(input, &Ctx::default())?.different.to_vec())
    }

    #[test]
    fn shares_are_of_all_pixels() {
        let reference = plain(8, 8, Vec3::splat(0.5));
        let mut radiance = reference.radiance.to_vec();
        radiance[..32].fill(Vec3::ZERO);
        let half = Image::new(8, 8, radiance);
        let bright = plain(8, 8, Vec3::ONE);
        let references = [reference.clone(), reference.clone(), reference.clone()];
        let found = run(&PerceptualDifferences::default(), &[half, reference, bright], &references);
        assert_eq!(found.unwrap(), [0.5, 0.0, 1.0]);
    }

    #[test]
    fn a_dim_display_shows_less() {
        let [.., dark] = pairs();
        let at = |luminance| {
            let node = PerceptualDifferences { luminance, ..Default::default() };
            run(&node, from_ref(&dark.1), from_ref(&dark.2)).unwrap()[0]
        };
        assert!(at(0.1) < at(1000.0));
    }

    #[test]
    fn bits_do_not_depend_on_threads() {
        let [first, second, ..] = pairs();
        let (images, references) = ([first.1, second.1], [first.2, second.2]);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&PerceptualDifferences::default(), &images, &references)).unwrap()
        };
        assert_eq!(on(1), on(2));
    }

    #[test]
    fn what_cannot_be_compared_is_named() {
        let error = |i: &[Image], r: &[Image]| {
            run(&PerceptualDifferences::default(), i, r).unwrap_err().to_string()
        };
        let (one, two) = ([grey(&[1.0])], [grey(&[1.0, 2.0])]);
        assert!(error(&[], &[]).contains("no image"));
        assert_eq!(error(&two, &one), "image 0 is 2x1 pixels but reference 0 is 1x1");
        assert!(error(&[grey(&[f32::INFINITY])], &one).starts_with("image 0 is not finite"));
    }
}
