//! The eye's filters: contrast sensitivity, and the edges and points it looks at (Andersson et al.
//! 2020, sections 4.1.1 and 4.2.1), each as one-dimensional kernels, as in the published tool.

use libm::{ceil, exp, sqrt};
use std::f64::consts::PI;

/// Weights of a one-dimensional filter: an odd number, the middle one for the pixel itself.
pub struct Kernel(Vec<f32>);

/// What the two pictures are filtered with at a certain number of pixels per degree.
pub struct Filters {
    /// Achromatic sensitivity.
    pub achromatic: Kernel,
    /// Red-green sensitivity.
    pub red_green: Kernel,
    /// Blue-yellow sensitivity: a filter along both axes by the one, added to that by the other.
    pub blue_yellow: [Kernel; 2],
    /// Smoothes along an edge or beside a point.
    pub smooth: Kernel,
    /// First derivative: edges.
    pub edge: Kernel,
    /// Second derivative: points.
    pub point: Kernel,
}

/// The sensitivities as Gaussians over degrees: amplitude and width (the paper's Table 1).
const ACHROMATIC: [f64; 2] = [1.0, 0.0047];
const RED_GREEN: [f64; 2] = [1.0, 0.0053];
const BLUE_YELLOW: [[f64; 2]; 2] = [[34.1, 0.04], [13.5, 0.025]];
/// Width of the features that the eye finds, in degrees.
const FEATURE: f64 = 0.082;

impl Filters {
    /// The filters for `pixels_per_degree` > 0.
    pub fn new(pixels_per_degree: f64) -> Self {
        // Three standard deviations of the widest Gaussian serve all of them.
        let radius = ceil(3.0 * sqrt(BLUE_YELLOW[0][1] / (2.0 * PI * PI)) * pixels_per_degree);
        // Along one axis each has the root of the amplitude, for the product of both axes to have it.
        let gaussian = |[amplitude, width]: [f64; 2]| {
            let height = sqrt(amplitude * sqrt(PI / width));
            sampled(radius, |x| {
                let degrees = x / pixels_per_degree;
                height * exp(-PI * PI * degrees * degrees / width)
            })
        };
        let pair = BLUE_YELLOW.map(gaussian);
        let [first, second] = [0, 1].map(|i| pair[i].iter().sum::<f64>());
        let both = sqrt(first * first + second * second);
        let alone = |of| {
            let weights: Vec<f64> = gaussian(of);
            let sum = weights.iter().sum::<f64>();
            kernel(&weights, |_| sum)
        };

        let deviation = 0.5 * FEATURE * pixels_per_degree;
        let reach = ceil(3.0 * deviation);
        let bell = |x: f64| exp(-x * x / (2.0 * deviation * deviation));
        let smooth = sampled(reach, bell);
        let sum = smooth.iter().sum::<f64>();
        Filters {
            achromatic: alone(ACHROMATIC),
            red_green: alone(RED_GREEN),
            blue_yellow: pair.map(|weights| kernel(&weights, |_| both)),
            smooth: kernel(&smooth, |_| sum),
            edge: balanced(&sampled(reach, |x| -x * bell(x))),
            point: balanced(&sampled(reach, |x| (x * x / (deviation * deviation) - 1.0) * bell(x))),
        }
    }

    /// The longest reach of a kernel, in pixels.
    pub fn reach(&self) -> usize {
        self.blue_yellow[0].reach().max(self.smooth.reach())
    }
}

impl Kernel {
    /// Pixels on each side.
    fn reach(&self) -> usize {
        self.0.len() / 2
    }

    /// The filtered row, where `padded` is the row with `margin` more pixels (at least
    /// the kernel's reach) on each side.
    pub fn along(&self, padded: &[f32], margin: usize, filtered: &mut [f32]) {
        filtered.fill(0.0);
        let start = margin - self.reach();
        for (k, &weight) in self.0.iter().enumerate() {
            add(filtered, weight, &padded[start + k..]);
        }
    }

    /// Row `y` of the picture of `height` rows filtered from top to bottom, added to `filtered`;
    /// `row` gives its rows. Beyond the edge the picture goes on as it is at the edge.
    pub fn across<'a>(
        &self,
        y: usize,
        height: usize,
        row: impl Fn(usize) -> &'a [f32],
        filtered: &mut [f32],
    ) {
        for (k, &weight) in self.0.iter().enumerate() {
            add(filtered, weight, row((y + k).saturating_sub(self.reach()).min(height - 1)));
        }
    }
}

fn add(sums: &mut [f32], weight: f32, values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

/// `of` at the whole numbers from -`radius` to `radius`.
fn sampled(radius: f64, of: impl Fn(f64) -> f64) -> Vec<f64> {
    let radius = radius as i32;
    (-radius..=radius).map(|x| of(f64::from(x))).collect()
}

fn kernel(weights: &[f64], divisor: impl Fn(f64) -> f64) -> Kernel {
    Kernel(weights.iter().map(|&w| (w / divisor(w)) as f32).collect())
}

/// Positive weights that sum to 1 and negative ones that sum to -1.
fn balanced(weights: &[f64]) -> Kernel {
    let positive: f64 = weights.iter().filter(|&&w| w > 0.0).sum();
    let negative: f64 = weights.iter().filter(|&&w| w < 0.0).sum();
    kernel(weights, |w| if w > 0.0 { positive } else { -negative })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(kernel: &Kernel) -> f64 {
        kernel.0.iter().map(|&w| f64::from(w)).sum()
    }

    #[test]
    fn kernels_are_normalized_at_any_resolution() {
        for pixels_per_degree in [1.0, 7.3, 67.0206, 1000.0] {
            let filters = Filters::new(pixels_per_degree);
            for kernel in [&filters.achromatic, &filters.red_green, &filters.smooth] {
                assert!((sum(kernel) - 1.0).abs() < 1e-5);
            }
            let [a, b] = [0, 1].map(|i| sum(&filters.blue_yellow[i]));
            assert!((a * a + b * b - 1.0).abs() < 1e-5 && a > b);
            for kernel in [&filters.edge, &filters.point] {
                assert!(sum(kernel).abs() < 1e-5);
                let size: f64 = kernel.0.iter().map(|&w| f64::from(w).abs()).sum();
                assert!((size - 2.0).abs() < 1e-5);
            }
        }
        let usual = Filters::new(67.0206);
        assert_eq!((usual.achromatic.reach(), usual.smooth.reach(), usual.reach()), (10, 9, 10));
    }

    #[test]
    fn both_directions_agree_and_edges_are_repeated() {
        let kernel = Kernel(vec![1.0, 10.0, 100.0]);
        let (padded, mut along) = ([2.0, 2.0, 3.0, 5.0, 5.0], [0.0; 3]);
        kernel.along(&padded, 1, &mut along);
        assert_eq!(along, [322.0, 532.0, 553.0]);
        let rows = [[2.0], [3.0], [5.0]];
        let down = [0, 1, 2].map(|y| {
            let mut sum = [0.0];
            kernel.across(y, 3, |y| &rows[y], &mut sum);
            sum[0]
        });
        assert_eq!(down, along);
    }
}
