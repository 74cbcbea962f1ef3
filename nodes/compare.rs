//! Images against their references in numbers.

use crate::data::{Comparison, Image};
use crate::kernel::metrics::errors::{Sums, error99, peak, psnr, psnr_linear};
use crate::kernel::metrics::steadiness::Steadiness;
use crate::kernel::metrics::{Pair, count, totals};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::params! {
    /// Compares images I with their references R over linear RGB, in pairs of the same place in order.
    /// Relative L2 error: |I - R| / |R| with the 2-norm over all pixels and channels; 0 where both are
    /// black. Energy: the sum of I over the sum of R; 1 where both are black. Flicker: the mean over
    /// neighbouring pairs of |(I' - R') - (I - R)| / |R'|, the same norm, with |R| where R' is black;
    /// zero for any error that does not change.
    /// RMSE: the root of the mean of (I - R)^2. Relative MSE: the mean of (I - R)^2 / (R^2 + epsilon).
    /// error99: the 99th percentile of |I - R|, linear between neighbours in order. All three over
    /// pixels and channels.
    /// PSNR: of display values, 10 log10(1 / MSE), where the 99th percentile of |R| (the largest |R|
    /// where that is 0) is white and display values are cut to [0, 1] and in sRGB without rounding.
    /// psnr_linear: of radiance as it is, 10 log10(white^2 / MSE). Both are in dB and at most 200, which
    /// is also the value of equal images.
    /// Static deviation: the standard deviation in time of I - R where R stands still, over the mean of
    /// |R| in all frames. A pixel stands still between neighbouring frames if |R' - R| is at most 1e-3
    /// of the larger of |R| and |R'|, the norm over its channels; frames so joined are a run, each run
    /// varies about its own mean, and the variance is over all runs, a run of n frames having n - 1
    /// degrees of freedom. 0 where no pixel stands still.
    pub struct Compare {
        /// Added to R^2 under the relative MSE, in units of radiance squared: it keeps black from
        /// weighing without bound.
        epsilon: f64 = 1e-2, 1e-12..=1e12;
    }
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
    const VERSION: u32 = 2;
    type In = CompareIn;
    type Out = Comparison;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // Two pairs at a time, where the images are not mapped; twice the size of an image for the
        // values of a percentile, and less than three times for the runs of still pixels.
        9 * inputs.total() / (inputs.items("image") + inputs.items("reference")).max(1)
    }

    fn run(&self, input: CompareIn, ctx: &Ctx) -> Result<Comparison, Error> {
        let CompareIn { image, reference } = input;
        let count = count(&image, &reference)?;
        let mut frames: Vec<Frame> = Vec::with_capacity(count);
        let (mut changes, mut magnitude, mut steadiness) = (0.0, 0.0, Steadiness::default());
        let mut before: Option<Pair> = None;
        for k in 0..count {
            ctx.tick(k as u64, count as u64)?;
            let pair = Pair::get(&image, &reference, k)?;
            let frame = Frame::of(&pair, self.epsilon, k)?;
            if let (Some(before), Some(last)) = (&before, frames.last()) {
                let norm = if frame.norm > 0.0 { frame.norm } else { last.norm };
                changes += change(before, &pair, norm, k)?;
            }
            steadiness.add(before.as_ref(), &pair);
            magnitude += frame.magnitude / count as f64;
            frames.push(frame);
            before = Some(pair);
        }
        let steady = steadiness.deviation();
        let each = |of: fn(&Frame) -> f64| frames.iter().map(of).collect();
        Ok(Comparison {
            relative_l2: each(|frame| frame.relative_l2),
            energy: each(|frame| frame.energy),
            rmse: each(|frame| frame.rmse),
            rel_mse: each(|frame| frame.rel_mse),
            psnr: each(|frame| frame.psnr),
            psnr_linear: each(|frame| frame.psnr_linear),
            error99: each(|frame| frame.error99),
            flicker: changes / (count - 1).max(1) as f64,
            // All black references have no error.
            static_deviation: if magnitude > 0.0 { steady / magnitude } else { 0.0 },
        })
    }
}

/// The numbers of one pair.
struct Frame {
    /// 2-norm of the reference.
    norm: f64,
    /// Mean of |R|.
    magnitude: f64,
    relative_l2: f64,
    energy: f64,
    rmse: f64,
    rel_mse: f64,
    psnr: f64,
    psnr_linear: f64,
    error99: f64,
}

impl Frame {
    /// The numbers of pair `k`.
    fn of(pair: &Pair, epsilon: f64, k: usize) -> Result<Frame, Error> {
        let sums = Sums::of(pair, epsilon);
        let (relative_l2, energy) = (relative_l2(&sums, k)?, energy(&sums, k)?);
        let peak = peak(pair);
        Ok(Frame {
            norm: sums.reference.sqrt(),
            magnitude: sums.magnitude / sums.values,
            relative_l2,
            energy,
            rmse: sums.mean_square().sqrt(),
            rel_mse: sums.relative / sums.values,
            psnr: psnr(pair, &sums, peak),
            psnr_linear: psnr_linear(&sums, peak),
            error99: error99(pair),
        })
    }
}

fn relative_l2(sums: &Sums, k: usize) -> Result<f64, Error> {
    match (sums.reference > 0.0, sums.error > 0.0) {
        (true, _) => Ok(sums.error.sqrt() / sums.reference.sqrt()),
        (false, false) => Ok(0.0),
        (false, true) => Err(Error::invalid(format!(
            "reference {k} is all black and image {k} is not: a relative error has no value"
        ))),
    }
}

fn energy(sums: &Sums, k: usize) -> Result<f64, Error> {
    let [image, reference] = sums.light;
    if reference != 0.0 {
        return Ok(image / reference);
    }
    if sums.reference > 0.0 {
        return Err(Error::invalid(format!(
            "reference {k} has negative radiance and sums to 0: the ratio of energies has no value"
        )));
    }
    Ok(1.0)
}

/// How far the error moved from the pair `before` to `pair`, the one of number `k`, relative to `norm`:
/// that of the reference now, or then where it is black now. Where it is black in both, so are the
/// images, and nothing moved.
fn change(before: &Pair, pair: &Pair, norm: f64, k: usize) -> Result<f64, Error> {
    let (size, old) = (pair.size(), before.size());
    if size != old {
        let last = k - 1;
        return Err(Error::invalid(format!(
            "image {k} is {}x{} pixels but image {last} is {}x{}",
            size.0, size.1, old.0, old.1
        )));
    }
    let [moved] = totals(size, |p| [(pair.error(p) - before.error(p)).length_squared()]);
    Ok(if norm > 0.0 { moved.sqrt() / norm } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::trial::{all, grey};
    use glam::Vec3;

    fn run(images: &[Image], references: &[Image]) -> Result<Comparison, Error> {
        Compare::default()
            .run(CompareIn { image: all(images), reference: all(references) }, &Ctx::default())
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
        for zeros in [&found.rmse, &found.rel_mse, &found.error99] {
            assert_eq!(zeros[..], [0.0; 3]);
        }
        assert_eq!((&found.psnr[..], &found.psnr_linear[..]), (&[200.0; 3][..], &[200.0; 3][..]));
        assert_eq!(found.static_deviation, 0.0);
    }

    #[test]
    fn errors_of_radiance_are_the_known_ones() {
        let found = run(&[grey(&[3.0, 1.0])], &[grey(&[1.0, 0.0])]).unwrap();
        assert!((found.rmse[0] - 2.5_f64.sqrt()).abs() < 1e-15);
        assert!((found.rel_mse[0] - (4.0 / 1.01 + 1.0 / 0.01) / 2.0).abs() < 1e-12);
        // Six values, 1, 1, 1, 2, 2, 2: the percentile is among the twos.
        assert_eq!(found.error99[..], [2.0]);
        assert!((found.psnr_linear[0] + 10.0 * 2.5_f64.log10()).abs() < 1e-12);
        // On the display 3 is as white as 1, and black is white.
        assert!((found.psnr[0] - 10.0 * 2.0_f64.log10()).abs() < 1e-12);
    }

    #[test]
    fn static_deviation_is_relative_to_the_mean_reference() {
        // Errors 1 and 3 at a pixel that stands still: a deviation of sqrt 2. The other one changes.
        let truth = [grey(&[2.0, 1.0]), grey(&[2.0, 3.0])];
        let found = run(&[grey(&[3.0, 1.0]), grey(&[5.0, 9.0])], &truth).unwrap();
        assert!((found.static_deviation - 2.0_f64.sqrt() / 2.0).abs() < 1e-15);
        let found = run(&[grey(&[3.0]), grey(&[9.0])], &[grey(&[2.0]), grey(&[3.0])]).unwrap();
        assert_eq!(found.static_deviation, 0.0);
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
        for number in [&found.rmse, &found.rel_mse, &found.psnr, &found.psnr_linear, &found.error99]
        {
            assert!(number[0].is_finite());
        }
        let negative = run(&[grey(&[-1.0, 0.5])], &[grey(&[-2.0, 0.5])]).unwrap();
        assert!(negative.psnr[0] == 200.0 && negative.psnr_linear[0] < 200.0);
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
            crate::data::encode(&found)
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
