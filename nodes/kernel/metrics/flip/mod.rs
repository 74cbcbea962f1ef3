//! FLIP: how different two pictures look to somebody who flips between them. "FLIP: A Difference
//! Evaluator for Alternating Images" (Andersson et al. 2020) for what a display shows; "Visualizing
//! Errors in Rendered High Dynamic Range Images" (Andersson et al. 2021) for radiance.

mod colour;
mod exposures;
mod filters;
pub mod magma;

use crate::data::Image;
use crate::node::Error;
use colour::{Space, power};
use exposures::{exposures, shown};
use filters::Filters;
use glam::Vec3;
use libm::sqrtf;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_SQRT_2;

crate::choice! {
    /// What of the radiance is looked at.
    pub enum FlipRange {
        /// All of it: the largest error of each pixel under exposures from where the brightest pixel
        /// of the reference shows to where its median does, through the ACES curve of Narkowicz (2015).
        Hdr = "hdr",
        /// What a display shows as it is: radiance from 0 to 1.
        Ldr = "ldr",
    }
}

/// Bytes that [`error_map`] takes for each pixel.
pub const BYTES_PER_PIXEL: u64 = 4 * (2 * PLANES as u64 + 2);

/// The error of every pixel, 0 to 1, row after row, of two finite images of one size that has
/// pixels, seen at `pixels_per_degree` > 0. Negative radiance is black. Beyond its edge a picture
/// goes on as it is there. `tick` hears of (done, all) exposures.
///
/// # Errors
/// Those of `tick`.
pub fn error_map(
    image: &Image,
    reference: &Image,
    range: FlipRange,
    pixels_per_degree: f32,
    tick: impl Fn(u64, u64) -> Result<(), Error>,
) -> Result<Vec<f32>, Error> {
    let viewer = Viewer {
        space: Space::new(),
        filters: Filters::new(f64::from(pixels_per_degree)),
        size: image.size(),
    };
    if range == FlipRange::Ldr {
        tick(0, 1)?;
        return Ok(viewer.errors(image, reference, |r| r.clamp(Vec3::ZERO, Vec3::ONE)));
    }
    let exposures = exposures(image, reference);
    let mut largest = vec![0.0_f32; image.radiance.len()];
    for (k, &exposure) in exposures.iter().enumerate() {
        tick(k as u64, exposures.len() as u64)?;
        let errors = viewer.errors(image, reference, shown(exposure));
        largest.iter_mut().zip(errors).for_each(|(largest, error)| *largest = largest.max(error));
    }
    Ok(largest)
}

/// The mean of an error map.
pub fn mean(errors: &[f32]) -> f64 {
    errors.iter().map(|&error| f64::from(error)).sum::<f64>() / errors.len().max(1) as f64
}

/// Rows that the filters from left to right give for each row of a picture.
const PLANES: usize = 7;

/// Somebody who looks at pictures of a certain size.
struct Viewer {
    space: Space,
    filters: Filters,
    size: (usize, usize),
}

impl Viewer {
    /// The errors of two pictures whose radiance is displayed as `show` says.
    fn errors(
        &self,
        image: &Image,
        reference: &Image,
        show: impl Fn(Vec3) -> Vec3 + Sync,
    ) -> Vec<f32> {
        let pictures = [image, reference].map(|image| self.filtered_along(image, &show));
        let mut errors = vec![0.0; image.radiance.len()];
        errors.par_chunks_mut(self.size.0).enumerate().for_each_init(
            || [vec![0.0; PLANES * self.size.0], vec![0.0; PLANES * self.size.0]],
            |seen, (y, errors)| {
                for (seen, picture) in seen.iter_mut().zip(&pictures) {
                    self.filter_across(y, picture, seen);
                }
                self.row_errors(seen, errors);
            },
        );
        errors
    }

    /// [`PLANES`] rows for each row of the picture, filtered from left to right: achromatic,
    /// red-green, blue-yellow twice, edge, point, smooth.
    fn filtered_along(&self, image: &Image, show: impl Fn(Vec3) -> Vec3 + Sync) -> Vec<f32> {
        let (width, _) = self.size;
        let (filters, margin) = (&self.filters, self.filters.reach());
        let mut filtered = vec![0.0; PLANES * image.radiance.len()];
        let rows = filtered.par_chunks_mut(PLANES * width).zip(image.radiance.par_chunks(width));
        rows.for_each_init(
            || [(); 3].map(|()| vec![0.0; width + 2 * margin]),
            |padded, (filtered, radiance)| {
                for (x, &radiance) in radiance.iter().enumerate() {
                    let colour = self.space.opponent(show(radiance));
                    (0..3).for_each(|c| padded[c][margin + x] = colour[c]);
                }
                for row in padded.iter_mut() {
                    let (first, last) = (row[margin], row[margin + width - 1]);
                    row[..margin].fill(first);
                    row[margin + width..].fill(last);
                }
                let plan = [
                    (0, &filters.achromatic),
                    (1, &filters.red_green),
                    (2, &filters.blue_yellow[0]),
                    (2, &filters.blue_yellow[1]),
                    (0, &filters.edge),
                    (0, &filters.point),
                    (0, &filters.smooth),
                ];
                for (row, (channel, kernel)) in filtered.chunks_exact_mut(width).zip(plan) {
                    kernel.along(&padded[channel], margin, row);
                }
            },
        );
        filtered
    }

    /// Row `y` of a picture filtered in both directions: achromatic, red-green, blue-yellow; edges
    /// and points along x; edges and points along y.
    fn filter_across(&self, y: usize, picture: &[f32], seen: &mut [f32]) {
        let (width, height) = self.size;
        let filters = &self.filters;
        seen.fill(0.0);
        let plan = [
            (0, 0, &filters.achromatic),
            (1, 1, &filters.red_green),
            (2, 2, &filters.blue_yellow[0]),
            (3, 2, &filters.blue_yellow[1]),
            (4, 3, &filters.smooth),
            (5, 4, &filters.smooth),
            (6, 5, &filters.edge),
            (6, 6, &filters.point),
        ];
        for (from, to, kernel) in plan {
            let row = |y: usize| &picture[(y * PLANES + from) * width..][..width];
            kernel.across(y, height, row, &mut seen[to * width..][..width]);
        }
    }

    /// The error in colour, raised by that in edges and points (the paper's section 4.3).
    fn row_errors(&self, seen: &[Vec<f32>; 2], errors: &mut [f32]) {
        let width = self.size.0;
        for (x, error) in errors.iter_mut().enumerate() {
            let [image, reference] = [0, 1].map(|i| move |plane: usize| seen[i][plane * width + x]);
            let colour = |of: &dyn Fn(usize) -> f32| Vec3::new(of(0), of(1), of(2));
            let strength = |of: &dyn Fn(usize) -> f32, x: usize, y: usize| {
                sqrtf(of(x) * of(x) + of(y) * of(y))
            };
            let apart = |x, y| (strength(&image, x, y) - strength(&reference, x, y)).abs();
            let feature = sqrtf(FRAC_1_SQRT_2 * apart(3, 5).max(apart(4, 6)));
            let colour = self.space.error(colour(&image), colour(&reference));
            *error = power(colour, 1.0 - feature);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::metrics::{pairs::pairs, published_flip::FLIP};

    fn errors(image: &Image, reference: &Image, range: FlipRange) -> Vec<f32> {
        error_map(image, reference, range, 67.0206, |_, _| Ok(())).unwrap()
    }

    #[test]
    fn means_are_those_of_the_published_tool() {
        for (name, image, reference) in pairs() {
            let (_, published) = FLIP.iter().find(|row| row.0 == name).unwrap();
            for (range, published) in [FlipRange::Ldr, FlipRange::Hdr].into_iter().zip(published) {
                let found = mean(&errors(&image, &reference, range));
                assert!((found - published).abs() < 1e-6, "{name}: {found} not {published}");
            }
        }
    }

    #[test]
    fn errors_do_not_depend_on_threads() {
        let (_, image, reference) = pairs().into_iter().next().unwrap();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let errors = pool.install(|| errors(&image, &reference, FlipRange::Hdr));
            errors.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        };
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn a_picture_stands_on_its_head_with_the_same_errors() {
        let (_, image, reference) = pairs().into_iter().nth(2).unwrap();
        let turned = |image: &Image| {
            let (width, height) = image.size();
            let flat = |p: usize| image.radiance[p % height * width + p / height];
            Image::new(height, width, (0..width * height).map(flat).collect())
        };
        let upright = errors(&image, &reference, FlipRange::Ldr);
        let lying = errors(&turned(&image), &turned(&reference), FlipRange::Ldr);
        let (width, height) = image.size();
        for (p, error) in lying.iter().enumerate() {
            assert!((error - upright[p % height * width + p / height]).abs() < 1e-4);
        }
    }

    #[test]
    fn a_tick_can_stop_it() {
        let (_, image, reference) = pairs().into_iter().next().unwrap();
        let stop = |done, all| if done + 1 < all { Ok(()) } else { Err(Error::Cancelled) };
        for range in [FlipRange::Hdr, FlipRange::Ldr] {
            let found = error_map(&image, &reference, range, 67.0, stop);
            assert!(matches!(found, Err(Error::Cancelled)));
        }
    }
}
