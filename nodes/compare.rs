//! Images against their references in numbers.

use crate::data::{Comparison, Image};
use crate::kernel::tone::checked;
use crate::node::{All, Ctx, Error, Item, Node, Sizes};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

crate::params! {
    /// Compares images with their references over linear RGB, in pairs of the same place in order.
    /// Relative L2 error: |I - R| / |R| with the 2-norm over all pixels and channels; 0 where both are
    /// black. Energy: the sum of I over the sum of R; 1 where both are black. Flicker: the mean over
    /// neighbouring pairs of |(I' - R') - (I - R)| / |R'|, the same norm, with |R| where R' is black;
    /// zero for any error that does not change.
    pub struct Compare {}
}

crate::inputs! {
    /// Inputs of [`Compare`].
    pub struct CompareIn {
        /// What to judge; all of one size and finite.
        image: All<Image>,
        /// What it should be: as many images, of the same size.
        reference: All<Image>,
    }
}

impl Node for Compare {
    const KIND: &'static str = "Compare";
    const VERSION: u32 = 1;
    type In = CompareIn;
    type Out = Comparison;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // Two pairs at a time, where the images are not mapped.
        4 * inputs.total() / (inputs.items("image") + inputs.items("reference")).max(1)
    }

    fn run(&self, input: CompareIn, ctx: &Ctx) -> Result<Comparison, Error> {
        let count = input.image.len();
        if count != input.reference.len() {
            let references = input.reference.len();
            return Err(Error::invalid(format!(
                "there are {count} images but {references} references"
            )));
        }
        if count == 0 {
            return Err(Error::invalid("there is no image to compare"));
        }
        let (mut relative_l2, mut energy, mut changes) = (Vec::new(), Vec::new(), 0.0);
        let mut before: Option<Pair> = None;
        for k in 0..count {
            ctx.tick(k as u64, count as u64)?;
            let pair = Pair::get(&input, k)?;
            relative_l2.push(pair.relative_l2(k)?);
            energy.push(pair.energy(k)?);
            if let Some(before) = before {
                changes += pair.change_from(&before, k)?;
            }
            before = Some(pair);
        }
        let flicker = changes / (count - 1).max(1) as f64;
        Ok(Comparison { relative_l2: relative_l2.into(), energy: energy.into(), flicker })
    }
}

/// An image, its reference, and their sums over all pixels and channels.
struct Pair {
    image: Item<Image>,
    reference: Item<Image>,
    /// 2-norm of image - reference.
    distance: f64,
    /// 2-norm of the reference.
    norm: f64,
    /// Sum of the image and of the reference.
    light: [f64; 2],
}

impl Pair {
    /// Pair `k`, of equal size and finite.
    fn get(input: &CompareIn, k: usize) -> Result<Pair, Error> {
        let (image, reference) = (input.image.get(k)?, input.reference.get(k)?);
        let size = checked(&image, format_args!("image {k}"))?;
        let (width, height) = checked(&reference, format_args!("reference {k}"))?;
        if (width, height) != size {
            let (w, h) = size;
            return Err(Error::invalid(format!(
                "image {k} is {w}x{h} pixels but reference {k} is {width}x{height}"
            )));
        }
        let [distance, norm, test, truth] = totals(size, |p| {
            let (i, r) = (wide(image.radiance[p]), wide(reference.radiance[p]));
            [(i - r).length_squared(), r.length_squared(), i.element_sum(), r.element_sum()]
        });
        Ok(Pair {
            image,
            reference,
            distance: distance.sqrt(),
            norm: norm.sqrt(),
            light: [test, truth],
        })
    }

    fn relative_l2(&self, k: usize) -> Result<f64, Error> {
        match (self.norm > 0.0, self.distance > 0.0) {
            (true, _) => Ok(self.distance / self.norm),
            (false, false) => Ok(0.0),
            (false, true) => Err(Error::invalid(format!(
                "reference {k} is all black and image {k} is not: a relative error has no value"
            ))),
        }
    }

    fn energy(&self, k: usize) -> Result<f64, Error> {
        let [image, reference] = self.light;
        if reference != 0.0 {
            return Ok(image / reference);
        }
        if self.norm > 0.0 {
            return Err(Error::invalid(format!(
                "reference {k} has negative radiance and sums to 0: the ratio of energies has no value"
            )));
        }
        Ok(1.0)
    }

    /// How far the error moved since the pair `before`, relative to the reference now, or then where
    /// it is black now. Where it is black in both, so are the images, and nothing moved.
    fn change_from(&self, before: &Pair, k: usize) -> Result<f64, Error> {
        let (size, old) = (self.image.size(), before.image.size());
        if size != old {
            let last = k - 1;
            return Err(Error::invalid(format!(
                "image {k} is {}x{} pixels but image {last} is {}x{}",
                size.0, size.1, old.0, old.1
            )));
        }
        let error =
            |pair: &Pair, p: usize| wide(pair.image.radiance[p]) - wide(pair.reference.radiance[p]);
        let [moved] = totals(size, |p| [(error(self, p) - error(before, p)).length_squared()]);
        let norm = if self.norm > 0.0 { self.norm } else { before.norm };
        Ok(if norm > 0.0 { moved.sqrt() / norm } else { 0.0 })
    }
}

/// Doubles hold differences, squares and sums of any finite radiance without overflow or underflow.
fn wide(radiance: Vec3) -> DVec3 {
    radiance.as_dvec3()
}

/// Sums of `of` over all pixels: rows side by side, then row after row, on any number of threads.
fn totals<const N: usize>(
    (width, height): (usize, usize),
    of: impl Fn(usize) -> [f64; N] + Sync,
) -> [f64; N] {
    let add = |sum: [f64; N], more: [f64; N]| std::array::from_fn(|i| sum[i] + more[i]);
    let row = |y: usize| (y * width..(y + 1) * width).map(&of).fold([0.0; N], add);
    let rows: Vec<[f64; N]> = (0..height).into_par_iter().map(row).collect();
    rows.into_iter().fold([0.0; N], add)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(images: &[Image], references: &[Image]) -> Result<Comparison, Error> {
        let all = |images: &[Image]| {
            All::from(images.iter().cloned().map(Item::from).collect::<Vec<_>>())
        };
        Compare {}
            .run(CompareIn { image: all(images), reference: all(references) }, &Ctx::default())
    }

    fn grey(values: &[f32]) -> Image {
        Image::new(values.len(), 1, values.iter().copied().map(Vec3::splat).collect())
    }

    #[test]
    fn numbers_are_the_known_ones() {
        let image = Image::new(2, 1, vec![Vec3::new(3.0, 0.0, 0.0), Vec3::new(0.0, 5.0, 0.0)]);
        let reference = Image::new(2, 1, vec![Vec3::ZERO, Vec3::new(0.0, 1.0, 0.0)]);
        let found = run(&[image], &[reference]).unwrap();
        assert_eq!(
            (&found.relative_l2[..], &found.energy[..], found.flicker),
            (&[5.0][..], &[8.0][..], 0.0)
        );
    }

    #[test]
    fn equal_images_have_no_error() {
        let frames = [grey(&[0.3, 1e30]), grey(&[1e-30, 0.0]), grey(&[0.0, 0.0])];
        let found = run(&frames, &frames).unwrap();
        assert_eq!(
            (&found.relative_l2[..], &found.energy[..], found.flicker),
            (&[0.0; 3][..], &[1.0; 3][..], 0.0)
        );
    }

    #[test]
    fn flicker_is_zero_for_a_constant_bias_and_known_for_a_blink() {
        let truth = [grey(&[1.0, 2.0]), grey(&[4.0, 3.0]), grey(&[2.0, 2.0])];
        let biased = [grey(&[1.5, 1.75]), grey(&[4.5, 2.75]), grey(&[2.5, 1.75])];
        let found = run(&biased, &truth).unwrap();
        assert_eq!(found.flicker, 0.0);
        assert!(found.relative_l2.iter().all(|&e| e > 0.1));
        // The error is 1, 0, 3 at the first pixel: it moves by 1 against |R| = 5, then by 3 against 2 sqrt 2.
        let blinking = [grey(&[2.0, 2.0]), grey(&[4.0, 3.0]), grey(&[5.0, 2.0])];
        let expected = (1.0 / 5.0 + 3.0 / 8.0_f64.sqrt()) / 2.0;
        assert!((run(&blinking, &truth).unwrap().flicker - expected).abs() < 1e-15);
    }

    #[test]
    fn a_fade_to_black_has_a_flicker() {
        let (images, truth) = (
            [grey(&[3.0]), grey(&[0.0]), grey(&[0.0])],
            [grey(&[2.0]), grey(&[0.0]), grey(&[0.0])],
        );
        let found = run(&images, &truth).unwrap();
        assert_eq!(
            (&found.relative_l2[..], &found.energy[..]),
            (&[0.5, 0.0, 0.0][..], &[1.5, 1.0, 1.0][..])
        );
        assert_eq!(found.flicker, 0.25);
    }

    #[test]
    fn extremes_stay_finite() {
        let found = run(&[grey(&[f32::MAX])], &[grey(&[f32::from_bits(1)])]).unwrap();
        assert!(
            found.relative_l2[0].is_finite()
                && found.relative_l2[0] > 1e80
                && found.energy[0].is_finite()
        );
        let scaled =
            |s: f32| run(&[grey(&[1.5 * s, s])], &[grey(&[s, 2.0 * s])]).unwrap().relative_l2[0];
        let (one, tiny, huge) =
            (scaled(1.0), scaled(2.0_f32.powi(-120)), scaled(2.0_f32.powi(120)));
        assert!(one == tiny && one == huge);
    }

    #[test]
    fn sums_do_not_depend_on_threads() {
        let value = |i: usize, s: usize| Vec3::splat((i * s % 1013) as f32 * 0.013);
        let image = |s| Image::new(31, 97, (0..31 * 97).map(|i| value(i, s)).collect());
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found =
                pool.install(|| run(&[image(7), image(11)], &[image(13), image(17)])).unwrap();
            [found.relative_l2[0], found.relative_l2[1], found.energy[0], found.flicker]
                .map(f64::to_bits)
        };
        assert_eq!(on(1), on(2));
    }

    #[test]
    fn what_has_no_number_is_refused() {
        let error = |i: &[Image], r: &[Image]| run(i, r).unwrap_err().to_string();
        let (black, white) = (grey(&[0.0]), grey(&[1.0]));
        let whites = [white.clone(), white.clone()];
        assert_eq!(error(&whites, &whites[..1]), "there are 2 images but 1 references");
        assert!(error(&[], &[]).contains("no image"));
        let fading = [white.clone(), black];
        assert!(error(&whites, &fading).starts_with("reference 1 is all black and image 1 is not"));
        let holed = [white.clone(), grey(&[f32::NAN])];
        assert!(error(&holed, &whites).starts_with("image 1 is not finite at pixel (0, 0)"));
        assert!(error(&whites, &holed).starts_with("reference 1 is not finite at pixel (0, 0)"));
        let growing = [white, grey(&[1.0, 1.0])];
        assert_eq!(error(&growing, &growing), "image 1 is 2x1 pixels but image 0 is 1x1");
        assert_eq!(error(&growing, &whites), "image 1 is 2x1 pixels but reference 1 is 1x1");
        assert!(error(&growing[1..], &[grey(&[1.0, -1.0])]).contains("sums to 0"));
        let empty = [Image::new(0, 0, Vec::new())];
        assert!(error(&empty, &empty).contains("image 0 has no pixels"));
    }
}
