//! Stored trees: shape, spheres, leaves and vectors, each over borrowed arrays, gathered from as a [`Hierarchy`].

pub mod colours;
pub mod encode;
pub mod lattice;
pub mod looks;
pub mod octahedral;
pub mod sizes;
pub mod spheres;
pub mod vectors;

use super::hierarchy::{Bound, Entry, Hierarchy, Sent, Surfel};
use super::topology::{Part, Topology};
use crate::kernel::lanes::{Lanes, Triple, prefetch};
use glam::Vec3;
use looks::{Look, Scales};
use spheres::Spheres;
use vectors::Vectors;

/// A tree that can be gathered from.
#[derive(Clone, Debug)]
pub struct Tree<'a, T> {
    /// Its shape.
    pub topology: T,
    /// The sphere of the root.
    pub root: Bound,
    /// Spheres and areas of inner nodes.
    pub spheres: Spheres<'a>,
    /// Leaves.
    pub leaves: Leaves<'a>,
    /// What inner nodes send.
    pub vectors: Vectors<'a>,
}

/// Leaves by their number.
#[derive(Clone, Copy, Debug)]
pub struct Leaves<'a> {
    /// Where they are.
    pub places: Places<'a>,
    /// Colour, normal, area.
    pub looks: Looks<'a>,
    /// What they share.
    pub scales: &'a Scales,
}

/// Places of leaves.
#[derive(Clone, Copy, Debug)]
pub enum Places<'a> {
    /// In the world.
    World(&'a [Vec3]),
    /// In the sphere of the parent ([`lattice`]).
    Parent(&'a [u16]),
}

/// Codes of leaves without their places.
#[derive(Clone, Copy, Debug)]
pub enum Looks<'a> {
    /// As [`Look::Half`].
    Half(&'a [[u16; 7]]),
    /// As [`Look::Lean`].
    Lean(&'a [[u8; 8]]),
}

impl Leaves<'_> {
    /// Leaf `k` below a node with the sphere `parent`.
    #[inline(always)]
    pub fn surfel(&self, k: usize, parent: Bound) -> Surfel {
        let position = match self.places {
            Places::World(places) => places[k],
            Places::Parent(codes) => lattice::decode(codes[k], parent),
        };
        let look = match self.looks {
            Looks::Half(codes) => Look::Half(codes[k]),
            Looks::Lean(codes) => Look::Lean(codes[k]),
        };
        self.scales.decode(look, position)
    }
}

/// A node on a walk from the root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place<N> {
    node: N,
    /// The sphere of an inner node; of a leaf that of its parent.
    bound: Bound,
}

impl<T: Topology> Hierarchy for Tree<'_, T> {
    type Node = Place<T::Node>;

    fn root(&self) -> Option<Self::Node> {
        Some(Place { node: self.topology.root()?, bound: self.root })
    }

    #[inline(always)]
    fn entry(&self, place: Self::Node) -> Entry {
        match self.topology.part(place.node) {
            Part::Leaf(k) => Entry::Leaf(self.leaves.surfel(k, place.bound)),
            Part::Inner(_) => Entry::Inner(place.bound),
        }
    }

    #[inline(always)]
    fn children(&self, place: Self::Node, mut visit: impl FnMut(Self::Node)) {
        self.topology.children(place.node, |node| {
            let bound = match self.topology.part(node) {
                Part::Leaf(_) => place.bound,
                Part::Inner(i) => self.spheres.sphere(i, place.bound),
            };
            visit(Place { node, bound });
        });
    }

    #[inline]
    fn sent(&self, place: Self::Node, direction: Vec3) -> Sent {
        match self.topology.part(place.node) {
            Part::Leaf(_) => Sent::default(),
            Part::Inner(i) => {
                let (radiance, share) = self.vectors.sent(i, direction);
                Sent { radiance, area: share * self.spheres.area(i) }
            }
        }
    }

    #[inline(always)]
    fn sent_to_each<L: Lanes>(
        &self,
        place: Self::Node,
        directions: Triple<L>,
        _: u32,
    ) -> (Triple<L>, L) {
        match self.topology.part(place.node) {
            Part::Leaf(_) => (Triple::splat(Vec3::ZERO), L::splat(0.0)),
            Part::Inner(i) => {
                let (radiance, share) = self.vectors.sent_to_each(i, directions);
                (radiance, share * L::splat(self.spheres.area(i)))
            }
        }
    }

    #[inline(always)]
    fn prefetch(&self, place: Self::Node) {
        if let Part::Inner(i) = self.topology.part(place.node) {
            prefetch(self.vectors.row(i));
            self.spheres.prefetch_area(i);
        }
    }
}

#[cfg(test)]
mod tests;
