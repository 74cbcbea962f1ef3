//! Point-based global illumination (Christensen 2008; Buchholz and Boubekeur 2012).
//!
//! Down the page: surfels ([`poisson_disk`]) -> a tree's shape ([`topology`]) -> node data vectors
//! ([`harmonics`], [`stream`]) -> a table of them ([`lut`]) -> a stored tree ([`tree`], [`stored`]) ->
//! what a receiver sees of it ([`gather`], through [`hierarchy`]).

pub mod bits;
pub mod gather;
pub mod half;
pub mod harmonics;
pub mod hierarchy;
pub mod learning;
pub mod lut;
pub mod memory;
pub mod poisson_disk;
pub mod stored;
pub mod stream;
pub mod topology;
pub mod tree;

#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod table;
