//! Random projection of the unfolded slabs of the lights (Hašan 2008, section 4.3.2, "Clustering initialization").
//!
//! Every entry of a slab goes, with a random sign, to one coordinate in each of `COPIES` independent tables, and these are added
//! up: a sparse embedding (Kane and Nelson 2014) which, like a dense matrix of random signs, keeps inner products in the mean
//! with a variance of the order 1 / DIMENSIONS, at 4 instead of 50 additions an entry. Within a table the entries go round the
//! coordinates in order, from a random start for every `DIMENSIONS` rows of a frame, so that they are read as vectors.

use std::ops::Range;

use rand_pcg::rand_core::Rng;
use rayon::prelude::*;

use super::{Beat, Draw, Tensor, lanes, random};

/// Dimensions of the projected slabs.
pub const DIMENSIONS: usize = 50;
const COPIES: usize = 4;
/// Lights between two calls of `beat`.
const LIGHTS: usize = 32;

/// Unit vectors in the directions of the slabs of `lights` over `frames`, one after the other, with their dimension:
/// `DIMENSIONS`, or that of the slabs if it is no larger, when nothing is projected. A slab that vanishes gives zeros.
pub fn directions<E: Send>(
    tensor: &Tensor,
    lights: &[u32],
    frames: Range<usize>,
    seed: u64,
    beat: &Beat<E>,
) -> Result<(Vec<f32>, usize), E> {
    let entries = tensor.rows() * frames.len();
    let dimensions = entries.min(DIMENSIONS);
    let projection = (entries > DIMENSIONS)
        .then(|| Projection::new(tensor.rows(), frames.len(), random_of(seed, frames.start)));
    let mut directions = vec![0.0; lights.len() * dimensions];
    directions.par_chunks_mut(LIGHTS * dimensions).zip(lights.par_chunks(LIGHTS)).try_for_each(
        |(directions, lights)| {
            beat()?;
            for (direction, &light) in directions.chunks_exact_mut(dimensions).zip(lights) {
                let slab = tensor.slab(light as usize, frames.clone());
                match &projection {
                    Some(projection) => normalize(&project(projection, slab), direction),
                    None => {
                        let slab: Vec<f64> = slab.iter().map(|&x| f64::from(x)).collect();
                        normalize(&slab, direction);
                    }
                }
            }
            Ok(())
        },
    )?;
    Ok((directions, dimensions))
}

fn random_of(seed: u64, first_frame: usize) -> rand_pcg::Pcg64Mcg {
    random(seed, Draw::Projection, first_frame as u64)
}

fn normalize(vector: &[f64], unit: &mut [f32]) {
    let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm > 0.0 {
        for (unit, x) in unit.iter_mut().zip(vector) {
            *unit = (x / norm) as f32;
        }
    }
}

/// The random signs of all entries and the first coordinate of each run of up to `DIMENSIONS` entries, copy after copy.
struct Projection {
    rows: usize,
    signs: Vec<f32>,
    starts: Vec<usize>,
}

impl Projection {
    fn new(rows: usize, frames: usize, mut random: rand_pcg::Pcg64Mcg) -> Projection {
        let runs = COPIES * frames * rows.div_ceil(DIMENSIONS);
        let mut start = || ((u128::from(random.next_u64()) * DIMENSIONS as u128) >> 64) as usize;
        let starts = (0..runs).map(|_| start()).collect();
        let mut sign = || if random.next_u64() >> 63 == 0 { 1.0 } else { -1.0 };
        let signs = (0..COPIES * frames * rows).map(|_| sign()).collect();
        Projection { rows, signs, starts }
    }

    #[inline(always)]
    fn apply(&self, slab: &[f32]) -> [f64; DIMENSIONS] {
        // Runs that pass the last coordinate go on in a second half, folded back at the end.
        let mut sums = [0.0; 2 * DIMENSIONS];
        let mut starts = self.starts.iter();
        for signs in self.signs.chunks_exact(slab.len()) {
            for (column, signs) in slab.chunks_exact(self.rows).zip(signs.chunks_exact(self.rows)) {
                let runs = column.chunks(DIMENSIONS).zip(signs.chunks(DIMENSIONS));
                for ((run, signs), &start) in runs.zip(&mut starts) {
                    for ((sum, &x), &sign) in sums[start..].iter_mut().zip(run).zip(signs) {
                        *sum += f64::from(x * sign);
                    }
                }
            }
        }
        std::array::from_fn(|d| sums[d] + sums[d + DIMENSIONS])
    }
}

lanes::wide! {
    /// The projection of an unfolded slab, up to the constant factor 1 / sqrt(COPIES).
    fn project(projection: &Projection, slab: &[f32]) -> [f64; DIMENSIONS] = Projection::apply
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, noise, smooth, tensor_of};
    use super::*;

    fn dot(directions: &[f32], a: usize, b: usize) -> f64 {
        let [a, b] = [a, b].map(|at| &directions[at * DIMENSIONS..][..DIMENSIONS]);
        a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
    }

    #[test]
    fn angles_survive() {
        // One row of a static light each (the hardest case), and broad random slabs.
        for sparse in [true, false] {
            let tensor = tensor_of(40, 123, 6, |j, i, k| match sparse {
                true => {
                    if i == 3 * j || i == 3 * (j / 2) {
                        1.0
                    } else {
                        0.0
                    }
                }
                false => noise(j / 2, i, k).powi(3) + 0.3 * noise(j, i, k),
            });
            let lights: Vec<u32> = (0..40).collect();
            let mut error = 0.0;
            for seed in 0..40 {
                let (directions, _) = directions(&tensor, &lights, 0..6, seed, &never).unwrap();
                for pair in 0..39 {
                    let exact: f64 = tensor
                        .slab(pair, 0..6)
                        .iter()
                        .zip(tensor.slab(pair + 1, 0..6))
                        .map(|(&a, &b)| f64::from(a) * f64::from(b))
                        .sum();
                    let norm = |j| tensor.norms(j, 0..6).iter().map(|w| w * w).sum::<f64>().sqrt();
                    let exact = exact / (norm(pair) * norm(pair + 1));
                    error += (dot(&directions, pair, pair + 1) - exact).powi(2) / (40.0 * 39.0);
                }
            }
            // A dense projection has a mean square error of (1 - cos^2)^2 / 50 or less.
            assert!(error < 1.2 / DIMENSIONS as f64, "{error}");
            assert!(error > 0.01 / DIMENSIONS as f64, "really projected: {error}");
        }
    }

    #[test]
    fn scale_does_not_count_and_short_slabs_stay() {
        let lights = [5, 1, 8];
        let project = |scale: f32| {
            let tensor = tensor_of(9, 61, 3, |j, i, k| noise(j, i, k) * scale);
            directions(&tensor, &lights, 1..3, 7, &never).unwrap()
        };
        assert_eq!(project(1.0), project(2f32.powi(40)));
        assert_eq!(project(1.0), project(2f32.powi(-40)));

        let (short, dimensions) = directions(&smooth(9, 7, 2), &lights, 0..2, 7, &never).unwrap();
        assert_eq!((short.len(), dimensions), (3 * 14, 14));
    }
}
