//! The binary hierarchy of bounding spheres, split at the median of the longest side: every surfel is a leaf, and the shape follows
//! from the number of leaves alone, so that nothing of it is stored.
//!
//! A node is a run of leaves in the order of the tree; it splits in halves, the first one longer where the count is odd. The number of an
//! inner node is that of the last leaf of its first half, which numbers the inner nodes from 0 without gaps. A tree of n leaves is
//! ceil(log2 n) deep whatever the input, so the recursions here are at most 32 deep.

use super::super::hierarchy::{Bound, SurfelSet};
use super::disc::{Disc, corners, discs, sphere};
use super::{Built, Part, Topology};
use glam::Vec3;
use std::ops::Range;

/// The shape of a balanced binary tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binary {
    /// Number of leaves.
    pub leaves: u32,
}

/// A node of a balanced binary tree: `count` leaves from `first` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    first: u32,
    count: u32,
}

impl Run {
    #[inline(always)]
    fn left(self) -> u32 {
        self.count.div_ceil(2)
    }
}

impl Topology for Binary {
    type Node = Run;

    fn leaves(&self) -> usize {
        self.leaves as usize
    }

    fn inner(&self) -> usize {
        self.leaves.saturating_sub(1) as usize
    }

    fn root(&self) -> Option<Run> {
        (self.leaves > 0).then_some(Run { first: 0, count: self.leaves })
    }

    #[inline(always)]
    fn part(&self, run: Run) -> Part {
        match run.count {
            1 => Part::Leaf(run.first as usize),
            _ => Part::Inner((run.first + run.left() - 1) as usize),
        }
    }

    #[inline(always)]
    fn children(&self, run: Run, mut visit: impl FnMut(Run)) {
        if run.count > 1 {
            let left = run.left();
            visit(Run { first: run.first, count: left });
            visit(Run { first: run.first + left, count: run.count - left });
        }
    }

    fn below(&self, run: Run) -> Range<usize> {
        run.first as usize..(run.first + run.count - 1) as usize
    }
}

/// Below so many leaves a subtree is built by one thread.
const PIECE: usize = 1 << 14;

/// Builds the tree over surfels (fewer than 2^32, finite). Surfels at one place are told apart by their number.
pub fn build(surfels: &impl SurfelSet) -> Built<Binary> {
    let mut discs = discs(surfels);
    let mut bounds = vec![Bound::default(); discs.len().saturating_sub(1)];
    split(&mut discs, &mut bounds, Bound { center: Vec3::ZERO, radius: f32::INFINITY });
    let topology = Binary { leaves: discs.len() as u32 };
    // Collected in the memory of the discs, of which most is given back.
    let mut order: Vec<u32> = discs.into_iter().map(|d| d.surfel).collect();
    order.shrink_to_fit();
    Built { topology, order, bounds }
}

/// Sorts a run of discs into the order of the tree and writes the spheres of its nodes; none is larger than `around`,
/// the sphere of the parent.
fn split(discs: &mut [Disc], bounds: &mut [Bound], around: Bound) {
    if discs.len() < 2 {
        return;
    }
    let corners = corners(discs);
    let own = sphere(discs, corners);
    let bound = if own.radius <= around.radius { own } else { around };
    let axis = (corners[1] - corners[0]).max_position();
    let left = discs.len().div_ceil(2);
    discs.select_nth_unstable_by(left, |a, b| {
        a.position[axis].total_cmp(&b.position[axis]).then(a.surfel.cmp(&b.surfel))
    });
    let large = discs.len() > PIECE;
    let (left_discs, right_discs) = discs.split_at_mut(left);
    let (left_bounds, rest) = bounds.split_at_mut(left - 1);
    let Some((node, right_bounds)) = rest.split_first_mut() else { return };
    *node = bound;
    let mut left = || split(left_discs, left_bounds, bound);
    let mut right = || split(right_discs, right_bounds, bound);
    if large {
        rayon::join(left, right);
    } else {
        left();
        right();
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::{ball, cloud};
    use super::super::super::hierarchy::Surfel;
    use super::super::tests_of_shapes::check;
    use super::*;

    #[test]
    fn trees_of_all_sizes_are_whole() {
        for count in (0..40).chain([1000, 4097]) {
            let surfels = cloud(count, 10.0, 7);
            let built = build(&surfels);
            let depth = check(&built, &surfels);
            assert_eq!(depth, count.max(1).next_power_of_two().ilog2() as usize, "{count}");
        }
    }

    #[test]
    fn coincident_surfels_are_split_by_number() {
        let surfels = vec![Surfel { position: Vec3::splat(3.0), ..cloud(1, 1.0, 1)[0] }; 100_000];
        let built = build(&surfels);
        assert_eq!(check(&built, &surfels), 17);
        assert!(built.order.iter().copied().eq(0..100_000));
        assert!(built.bounds.iter().all(|b| b.radius == surfels[0].radius));
    }

    #[test]
    fn same_for_any_number_of_threads() {
        let surfels = ball(60_000, 2);
        let on = |threads| {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| build(&surfels))
        };
        assert!(on(1) == on(3));
    }
}
