//! Pixel mappings between images by nearest neighbours of 9-vectors (world position, shading normal, diffuse reflectance), after
//! the tensor clustering paper, sections 4.4 and 5: exact search over a whole frame, drift-free composition over many frames, and
//! the 3x3 search of the anti-aliasing.
//!
//! A pixel is named by its index `y * width + x`, and [`UNMAPPED`] names none. Every search is exact in one definition of the
//! squared distance ([`squared_distance`]) and breaks ties by a rule that knows neither thread, seed nor traversal order, so the
//! maps have the same bits for any number of threads.

mod candidates;
mod compose;
mod features;
mod lanes;
mod map;
mod pyramid;

#[cfg(test)]
mod box_room;

pub use compose::{compose, nearest_of_3x3};
pub use features::{Features, Frame, NeighbourError, UNMAPPED, Weights, squared_distance};
pub use map::{Map, map};
pub use pyramid::Pyramid;
