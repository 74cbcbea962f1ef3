//! Collapsing a binary hierarchy into nodes of eight children, so that rays meet the least.
//!
//! Which descendants become the children of a node is decided for all nodes at once: of all ways to collapse the binary
//! hierarchy, the one whose nodes and leaves have the least sum of surfaces, which is what a random ray can expect to
//! meet. A subtree that fits into a leaf is one. Weighing leaves less or more than nodes changed nothing.

use super::build::Tree;
use super::hierarchy::{Bounds, LEAF, Node};
use crate::kernel::lanes::WIDTH;
use obvhs::bvh2::node::Bvh2Node;

/// What a subtree costs at least if it may take one slot of its parent's eight, two and so on up to seven.
type Costs = [f32; WIDTH - 1];

/// A binary hierarchy with what collapsing needs to know of each node.
pub(super) struct Collapse<'a> {
    binary: &'a [Bvh2Node],
    primitives: &'a [u32],
    /// Most members of a leaf.
    capacity: u32,
    /// The exact box.
    bounds: Vec<Bounds>,
    /// How many primitives lie below.
    sizes: Vec<u32>,
    costs: Vec<Costs>,
}

impl<'a> Collapse<'a> {
    pub(super) fn new(
        binary: &'a [Bvh2Node],
        primitives: &'a [u32],
        boxes: &[Bounds],
        capacity: u32,
    ) -> Self {
        let mut order = Vec::with_capacity(binary.len());
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            order.push(at);
            let node = &binary[at as usize];
            if !node.is_leaf() {
                stack.extend([node.first_index + 1, node.first_index]);
            }
        }
        let whole = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(*b)).half_area();
        let mut all = Self {
            binary,
            primitives,
            capacity,
            bounds: vec![Bounds::EMPTY; binary.len()],
            sizes: vec![0; binary.len()],
            costs: vec![[0.0; WIDTH - 1]; binary.len()],
        };
        // Backwards, so that both children are known when their parent's turn comes.
        for at in order.into_iter().rev() {
            let node = &binary[at as usize];
            let first = node.first_index as usize;
            let at = at as usize;
            if node.is_leaf() {
                let own = &primitives[first..first + node.prim_count as usize];
                all.bounds[at] = own.iter().fold(Bounds::EMPTY, |b, &p| b.union(boxes[p as usize]));
                all.sizes[at] = node.prim_count;
            } else {
                all.bounds[at] = all.bounds[first].union(all.bounds[first + 1]);
                all.sizes[at] = all.sizes[first] + all.sizes[first + 1];
            }
            let area = all.bounds[at].half_area() / whole.max(f64::MIN_POSITIVE);
            all.costs[at] = all.least(at, area as f32);
        }
        all
    }

    /// The least costs of a subtree, given those of its children and the surface of its box as a share of the whole.
    fn least(&self, at: usize, area: f32) -> Costs {
        if self.is_leaf(at as u32) {
            return [area; WIDTH - 1];
        }
        let mut costs = [area + self.divide(at, WIDTH).0; WIDTH - 1];
        for slots in 2..WIDTH {
            costs[slots - 1] = costs[slots - 2].min(self.divide(at, slots).0);
        }
        costs
    }

    /// The least cost of the two children of an inner node in `slots` slots, and how many the first of them takes.
    fn divide(&self, at: usize, slots: usize) -> (f32, usize) {
        let first = self.binary[at].first_index as usize;
        let (a, b) = (&self.costs[first], &self.costs[first + 1]);
        let cost = |taken: usize| a[taken - 1] + b[slots - taken - 1];
        let mut best = (cost(1), 1);
        for taken in 2..slots {
            if cost(taken) < best.0 {
                best = (cost(taken), taken);
            }
        }
        best
    }

    /// Depth first, so that a node's descendants lie together.
    pub(super) fn run(&self) -> Tree {
        let mut tree = Tree::default();
        // What to place, and the slot (node, lane) that shall refer to it.
        let mut stack: Vec<(u32, Option<(usize, usize)>)> = vec![(0, None)];
        while let Some((at, slot)) = stack.pop() {
            let is_root = slot.is_none();
            let reference = if self.is_leaf(at) && !is_root {
                LEAF | self.place_leaf(at, &mut tree)
            } else {
                let index = tree.nodes.len();
                let children = self.children(at);
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
        tree
    }

    fn is_leaf(&self, at: u32) -> bool {
        self.sizes[at as usize] <= self.capacity || self.binary[at as usize].is_leaf()
    }

    /// Up to eight descendants that together hold what `at` holds, from first to last.
    fn children(&self, at: u32) -> Vec<u32> {
        if self.is_leaf(at) {
            return vec![at];
        }
        let mut children = Vec::with_capacity(WIDTH);
        let mut stack = Vec::with_capacity(WIDTH);
        let open = |stack: &mut Vec<(u32, usize)>, at: u32, slots: usize| {
            let (_, taken) = self.divide(at as usize, slots);
            let first = self.binary[at as usize].first_index;
            stack.extend([(first + 1, slots - taken), (first, taken)]);
        };
        open(&mut stack, at, WIDTH);
        while let Some((at, mut slots)) = stack.pop() {
            let costs = &self.costs[at as usize];
            while slots > 1 && costs[slots - 2] == costs[slots - 1] {
                slots -= 1;
            }
            match slots {
                1 => children.push(at),
                _ => open(&mut stack, at, slots),
            }
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
    use super::super::build;
    use super::super::hierarchy::Build;
    use super::*;
    use glam::Vec3;

    /// The ways to put what lies below `at` into slots of its parent, as lists of subtrees.
    fn ways(all: &Collapse, at: u32) -> Vec<Vec<u32>> {
        let mut ways = vec![vec![at]];
        if !all.is_leaf(at) {
            ways.extend(opened(all, at));
        }
        ways
    }

    fn opened(all: &Collapse, at: u32) -> impl Iterator<Item = Vec<u32>> {
        let first = all.binary[at as usize].first_index;
        let seconds = ways(all, first + 1);
        let join = move |a: Vec<u32>| {
            let join = |b: &Vec<u32>| [a.clone(), b.clone()].concat();
            seconds.iter().map(join).collect::<Vec<_>>()
        };
        ways(all, first).into_iter().flat_map(join).filter(|way| way.len() <= WIDTH)
    }

    /// The least sum of surfaces below and with `at`, by trying everything.
    fn exhaustive(all: &Collapse, at: u32) -> f64 {
        let own = all.bounds[at as usize].half_area();
        if all.is_leaf(at) {
            return own;
        }
        let cost = |way: Vec<u32>| way.iter().map(|&child| exhaustive(all, child)).sum::<f64>();
        own + opened(all, at).map(cost).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_way_to_collapse_has_less_surface() {
        for (count, capacity) in [(12, 1), (14, 1), (22, 2)] {
            let low = |i: u32| Vec3::from([i * 7 % 5, i * 11 % 13, i * 3 % 4].map(|x| x as f32));
            let size = |i: u32| Vec3::new(1.0, (1 + i % 3) as f32, 0.5);
            let boxes: Vec<Bounds> =
                (0..count).map(|i| Bounds { low: low(i), high: low(i) + size(i) }).collect();
            let binary = build::binary(&boxes, Build::Fast);
            let all = Collapse::new(&binary.nodes, &binary.primitive_indices, &boxes, capacity);
            let tree = all.run();
            let surface = |node: &Node, lane: usize| {
                let corner = |of: &[[f32; WIDTH]; 3]| of.map(|axis| axis[lane]).into();
                Bounds { low: corner(&node.low), high: corner(&node.high) }.half_area()
            };
            let below =
                |node: &Node| (0..node.count as usize).map(|l| surface(node, l)).sum::<f64>();
            let found = all.bounds[0].half_area() + tree.nodes.iter().map(below).sum::<f64>();
            let least = exhaustive(&all, 0);
            assert!((found - least).abs() < 1e-6 * least, "{count} boxes: {found}, {least}");
            assert!(tree.nodes.len() > 1);
        }
    }
}
