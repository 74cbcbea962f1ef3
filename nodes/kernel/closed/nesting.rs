//! Bounding boxes within a bounding box, found among many.

use glam::Vec3;

/// Boxes under one node of [`Nesting`].
const FAN: usize = 8;

/// A bounding box.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
}

impl Extent {
    pub(super) const NOTHING: Extent = Extent { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    fn encloses(&self, other: &Extent) -> bool {
        self.low.cmple(other.low).all() && self.high.cmpge(other.high).all()
    }
}

/// Finds boxes within a box.
pub(super) struct Nesting {
    /// The boxes, then for each [`FAN`] of a level what they have in common: the largest low and the
    /// smallest high corner, even where that is no box. A box that does not enclose it encloses none
    /// of them.
    level: Vec<Vec<Extent>>,
}

impl Nesting {
    pub(super) fn new(extent: &[Extent]) -> Self {
        let mut boxes = extent.to_vec();
        near_together(&mut boxes, 0);
        let mut level = vec![boxes];
        while let Some(last) = level.last().filter(|last| last.len() > FAN) {
            let common = |some: &[Extent]| {
                some.iter().skip(1).fold(some[0], |all, one| Extent {
                    low: all.low.max(one.low),
                    high: all.high.min(one.high),
                })
            };
            let next = last.chunks(FAN).map(common).collect();
            level.push(next);
        }
        Nesting { level }
    }

    /// Whether a second box lies within one of the boxes.
    pub(super) fn encloses_another(&self, outer: &Extent) -> bool {
        let top = self.level.len() - 1;
        // The box itself is found too.
        self.count(outer, top, 0, 2) >= 2
    }

    /// The boxes within `outer` under one group of a level, at most `enough`.
    fn count(&self, outer: &Extent, level: usize, group: usize, enough: usize) -> usize {
        let mut found = 0;
        let all = &self.level[level];
        for (at, one) in all.iter().enumerate().skip(group * FAN).take(FAN) {
            if found < enough && outer.encloses(one) {
                found += match level {
                    0 => 1,
                    _ => self.count(outer, level - 1, at, enough - found),
                };
            }
        }
        found
    }
}

/// Orders boxes so that neighbours in the order are near in space: halves by one axis after another.
fn near_together(boxes: &mut [Extent], axis: usize) {
    if boxes.len() > FAN {
        let middle = boxes.len() / 2;
        let place = |b: &Extent| b.low[axis] + b.high[axis];
        boxes.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)));
        let (below, above) = boxes.split_at_mut(middle);
        near_together(below, (axis + 1) % 3);
        near_together(above, (axis + 1) % 3);
    }
}
