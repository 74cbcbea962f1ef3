//! Errors of one picture pixel by pixel, over all of its pixels and channels, in linear radiance and
//! in display values.

use super::display::srgb;
use super::{Pair, totals, wide};
use glam::DVec3;

/// The signal-to-noise ratio given to pictures without a difference, and the largest one, in dB.
pub const IDENTICAL: f64 = 200.0;

/// Sums of a pair over its pixels and channels; I is the image, R the reference.
pub struct Sums {
    /// How many values there are: three for each pixel.
    pub values: f64,
    /// Sum of (I - R)^2.
    pub error: f64,
    /// Sum of R^2.
    pub reference: f64,
    /// Sum of |R|.
    pub magnitude: f64,
    /// Sums of I and of R.
    pub light: [f64; 2],
    /// Sum of (I - R)^2 / (R^2 + epsilon).
    pub relative: f64,
}

impl Sums {
    /// The sums of a pair.
    pub fn of(pair: &Pair, epsilon: f64) -> Sums {
        let [error, reference, magnitude, test, truth, relative] = totals(pair.size(), |p| {
            let (i, r) = (wide(pair.image.radiance[p]), wide(pair.reference.radiance[p]));
            let (e2, r2) = ((i - r) * (i - r), r * r);
            let [e2_sum, r2_sum] = [e2, r2].map(DVec3::element_sum);
            let relative = (e2 / (r2 + epsilon)).element_sum();
            [e2_sum, r2_sum, r.abs().element_sum(), i.element_sum(), r.element_sum(), relative]
        });
        let (width, height) = pair.size();
        let values = 3.0 * width as f64 * height as f64;
        Sums { values, error, reference, magnitude, light: [test, truth], relative }
    }

    /// Mean of (I - R)^2.
    pub fn mean_square(&self) -> f64 {
        self.error / self.values
    }
}

/// The 99th percentile of |I - R| over pixels and channels.
pub fn error99(pair: &Pair) -> f64 {
    percentile99(pair, |p| pair.error(p))
}

/// The radiance that counts as white: the 99th percentile of |R| over pixels and channels, so that a
/// few bright pixels do not decide it, or the largest |R| where that percentile is 0; 0 only for a
/// black reference.
pub fn peak(pair: &Pair) -> f64 {
    let reference = |p: usize| wide(pair.reference.radiance[p]);
    let share = percentile99(pair, reference);
    if share > 0.0 {
        return share;
    }
    (0..pair.reference.radiance.len()).map(|p| reference(p).abs().max_element()).fold(0.0, f64::max)
}

/// Peak signal-to-noise ratio in dB of display values: radiance over `peak` cut to [0, 1], in sRGB
/// without rounding; the peak of these is 1. [`IDENTICAL`] where nothing differs.
pub fn psnr(pair: &Pair, sums: &Sums, peak: f64) -> f64 {
    if sums.error == 0.0 {
        return IDENTICAL;
    }
    let shown = |radiance| (wide(radiance) / peak).to_array().map(srgb);
    let [error] = totals(pair.size(), |p| {
        let (image, reference) = (shown(pair.image.radiance[p]), shown(pair.reference.radiance[p]));
        [(DVec3::from(image) - DVec3::from(reference)).length_squared()]
    });
    decibels(1.0, error / sums.values)
}

/// Peak signal-to-noise ratio in dB of linear radiance. [`IDENTICAL`] where nothing differs.
pub fn psnr_linear(sums: &Sums, peak: f64) -> f64 {
    decibels(peak, sums.mean_square())
}

fn decibels(peak: f64, mean_square: f64) -> f64 {
    if mean_square == 0.0 {
        return IDENTICAL;
    }
    (20.0 * libm::log10(peak) - 10.0 * libm::log10(mean_square)).min(IDENTICAL)
}

/// The 99th percentile of the magnitudes of `of` over pixels and channels.
fn percentile99(pair: &Pair, of: impl Fn(usize) -> DVec3) -> f64 {
    let pixels = pair.reference.radiance.len();
    let mut values = Vec::with_capacity(3 * pixels);
    values.extend((0..pixels).flat_map(|p| of(p).abs().to_array()));
    between(values, 0.99)
}

/// The value `share` of the way through `values` in order, linear between neighbours; there is at
/// least one.
fn between(mut values: Vec<f64>, share: f64) -> f64 {
    let place = share * (values.len() - 1) as f64;
    let below = place as usize;
    let (_, &mut low, above) = values.select_nth_unstable_by(below, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    low + (place - below as f64) * (high - low)
}

#[cfg(test)]
mod tests {
    use super::super::trial::{grey, pair, plain};
    use super::*;
    use glam::Vec3;

    #[test]
    fn percentile_lies_between_neighbours() {
        assert_eq!(between(vec![7.0], 0.99), 7.0);
        assert_eq!(between((0..=100).rev().map(f64::from).collect(), 0.99), 99.0);
        assert!((between(vec![2.0, 1.0], 0.99) - 1.99).abs() < 1e-15);
    }

    #[test]
    fn ratios_are_the_known_ones() {
        // White is 2: the display shows 1 for the reference, and the sRGB value of 1/2 for the image.
        let pair = pair(&plain(4, 4, Vec3::ONE), &plain(4, 4, Vec3::splat(2.0)));
        let (sums, peak) = (Sums::of(&pair, 0.01), peak(&pair));
        assert_eq!((peak, sums.mean_square()), (2.0, 1.0));
        assert!((psnr_linear(&sums, peak) - 20.0 * 2.0_f64.log10()).abs() < 1e-12);
        let error = 1.0 - 0.735_356_983;
        assert!((psnr(&pair, &sums, peak) + 20.0 * f64::log10(error)).abs() < 1e-7);
        assert!((sums.relative / sums.values - 1.0 / 4.01).abs() < 1e-15);
        assert_eq!(error99(&pair), 1.0);
    }

    #[test]
    fn a_few_bright_pixels_do_not_decide_the_peak() {
        let mut values = [0.5; 400];
        values[7] = 1e6;
        assert_eq!(peak(&pair(&grey(&values), &grey(&values))), 0.5);
        let mut values = [0.0; 400];
        values[7] = -3.0;
        assert_eq!(peak(&pair(&grey(&values), &grey(&values))), 3.0);
    }

    #[test]
    fn ratios_of_extremes_are_finite() {
        for (image, reference) in
            [(f32::MAX, f32::from_bits(1)), (f32::MIN, f32::MAX), (-1.0, -2.0), (1.0, f32::MAX)]
        {
            let pair = pair(&grey(&[image]), &grey(&[reference]));
            let (sums, peak) = (Sums::of(&pair, 0.01), peak(&pair));
            let found = [psnr(&pair, &sums, peak), psnr_linear(&sums, peak), sums.relative];
            assert!(found.iter().all(|x| x.is_finite()), "{found:?}");
        }
    }
}
