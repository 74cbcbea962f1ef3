//! How much errors vary in time where nothing should move.

use super::Pair;
use glam::DVec3;
use rayon::prelude::*;

/// Largest change of a static pixel, relative to its radiance.
const STATIC: f64 = 1e-3;

/// Collects over the frames of a shot the variance of the error I - R at static pixels. A pixel is
/// static between neighbouring frames if |R' - R| <= 1e-3 max(|R|, |R'|), the norm over its channels;
/// frames joined in this way are a run. Each run varies about its own mean, and has one degree of
/// freedom less than frames.
#[derive(Default)]
pub struct Steadiness {
    /// The run in which each pixel is.
    runs: Vec<Run>,
    /// Sum over runs and channels of the squared deviations from the run's mean.
    squares: f64,
    /// Degrees of freedom of those.
    freedom: f64,
}

#[derive(Clone, Copy, Default)]
struct Run {
    mean: DVec3,
    length: f64,
}

impl Steadiness {
    /// Adds a frame after `before`, which is of the same size; the first frame has none before it.
    pub fn add(&mut self, before: Option<&Pair>, pair: &Pair) {
        let (width, height) = pair.size();
        self.runs.resize(width * height, Run::default());
        let rows = self.runs.par_chunks_mut(width).enumerate().map(|(y, runs)| {
            let (mut squares, mut freedom) = (0.0, 0.0);
            for (x, run) in runs.iter_mut().enumerate() {
                let p = y * width + x;
                if !before.is_some_and(|before| is_static(before, pair, p)) {
                    *run = Run::default();
                }
                let error = pair.error(p);
                run.length += 1.0;
                let deviation = error - run.mean;
                run.mean += deviation / run.length;
                // Welford's update: zero for the first frame of a run.
                squares += deviation.dot(error - run.mean);
                freedom += if run.length > 1.0 { 3.0 } else { 0.0 };
            }
            (squares, freedom)
        });
        for (squares, freedom) in rows.collect::<Vec<_>>() {
            self.squares += squares;
            self.freedom += freedom;
        }
    }

    /// The standard deviation in time, in units of radiance; 0 where no pixel was ever static.
    pub fn deviation(&self) -> f64 {
        if self.freedom > 0.0 { (self.squares / self.freedom).sqrt() } else { 0.0 }
    }
}

fn is_static(before: &Pair, pair: &Pair, p: usize) -> bool {
    let [old, new] = [before, pair].map(|pair| super::wide(pair.reference.radiance[p]));
    let size = old.length_squared().max(new.length_squared());
    (new - old).length_squared() <= STATIC * STATIC * size
}

#[cfg(test)]
mod tests {
    use super::super::trial::{grey, pair};
    use super::*;

    fn deviation(frames: &[([f32; 2], [f32; 2])]) -> f64 {
        let mut steadiness = Steadiness::default();
        let mut before = None;
        for (image, reference) in frames {
            let pair = pair(&grey(image), &grey(reference));
            steadiness.add(before.as_ref(), &pair);
            before = Some(pair);
        }
        steadiness.deviation()
    }

    #[test]
    fn deviation_is_that_of_statistics() {
        // Errors 1, 2, 6 at the first pixel: mean 3, variance (4 + 1 + 9) / 2; none at the second.
        let frames = [([2.0, 4.0], [1.0, 4.0]), ([3.0, 4.0], [1.0, 4.0]), ([7.0, 4.0], [1.0, 4.0])];
        assert!((deviation(&frames) - 3.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!(deviation(&frames[..1]), 0.0);
    }

    #[test]
    fn only_static_pixels_count_and_each_run_has_its_own_mean() {
        // The second pixel changes by 1 %, and its errors do not count; the first jumps once.
        let frames = [
            ([1.5, 9.0], [1.0, 1.0]),
            ([1.5, 2.0], [1.0005, 1.01]),
            ([8.5, 7.0], [8.0, 1.0]),
            ([9.0, 1.0], [8.0, 1.01]),
        ];
        // Runs of errors (0.5, 0.4995) and (0.5, 1): deviations 0.00025 and 0.25, twice each.
        let error = f64::from(1.5_f32) - f64::from(1.0005_f32);
        let squares = 0.5 * (0.5 - error).powi(2) + 0.5 * 0.25;
        assert!((deviation(&frames) - (squares / 2.0).sqrt()).abs() < 1e-12);
        assert_eq!(deviation(&[frames[0], frames[3]]), 0.0);
    }

    #[test]
    fn constant_errors_and_black_references_are_steady() {
        let black = ([0.5, 0.25], [0.0, 0.0]);
        assert_eq!(deviation(&[black, black, black]), 0.0);
        let blinking = ([1.5, 0.25], [0.0, 0.0]);
        assert!((deviation(&[black, blinking]) - 0.5).abs() < 1e-15);
        let huge = ([f32::MAX, 0.0], [f32::MIN, 0.0]);
        assert!(deviation(&[huge, ([0.0, 0.0], [f32::MIN, 0.0])]).is_finite());
    }
}
