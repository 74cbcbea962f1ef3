//! Which rays of a packet a leaf's triangles block.

use super::hierarchy::{Leaf, extra_slack};
use super::packet::Packet;
use super::picked::{GROUPS, Source, groups};
use super::triangle::{Planes, Three, barycentric, corners, splat, store};
use crate::kernel::lanes::{Lanes, WIDTH};

/// The leaf that blocked most of the rays of a query: what blocks one bundle often blocks the next. It changes how fast
/// answers are found, and not what they are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Blocker {
    pub(super) instance: u32,
    pub(super) leaf: u32,
    /// How many it blocked; of none, nothing is known.
    pub(super) rays: u32,
}

impl<const PARALLEL: bool> Packet<PARALLEL> {
    /// Which of `rays` are blocked by a leaf's triangles. A hit of a masked triangle counts only if
    /// `keep(local triangle, u, v)`.
    #[inline(always)]
    pub(super) fn leaf<L: Lanes>(
        &self,
        leaf: &Leaf,
        rays: u64,
        keep: &impl Fn(u32, f32, f32) -> bool,
    ) -> u64 {
        let corners = corners::<L>(leaf, splat(self.origin));
        let met = match &self.beam {
            Some(beam) => beam.meets_triangles(&corners, L::splat(extra_slack(self.reach))),
            None => u32::MAX,
        };
        if met == 0 {
            return 0;
        }
        let planes = if PARALLEL {
            Planes::along(leaf, corners, splat(self.direction))
        } else {
            Planes::around_point(leaf, corners)
        };
        let met = met & planes.usable;
        let groups = groups(rays);
        let mut blocked = 0;
        if rays.count_ones() <= met.count_ones() * groups.count_ones() {
            let mut left = rays;
            while left != 0 {
                let ray = left.trailing_zeros() as usize;
                left &= left - 1;
                let x = Self::ray::<L>(&self.picked.vector, ray);
                let length = L::splat(self.length[ray / WIDTH % GROUPS][ray % WIDTH]);
                let hit = met & planes.passed::<PARALLEL>(x, length);
                if hit & !leaf.masked != 0
                    || hit != 0 && any_kept::<L, PARALLEL>(leaf, &planes, x, hit, keep)
                {
                    blocked |= 1 << ray;
                }
            }
            return blocked;
        }
        let stored = planes.store();
        let mut left = met;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let plane = Planes::<L>::only(&stored, lane);
            let mut groups = groups;
            while groups != 0 {
                let group = groups.trailing_zeros() as usize;
                groups &= groups - 1;
                let length = L::load(&self.length[group % GROUPS]);
                let x = self.picked.vectors::<L>(group);
                let passed = plane.passed::<PARALLEL>(x, length);
                let mut hit = u64::from(passed) << (group * WIDTH) & rays & !blocked;
                if leaf.masked >> lane & 1 == 0 {
                    blocked |= hit;
                    continue;
                }
                while hit != 0 {
                    let ray = hit.trailing_zeros() as usize;
                    hit &= hit - 1;
                    let x = Self::ray::<L>(&self.picked.vector, ray);
                    if any_kept::<L, PARALLEL>(leaf, &planes, x, 1 << lane, keep) {
                        blocked |= 1 << ray;
                    }
                }
            }
            if blocked == rays {
                break;
            }
        }
        blocked
    }
}

/// Whether the filter keeps any of a ray's hits on masked triangles.
#[inline(always)]
fn any_kept<L: Lanes, const PARALLEL: bool>(
    leaf: &Leaf,
    planes: &Planes<L>,
    x: Three<L>,
    mut hit: u32,
    keep: &impl Fn(u32, f32, f32) -> bool,
) -> bool {
    let weights = store(planes.weights::<PARALLEL>(x));
    while hit != 0 {
        let lane = hit.trailing_zeros() as usize % WIDTH;
        hit &= hit - 1;
        let (u, v) = barycentric(weights.map(|w| w[lane]));
        if keep(leaf.index[lane], u, v) {
            return true;
        }
    }
    false
}
