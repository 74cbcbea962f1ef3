//! The region of space that a packet's rays fill, to discard what none of them can meet.

use super::hierarchy::{Boxes, SLACK};
use super::picked::PerRay;
use super::triangle::Three;
use crate::kernel::lanes::Lanes;

/// Rays that all go the same way along one axis: at depth z along it, another coordinate lies between
/// `low.0 + low.1 z` and `high.0 + high.1 z`. Relative to the rays' shared point.
#[derive(Clone, Copy)]
pub(super) struct Beam {
    axis: usize,
    /// The rays go towards smaller coordinates: z is minus the coordinate.
    backwards: bool,
    first: f32,
    last: f32,
    sides: [Side; 2],
}

#[derive(Clone, Copy)]
struct Side {
    axis: usize,
    low: (f32, f32),
    high: (f32, f32),
}

/// The least and the greatest of some numbers, lane by lane; NaN is passed over.
#[derive(Clone, Copy)]
struct Range<L>(L, L);

impl<L: Lanes> Range<L> {
    #[inline(always)]
    fn new() -> Self {
        Self(L::splat(f32::INFINITY), L::splat(f32::NEG_INFINITY))
    }

    #[inline(always)]
    fn widen(&mut self, value: L) {
        self.0 = value.min(self.0);
        self.1 = value.max(self.1);
    }

    /// Over all lanes.
    #[inline(always)]
    fn ends(self) -> (f32, f32) {
        (self.0.least(), self.1.greatest())
    }
}

/// The index of the largest; of equal ones the first.
#[inline(always)]
fn largest(values: [f32; 3]) -> usize {
    let last = if values[2] > values[1] { 2 } else { 1 };
    if values[last] > values[0] { last } else { 0 }
}

/// A line's value at depth z.
#[inline(always)]
fn at<L: Lanes>((start, slope): (f32, f32), z: L) -> L {
    L::splat(start).add(L::splat(slope).mul(z))
}

impl Beam {
    /// Of rays that start at the shared point and have these directions, in the first `groups`; `None` if they go all
    /// ways.
    #[inline(always)]
    pub(super) fn around_point<L: Lanes>(directions: &[PerRay; 3], groups: usize) -> Option<Self> {
        let mut pace = [Range::<L>::new(); 3];
        for (pace, axis) in pace.iter_mut().zip(directions) {
            for group in axis.iter().take(groups) {
                pace.widen(L::load(group));
            }
        }
        let pace = [pace[0].ends(), pace[1].ends(), pace[2].ends()];
        // The axis along which the slowest ray goes farthest.
        let slowest =
            [pace[0].0.max(-pace[0].1), pace[1].0.max(-pace[1].1), pace[2].0.max(-pace[2].1)];
        let axis = largest(slowest);
        if slowest[axis].is_nan() || slowest[axis] <= f32::MIN_POSITIVE {
            return None;
        }
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut slopes = [Range::<L>::new(); 2];
        let all = directions[axis].iter().zip(&directions[i]).zip(&directions[j]);
        for ((z, x), y) in all.take(groups) {
            let along = L::load(z).abs();
            slopes[0].widen(L::load(x).div(along));
            slopes[1].widen(L::load(y).div(along));
        }
        let [a, b] = [slopes[0].ends(), slopes[1].ends()];
        Self {
            axis,
            backwards: pace[axis].0 < 0.0,
            first: 0.0,
            last: pace[axis].1.max(-pace[axis].0),
            sides: [
                Side { axis: i, low: (0.0, a.0), high: (0.0, a.1) },
                Side { axis: j, low: (0.0, b.0), high: (0.0, b.1) },
            ],
        }
        .if_finite()
    }

    /// Of rays that go along `direction` and start at these points relative to the shared one.
    #[inline(always)]
    pub(super) fn along<L: Lanes>(
        direction: [f32; 3],
        starts: &[PerRay; 3],
        groups: usize,
    ) -> Option<Self> {
        let axis = largest(direction.map(f32::abs));
        let backwards = direction[axis] < 0.0;
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let pace = direction[axis].abs();
        let slopes = [direction[i] / pace, direction[j] / pace];
        let mut depth = Range::<L>::new();
        let mut sides = [Range::<L>::new(); 2];
        let sign = L::splat(direction[axis]);
        let all = starts[axis].iter().zip(&starts[i]).zip(&starts[j]);
        for ((z, x), y) in all.take(groups) {
            let z = L::load(z).flip(sign);
            depth.widen(z);
            sides[0].widen(L::load(x).sub(L::splat(slopes[0]).mul(z)));
            sides[1].widen(L::load(y).sub(L::splat(slopes[1]).mul(z)));
        }
        let [a, b] = [sides[0].ends(), sides[1].ends()];
        Self {
            axis,
            backwards,
            first: depth.ends().0,
            last: f32::MAX,
            sides: [
                Side { axis: i, low: (a.0, slopes[0]), high: (a.1, slopes[0]) },
                Side { axis: j, low: (b.0, slopes[1]), high: (b.1, slopes[1]) },
            ],
        }
        .if_finite()
    }

    /// The same rays, the farthest of which reaches `end` lengths of its vector.
    #[inline(always)]
    pub(super) fn reaching(self, end: f32) -> Self {
        Self { last: (self.last * end).min(f32::MAX), ..self }
    }

    #[inline(always)]
    fn if_finite(self) -> Option<Self> {
        let [a, b] = &self.sides;
        // Finite only if every term is; rays so far that the sum overflows do without a beam.
        let sum = |s: &Side| s.low.0.abs() + s.low.1.abs() + s.high.0.abs() + s.high.1.abs();
        (sum(a) + sum(b) + self.first.abs() + self.last.abs() / 2.0).is_finite().then_some(self)
    }

    /// Which boxes the beam may meet.
    #[inline(always)]
    pub(super) fn meets<L: Lanes>(&self, boxes: &Boxes<L>) -> u32 {
        let zero = L::splat(0.0);
        let (low, high) = (boxes.low[self.axis], boxes.high[self.axis]);
        let (near, far) =
            if self.backwards { (zero.sub(high), zero.sub(low)) } else { (low, high) };
        let (first, last) = (L::splat(self.first), L::splat(self.last));
        let mut room = far.sub(first).min(last.sub(near));
        let (near, far) = (near.max(first), far.min(last));
        for side in &self.sides {
            let least = at(side.low, if side.low.1 >= 0.0 { near } else { far });
            let most = at(side.high, if side.high.1 < 0.0 { near } else { far });
            room = room.min(boxes.high[side.axis].sub(least));
            room = room.min(most.sub(boxes.low[side.axis]));
        }
        room.ge(zero) & boxes.present
    }

    /// Which triangles, by their corners, the beam may meet; `extra` as for boxes.
    #[inline(always)]
    pub(super) fn meets_triangles<L: Lanes>(&self, corners: &[Three<L>; 3], extra: L) -> u32 {
        let zero = L::splat(0.0);
        let mut reach = zero;
        for corner in corners {
            for x in corner {
                reach = reach.max(*x).max(zero.sub(*x));
            }
        }
        let slack = reach.mul(L::splat(SLACK)).add(extra);
        // For each bounding plane, how far the innermost corner is inside it.
        let mut inner = [L::splat(f32::NEG_INFINITY); 6];
        for corner in corners {
            let x = corner[self.axis];
            let z = if self.backwards { zero.sub(x) } else { x };
            let [s, t] = &self.sides;
            let inside = [
                z.sub(L::splat(self.first)),
                L::splat(self.last).sub(z),
                corner[s.axis].sub(at(s.low, z)),
                at(s.high, z).sub(corner[s.axis]),
                corner[t.axis].sub(at(t.low, z)),
                at(t.high, z).sub(corner[t.axis]),
            ];
            for i in 0..6 {
                inner[i] = inner[i].max(inside[i]);
            }
        }
        let [a, b, c, d, e, f] = inner;
        a.min(b).min(c).min(d).min(e).min(f).add(slack).ge(zero)
    }
}
