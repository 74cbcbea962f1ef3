//! Visibility: which point sees which, by exact ray casting on the CPU.
//!
//! A [`Blas`] is the eight-wide bounding hierarchy of one mesh, a [`World`] places meshes as instances and answers
//! queries. Many-light rendering asks for rows and columns of the lighting matrix: all segments between one point and
//! many. [`World::occluded_from`] and, for directional lights, [`World::occluded_parallel`] trace up to 64 such rays
//! together, which is several times faster than [`World::occluded`] one by one; [`World::closest_from`] does the same
//! for what a camera sees. The scalar queries are the reference.
//!
//! Answers are the same bits on every processor and do not depend on the number of threads.

mod beam;
mod blocking;
mod build;
mod collapse;
mod hierarchy;
mod nearest;
mod packet;
mod picked;
mod query;
mod single;
mod stack;
mod triangle;
mod world;

pub use blocking::Blocker;
pub use hierarchy::{Blas, Build};
pub use world::{Instance, World};

use glam::Vec3;

/// Decides whether a hit of an alpha-masked triangle counts: given the triangle's number in the world and the
/// barycentric weights of its vertices 1 and 2, false means that the surface is transparent there. Called from the
/// thread that asks, only for triangles marked as masked, and perhaps several times for one hit.
pub type Filter<'a> = dyn Fn(u32, f32, f32) -> bool + Sync + 'a;

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The distance in lengths of the ray's direction.
    pub t: f32,
    /// The triangle's number in the world: its instance's `first_triangle` plus its index in the mesh.
    pub triangle: u32,
    /// The barycentric weight of vertex 1.
    pub u: f32,
    /// The barycentric weight of vertex 2.
    pub v: f32,
}

/// The nearest hit of each of up to 64 rays; none where nothing is hit.
pub type Hits = [Option<Hit>; Ends::CAPACITY];

/// Up to 64 points, axis by axis, world space. Which of them count is said by a query's mask.
#[derive(Clone, Debug)]
pub struct Ends {
    /// First coordinates.
    pub xs: [f32; Ends::CAPACITY],
    /// Second coordinates.
    pub ys: [f32; Ends::CAPACITY],
    /// Third coordinates.
    pub zs: [f32; Ends::CAPACITY],
}

impl Ends {
    /// How many points fit in.
    pub const CAPACITY: usize = 64;

    /// All points at the frame's origin.
    #[must_use]
    pub const fn new() -> Self {
        let zero = [0.0; Self::CAPACITY];
        Self { xs: zero, ys: zero, zs: zero }
    }

    /// The first 64 of `points` and the mask that makes them count; the rest are ignored.
    #[must_use]
    pub fn from_points(points: &[Vec3]) -> (Self, u64) {
        let mut ends = Self::new();
        for (i, point) in points.iter().take(Self::CAPACITY).enumerate() {
            ends.set(i, *point);
        }
        (ends, picked::low_bits(points.len()))
    }

    /// Puts `point` at place `index`. A place beyond 63 is ignored.
    #[inline]
    pub fn set(&mut self, index: usize, point: Vec3) {
        if index < Self::CAPACITY {
            self.xs[index] = point.x;
            self.ys[index] = point.y;
            self.zs[index] = point.z;
        }
    }
}

impl Default for Ends {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests;
