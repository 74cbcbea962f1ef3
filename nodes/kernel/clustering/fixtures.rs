//! Small tensors for the tests.

use super::{Cluster, Error, Tensor};

/// A tensor from its entries (light, row, frame).
pub fn tensor_of(
    lights: usize,
    rows: usize,
    frames: usize,
    entry: impl Fn(usize, usize, usize) -> f32,
) -> Tensor {
    let frame =
        |k| (0..lights * rows).map(|at| entry(at / rows, at % rows, k)).collect::<Vec<f32>>();
    Tensor::from_frames(lights, rows, frames, |k| Ok::<_, Error>(frame(k))).unwrap()
}

/// A number in [0, 1) for each entry.
pub fn noise(light: usize, row: usize, frame: usize) -> f32 {
    let bits = super::scramble(light as u64 | (row as u64) << 24 | (frame as u64) << 48);
    (bits >> 40) as f32 / (1 << 24) as f32
}

/// Lights that move past the rows, each with its own reach and power; a share of the pairs is dark.
pub fn smooth(lights: usize, rows: usize, frames: usize) -> Tensor {
    tensor_of(lights, rows, frames, |j, i, k| {
        let place = noise(j, 0, 9) + k as f32 * 0.02 * noise(j, 1, 9);
        let reach = 0.05 + 0.4 * noise(j, 2, 9);
        let power = 10f32.powf(4.0 * noise(j, 3, 9) - 2.0);
        let distance = (i as f32 / rows as f32 - place) / reach;
        if noise(j, 7, k) < 0.1 { 0.0 } else { power * (1.0 - distance * distance).max(0.0) }
    })
}

/// Progress nobody looks at.
pub fn never() -> Result<(), Error> {
    Ok(())
}

/// Progress nobody looks at.
pub fn no_tick(_: u64, _: u64) -> Result<(), Error> {
    Ok(())
}

/// In canonical order, to compare partitions whatever the order of the clusters.
pub fn sorted(mut clusters: Vec<Cluster>) -> Vec<Cluster> {
    clusters.sort();
    clusters
}
