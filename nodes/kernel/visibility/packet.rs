//! Up to 64 rays at once that share their origin or their direction.
//!
//! Each ray keeps its own mask of boxes, so a packet visits exactly what its rays need; what they share is the work
//! per node and per triangle. Per node either every ray meets eight boxes at once or every box eight rays at once,
//! whichever is less.

use super::beam::Beam;
use super::hierarchy::{Bounds, Boxes, Grown, LEAF, Node};
use super::picked::{GROUPS, PerRay, Picked, low_bits};
use super::single::{inverse, length};
use super::stack::Stack;
use super::triangle::{Three, load, splat, splat_lane, store};
use crate::kernel::lanes::{Lanes, WIDTH, prefetch};

/// What the leaves of a hierarchy stand for. A trait and not a closure, because its method must be inlined.
pub(super) trait Leaves {
    /// Which of `rays` are blocked by what leaf `leaf` holds. Must be inlined.
    fn block<L: Lanes>(&self, leaf: u32, rays: u64) -> u64;

    /// Hints that leaf `leaf` will be met soon.
    fn prefetch(&self, leaf: u32);
}

/// Rays in some frame. If they are not `PARALLEL`, they are the segments from `origin` to `origin + vector`; if they
/// are, they start at `origin + vector` and go along `direction` without end.
pub(super) struct Packet<const PARALLEL: bool> {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
    pub(super) vector: [PerRay; 3],
    /// Per ray, what boxes' bounds are multiplied by; if parallel, what is taken from them after multiplication.
    scale: [PerRay; 3],
    /// Each vector's largest coordinate.
    pub(super) length: PerRay,
    inverse: [f32; 3],
    pub(super) beam: Option<Beam>,
    /// How far from `origin` rays start.
    pub(super) reach: f32,
    count: usize,
}

/// Where the rays of a packet end, in lengths of their vectors. A trait, so that ends that are all the same are not
/// read.
pub(super) trait RayEnds {
    /// The end of one ray, in every lane.
    fn ray<L: Lanes>(&self, ray: usize) -> L;
    /// Those of a group of rays.
    fn group<L: Lanes>(&self, group: usize) -> L;
}

/// Segments end where their vector does, parallel rays nowhere.
struct Whole<const PARALLEL: bool>;

impl<const PARALLEL: bool> RayEnds for Whole<PARALLEL> {
    #[inline(always)]
    fn ray<L: Lanes>(&self, _: usize) -> L {
        L::splat(if PARALLEL { f32::INFINITY } else { 1.0 })
    }

    #[inline(always)]
    fn group<L: Lanes>(&self, group: usize) -> L {
        self.ray(group)
    }
}

impl RayEnds for PerRay {
    #[inline(always)]
    fn ray<L: Lanes>(&self, ray: usize) -> L {
        L::splat(self[ray / WIDTH % GROUPS][ray % WIDTH])
    }

    #[inline(always)]
    fn group<L: Lanes>(&self, group: usize) -> L {
        L::load(&self[group % GROUPS])
    }
}

impl<const PARALLEL: bool> Packet<PARALLEL> {
    /// The picked rays. `direction` is used only if they are parallel.
    #[inline(always)]
    pub(super) fn new<L: Lanes>(origin: [f32; 3], direction: [f32; 3], picked: &Picked) -> Self {
        let mut vector = picked.vector;
        let groups = picked.count.div_ceil(WIDTH).min(GROUPS);
        // The last group's empty lanes repeat its first ray, so that they widen nothing.
        for axis in &mut vector {
            if let Some(group) = axis.get_mut(picked.count / WIDTH) {
                let first = group[0];
                group[picked.count % WIDTH..].fill(first);
            }
        }
        let along = splat::<L>(direction);
        let along = inverse(along, length(along));
        let mut scale = [[[0.0; WIDTH]; GROUPS]; 3];
        let mut lengths = [[0.0; WIDTH]; GROUPS];
        let mut reach = 0.0f32;
        for group in 0..groups {
            let v = Self::group::<L>(&vector, group);
            let length = length(v);
            lengths[group] = length.store();
            let s = if PARALLEL {
                for ray in lengths[group] {
                    reach = if ray.is_finite() { reach.max(ray) } else { reach };
                }
                [v[0].mul(along[0]), v[1].mul(along[1]), v[2].mul(along[2])]
            } else {
                inverse(v, length)
            };
            for k in 0..3 {
                scale[k][group] = s[k].store();
            }
        }
        let beam = if PARALLEL {
            Beam::along::<L>(direction, &vector, groups)
        } else {
            Beam::around_point::<L>(&vector, groups)
        };
        let along = store(along);
        let inverse = [along[0][0], along[1][0], along[2][0]];
        let count = picked.count;
        Self { origin, direction, vector, scale, length: lengths, inverse, beam, reach, count }
    }

    /// Every ray's bit.
    pub(super) fn all(&self) -> u64 {
        low_bits(self.count)
    }

    /// Some of the rays in another frame, given how that maps points and vectors, and where they were picked.
    #[inline(always)]
    pub(super) fn mapped<L: Lanes>(
        &self,
        mut rays: u64,
        point: impl Fn([f32; 3]) -> [f32; 3],
        vector: impl Fn([f32; 3]) -> [f32; 3],
    ) -> (Self, Picked) {
        let mut picked = Picked::new();
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            let (group, lane) = (ray / WIDTH, ray % WIDTH);
            let [x, y, z] = &self.vector;
            picked.push(vector([x[group][lane], y[group][lane], z[group][lane]]), ray);
        }
        (Self::new::<L>(point(self.origin), vector(self.direction), &picked), picked)
    }

    #[inline(always)]
    pub(super) fn ray<L: Lanes>(of: &[PerRay; 3], ray: usize) -> Three<L> {
        let (group, lane) = (ray / WIDTH % GROUPS, ray % WIDTH);
        splat([of[0][group][lane], of[1][group][lane], of[2][group][lane]])
    }

    #[inline(always)]
    pub(super) fn group<L: Lanes>(of: &[PerRay; 3], group: usize) -> Three<L> {
        let group = group % GROUPS;
        load([&of[0][group], &of[1][group], &of[2][group]])
    }

    /// Boxes as the slab test wants them: if parallel, scaled by the shared direction, near side first.
    #[inline(always)]
    fn slabs<L: Lanes>(&self, boxes: &Boxes<L>) -> (Three<L>, Three<L>) {
        if !PARALLEL {
            return (boxes.low, boxes.high);
        }
        let (mut low, mut high) = (boxes.low, boxes.high);
        for k in 0..3 {
            let inverse = L::splat(self.inverse[k]);
            let (a, b) = (low[k].mul(inverse), high[k].mul(inverse));
            low[k] = a.min(b);
            high[k] = a.max(b);
        }
        (low, high)
    }

    /// Which lanes' rays pass through which lanes' boxes before they end.
    #[inline(always)]
    fn pass<L: Lanes>(low: Three<L>, high: Three<L>, scale: Three<L>, end: L) -> u32 {
        let (mut enter, mut leave) = (L::splat(0.0), end);
        for k in 0..3 {
            if PARALLEL {
                enter = low[k].sub(scale[k]).max(enter);
                leave = high[k].sub(scale[k]).min(leave);
            } else {
                let (a, b) = (low[k].mul(scale[k]), high[k].mul(scale[k]));
                enter = a.min(b).max(enter);
                leave = a.max(b).min(leave);
            }
        }
        leave.ge(enter)
    }

    /// Sorts children by this: how far from the shared point they begin, squared; if parallel, how far along the
    /// shared direction.
    #[inline(always)]
    pub(super) fn nearness<L: Lanes>(&self, boxes: &Boxes<L>) -> [f32; WIDTH] {
        let zero = L::splat(0.0);
        let mut far = zero;
        if PARALLEL {
            let (low, _) = self.slabs(boxes);
            return low[0].max(low[1]).max(low[2]).max(zero).store();
        }
        for k in 0..3 {
            let outside = boxes.low[k].max(zero.sub(boxes.high[k])).max(zero);
            far = far.add(outside.mul(outside));
        }
        far.store()
    }

    /// Walks a hierarchy from `root` with the rays of `active`, and gives which of them are blocked. All boxes lie
    /// within `bounds`.
    #[inline(always)]
    pub(super) fn walk<L: Lanes>(
        &self,
        (nodes, root, bounds): (&[Node], u32, &Bounds),
        active: u64,
        leaves: &impl Leaves,
    ) -> u64 {
        if nodes.is_empty() && root & LEAF == 0 || active == 0 {
            return 0;
        }
        let origin = Grown::<L>::new(self.origin, self.reach, bounds);
        let mut live = active;
        let mut stack = Stack::<(u32, u64)>::new((root, active));
        while let Some((reference, rays)) = stack.pop() {
            let rays = rays & live;
            if rays == 0 {
                continue;
            }
            if reference & LEAF != 0 {
                live &= !leaves.block::<L>(reference ^ LEAF, rays);
                if live == 0 {
                    break;
                }
                continue;
            }
            let node = &nodes[reference as usize];
            let boxes = node.boxes(&origin);
            let met = match &self.beam {
                Some(beam) => beam.meets(&boxes),
                None => boxes.present,
            };
            if met == 0 {
                continue;
            }
            let through = self.sort_rays(&boxes, met, rays, &Whole::<PARALLEL>);
            let (order, count) = farthest_first(self.nearness(&boxes), node, met, &through);
            for &(_, child) in &order[..count] {
                if child.0 & LEAF != 0 {
                    leaves.prefetch(child.0 ^ LEAF);
                } else if let Some(node) = nodes.get(child.0 as usize) {
                    prefetch(node);
                }
                stack.push(child);
            }
        }
        active & !live
    }

    /// For each box of `met`, the rays that pass through it.
    #[inline(always)]
    pub(super) fn sort_rays<L: Lanes>(
        &self,
        boxes: &Boxes<L>,
        met: u32,
        rays: u64,
        ends: &impl RayEnds,
    ) -> [u64; WIDTH] {
        let mut through = [0; WIDTH];
        let (low, high) = self.slabs(boxes);
        let groups = groups(rays);
        if rays.count_ones() <= met.count_ones() * groups.count_ones() {
            let mut left = rays;
            while left != 0 {
                let ray = left.trailing_zeros() as usize;
                left &= left - 1;
                let scale = Self::ray::<L>(&self.scale, ray);
                let mut passed = met & Self::pass(low, high, scale, ends.ray(ray));
                while passed != 0 {
                    through[passed.trailing_zeros() as usize % WIDTH] |= 1 << ray;
                    passed &= passed - 1;
                }
            }
            return through;
        }
        let (low, high) = (store(low), store(high));
        let mut left = met;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let (near, far) = (splat_lane(&low, lane), splat_lane(&high, lane));
            let mut groups = groups;
            while groups != 0 {
                let group = groups.trailing_zeros() as usize;
                groups &= groups - 1;
                let scale = Self::group::<L>(&self.scale, group);
                let passed = Self::pass(near, far, scale, ends.group(group));
                through[lane] |= u64::from(passed) << (group * WIDTH);
            }
            through[lane] &= rays;
        }
        through
    }
}

/// A child to visit: how near it is, where it is, and the rays that pass through its box.
pub(super) type Child = (f32, (u32, u64));

/// The children of `met` that any ray passes through, farthest first, and how many they are.
#[inline(always)]
pub(super) fn farthest_first(
    nearness: [f32; WIDTH],
    node: &Node,
    mut met: u32,
    through: &[u64; WIDTH],
) -> ([Child; WIDTH], usize) {
    // Insertion among at most eight.
    let mut order = [(0.0, (0, 0)); WIDTH];
    let mut count = 0;
    while met != 0 {
        let lane = met.trailing_zeros() as usize % WIDTH;
        met &= met - 1;
        if through[lane] == 0 {
            continue;
        }
        let mut at = count;
        while at > 0 && order[at - 1].0 < nearness[lane] {
            order[at] = order[at - 1];
            at -= 1;
        }
        order[at] = (nearness[lane], (node.child[lane], through[lane]));
        count += 1;
    }
    (order, count)
}

/// Bit g is set where any of rays 8g to 8g + 7 is.
#[inline(always)]
pub(super) fn groups(rays: u64) -> u32 {
    // Gathers each byte's bits in its lowest, then those in the highest byte.
    let mut any = rays | rays >> 4;
    any |= any >> 2;
    any |= any >> 1;
    ((any & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_the_bytes_with_any_bit() {
        for rays in [0, 1, u64::MAX, 0x8000_0000_0000_0000, 0x0040_0000_0200_8000, 1 << 17] {
            let expected =
                (0..GROUPS).filter(|g| rays >> (8 * g) & 0xff != 0).fold(0, |m, g| m | 1 << g);
            assert_eq!(groups(rays), expected, "{rays:x}");
        }
    }
}
