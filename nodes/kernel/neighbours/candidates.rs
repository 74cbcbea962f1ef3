//! The part of an image that can hold the nearest neighbours of a tile of queries.
//!
//! Boxes of many pixels say little in nine dimensions: most of a search goes to proving, from the root down, that nobody far
//! away is near. Queries of one tile share that proof. What is within the largest of their distances of the box around them is
//! found once, and each query then looks at that only.

use super::lanes::{Bounds, DIMENSIONS, Node, WIDE, near};
use super::pyramid::{Pyramid, Search};

/// Nodes beyond which every query searches for itself: the tile's pixels then have little in common.
const MOST: usize = 8 * WIDE;

/// The smallest nodes near a tile, by eights.
#[derive(Default)]
pub(super) struct Candidates {
    bounds: Vec<Bounds>,
    /// Column and row of each.
    at: Vec<[u32; 2]>,
    groups: Vec<Node>,
}

impl Candidates {
    /// Finds what may hold pixels within the squared distance `bound` of any of `queries`; false if that is too much to be
    /// worth a list, or the image too small.
    #[inline(always)]
    pub(super) fn gather<'a>(
        &mut self,
        pyramid: &Pyramid,
        queries: impl Iterator<Item = &'a [f32; DIMENSIONS]>,
        bound: f32,
    ) -> bool {
        self.bounds.clear();
        self.at.clear();
        self.groups.clear();
        let levels = &pyramid.levels;
        if levels.len() < 2 {
            return false;
        }
        let tile = queries
            .fold(Bounds::EMPTY, |all, point| all.union(&Bounds { low: *point, high: *point }));
        let mut waiting = vec![(levels.len() - 1, 0, 0)];
        while let Some((level, column, row)) = waiting.pop() {
            let node = pyramid.node(level, column, row);
            for lane in near(&node.distances_to(&tile), bound) {
                let [x, y] = levels[level].fan.child(column, row, lane);
                if level > 1 {
                    waiting.push((level - 1, x, y));
                    continue;
                }
                if self.at.len() == MOST {
                    return false;
                }
                self.at.push([x, y]);
                self.bounds.push(node.child(lane));
            }
        }
        let group = |bounds: &[Bounds]| Node::new(|lane| bounds.get(lane));
        self.groups.extend(self.bounds.chunks(WIDE).map(group));
        true
    }

    /// Offers a search what is near enough among the candidates.
    #[inline(always)]
    pub(super) fn visit(&self, pyramid: &Pyramid, search: &mut Search) {
        for (group, at) in self.groups.iter().zip(self.at.chunks(WIDE)) {
            for lane in near(&group.distances(&search.vector), search.distance) {
                let [column, row] = at[lane];
                let fan = pyramid.levels[0].fan;
                let leaves = pyramid.node(0, column, row).distances(&search.vector);
                for lane in near(&leaves, search.distance) {
                    // A leaf found meanwhile may have brought the nearest closer.
                    if leaves[lane] <= search.distance {
                        let [x, y] = fan.child(column, row, lane);
                        pyramid.visit_leaf(x, y, search);
                    }
                }
            }
        }
    }
}
