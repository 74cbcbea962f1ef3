//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004).

use super::Pair;
use super::display::luma;
use crate::data::Image;
use rayon::prelude::*;

const RADIUS: usize = 5;
/// (K1 L)^2 and (K2 L)^2 with K1 = 0.01, K2 = 0.03 and values from 0 to L = 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The means of x, y, x^2, y^2 and xy under a window.
type Moments = [f64; 5];

/// Mean structural similarity of the luma of two pictures, from -1 to 1 for equal ones. Luma is that
/// of sRGB values cut to [0, 1], with radiance times `gain` as display light. Windows are Gaussian,
/// 11x11 pixels, standard deviation 1.5; only those inside the picture count, as in the paper's own
/// program. Across a picture of fewer than 11 pixels they are centred on each pixel, and the weights
/// on what is there are raised to the sum 1.
pub fn ssim(pair: &Pair, gain: f64) -> f64 {
    let (width, height) = pair.size();
    let shades = |image: &Image| -> Vec<f64> {
        image.radiance.par_iter().map(|&radiance| luma(super::wide(radiance) * gain)).collect()
    };
    let (image, reference) = (shades(&pair.image), shades(&pair.reference));
    let (columns, rows) = (windows(width), windows(height));
    let mut across = vec![[0.0; 5]; columns.len() * height];
    across.par_chunks_mut(columns.len()).enumerate().for_each(|(y, means)| {
        let at = |x: usize| {
            let (x, y) = (image[y * width + x], reference[y * width + x]);
            [x, y, x * x, y * y, x * y]
        };
        for (mean, window) in means.iter_mut().zip(&columns) {
            *mean = window.mean(at);
        }
    });
    let sums: Vec<f64> = rows
        .par_iter()
        .map(|window| {
            let mean = |x: usize| window.mean(|y| across[y * columns.len() + x]);
            (0..columns.len()).map(|x| similarity(mean(x))).sum()
        })
        .collect();
    sums.iter().sum::<f64>() / (columns.len() * rows.len()) as f64
}

fn similarity([x, y, xx, yy, xy]: Moments) -> f64 {
    let (x2, y2) = (x * x, y * y);
    let (variances, covariance) = ((xx - x2) + (yy - y2), xy - x * y);
    (2.0 * (x * y) + C1) * (2.0 * covariance + C2) / ((x2 + y2 + C1) * (variances + C2))
}

/// A window along one axis: the first pixel under it, and the weights of the pixels from there on.
struct Window {
    first: usize,
    weights: Vec<f64>,
}

impl Window {
    fn mean(&self, at: impl Fn(usize) -> Moments) -> Moments {
        let weighed = |(i, &weight): (usize, &f64)| at(self.first + i).map(|value| weight * value);
        self.weights.iter().enumerate().map(weighed).fold([0.0; 5], super::add)
    }
}

/// The windows along an axis of `length` pixels.
fn windows(length: usize) -> Vec<Window> {
    let centres = if length > 2 * RADIUS { RADIUS..length - RADIUS } else { 0..length };
    let window = |centre: usize| {
        let first = centre.saturating_sub(RADIUS);
        let under = first..(centre + RADIUS + 1).min(length);
        let gauss = |at: usize| {
            let away = at as f64 - centre as f64;
            libm::exp(-0.5 * away * away / (1.5 * 1.5))
        };
        let sum: f64 = under.clone().map(gauss).sum();
        Window { first, weights: under.map(|at| gauss(at) / sum).collect() }
    };
    centres.map(window).collect()
}

#[cfg(test)]
mod tests {
    use super::super::trial::{grey, pair, plain};
    use super::super::{display::srgb, pairs::pairs};
    use super::*;
    use glam::Vec3;

    #[test]
    fn equal_pictures_have_exactly_one() {
        for (_, test, reference) in &pairs() {
            assert_eq!(ssim(&pair(test, test), 1.0), 1.0);
            assert_eq!(ssim(&pair(reference, reference), 4.0), 1.0);
        }
        for (width, height) in [(1, 1), (3, 40), (10, 10), (11, 11), (640, 1)] {
            let image = plain(width, height, Vec3::new(0.3, 0.0, 9.0));
            assert_eq!(ssim(&pair(&image, &image), 1.0), 1.0);
        }
    }

    #[test]
    fn flat_pictures_differ_by_their_means() {
        let found =
            ssim(&pair(&plain(20, 13, Vec3::splat(0.25)), &plain(20, 13, Vec3::splat(0.5))), 2.0);
        let (x, y) = (srgb(0.5), 1.0);
        assert!((found - (2.0 * x * y + C1) / (x * x + y * y + C1)).abs() < 1e-12);
        // One pixel is a flat picture.
        let one = ssim(&pair(&grey(&[0.25]), &grey(&[0.5])), 2.0);
        assert!((found - one).abs() < 1e-12);
    }

    #[test]
    fn inverse_structure_is_negative() {
        let stripes = |phase: usize| {
            grey(&std::array::from_fn::<f32, 7, _>(|x| if x % 2 == phase { 1.0 } else { 0.0 }))
        };
        assert!(ssim(&pair(&stripes(0), &stripes(1)), 1.0) < -0.5);
    }

    #[test]
    fn what_a_display_cannot_show_does_not_count() {
        let (wild, cut) = (grey(&[-5.0, f32::MAX, 0.5]), grey(&[0.0, 1.0, 0.5]));
        assert_eq!(ssim(&pair(&wild, &cut), 1.0), 1.0);
        let black = plain(12, 12, Vec3::ZERO);
        let white = plain(12, 12, Vec3::splat(f32::MAX));
        assert!((ssim(&pair(&white, &black), 1.0) - C1 / (1.0 + C1)).abs() < 1e-12);
    }
}
