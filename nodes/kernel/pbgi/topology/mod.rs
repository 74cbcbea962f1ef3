//! The shapes of point hierarchies: which surfel is a leaf of which node (Buchholz and Boubekeur 2012, section 1.1).
//!
//! A shape says nothing of what nodes hold. Inner nodes and leaves are numbered, each from 0; leaf k is surfel `order[k]`.

pub mod binary;
mod disc;
pub mod octree;
pub mod walk;

use super::hierarchy::Bound;
use std::ops::Range;

pub use binary::Binary;
pub use disc::above;
pub use octree::Octree;

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The leaf of this number.
    Leaf(usize),
    /// The inner node of this number.
    Inner(usize),
}

/// Most children of a node.
pub const ARITY: usize = 8;

/// The shape of a tree with one surfel a leaf.
pub trait Topology: Sync {
    /// A node as a walk carries it.
    type Node: Copy + Send + Sync;
    /// Number of leaves.
    fn leaves(&self) -> usize;
    /// Number of inner nodes.
    fn inner(&self) -> usize;
    /// The root; none when there is no leaf.
    fn root(&self) -> Option<Self::Node>;
    /// What a node is.
    fn part(&self, node: Self::Node) -> Part;
    /// Calls `visit` for each of the 2 to [`ARITY`] children of an inner node, first for the one below which a walk has to keep the
    /// most; never for a leaf.
    fn children(&self, node: Self::Node, visit: impl FnMut(Self::Node));
    /// Numbers among which are those of all inner nodes below this one, and none of a node that is neither below it nor itself.
    fn below(&self, node: Self::Node) -> Range<usize>;
}

/// A tree over surfels before anything is stored of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Built<T> {
    /// Its shape.
    pub topology: T,
    /// The surfel of each leaf.
    pub order: Vec<u32>,
    /// The sphere of each inner node: it holds the discs of all surfels below, and is no larger than that of its parent.
    pub bounds: Vec<Bound>,
}

#[cfg(test)]
mod tests_of_shapes {
    use super::super::hierarchy::Surfel;
    use super::*;

    /// Checks that a tree has every surfel as a leaf once, every number once, 2 to 8 children a node, spheres that hold the discs below
    /// and do not grow, and ranges `below` that are right. Gives its depth.
    pub fn check<T: Topology>(built: &Built<T>, surfels: &[Surfel]) -> usize {
        let Built { topology, order, bounds } = built;
        assert_eq!((order.len(), bounds.len()), (topology.leaves(), topology.inner()));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..surfels.len() as u32));
        let (mut seen_leaves, mut seen_inner) =
            (vec![false; order.len()], vec![false; bounds.len()]);
        // Each with the inner nodes above it.
        let mut open: Vec<(T::Node, Vec<T::Node>)> =
            topology.root().map(|root| (root, Vec::new())).into_iter().collect();
        let mut depth = 0;
        while let Some((node, above)) = open.pop() {
            depth = depth.max(above.len());
            let number = |n| match topology.part(n) {
                Part::Inner(i) => i,
                Part::Leaf(_) => usize::MAX,
            };
            match topology.part(node) {
                Part::Leaf(k) => {
                    assert!(!std::mem::replace(&mut seen_leaves[k], true));
                    let s = surfels[order[k] as usize];
                    for &n in &above {
                        let b = bounds[number(n)];
                        let reach = (s.position.as_dvec3() - b.center.as_dvec3()).length()
                            + f64::from(s.radius);
                        assert!(reach <= f64::from(b.radius), "{reach} {b:?}");
                    }
                    topology.children(node, |_| panic!("a leaf has children"));
                }
                Part::Inner(i) => {
                    assert!(!std::mem::replace(&mut seen_inner[i], true));
                    for &n in &above {
                        assert!(
                            topology.below(n).contains(&i)
                                && bounds[i].radius <= bounds[number(n)].radius
                        );
                    }
                    let mut children = 0;
                    topology.children(node, |child| {
                        children += 1;
                        open.push((child, above.iter().copied().chain([node]).collect()));
                    });
                    assert!((2..=ARITY).contains(&children));
                }
            }
        }
        assert!(seen_leaves.into_iter().chain(seen_inner).all(|seen| seen));
        // Ranges of children do not meet.
        if let Some(root) = topology.root() {
            let mut ranges = Vec::new();
            topology.children(root, |child| ranges.push(topology.below(child)));
            ranges.retain(|r| !r.is_empty());
            ranges.sort_by_key(|r| r.start);
            assert!(ranges.windows(2).all(|w| w[0].end <= w[1].start));
        }
        depth
    }
}
