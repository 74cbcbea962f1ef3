//! The octree: cells halved along all three axes until each holds one surfel, cells without company left out.
//!
//! Surfels are sorted by Morton code of 21 bits an axis, over the cube around all of them. What shares a code is nearer than 2^-21 of that cube
//! (coincident surfels most of all) and is split by number in up to eight equal runs. So a tree of n leaves is at most
//! 21 + log8 n deep, and nothing here recurses.
//!
//! Inner children of a node are numbered one after the other, and so are its leaf children; all numbers below a node follow each other.

use super::super::hierarchy::{Bound, SurfelSet};
use super::disc::{Disc, corners, discs, sphere};
use super::{ARITY, Built, Part, Topology};
use crate::kernel::morton;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// The shape of an octree, over arrays of its own or of an artifact.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree<'a> {
    /// For each inner node its first inner child and its first leaf child.
    pub first: Cow<'a, [[u32; 2]]>,
    /// For each inner node how many inner children (low four bits) and leaf children (high four bits) it has.
    pub counts: Cow<'a, [u8]>,
    /// Number of leaves.
    pub leaves: u32,
}

/// A node of an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell(u32);

/// Set in the number of a leaf.
const LEAF: u32 = 1 << 31;

impl Octree<'_> {
    /// Numbers of the inner children and of the leaf children of inner node `i`.
    #[inline(always)]
    fn ranges(&self, i: usize) -> (Range<u32>, Range<u32>) {
        let ([inner, leaf], counts) = (self.first[i], u32::from(self.counts[i]));
        (inner..inner + (counts & 15), leaf..leaf + (counts >> 4))
    }
}

impl Topology for Octree<'_> {
    type Node = Cell;

    fn leaves(&self) -> usize {
        self.leaves as usize
    }

    fn inner(&self) -> usize {
        self.counts.len()
    }

    fn root(&self) -> Option<Cell> {
        match (self.leaves, self.counts.len()) {
            (0, _) => None,
            (_, 0) => Some(Cell(LEAF)),
            _ => Some(Cell(0)),
        }
    }

    #[inline(always)]
    fn part(&self, cell: Cell) -> Part {
        match cell.0 & LEAF {
            0 => Part::Inner(cell.0 as usize),
            _ => Part::Leaf((cell.0 & !LEAF) as usize),
        }
    }

    #[inline(always)]
    fn children(&self, cell: Cell, mut visit: impl FnMut(Cell)) {
        if cell.0 & LEAF == 0 {
            let (inner, leaves) = self.ranges(cell.0 as usize);
            inner.for_each(|i| visit(Cell(i)));
            leaves.for_each(|k| visit(Cell(k | LEAF)));
        }
    }

    fn below(&self, cell: Cell) -> Range<usize> {
        let Part::Inner(node) = self.part(cell) else { return 0..0 };
        let (mut children, _) = self.ranges(node);
        let (start, mut end) = (children.start, children.end);
        // The highest numbers are below the child whose own children have the highest.
        while let Some(next) = children
            .map(|i| self.ranges(i as usize).0)
            .filter(|r| !r.is_empty())
            .max_by_key(|r| r.start)
        {
            end = next.end;
            children = next;
        }
        start as usize..end as usize
    }
}

/// Builds the tree over surfels (fewer than 2^31, finite).
pub fn build(surfels: &impl SurfelSet) -> Built<Octree<'static>> {
    let mut discs = discs(surfels);
    let codes = sort(&mut discs);
    let mut tree = Growing::default();
    if discs.len() == 1 {
        tree.order.push(0);
    }
    let mut open = Vec::new();
    if discs.len() > 1 {
        tree.node(sphere(&discs, corners(&discs)));
        open.push((0, 0..discs.len()));
    }
    while let Some((node, range)) = open.pop() {
        let parent = tree.bounds[node];
        let parts = divide(&codes, range);
        tree.first[node] = [tree.bounds.len() as u32, tree.order.len() as u32];
        for part in parts.into_iter().filter(|part| !part.is_empty()) {
            if part.len() == 1 {
                tree.order.push(discs[part.start].surfel);
                tree.counts[node] += 16;
                continue;
            }
            let own = sphere(&discs[part.clone()], corners(&discs[part.clone()]));
            open.push((tree.bounds.len(), part));
            tree.node(if own.radius <= parent.radius { own } else { parent });
            tree.counts[node] += 1;
        }
    }
    tree.heavier_first();
    let topology =
        Octree { first: tree.first.into(), counts: tree.counts.into(), leaves: discs.len() as u32 };
    Built { topology, order: tree.order, bounds: tree.bounds }
}

/// Sorts discs by code and then by number, and gives the codes.
fn sort(discs: &mut Vec<Disc>) -> Vec<u64> {
    let [low, high] = corners(discs);
    let origin = low.as_dvec3();
    let side = (high.as_dvec3() - origin).max_element();
    let cells = if side > 0.0 { f64::from(1 << morton::BITS) / side } else { 0.0 };
    let mut keys: Vec<(u64, u32)> = discs
        .par_iter()
        .map(|d| {
            let at = (d.position.as_dvec3() - origin) * cells;
            (morton::code(at.to_array().map(|c| c as u32)), d.surfel)
        })
        .collect();
    keys.par_sort_unstable();
    *discs = keys.par_iter().map(|&(_, surfel)| discs[surfel as usize]).collect();
    keys.into_iter().map(|(code, _)| code).collect()
}

/// Divides a range of at least two surfels by the first level of cells that tells some of them apart; without one in equal runs.
fn divide(codes: &[u64], range: Range<usize>) -> [Range<usize>; ARITY] {
    let differ = codes[range.start] ^ codes[range.end - 1];
    let mut start = range.start;
    std::array::from_fn(|k| {
        let end = if differ == 0 {
            range.start + range.len() * (k + 1) / ARITY
        } else {
            let shift = differ.ilog2() / 3 * 3;
            start
                + codes[start..range.end].partition_point(|code| (code >> shift & 7) as usize <= k)
        };
        let part = start..end;
        start = end;
        part
    })
}

/// An octree that grows.
#[derive(Default)]
struct Growing {
    first: Vec<[u32; 2]>,
    counts: Vec<u8>,
    bounds: Vec<Bound>,
    order: Vec<u32>,
}

impl Growing {
    fn node(&mut self, bound: Bound) {
        self.first.push([0; 2]);
        self.counts.push(0);
        self.bounds.push(bound);
    }

    /// Exchanges siblings so that the one that needs the most values at once comes first (Sethi and Ullman 1970). A leaf needs one;
    /// after the first child each further one needs one more than below itself, the sum so far.
    fn heavier_first(&mut self) {
        let mut needs = vec![1u8; self.counts.len()];
        for node in (0..self.counts.len()).rev() {
            let first = self.first[node][0] as usize;
            let inner = first..first + usize::from(self.counts[node] & 15);
            // Of equals the first: `max_by_key` would give the last.
            let heaviest = inner.clone().rev().max_by_key(|&i| needs[i]);
            if let Some(heaviest) = heaviest {
                self.first.swap(first, heaviest);
                self.counts.swap(first, heaviest);
                self.bounds.swap(first, heaviest);
                needs.swap(first, heaviest);
            }
            let next = inner.clone().skip(1).map(|i| needs[i] + 1).max();
            needs[node] = inner.clone().next().map_or(1, |i| needs[i]).max(next.unwrap_or(2));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{ball, cloud};
    use super::super::super::hierarchy::Surfel;
    use super::super::tests_of_shapes::check;
    use super::*;
    use glam::Vec3;

    #[test]
    fn trees_of_all_sizes_are_whole() {
        for count in (0..40).chain([1000, 4097]) {
            let surfels = cloud(count, 10.0, 7);
            check(&build(&surfels), &surfels);
        }
        let surfels = ball(20_000, 3);
        let built = build(&surfels);
        assert!(check(&built, &surfels) < 16);
        assert!(built.bounds.len() < 12_000);
    }

    #[test]
    fn coincident_surfels_are_split_by_number() {
        let surfels = vec![Surfel { position: Vec3::splat(3.0), ..cloud(1, 1.0, 1)[0] }; 100_000];
        assert_eq!(check(&build(&surfels), &surfels), 6);
        let mut surfels = cloud(50, 1.0, 4);
        surfels.extend([surfels[7]; 20]);
        check(&build(&surfels), &surfels);
    }

    #[test]
    fn same_for_any_number_of_threads() {
        let surfels = ball(30_000, 2);
        let on = |threads| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| build(&surfels))
        };
        assert!(on(1) == on(3));
    }
}
