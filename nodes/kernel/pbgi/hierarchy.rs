//! What a gatherer sees of a point hierarchy, whatever its topology and however it is stored.

use crate::kernel::lanes::{Lanes, Triple, WIDTH};
use glam::Vec3;

/// A disc of surface that sends light from its front. Its back is not seen and hides nothing: surfels cover closed solids or
/// both sides of sheets, so that before every back there is a front. In a cell that sees a thin solid aslant, its backs would
/// take the place of fronts farther on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Its centre, world space.
    pub position: Vec3,
    /// Unit normal of the side that sends light.
    pub normal: Vec3,
    /// Radiance it sends, the same in all directions of its side.
    pub radiance: Vec3,
    /// The area it stands for, square world units; all surfels of a surface together have its area.
    pub area: f32,
    /// Radius of the disc it is drawn as; larger than that of its area, so that discs leave no holes.
    pub radius: f32,
}

/// Surfels by number, wherever they are kept: what trees are built over without a copy of them all.
pub trait SurfelSet: Sync {
    /// How many there are.
    fn count(&self) -> usize;
    /// Surfel `i`, below the count.
    fn surfel(&self, i: usize) -> Surfel;
}

impl SurfelSet for Vec<Surfel> {
    fn count(&self) -> usize {
        self.len()
    }

    fn surfel(&self, i: usize) -> Surfel {
        self[i]
    }
}

/// A sphere around all surfels of a subtree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// Its centre, world space.
    pub center: Vec3,
    /// Its radius; it holds the centres of all surfels with their discs.
    pub radius: f32,
}

/// A node of the hierarchy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Entry {
    /// One surfel.
    Leaf(Surfel),
    /// Several, of which the children are found by [`Hierarchy::children`].
    Inner(Bound),
}

/// What a subtree sends in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sent {
    /// Mean radiance over what faces the direction.
    pub radiance: Vec3,
    /// Area that faces it, as seen from there (area times cosine), square world units.
    pub area: f32,
}

/// A tree of surfels.
///
/// A node is only found by walking down from the root: what a tree stores of it may be relative to its parent, and
/// then the value of type `Node` carries what the parent gave.
pub trait Hierarchy: Sync {
    /// A node as a walk carries it.
    type Node: Copy + Send;
    /// Its root; none where there is no surfel.
    fn root(&self) -> Option<Self::Node>;
    /// A node.
    fn entry(&self, node: Self::Node) -> Entry;
    /// Calls `visit` for each child of an inner node, in a fixed order; never for a leaf.
    fn children(&self, node: Self::Node, visit: impl FnMut(Self::Node));
    /// What an inner node sends towards the unit vector `direction`, which points away from it; nothing for a leaf.
    fn sent(&self, node: Self::Node, direction: Vec3) -> Sent;
    /// The same towards one unit vector a lane, the same bits: radiance and area. What lanes outside of `mask` give means nothing.
    #[inline(always)]
    fn sent_to_each<L: Lanes>(
        &self,
        node: Self::Node,
        directions: Triple<L>,
        mask: u32,
    ) -> (Triple<L>, L) {
        let directions = directions.store();
        let sent: [Sent; WIDTH] = std::array::from_fn(|lane| match mask >> lane & 1 {
            1 => self.sent(node, directions[lane]),
            _ => Sent::default(),
        });
        (Triple::load(&sent.map(|s| s.radiance)), L::load(&sent.map(|s| s.area)))
    }
    /// Hints that it will soon be asked what a node sends.
    #[inline(always)]
    fn prefetch(&self, _: Self::Node) {}
}
