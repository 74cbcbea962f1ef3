//! Clustering by multi-set sampling (Hašan 2007; checklist M7): draw centres where the cost is, give every light to one.

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;
use rayon::prelude::*;

use super::{Beat, unit};

/// Centres compared with a light at a time.
const BLOCK: usize = 16;
/// Lights between two calls of `beat`.
const LIGHTS: usize = 128;
/// Share of the largest possible distance that is rounding of the f32 directions; below it a light counts as typical.
const ROUNDING: f64 = 1e-6;

/// Clusters vectors given by their norms w (> 0) and unit `directions` x of `dimensions` entries each, up to `count` clusters; gives
/// the positions of each cluster, ascending; none is empty. Fewer clusters come out when a vector is drawn more than once.
///
/// A vector is drawn, with replacement, with the probability p of its share in the cost, `w_i sum_j w_j (1 - x_i . x_j)`; a
/// centre's weight is the sum of 1 / p over its draws; vector i goes to the centre k of least
/// `weight_k w_k w_i (1 - x_k . x_i)`. If all vectors are parallel, the draw is uniform.
pub fn sample<E: Send>(
    norms: &[f64],
    directions: &[f32],
    dimensions: usize,
    count: usize,
    random: &mut Pcg64Mcg,
    beat: &Beat<E>,
) -> Result<Vec<Vec<u32>>, E> {
    let shares = shares(norms, directions, dimensions);
    let centres = draw(&shares, count, random);
    let blocks = Block::all(&centres, norms, directions, dimensions);
    let mut nearest = vec![0u32; norms.len()];
    nearest.par_chunks_mut(LIGHTS).zip(directions.par_chunks(LIGHTS * dimensions)).try_for_each(
        |(nearest, directions)| {
            beat()?;
            for (nearest, direction) in nearest.iter_mut().zip(directions.chunks_exact(dimensions))
            {
                *nearest = closest(&blocks, direction);
            }
            Ok(())
        },
    )?;
    let mut clusters = vec![Vec::new(); centres.len()];
    for (at, &centre) in nearest.iter().enumerate() {
        clusters[centre as usize].push(at as u32);
    }
    clusters.retain(|cluster| !cluster.is_empty());
    Ok(clusters)
}

/// Each vector's part in the cost of one cluster of all: `w_i (sum_j w_j - x_i . sum_j w_j x_j)`, all 1 if there is no cost.
fn shares(norms: &[f64], directions: &[f32], dimensions: usize) -> Vec<f64> {
    let total: f64 = norms.iter().sum();
    let mut sum = vec![0.0; dimensions];
    for (direction, &w) in directions.chunks_exact(dimensions).zip(norms) {
        for (sum, &x) in sum.iter_mut().zip(direction) {
            *sum += w * f64::from(x);
        }
    }
    let share = |(direction, &w): (&[f32], &f64)| {
        let along: f64 = direction.iter().zip(&sum).map(|(&x, s)| f64::from(x) * s).sum();
        let apart = total - along;
        if apart > ROUNDING * total { w * apart } else { 0.0 }
    };
    let shares: Vec<f64> = directions.chunks_exact(dimensions).zip(norms).map(share).collect();
    if shares.iter().any(|&share| share > 0.0) { shares } else { vec![1.0; norms.len()] }
}

/// `count` draws in proportion to the shares: the positions drawn, ascending, each with the sum of its 1 / p.
fn draw(shares: &[f64], count: usize, random: &mut Pcg64Mcg) -> Vec<(usize, f64)> {
    let mut ends = Vec::with_capacity(shares.len());
    let total = shares.iter().fold(0.0, |sum, share| {
        ends.push(sum + share);
        sum + share
    });
    let last = shares.iter().rposition(|&share| share > 0.0).unwrap_or(0);
    let mut drawn: Vec<usize> = (0..count)
        .map(|_| {
            let at = unit(random.next_u64()) * total;
            ends.partition_point(|&end| end <= at).min(last)
        })
        .collect();
    drawn.sort_unstable();
    let centres = drawn.chunk_by(|a, b| a == b);
    centres.map(|same| (same[0], same.len() as f64 * (total / shares[same[0]]))).collect()
}

/// Up to `BLOCK` centres, `[dimension][centre]`, with the factors on their distances.
struct Block {
    directions: Vec<[f32; BLOCK]>,
    factors: Vec<f64>,
}

impl Block {
    fn all(
        centres: &[(usize, f64)],
        norms: &[f64],
        directions: &[f32],
        dimensions: usize,
    ) -> Vec<Block> {
        let block = |centres: &[(usize, f64)]| {
            let mut block = Block {
                directions: vec![[0.0; BLOCK]; dimensions],
                factors: centres.iter().map(|&(at, weight)| weight * norms[at]).collect(),
            };
            for (lane, &(at, _)) in centres.iter().enumerate() {
                let direction = &directions[at * dimensions..][..dimensions];
                block.directions.iter_mut().zip(direction).for_each(|(row, &x)| row[lane] = x);
            }
            block
        };
        centres.chunks(BLOCK).map(block).collect()
    }
}

/// The centre of least distance, the first of equals.
fn closest(blocks: &[Block], direction: &[f32]) -> u32 {
    let mut best = (0, f64::INFINITY);
    for (number, block) in blocks.iter().enumerate() {
        let mut along = [0.0f32; BLOCK];
        for (centres, &x) in block.directions.iter().zip(direction) {
            for (along, centre) in along.iter_mut().zip(centres) {
                *along += centre * x;
            }
        }
        for (lane, (factor, &along)) in block.factors.iter().zip(&along).enumerate() {
            let distance = factor * f64::from(1.0 - along).max(0.0);
            if distance < best.1 {
                best = ((number * BLOCK + lane) as u32, distance);
            }
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, noise};
    use super::super::{Draw, random};
    use super::*;

    /// Vectors around `axes` coordinate axes of a space, at a small angle.
    fn bundles(count: usize, axes: usize) -> (Vec<f64>, Vec<f32>) {
        let norms = (0..count).map(|j| 10f64.powf(f64::from(4.0 * noise(j, 0, 0)))).collect();
        let vector = |j: usize| {
            let entry = move |i: usize| if i == j % axes { 1.0 } else { 0.02 * noise(j, i, 1) };
            let norm = (0..axes).map(|i| entry(i).powi(2)).sum::<f32>().sqrt();
            (0..axes).map(move |i| entry(i) / norm)
        };
        (norms, (0..count).flat_map(vector).collect())
    }

    #[test]
    fn bundles_stay_together() {
        let (norms, directions) = bundles(300, 5);
        let mut random = random(3, Draw::Sampling, 0);
        let clusters = sample(&norms, &directions, 5, 60, &mut random, &never).unwrap();
        assert!(clusters.len() <= 60 && clusters.len() > 20, "{}", clusters.len());
        for cluster in &clusters {
            assert!(cluster.iter().all(|at| at % 5 == cluster[0] % 5), "{cluster:?}");
        }
        let mut all: Vec<u32> = clusters.concat();
        all.sort_unstable();
        assert!(all.iter().copied().eq(0..300));
    }

    #[test]
    fn the_weights_of_the_centres_estimate_the_number_of_vectors() {
        // sum of 1 / p over the draws, divided by their number, is an unbiased estimate of the number of vectors.
        let shares: Vec<f64> = (0..50).map(|j| 0.2 + f64::from(noise(j, 1, 1))).collect();
        let drawn = draw(&shares, 20_000, &mut random(1, Draw::Sampling, 0));
        let estimate = drawn.iter().map(|(_, weight)| weight).sum::<f64>() / 20_000.0;
        assert!((estimate / 50.0 - 1.0).abs() < 0.02, "{estimate}");
    }

    #[test]
    fn shares_are_halves_of_the_summed_distances() {
        let (norms, directions) = bundles(40, 3);
        let x = |j: usize| &directions[3 * j..][..3];
        for (i, share) in shares(&norms, &directions, 3).into_iter().enumerate() {
            let distances = (0..40).map(|j| {
                let apart: f64 = x(i)
                    .iter()
                    .zip(x(j))
                    .map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))
                    .sum();
                norms[i] * norms[j] * apart
            });
            let half = 0.5 * distances.sum::<f64>();
            assert!((share - half).abs() < 1e-6 * norms[i] * norms.iter().sum::<f64>());
        }
    }

    #[test]
    fn parallel_vectors_are_drawn_uniformly() {
        let directions = [0.6f32, 0.8].repeat(1000);
        assert_eq!(shares(&[2.0; 1000], &directions, 2), vec![1.0; 1000]);
        let clusters =
            sample(&[2.0; 1000], &directions, 2, 30, &mut random(1, Draw::Sampling, 0), &never)
                .unwrap();
        assert_eq!(clusters.iter().map(Vec::len).sum::<usize>(), 1000);
    }
}
