//! Perceptually different pixels (Yee 2004, after Yee, Pattanaik and Greenberg 2001), with the
//! constants, levels and borders of the comparison in OpenImageIO.

use super::{Pair, wide};
use crate::data::Image;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Levels of blur, the picture itself being the first; all at full resolution.
const LEVELS: usize = 8;
/// Levels at which contrast is taken: each needs the two after it.
const BANDS: usize = LEVELS - 2;
/// No luminance that divides or adapts is less, cd/m^2.
const LEAST: f64 = 1e-5;

/// How the picture is seen.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Angle that the picture's width fills, degrees.
    pub fov: f64,
    /// Luminance of radiance 1, cd/m^2.
    pub luminance: f64,
}

/// How many pixels of a pair look different.
pub fn different(pair: &Pair, view: View) -> usize {
    let size = pair.size();
    let [image, reference] =
        [&pair.image, &pair.reference].map(|image| blurred(image, view.luminance, size));
    let observer = Observer::new(view.fov, size.0);
    let differs = |p: usize| {
        let at = |levels: &[Vec<f64>; LEVELS]| std::array::from_fn(|i| levels[i][p]);
        let (a, b) = (at(&image), at(&reference));
        let light = observer.adaptation(a, b);
        // In dim light colour hardly counts. That it does so by a step is a property of the comparison
        // in OpenImageIO.
        let fade = if light < 10.0 { 0.01 } else { 1.0 };
        let [hue, other] =
            [&pair.image, &pair.reference].map(|image| chroma(wide(image.radiance[p])));
        let colour = fade * (hue - other).length_squared();
        let excess = ((a[0] - b[0]).abs() / threshold(light)).max(colour);
        // The threshold is never lowered: most equal pixels need no look at the contrast.
        excess > 1.0 && excess > observer.elevation(a, b, light)
    };
    (0..size.0 * size.1).into_par_iter().filter(|&p| differs(p)).count()
}

/// CIE XYZ of RGB in the primaries of Adobe RGB (1998), which the comparison assumes.
fn xyz(rgb: DVec3) -> DVec3 {
    ADOBE_RGB * rgb
}

const ADOBE_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(0.576_700, 0.297_361, 0.027_032_8),
    DVec3::new(0.185_556, 0.627_355, 0.070_687_9),
    DVec3::new(0.188_212, 0.075_284_7, 0.991_248),
);

/// The a and b of CIE L*a*b*, relative to the white of RGB (1, 1, 1).
fn chroma(rgb: DVec3) -> glam::DVec2 {
    let relative = xyz(rgb) / xyz(DVec3::ONE);
    let [x, y, z] = relative.to_array().map(|t| {
        if t > 216.0 / 24_389.0 { libm::cbrt(t) } else { (24_389.0 / 27.0 * t + 16.0) / 116.0 }
    });
    glam::DVec2::new(500.0 * (x - y), 200.0 * (y - z))
}

/// The luminance of a picture in cd/m^2, again and again under a Gaussian of 5x5 pixels.
fn blurred(image: &Image, luminance: f64, size: (usize, usize)) -> [Vec<f64>; LEVELS] {
    let mut levels: [Vec<f64>; LEVELS] = Default::default();
    levels[0] = image.radiance.par_iter().map(|&rgb| xyz(wide(rgb)).y * luminance).collect();
    for i in 1..LEVELS {
        levels[i] = blur(&levels[i - 1], size);
    }
    levels
}

/// A Gaussian exp(-0.32 x^2) over five pixels along both axes; beyond the border its pixels go on.
fn blur(values: &[f64], (width, height): (usize, usize)) -> Vec<f64> {
    let gauss = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|x: f64| libm::exp(-0.32 * x * x));
    let sum: f64 = gauss.iter().sum();
    let kernel = gauss.map(|weight| weight / sum);
    let near = |centre: usize, length: usize| -> [usize; 5] {
        std::array::from_fn(|i| (centre + i).saturating_sub(2).min(length - 1))
    };
    let mean = |at: [f64; 5]| -> f64 { (0..5).map(|i| kernel[i] * at[i]).sum() };
    let mut across = vec![0.0; values.len()];
    across.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(across, row)| {
        for (x, value) in across.iter_mut().enumerate() {
            *value = mean(near(x, width).map(|x| row[x]));
        }
    });
    let mut down = vec![0.0; values.len()];
    down.par_chunks_mut(width).enumerate().for_each(|(y, down)| {
        let rows = near(y, height).map(|y| &across[y * width..(y + 1) * width]);
        for (x, value) in down.iter_mut().enumerate() {
            *value = mean(rows.map(|row| row[x]));
        }
    });
    down
}

/// What depends on the viewing angle and the picture's width alone.
struct Observer {
    /// Spatial frequency of each band, cycles per degree.
    frequency: [f64; BANDS],
    /// Greatest sensitivity to contrast at 100 cd/m^2 over that of each band.
    insensitivity: [f64; BANDS],
    /// The level whose blur is about a degree: what the eye adapts to.
    adaptation: usize,
}

impl Observer {
    fn new(fov: f64, width: usize) -> Observer {
        let degrees = 2.0 * libm::tan(0.5 * fov.to_radians()) * 1_f64.to_degrees();
        let bright = Sensitivity::at(100.0);
        let frequency =
            std::array::from_fn(|i| 0.5 * (width as f64 / degrees) / (1_u32 << i) as f64);
        let fits = |&level: &usize| f64::from(1_u32 << level) <= degrees;
        Observer {
            frequency,
            insensitivity: frequency.map(|frequency| bright.to(3.248) / bright.to(frequency)),
            adaptation: (0..LEVELS).filter(fits).max().unwrap_or(0),
        }
    }

    /// The luminance to which the eye adapts.
    fn adaptation(&self, a: [f64; LEVELS], b: [f64; LEVELS]) -> f64 {
        (0.5 * (a[self.adaptation] + b[self.adaptation])).max(LEAST)
    }

    /// By how much the threshold rises for the frequencies that are there and their masking, 1 to 10.
    fn elevation(&self, a: [f64; LEVELS], b: [f64; LEVELS], light: f64) -> f64 {
        let contrast: [f64; BANDS] = std::array::from_fn(|i| {
            let change = (a[i] - a[i + 1]).abs().max((b[i] - b[i + 1]).abs());
            change / a[i + 2].abs().max(b[i + 2].abs()).max(LEAST)
        });
        let sum = contrast.iter().sum::<f64>().max(1e-5);
        let sensitivity = Sensitivity::at(light);
        let band = |i: usize| {
            // No contrast adds nothing, also at frequencies that no eye sees.
            if contrast[i] == 0.0 {
                return 0.0;
            }
            let masked = masking(contrast[i] * sensitivity.to(self.frequency[i]));
            contrast[i] * self.insensitivity[i] * masked / sum
        };
        (0..BANDS).map(band).sum::<f64>().clamp(1.0, 10.0)
    }
}

/// The eye's sensitivity to contrast at a luminance (Barten 1989): a f exp(-bf) sqrt(1 + 0.06 exp(bf)).
struct Sensitivity {
    a: f64,
    b: f64,
}

impl Sensitivity {
    /// That at a luminance in cd/m^2.
    fn at(luminance: f64) -> Sensitivity {
        Sensitivity {
            a: 440.0 * libm::pow(1.0 + 0.7 / luminance, -0.2),
            b: 0.3 * libm::pow(1.0 + 100.0 / luminance, 0.15),
        }
    }

    /// That to a frequency in cycles per degree.
    fn to(&self, frequency: f64) -> f64 {
        // Multiplied out, for a value at every frequency.
        let decay = libm::exp(-self.b * frequency);
        self.a * frequency * (decay * decay + 0.06 * decay).sqrt()
    }
}

/// By how much contrast in multiples of its threshold hides contrast (Daly 1993).
fn masking(contrast: f64) -> f64 {
    let root = 0.0153 * libm::pow(392.498 * contrast, 0.7);
    (1.0 + root * root * root * root).sqrt().sqrt()
}

/// The least visible change of luminance at an adaptation luminance, cd/m^2 (Ward Larson,
/// Rushmeier and Piatko 1997).
fn threshold(luminance: f64) -> f64 {
    let log = libm::log10(luminance);
    let exponent = if log < -3.94 {
        -2.86
    } else if log < -1.44 {
        libm::pow(0.405 * log + 1.6, 2.18) - 2.86
    } else if log < -0.0184 {
        log - 0.395
    } else if log < 1.9 {
        libm::pow(0.249 * log + 0.65, 2.7) - 0.72
    } else {
        log - 1.255
    };
    libm::exp10(exponent)
}

#[cfg(test)]
mod tests {
    use super::super::pairs::pairs;
    use super::super::trial::{grey, pair, plain};
    use super::*;
    use glam::Vec3;

    const VIEW: View = View { fov: 45.0, luminance: 100.0 };

    fn count(image: &Image, reference: &Image) -> usize {
        different(&pair(image, reference), VIEW)
    }

    #[test]
    fn equal_pictures_do_not_differ() {
        for (_, test, reference) in &pairs() {
            assert_eq!((count(test, test), count(reference, reference)), (0, 0));
        }
        let wild = grey(&[f32::MAX, f32::MIN, 0.0, f32::from_bits(1), -1.0]);
        assert_eq!(count(&wild, &wild), 0);
        assert_eq!(count(&grey(&[0.0]), &grey(&[-0.0])), 0);
    }

    #[test]
    fn flat_pictures_differ_beyond_the_threshold_of_luminance() {
        // Without contrast the threshold is not raised: 50 cd/m^2 against the middle of both.
        let reference = plain(3, 2, Vec3::splat(0.5));
        let step = threshold(50.0) / 100.0;
        assert!(step > 0.015 && step < 0.05);
        let lit = |light: f64| plain(3, 2, Vec3::splat(light as f32));
        assert_eq!(count(&lit(0.5 + 0.9 * step), &reference), 0);
        assert_eq!(count(&lit(0.5 + 1.2 * step), &reference), 6);
        assert_eq!(count(&grey(&[0.5 + 1.2 * step as f32]), &grey(&[0.5])), 1);
    }

    #[test]
    fn colour_differs_at_equal_luminance_and_hardly_in_the_dark() {
        let colour = |light: f32, tint: f32| {
            plain(4, 4, light * Vec3::new(1.0 + tint, 1.0 - tint * 0.297_361 / 0.627_355, 1.0))
        };
        assert_eq!(count(&colour(0.5, 0.02), &colour(0.5, 0.0)), 16);
        assert_eq!(count(&colour(0.05, 0.02), &colour(0.05, 0.0)), 0);
    }

    #[test]
    fn thresholds_hardly_jump_between_their_pieces() {
        for log in [-3.94, -1.44, -0.0184, 1.9] {
            let [below, above] = [log - 1e-9, log + 1e-9].map(|log| threshold(libm::exp10(log)));
            assert!((below / above - 1.0).abs() < 0.03, "{log}: {below} {above}");
        }
    }

    #[test]
    fn extremes_have_a_count() {
        let black = grey(&[0.0; 4]);
        assert_eq!(count(&grey(&[f32::MAX; 4]), &black), 4);
        assert_eq!(count(&grey(&[f32::MIN; 4]), &black), 4);
        // Next to it the eye sees nothing else.
        assert_eq!(count(&grey(&[f32::MAX, 1.0]), &grey(&[f32::MAX, 0.0])), 0);
        let (a, b) = (grey(&[0.0, 1.0, 0.0, 1.0]), grey(&[1.0, 0.0, 1.0, 0.0]));
        for fov in [0.001, 1.0, 179.9] {
            assert_eq!(different(&pair(&a, &b), View { fov, luminance: 1e4 }), 4, "{fov}");
        }
        let observer = Observer::new(0.001, 100_000);
        assert_eq!(observer.elevation([1.0; LEVELS], [1.0; LEVELS], 50.0), 1.0);
        let steps = std::array::from_fn(|i| 1.0 + i as f64);
        assert_eq!(observer.elevation(steps, steps, 50.0), 10.0);
    }

    #[test]
    fn a_blur_keeps_flat_pictures_and_spreads_a_point() {
        assert!(blur(&[3.0; 6], (3, 2)).iter().all(|x| (x - 3.0).abs() < 1e-15));
        let mut point = [0.0; 81];
        point[40] = 1.0;
        let soft = blur(&point, (9, 9));
        // The kernel of OpenImageIO 3.2.2, `make_kernel("gaussian", 5, 5)`.
        assert!((soft[40] - 0.110_493_53).abs() < 1e-6 && (soft[20] - 0.008_541_86).abs() < 1e-6);
    }
}
