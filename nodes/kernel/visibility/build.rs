//! Building: a binary hierarchy from `obvhs`, collapsed into nodes of eight children.

use super::hierarchy::{Bounds, Build, LEAF, Node};
use crate::kernel::lanes::WIDTH;
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::{Boundable, BvhBuildParams};
use std::time::Duration;

/// Nodes (the root is node 0; none if there was nothing to put in) and the members of the leaves.
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Tree {
    /// The members of each leaf, in the order in which nodes refer to leaves.
    pub(super) fn leaves(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        let end = self.members.len() as u32;
        let ends = move |leaf: usize| self.starts.get(leaf + 1).copied().unwrap_or(end) as usize;
        (0..self.starts.len()).map(move |i| &self.members[self.starts[i] as usize..ends(i)])
    }
}

/// Whether a triangle can be hit: its vertices and the squares of its sides are finite, and it has an area.
pub(super) fn has_area(triangle: &[Vec3; 3]) -> bool {
    let [a, b, c] = *triangle;
    let (e, f) = (b - a, c - a);
    let extent = a.abs().max(b.abs()).max(c.abs()).max_element();
    let normal = e.as_dvec3().cross(f.as_dvec3());
    // Beyond this the products of the triangle test may overflow.
    triangle.iter().all(|v| v.is_finite()) && extent < 1e12 && normal.length_squared() > 0.0
}

struct Scaled(Aabb);

impl Boundable for Scaled {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Builds a hierarchy over `boxes`, whose leaves hold at most `capacity` of them.
pub(super) fn tree(boxes: &[Bounds], capacity: u32, build: Build) -> Tree {
    let mut tree = Tree { nodes: Vec::new(), starts: Vec::new(), members: Vec::new() };
    if boxes.is_empty() {
        return tree;
    }
    // obvhs compares areas and cannot bear ones that overflow: it sees the boxes scaled into the unit cube.
    let extent = boxes.iter().fold(f32::MIN_POSITIVE, |m, b| {
        m.max(b.low.abs().max_element()).max(b.high.abs().max_element())
    });
    let scaled: Vec<Scaled> = boxes
        .iter()
        .map(|b| Scaled(Aabb::new((b.low / extent).into(), (b.high / extent).into())))
        .collect();
    let preset = match build {
        Build::Fast => BvhBuildParams::fastest_build(),
        Build::Medium => BvhBuildParams::medium_build(),
    };
    // Leaves are formed here, by count: eight triangles cost a leaf no more than one does.
    let parameters = BvhBuildParams {
        max_prims_per_leaf: 1,
        post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
        ..preset
    };
    let binary = build_bvh2(&scaled, parameters, &mut Duration::default());
    Collapse::new(&binary.nodes, &binary.primitive_indices, boxes).run(capacity, &mut tree);
    tree
}

/// A binary hierarchy with what collapsing needs to know of each node: its exact box and its size.
struct Collapse<'a> {
    binary: &'a [Bvh2Node],
    primitives: &'a [u32],
    bounds: Vec<Bounds>,
    sizes: Vec<u32>,
}

impl<'a> Collapse<'a> {
    fn new(binary: &'a [Bvh2Node], primitives: &'a [u32], boxes: &[Bounds]) -> Self {
        let mut order = Vec::with_capacity(binary.len());
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            order.push(at);
            let node = &binary[at as usize];
            if !node.is_leaf() {
                stack.extend([node.first_index + 1, node.first_index]);
            }
        }
        let mut bounds = vec![Bounds::EMPTY; binary.len()];
        let mut sizes = vec![0; binary.len()];
        // Backwards, so that both children are known when their parent's turn comes.
        for &at in order.iter().rev() {
            let node = &binary[at as usize];
            let first = node.first_index as usize;
            let at = at as usize;
            if node.is_leaf() {
                let own = &primitives[first..first + node.prim_count as usize];
                bounds[at] = own.iter().fold(Bounds::EMPTY, |b, &p| b.union(boxes[p as usize]));
                sizes[at] = node.prim_count;
            } else {
                bounds[at] = bounds[first].union(bounds[first + 1]);
                sizes[at] = sizes[first] + sizes[first + 1];
            }
        }
        Self { binary, primitives, bounds, sizes }
    }

    /// Depth first, so that a node's descendants lie together.
    fn run(&self, capacity: u32, tree: &mut Tree) {
        // What to place, and the slot (node, lane) that shall refer to it.
        let mut stack: Vec<(u32, Option<(usize, usize)>)> = vec![(0, None)];
        while let Some((at, slot)) = stack.pop() {
            let is_root = slot.is_none();
            let reference = if self.is_leaf(at, capacity) && !is_root {
                LEAF | self.place_leaf(at, tree)
            } else {
                let index = tree.nodes.len();
                let children = self.children(at, capacity);
                let mut node = Node::EMPTY;
                node.count = children.len() as u32;
                for (lane, &child) in children.iter().enumerate() {
                    let Bounds { low, high } = self.bounds[child as usize];
                    for k in 0..3 {
                        node.low[k][lane] = low[k];
                        node.high[k][lane] = high[k];
                    }
                }
                tree.nodes.push(node);
                let slots = children.iter().enumerate().rev();
                stack.extend(slots.map(|(lane, &child)| (child, Some((index, lane)))));
                index as u32
            };
            if let Some((node, lane)) = slot {
                tree.nodes[node].child[lane] = reference;
            }
        }
    }

    fn is_leaf(&self, at: u32, capacity: u32) -> bool {
        self.sizes[at as usize] <= capacity || self.binary[at as usize].is_leaf()
    }

    /// Up to eight descendants that together hold what `at` holds: the largest box is opened first.
    fn children(&self, at: u32, capacity: u32) -> Vec<u32> {
        let mut children = Vec::with_capacity(WIDTH);
        children.push(at);
        while children.len() < WIDTH {
            let area = |&(_, c): &(usize, u32)| self.bounds[c as usize].half_area();
            let inner = children.iter().copied().enumerate();
            let inner = inner.filter(|&(_, c)| !self.is_leaf(c, capacity));
            let Some((lane, child)) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else {
                break;
            };
            let first = self.binary[child as usize].first_index;
            children[lane] = first;
            children.push(first + 1);
        }
        children
    }

    fn place_leaf(&self, at: u32, tree: &mut Tree) -> u32 {
        let leaf = tree.starts.len() as u32;
        tree.starts.push(tree.members.len() as u32);
        let mut stack = vec![at];
        while let Some(at) = stack.pop() {
            let node = &self.binary[at as usize];
            let first = node.first_index;
            if node.is_leaf() {
                let range = first as usize..(first + node.prim_count) as usize;
                tree.members.extend_from_slice(&self.primitives[range]);
            } else {
                stack.extend([first + 1, first]);
            }
        }
        leaf
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(count: usize) -> Vec<Bounds> {
        (0..count)
            .map(|i| {
                let low = Vec3::new((i * 7 % 31) as f32, (i * 11 % 37) as f32, (i % 5) as f32);
                Bounds { low, high: low + Vec3::ONE }
            })
            .collect()
    }

    #[test]
    fn every_member_is_in_exactly_one_leaf_within_the_boxes_above_it() {
        for (count, capacity) in [(1, 8), (1, 1), (7, 8), (9, 8), (500, 8), (300, 1)] {
            let boxes = boxes(count);
            for build in [Build::Fast, Build::Medium] {
                let tree = tree(&boxes, capacity, build);
                let leaves: Vec<&[u32]> = tree.leaves().collect();
                let mut seen = vec![0; count];
                let all = Bounds::EMPTY.union(boxes.iter().fold(Bounds::EMPTY, |a, b| a.union(*b)));
                let mut stack = vec![(0u32, all)];
                while let Some((reference, outer)) = stack.pop() {
                    if reference & LEAF != 0 {
                        let members = leaves[(reference ^ LEAF) as usize];
                        assert!(members.len() <= capacity as usize);
                        for &m in members {
                            seen[m as usize] += 1;
                            assert!(boxes[m as usize].low.cmpge(outer.low).all());
                            assert!(boxes[m as usize].high.cmple(outer.high).all());
                        }
                        continue;
                    }
                    let node = &tree.nodes[reference as usize];
                    for lane in 0..node.count as usize {
                        let low = Vec3::from_array(node.low.map(|axis| axis[lane]));
                        let high = Vec3::from_array(node.high.map(|axis| axis[lane]));
                        assert!(low.cmpge(outer.low).all() && high.cmple(outer.high).all());
                        stack.push((node.child[lane], Bounds { low, high }));
                    }
                }
                assert!(seen.iter().all(|&n| n == 1));
            }
        }
    }

    #[test]
    fn nothing_and_huge_things_build() {
        assert!(tree(&[], 8, Build::Medium).nodes.is_empty());
        let huge: Vec<Bounds> =
            boxes(100).iter().map(|b| Bounds { low: b.low * 1e30, high: b.high * 1e30 }).collect();
        assert!(!tree(&huge, 8, Build::Medium).nodes.is_empty());
    }
}
