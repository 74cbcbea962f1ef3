//! A tree of boxes around entries along their principal axes, to find the nearest without comparing with all.

use super::best::Best;
use super::lanes::{Eight, GROUP, Lanes, WIDTH};

/// Most nodes that wait to be visited: seven of each level and the root, for as many entries as 32 bits number.
const WAITING: usize = 80;
/// A search ends when it has compared with so many groups: the axes say too little.
const PATIENCE: u32 = 64;

/// Eight boxes, or eight points.
type Corner = [Eight; WIDTH];

/// The tree. Nodes are numbered from the leaves up, the root last.
pub struct Boxes {
    /// The entries by position in the tree.
    order: Vec<u32>,
    /// The position of each entry.
    place: Vec<u32>,
    /// Their numbers along the axes.
    leaves: Vec<Corner>,
    inner: Vec<Inner>,
}

/// Eight nodes seen from above.
struct Inner {
    first: u32,
    low: Corner,
    high: Corner,
}

impl Boxes {
    /// The tree of these entries along the axes, at least one.
    pub fn new(points: &[Eight]) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        split(points, &mut order);
        let far = [Eight([f32::INFINITY; WIDTH]); WIDTH];
        let mut leaves = vec![far; order.len().div_ceil(WIDTH)];
        for (at, &c) in order.iter().enumerate() {
            put(&mut leaves[at / WIDTH], at % WIDTH, points[c as usize]);
        }
        let mut level: Vec<Span> = order.chunks(WIDTH).map(|eight| span(points, eight)).collect();
        let mut inner: Vec<Inner> = Vec::new();
        let mut first = 0;
        while level.len() > 1 {
            for boxes in level.chunks(WIDTH) {
                let mut node = Inner { first, low: far, high: far };
                for (lane, &(low, high)) in boxes.iter().enumerate() {
                    put(&mut node.low, lane, low);
                    put(&mut node.high, lane, high);
                }
                inner.push(node);
                first += boxes.len() as u32;
            }
            level = level.chunks(WIDTH).map(|boxes| around(boxes.iter().copied())).collect();
        }
        let mut place = vec![0; order.len()];
        order.iter().zip(0..).for_each(|(&entry, at)| place[entry as usize] = at);
        Boxes { order, place, leaves, inner }
    }

    /// An entry near to another one; that one itself if there is no other.
    pub fn beside(&self, entry: u32) -> u32 {
        let at = self.place[entry as usize] as usize;
        self.order[if at + 1 < self.order.len() { at + 1 } else { at.saturating_sub(1) }]
    }

    /// Improves `best` to the nearest; false if it gave up.
    #[inline(always)]
    pub fn search<L: Lanes>(&self, best: &mut Best) -> bool {
        let mut waiting = [(0.0f32, 0u32); WAITING];
        waiting[0].1 = (self.leaves.len() + self.inner.len() - 1) as u32;
        let mut count = 1;
        let mut left = PATIENCE;
        while count > 0 {
            count -= 1;
            let (least, node) = waiting[count];
            if least > best.most {
                continue;
            }
            let Some(leaf) = self.leaves.get(node as usize) else {
                let node = &self.inner[node as usize - self.leaves.len()];
                let (mut inside, sums) = within::<L>(best, &node.low, &node.high);
                let others = count;
                while inside != 0 {
                    let lane = inside.trailing_zeros();
                    inside &= inside - 1;
                    // The nearest is to be visited first.
                    let next = (sums[lane as usize], node.first + lane);
                    let mut at = count;
                    while at > others && waiting[at - 1].0 < next.0 {
                        waiting[at] = waiting[at - 1];
                        at -= 1;
                    }
                    waiting[at] = next;
                    count += 1;
                }
                continue;
            };
            let (mut inside, _) = within::<L>(best, leaf, leaf);
            while inside != 0 {
                let mut entries = [best.entry; GROUP];
                for entry in &mut entries {
                    if inside != 0 {
                        let at = node as usize * WIDTH + inside.trailing_zeros() as usize;
                        *entry = self.order[at];
                        inside &= inside - 1;
                    }
                }
                best.compare::<L>(&entries);
                if left == 0 {
                    return false;
                }
                left -= 1;
            }
        }
        true
    }
}

/// Which of eight boxes may hold something nearer than `best`, and their squared distances.
#[inline(always)]
fn within<L: Lanes>(best: &Best, low: &Corner, high: &Corner) -> (u32, [f32; WIDTH]) {
    let mut sum = L::splat(0.0);
    for ((low, high), x) in low.iter().zip(high).zip(best.point.0) {
        let x = L::splat(x);
        let d = L::load(low).sub(x).max(x.sub(L::load(high))).max(L::splat(0.0));
        sum = sum.add(d.mul(d));
    }
    (!L::splat(best.most).less(sum) & 0xff, sum.store())
}

/// The lowest and the highest corner.
type Span = (Eight, Eight);

/// Orders entries so that those of each node of the tree are near each other.
fn split(points: &[Eight], order: &mut [u32]) {
    if order.len() <= WIDTH {
        return;
    }
    let (low, high) = span(points, order);
    let spread = |&axis: &usize| high.0[axis] - low.0[axis];
    let axis = (0..WIDTH).max_by(|a, b| spread(a).total_cmp(&spread(b))).unwrap_or(0);
    // A power of two, so that nodes of eight end where splits are.
    let middle = order.len().next_power_of_two() / 2;
    let number = |c: u32| points[c as usize].0[axis];
    order.select_nth_unstable_by(middle, |&a, &b| number(a).total_cmp(&number(b)));
    let (left, right) = order.split_at_mut(middle);
    split(points, left);
    split(points, right);
}

/// The box around some of the points.
fn span(points: &[Eight], some: &[u32]) -> Span {
    around(some.iter().map(|&c| (points[c as usize], points[c as usize])))
}

/// The box around boxes.
fn around(boxes: impl Iterator<Item = Span>) -> Span {
    let none = (Eight([f32::INFINITY; WIDTH]), Eight([f32::NEG_INFINITY; WIDTH]));
    boxes.fold(none, |(low, high), (l, h)| {
        (
            Eight(std::array::from_fn(|i| low.0[i].min(l.0[i]))),
            Eight(std::array::from_fn(|i| high.0[i].max(h.0[i]))),
        )
    })
}

fn put(corner: &mut Corner, lane: usize, point: Eight) {
    corner.iter_mut().zip(point.0).for_each(|(corner, x)| corner.0[lane] = x);
}

#[cfg(test)]
mod tests {
    use super::super::centres::Centres;
    use super::super::fixtures::{flat, noise};
    use super::super::lanes::{Portable, squared};
    use super::super::principal::{Principal, Projected};
    use super::*;

    /// What a search over `entries` finds from each of some starts, and whether it did not give up.
    fn search(entries: &[f32], vector: &[f32], starts: &[u32]) -> Vec<(u32, bool)> {
        let (dims, lanes) = (vector.len(), vector.len().div_ceil(WIDTH));
        let centres = Centres::new(entries, dims, 1.0);
        let projected = Projected::new(Principal::new(&centres.padded, dims), &centres);
        let boxes = Boxes::new(&projected.points);
        let mut every = boxes.order.clone();
        every.sort_unstable();
        assert!(every.into_iter().eq(0..centres.count as u32));
        let x = super::super::lanes::padded(vector, dims, 1.0);
        let from = |&start: &u32| {
            let [square, ..] = squared::<Portable>(&x, [centres.get(start, lanes); GROUP]);
            let mut best = Best::new::<Portable>(&centres, &projected, &x, (start, square));
            let done = boxes.search::<Portable>(&mut best);
            (best.entry, done)
        };
        starts.iter().map(from).collect()
    }

    #[test]
    fn the_nearest_is_found_from_any_start() {
        for count in [1, 7, 8, 9, 64, 65, 500, 4097] {
            let entries = flat(count, 36, 3);
            for far in [0.0, 0.1, 30.0] {
                let vector: Vec<f32> =
                    entries[..36].iter().zip(noise(36, 9)).map(|(x, n)| x + far * n).collect();
                let square = |c: &[f32]| -> f64 {
                    c.iter().zip(&vector).map(|(a, b)| f64::from(a - b).powi(2)).sum()
                };
                let nearest = (0..)
                    .zip(entries.chunks_exact(36))
                    .min_by(|a, b| square(a.1).total_cmp(&square(b.1)))
                    .unwrap()
                    .0;
                for found in search(&entries, &vector, &[0, count as u32 / 2, count as u32 - 1]) {
                    assert_eq!(found.0, nearest);
                    assert!(found.1 || far > 1.0);
                }
            }
        }
    }

    #[test]
    fn one_bright_entry_does_not_blunt_the_boxes() {
        let mut entries = flat(4097, 36, 3);
        entries[36 * 40..36 * 41].iter_mut().for_each(|x| *x = *x * 1e8 + 1e8);
        for vector in flat(50, 36, 4).chunks_exact(36) {
            assert!(search(&entries, vector, &[5])[0].1);
        }
    }

    #[test]
    fn it_gives_up_where_seven_axes_say_little() {
        assert!(!search(&noise(5000 * 64, 1), &noise(64, 2), &[5])[0].1);
        // All are as far off the axes as from the mean.
        assert!(search(&noise(5000 * 64, 1), &[0.5; 64], &[5])[0].1);
    }
}
