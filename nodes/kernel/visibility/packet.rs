//! Up to 64 rays at once that share their origin or their direction.
//!
//! Each ray keeps its own mask of boxes, so a packet visits exactly what its rays need; what they share is the work
//! per node and per triangle. Per node either every ray meets eight boxes at once or every box eight rays at once,
//! whichever is less.

use super::beam::Beam;
use super::hierarchy::{Bounds, Boxes, Grown, LEAF, Node};
use super::picked::{GROUPS, PerRay, Picked, Source, groups, low_bits};
use super::single::{inverse, length};
use super::stack::Stack;
use super::triangle::{Three, load, splat, splat_lane, store};
use super::world::ToObject;
use crate::kernel::lanes::{Lanes, WIDTH, prefetch};

/// What the leaves of a hierarchy stand for. A trait and not a closure, because its method must be inlined.
pub(super) trait Leaves {
    /// Which of `rays` are blocked by what leaf `leaf` holds. Must be inlined.
    fn block<L: Lanes>(&self, leaf: u32, rays: u64) -> u64;

    /// Hints that leaf `leaf` will be met soon.
    fn prefetch(&self, leaf: u32);
}

/// Rays in some frame. If they are not `PARALLEL`, they are the segments from `origin` to `origin` plus the vector picked;
/// if they are, they start there and go along `direction` without end.
pub(super) struct Packet<const PARALLEL: bool> {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
    pub(super) picked: Picked,
    /// Per ray, what boxes' bounds are multiplied by; if parallel, what is taken from them after multiplication.
    scale: [PerRay; 3],
    /// Each vector's largest coordinate.
    pub(super) length: PerRay,
    inverse: [f32; 3],
    pub(super) beam: Option<Beam>,
    /// How far from `origin` rays start.
    pub(super) reach: f32,
}

/// Rays in another frame.
pub(super) struct Turned<'a> {
    pub(super) picked: &'a Picked,
    pub(super) to: &'a ToObject,
}

impl Source for Turned<'_> {
    #[inline(always)]
    fn vectors<L: Lanes>(&self, group: usize) -> Three<L> {
        self.to.vectors(self.picked.vectors::<L>(group))
    }
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
    /// No rays yet. `direction` is used only if they are parallel.
    #[inline(always)]
    pub(super) fn empty(origin: [f32; 3], direction: [f32; 3]) -> Self {
        let zeros = [[0.0; WIDTH]; GROUPS];
        Self {
            origin,
            direction,
            picked: Picked::none(),
            scale: [zeros; 3],
            length: zeros,
            inverse: [0.0; 3],
            beam: None,
            reach: 0.0,
        }
    }

    /// Picks those of `rays`, whose vectors `source` has; for a packet that is empty. It is filled in place because what
    /// a function gives back is copied, two kilobytes here.
    #[inline(always)]
    pub(super) fn pick<L: Lanes>(&mut self, rays: u64, source: &impl Source) {
        self.picked.pick::<L>(rays, source);
        let groups = self.picked.count().div_ceil(WIDTH).min(GROUPS);
        let along = splat::<L>(self.direction);
        let along = inverse(along, length(along));
        let (zero, finite) = (L::splat(0.0), L::splat(f32::MAX));
        let mut reach = zero;
        for group in 0..groups {
            let v = self.picked.vectors::<L>(group);
            let length = length(v);
            self.length[group] = length.store();
            let scale = if PARALLEL {
                reach = length.or(finite.ge(length), zero).max(reach);
                [v[0].mul(along[0]), v[1].mul(along[1]), v[2].mul(along[2])]
            } else {
                inverse(v, length)
            };
            for (numbers, scale) in self.scale.iter_mut().zip(scale) {
                numbers[group] = scale.store();
            }
        }
        self.beam = if PARALLEL {
            Beam::along::<L>(self.direction, &self.picked.vector, groups)
        } else {
            Beam::around_point::<L>(&self.picked.vector, groups)
        };
        self.reach = reach.greatest();
        let along = store(along);
        self.inverse = [along[0][0], along[1][0], along[2][0]];
    }

    /// Every ray's bit.
    pub(super) fn all(&self) -> u64 {
        low_bits(self.picked.count())
    }

    /// No rays yet, in another frame.
    #[inline(always)]
    pub(super) fn turned(&self, to: &ToObject) -> Self {
        Self::empty(to.point(self.origin), to.vector(self.direction))
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
