//! Vectors and tables for tests.

use super::{KMeans, Lut, Tick};
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::Rng;

/// `count` numbers in [0, 1).
pub fn noise(count: usize, seed: u64) -> Vec<f32> {
    let mut random = Pcg64Mcg::new(u128::from(seed) << 1 | 1);
    (0..count).map(|_| (random.next_u64() >> 40) as f32 / (1 << 24) as f32).collect()
}

/// `count` vectors, each near the one before it, in [0, 1].
pub fn walk(count: usize, dims: usize, seed: u64) -> Vec<f32> {
    let mut at = vec![0.5; dims];
    let steps = noise(count * dims, seed);
    let mut out = Vec::with_capacity(steps.len());
    for steps in steps.chunks_exact(dims) {
        at.iter_mut().zip(steps).for_each(|(x, s)| *x = (*x + 0.1 * (s - 0.5)).clamp(0.0, 1.0));
        out.extend_from_slice(&at);
    }
    out
}

/// `count` vectors that are sums of five vectors and a little of everything, as those of real scenes are.
pub fn flat(count: usize, dims: usize, seed: u64) -> Vec<f32> {
    let (of, by) = (noise(5 * dims, 77), walk(count, 5, seed));
    let mut out = noise(count * dims, seed + 1);
    for (x, by) in out.chunks_exact_mut(dims).zip(by.chunks_exact(5)) {
        x.iter_mut().for_each(|x| *x = 0.01 * (*x - 0.5));
        for (of, by) in of.chunks_exact(dims).zip(by) {
            x.iter_mut().zip(of).for_each(|(x, of)| *x += by * of);
        }
    }
    out
}

/// Goes on.
pub const QUIET: &Tick = &|_, _| Ok(());

/// Settings for so many entries, of all vectors.
pub fn all(entries: u32) -> KMeans {
    KMeans { entries, black: 0.0, ..KMeans::default() }
}

/// A trained table.
pub fn build(vectors: &[f32], dims: usize, settings: &KMeans) -> Lut {
    Lut::build(vectors, dims, settings, QUIET).unwrap()
}
