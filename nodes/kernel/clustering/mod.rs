//! Clustering of the columns of a reduced light matrix (Hašan 2007) or tensor (Hašan 2008, sections 4.3 and 5).
//!
//! The cost of a cluster is `W^2 - |s|^2`: W is the sum of the norms of its reduced columns and s the sum of the columns. It is the
//! papers' `sum d(p, q)` with every unordered pair counted once, and also the exact variance, on the sampled rows, of a
//! representative drawn with probability `w / W`.
//!
//! `Tensor` holds the columns, `cluster_tensor` and `cluster_columns` find clusters, `History` answers every smaller count.
//!
//! The result is a function of the tensor and the settings alone: number of threads and instruction set do not count. The order
//! of the lights counts only through the random draws and through rounding; see `cluster_tensor`.

mod columns;
mod cost;
mod history;
mod lanes;
mod line;
mod multiset;
mod project;
mod queue;
mod rectangles;
mod split;
mod sweep;
mod tensor;

#[cfg(test)]
mod extremes;
#[cfg(test)]
mod fixtures;

use rand_pcg::Pcg64Mcg;

pub use columns::{Mode, cluster_columns};
pub use history::{Cluster, History};
pub use rectangles::{Settings, cluster_tensor};
pub use tensor::Tensor;

/// Progress and cancellation: called at least ten times a second with (clusters found, clusters wanted), from any thread; an
/// error ends the work and is handed on.
pub type Tick<'a, E> = dyn Fn(u64, u64) -> Result<(), E> + Sync + 'a;

/// `Tick` inside one step of the work.
type Beat<'a, E> = dyn Fn() -> Result<(), E> + Sync + 'a;

/// What cannot be clustered, and why.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The tensor has no lights, rows or frames; rows are missing when no sampled pixel sees a surface.
    #[error("the reduced tensor has no {0}")]
    Empty(&'static str),
    /// More entries than memory addresses, or more light-frame pairs than 32 bits number.
    #[error("a reduced tensor of {lights} lights, {rows} rows and {frames} frames is too large")]
    TooLarge {
        /// Number of lights.
        lights: usize,
        /// Number of rows.
        rows: usize,
        /// Number of frames.
        frames: usize,
    },
    /// The rows of a frame have another size than lights x rows.
    #[error("frame {frame} has {found} row entries, expected {expected}")]
    FrameSize {
        /// Frame within the tensor.
        frame: usize,
        /// Entries expected: lights x rows.
        expected: usize,
        /// Entries found.
        found: usize,
    },
    /// An entry is negative, infinite or not a number.
    #[error(
        "light {light}, row {row}, frame {frame}: {value} is not a finite non-negative contribution"
    )]
    Value {
        /// Light of the entry.
        light: usize,
        /// Row of the entry.
        row: usize,
        /// Frame of the entry.
        frame: usize,
        /// The entry.
        value: f32,
    },
    /// Clustering starts from no cluster.
    #[error("the clustering needs at least one starting cluster")]
    Start,
    /// Fewer clusters wanted than the clustering starts from (the starting clusters of every segment between camera cuts).
    #[error("{limit} clusters wanted, but the clustering starts from {start}")]
    Limit {
        /// Clusters wanted.
        limit: usize,
        /// Clusters at the start.
        start: usize,
    },
    /// The factor on time splits is not positive and finite.
    #[error("the weight of time splits must be positive and finite, found {0}")]
    TimeWeight(f64),
    /// A camera cut is not inside the tensor, or the cuts do not increase.
    #[error("camera cut at frame {cut}: cuts must increase and lie in 1..{frames}")]
    Cut {
        /// The frame given.
        cut: usize,
        /// Frames of the tensor.
        frames: usize,
    },
    /// Single-frame clustering was given several frames.
    #[error("single-frame clustering of a tensor of {0} frames")]
    Frames(usize),
    /// A stored history contradicts itself.
    #[error("damaged clustering history: {0}")]
    Damaged(&'static str),
}

/// What a random number is drawn for: each use has its own numbers.
#[derive(Clone, Copy)]
enum Draw {
    Projection = 1,
    Sampling = 2,
    Line = 3,
}

/// The generator of draw `index` of its kind.
fn random(seed: u64, draw: Draw, index: u64) -> Pcg64Mcg {
    let low = scramble(seed ^ scramble(draw as u64));
    let high = scramble(low ^ scramble(index));
    Pcg64Mcg::new((u128::from(high) << 64) | u128::from(scramble(high ^ low)))
}

/// The finalizer of SplitMix64: neighbouring numbers become unrelated ones.
fn scramble(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A number in [0, 1) from the upper 53 of 64 random bits.
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}
