//! The eight-wide hierarchy as it lies in memory: nodes, leaves of triangles and the hierarchy of one mesh.

use super::super::pages::Paged;
use super::build;
use crate::kernel::lanes::{Lanes, WIDTH};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// How much a child's box grows, as a share of its largest distance from the rays' shared point along an axis.
///
/// The triangle test errs by about ten roundings of that distance (products, sums and the subtraction of the shared
/// point), so a ray that it takes to be inside a triangle may pass that far outside the triangle's box. Boxes that
/// forgave less would reopen the edges that the triangle test closes.
pub(super) const SLACK: f32 = 1.0 / (1 << 19) as f32;

/// The coordinate of the boxes of absent children: far from everything, yet an ordinary number.
pub(super) const FAR: f32 = 1e30;

/// A reference to a child: a node, or with this bit a leaf.
pub(super) const LEAF: u32 = 1 << 31;

/// How carefully a hierarchy is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Build {
    /// For meshes that deform: built anew for every frame.
    Fast,
    /// For static meshes: slower to build, faster to trace.
    Medium,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

impl Bounds {
    pub(super) const EMPTY: Self =
        Self { low: Vec3::splat(f32::INFINITY), high: Vec3::splat(f32::NEG_INFINITY) };

    pub(super) fn around(points: &[Vec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, p| b.union(Self { low: *p, high: *p }))
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Half the surface, in f64 because the boxes of huge scenes overflow f32.
    pub(super) fn half_area(self) -> f64 {
        let d = (self.high - self.low).as_dvec3();
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// Up to eight children: their boxes, axis by axis, and where they are. 256 bytes.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Node {
    pub(super) low: [[f32; WIDTH]; 3],
    pub(super) high: [[f32; WIDTH]; 3],
    pub(super) child: [u32; WIDTH],
    /// Children present; they fill the first lanes.
    pub(super) count: u32,
    pub(super) padding: [u32; 7],
}

impl Node {
    pub(super) const EMPTY: Self = Self {
        low: [[FAR; WIDTH]; 3],
        high: [[FAR; WIDTH]; 3],
        child: [LEAF; WIDTH],
        count: 0,
        padding: [0; 7],
    };

    /// The children's boxes relative to an origin, grown.
    #[inline(always)]
    pub(super) fn boxes<L: Lanes>(&self, origin: &Grown<L>) -> Boxes<L> {
        let (low, high) = (&self.low, &self.high);
        Boxes {
            low: [
                L::load(&low[0]).sub(origin.low[0]),
                L::load(&low[1]).sub(origin.low[1]),
                L::load(&low[2]).sub(origin.low[2]),
            ],
            high: [
                L::load(&high[0]).sub(origin.high[0]),
                L::load(&high[1]).sub(origin.high[1]),
                L::load(&high[2]).sub(origin.high[2]),
            ],
            present: (1 << self.count) - 1,
        }
    }
}

/// A point to which boxes are made relative, moved so that they grow by what the triangle test may err.
pub(super) struct Grown<L> {
    /// What is taken from boxes' low sides, and from their high sides.
    pub(super) low: [L; 3],
    pub(super) high: [L; 3],
}

impl<L: Lanes> Grown<L> {
    /// For boxes within `bounds`, which all grow by what the farthest one needs: some thirty times the spacing of its
    /// coordinates, which is less than triangles are wide, and spares every node the reckoning. Rays may start as far
    /// as `spread` from `origin`.
    #[inline(always)]
    pub(super) fn new(origin: [f32; 3], spread: f32, bounds: &Bounds) -> Self {
        let (low, high) = (bounds.low.to_array(), bounds.high.to_array());
        let (mut reach, mut size) = (0.0f32, 0.0f32);
        for k in 0..3 {
            reach = reach.max(high[k] - origin[k]).max(origin[k] - low[k]);
            size = size.max(origin[k].abs());
        }
        // The second term is for the rounding of the moved origin.
        let slack = (reach + spread) * SLACK + size * f32::EPSILON;
        let moved = |by: f32| {
            [L::splat(origin[0] + by), L::splat(origin[1] + by), L::splat(origin[2] + by)]
        };
        Self { low: moved(slack), high: moved(-slack) }
    }
}

/// The boxes of a node's children relative to the rays' shared point.
#[derive(Clone, Copy)]
pub(super) struct Boxes<L> {
    pub(super) low: [L; 3],
    pub(super) high: [L; 3],
    pub(super) present: u32,
}

/// The extra slack of boxes for ray origins at most `reach` away from the point that the boxes are relative to.
pub(super) fn extra_slack(reach: f32) -> f32 {
    reach * SLACK
}

/// Up to eight triangles, vertex by vertex and axis by axis; absent ones have no area.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Leaf {
    pub(super) vertex: [[[f32; WIDTH]; 3]; 3],
    /// The largest coordinate of each triangle's shortest side.
    pub(super) side: [f32; WIDTH],
    /// The triangles' indices in the mesh.
    pub(super) index: [u32; WIDTH],
    /// Bit i: triangle i is alpha-masked.
    pub(super) masked: u32,
    /// Triangles present; they fill the first lanes.
    pub(super) count: u32,
    padding: [u32; 6],
}

/// The hierarchy of one mesh, in the mesh's own frame.
#[derive(Clone, Debug)]
pub struct Blas {
    pub(super) nodes: Paged<Node>,
    pub(super) leaves: Paged<Leaf>,
    pub(super) bounds: Bounds,
    skipped: usize,
}

impl Blas {
    /// Builds the hierarchy of `triangles` (three vertices each, object space). `masked[i]` says that triangle i is
    /// alpha-masked, so that hits on it are put to a query's filter; a shorter slice means "not masked" for the rest.
    ///
    /// Triangles without area and triangles with NaN, infinite or overflowing coordinates are left out and counted
    /// ([`Blas::skipped`]); the others keep their indices. No triangles at all are legal: nothing is ever hit.
    /// Indices and counts are 32 bits; triangles beyond 2^31 - 1 are left out too.
    #[must_use]
    pub fn new(triangles: &[[Vec3; 3]], masked: &[bool], build: Build) -> Self {
        let kept: Vec<u32> = (0..1 << 31)
            .zip(triangles)
            .filter_map(|(i, t)| build::has_area(t).then_some(i))
            .collect();
        let corners = |i: u32| &triangles[kept[i as usize] as usize];
        let boxes: Vec<Bounds> =
            (0..kept.len() as u32).map(|i| Bounds::around(corners(i))).collect();
        let tree = build::tree(&boxes, WIDTH as u32, build);
        let mut leaves = Paged::<Leaf>::zeroed(tree.leaves().len());
        for (leaf, members) in leaves.iter_mut().zip(tree.leaves()) {
            leaf.count = members.len() as u32;
            for (lane, &member) in members.iter().enumerate() {
                for (vertex, corner) in leaf.vertex.iter_mut().zip(corners(member)) {
                    for (axis, value) in vertex.iter_mut().zip(corner.to_array()) {
                        axis[lane] = value;
                    }
                }
                let [a, b, c] = *corners(member);
                let sides = [b - a, c - b, a - c].map(|side| side.abs().max_element());
                leaf.side[lane] = sides[0].min(sides[1]).min(sides[2]);
                let index = kept[member as usize];
                leaf.index[lane] = index;
                leaf.masked |=
                    u32::from(masked.get(index as usize).copied().unwrap_or(false)) << lane;
            }
        }
        Self {
            leaves,
            nodes: Paged::from(tree.nodes.as_slice()),
            bounds: boxes.iter().fold(Bounds::EMPTY, |a, b| a.union(*b)),
            skipped: triangles.len() - kept.len(),
        }
    }

    /// How many triangles were left out because they have no area or are not finite.
    #[must_use]
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// Memory in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val::<[Node]>(&self.nodes) + size_of_val::<[Leaf]>(&self.leaves)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unusable_triangles_are_counted_and_the_rest_keep_their_indices() {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
        let triangles = [
            [x, x, y],
            [x, y, z],
            [x, Vec3::splat(f32::NAN), z],
            [Vec3::ZERO, x, x * 2.0],
            [x, Vec3::splat(f32::INFINITY), z],
            [-x, y, z],
        ];
        let blas = Blas::new(&triangles, &[false, true], Build::Medium);
        assert_eq!(blas.skipped(), 4);
        assert_eq!(blas.leaves.len(), 1);
        let leaf = &blas.leaves[0];
        let mut found = [(leaf.index[0], leaf.masked & 1), (leaf.index[1], leaf.masked >> 1)];
        found.sort_unstable();
        assert_eq!(found, [(1, 1), (5, 0)]);
    }

    #[test]
    fn a_node_fills_four_cache_lines() {
        assert_eq!(size_of::<Node>(), 256);
    }
}
