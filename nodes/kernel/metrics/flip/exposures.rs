//! The exposures under which radiance is looked at, and the tone curve it is then shown with
//! (Andersson et al. 2021, section 4).

use crate::data::Image;
use glam::{DVec3, Vec3};
use libm::{ceil, exp2, log2, sqrt};

/// The ACES fit of Narkowicz (2015) of 0.6 x, as the published tool has it: numerator and
/// denominator, from the square down to the constant.
const ABOVE: [f64; 3] = [0.36 * 2.51, 0.6 * 0.03, 0.0];
const BELOW: [f64; 3] = [0.36 * 2.43, 0.6 * 0.59, 0.14];
/// The display light to which the first exposure takes the brightest pixel and the last the median.
const SHOWN: f64 = 0.85;

/// Exposures in stops, the darkest picture first: from where the brightest pixel of `reference` is
/// shown at 0.85 to where its median pixel is, at least two, as many as the stops between, in even
/// steps. Negative radiance counts as black. Where the median is black it is that of the pixels that
/// are not; where all of the reference is, `image` decides; none where both are black.
pub fn exposures(image: &Image, reference: &Image) -> Vec<f64> {
    let mut lit = luminances(reference);
    if lit.iter().all(|&y| y == 0.0) {
        lit = luminances(image);
    }
    let mut middle = lit.len() / 2;
    if median(&mut lit, middle) == 0.0 {
        lit.retain(|&y| y > 0.0);
        middle = lit.len() / 2;
    }
    if lit.is_empty() {
        return Vec::new();
    }
    let median = median(&mut lit, middle);
    let brightest = lit.iter().copied().fold(0.0, f64::max);
    let start = log2(white() / brightest);
    let range = log2(brightest / median);
    let steps = ceil(range).max(2.0) - 1.0;
    (0..=steps as u32).map(|i| start + range * f64::from(i) / steps).collect()
}

/// Display light from 0 to 1 of radiance under an exposure in stops.
pub fn shown(exposure: f64) -> impl Fn(Vec3) -> Vec3 {
    let gain = exp2(exposure);
    move |radiance| {
        // Squares of any radiance fit into a double.
        let x = gain * radiance.as_dvec3().max(DVec3::ZERO);
        let curve = |[square, line, rest]: [f64; 3]| (square * x + line) * x + rest;
        (curve(ABOVE) / curve(BELOW)).min(DVec3::ONE).as_vec3()
    }
}

/// The exposed radiance that the curve shows at [`SHOWN`].
fn white() -> f64 {
    let [a, b, c]: [f64; 3] = std::array::from_fn(|i| ABOVE[i] - SHOWN * BELOW[i]);
    (-b + sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
}

fn luminances(image: &Image) -> Vec<f64> {
    let weights = DVec3::new(0.2126, 0.7152, 0.0722);
    image.radiance.iter().map(|r| r.as_dvec3().max(DVec3::ZERO).dot(weights)).collect()
}

/// The value at place `middle` in rising order.
fn median(values: &mut [f64], middle: usize) -> f64 {
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32]) -> Image {
        Image::new(values.len(), 1, values.iter().copied().map(Vec3::splat).collect())
    }

    #[test]
    fn exposures_show_the_brightest_and_the_median() {
        let reference = grey(&[100.0, 0.5, 3.0, 0.01, 2.0]);
        let all = exposures(&reference, &reference);
        // log2(100 / 2) = 5.64: six exposures.
        assert_eq!(all.len(), 6);
        let light = |stops: f64, radiance: f32| shown(stops)(Vec3::splat(radiance)).y;
        assert!((light(all[0], 100.0) - 0.85).abs() < 1e-6);
        assert!((light(all[5], 2.0) - 0.85).abs() < 1e-6);
        assert!((all[1] - all[0] - 5.643_856 / 5.0).abs() < 1e-6);
        let flat = exposures(&grey(&[7.0]), &grey(&[7.0]));
        assert!(flat.len() == 2 && flat[0] == flat[1]);
    }

    #[test]
    fn black_pixels_do_not_decide() {
        let dim = grey(&[0.0, 0.0, -1.0, 0.5, 2.0]);
        let lit = grey(&[0.5, 2.0]);
        let black = grey(&[0.0, -3.0]);
        assert_eq!(exposures(&black, &dim), exposures(&black, &lit));
        assert_eq!(exposures(&lit, &black), exposures(&black, &lit));
        assert!(exposures(&black, &black).is_empty());
    }

    #[test]
    fn the_curve_holds_at_the_extremes() {
        let all =
            exposures(&grey(&[1.0]), &grey(&[f32::MAX, f32::from_bits(1), f32::from_bits(1)]));
        assert_eq!(all.len(), 277);
        for stops in [all[0], all[276]] {
            let show = shown(stops);
            assert_eq!(show(Vec3::NEG_INFINITY.max(Vec3::MIN)), Vec3::ZERO);
            assert!(show(Vec3::MAX).y >= 0.849 && show(Vec3::MAX).is_finite());
        }
        assert_eq!(shown(0.0)(Vec3::new(0.0, 20.0, -1.0)), Vec3::Y);
    }
}
