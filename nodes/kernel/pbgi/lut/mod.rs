//! Table of node data vectors (Buchholz and Boubekeur 2012, section 3.2): trained by k-means, asked for the nearest entry.
//!
//! [`Lut::build`] trains a table, [`Quantizer`] finds the nearest entry exactly, [`errors`] says what a table loses. All three give
//! the same bits for any number of threads and any instruction set.

mod balance;
mod best;
mod boxes;
mod centres;
mod distinct;
mod errors;
#[cfg(test)]
mod fixtures;
mod kmeans;
mod lanes;
mod lloyd;
mod nearest;
mod principal;
mod seeding;
mod weighting;

pub use balance::{Balanced, balance, balanced};
pub use errors::{Errors, errors};
pub use kmeans::{KMeans, Lut, Seeding};
pub use nearest::{DIMS, Quantizer};
pub use weighting::Weighting;

/// Progress and cancellation: called with (steps done, all steps), from any thread; an error ends the work and is handed on.
pub type Tick<'a> = dyn Fn(u64, u64) -> Result<(), crate::node::Error> + Sync + 'a;
