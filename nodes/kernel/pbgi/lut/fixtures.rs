//! Vectors for tests.

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
