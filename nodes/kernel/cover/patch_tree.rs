//! Patches in a tree of eights: in Morton order, eight to a leaf, eight leaves to a node, eight nodes to the next and so
//! on, so that eight boxes or eight patches are asked at once.

use super::{FLAT, Patch, SAME_SIDE};
use crate::kernel::lanes::{Lanes, Portable, Triple, WIDTH};
use crate::kernel::morton;
use glam::Vec3;

/// Patches in their tree.
pub(super) struct PatchTree {
    leaves: Vec<Leaf>,
    /// From the nodes over leaves up to the root, which is alone.
    levels: Vec<Vec<Node>>,
}

/// Eight patches. Absent ones repeat the first without its area.
#[derive(Clone, Copy)]
struct Leaf {
    position: Triple<[f32; WIDTH]>,
    normal: Triple<[f32; WIDTH]>,
    area: [f32; WIDTH],
}

/// The boxes of eight children; absent ones are not numbers, which no comparison finds near.
#[derive(Clone, Copy)]
struct Node {
    low: Triple<[f32; WIDTH]>,
    high: Triple<[f32; WIDTH]>,
}

/// A disc on a surface, in every lane.
struct Disc<L> {
    centre: Triple<L>,
    normal: Triple<L>,
    squared: L,
    thickness: L,
}

/// Levels of nodes that any list of patches can have: their numbers have 32 bits, and each level takes three.
const LEVELS: usize = 11;

impl PatchTree {
    /// Of patches with finite positions.
    pub(super) fn new(mut patches: Vec<Patch>) -> Self {
        let low = patches.iter().fold(Vec3::INFINITY, |low, patch| low.min(patch.position));
        let high = patches.iter().fold(Vec3::NEG_INFINITY, |high, patch| high.max(patch.position));
        let extent = (high.as_dvec3() - low.as_dvec3()).max_element().max(f64::MIN_POSITIVE);
        let cells = f64::from(1 << morton::BITS) / extent;
        patches.sort_by_cached_key(|patch| {
            let at = (patch.position.as_dvec3() - low.as_dvec3()) * cells;
            morton::code(at.to_array().map(|x| x as u32))
        });
        let leaves: Vec<Leaf> = patches.chunks(WIDTH).map(Leaf::new).collect();
        let boxes = |patches: &[Patch]| {
            let inner = |(low, high): (Vec3, Vec3), patch: &Patch| {
                (low.min(patch.position), high.max(patch.position))
            };
            patches.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), inner)
        };
        let mut boxes: Vec<(Vec3, Vec3)> = patches.chunks(WIDTH).map(boxes).collect();
        let mut levels = Vec::new();
        while levels.is_empty() || boxes.len() > 1 {
            levels.push(boxes.chunks(WIDTH).map(Node::new).collect());
            let union = |a: (Vec3, Vec3), b: &(Vec3, Vec3)| (a.0.min(b.0), a.1.max(b.1));
            let around =
                |boxes: &[_]| boxes.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), union);
            boxes = boxes.chunks(WIDTH).map(around).collect();
        }
        PatchTree { leaves, levels }
    }

    /// Area, m^2, of the patches on the surface around `at`, on its side, within a distance given squared.
    pub(super) fn area(&self, at: &Patch, squared: f32) -> f32 {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.area_with_avx2(at, squared) };
        }
        self.area_lanes::<Portable>(at, squared)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn area_with_avx2(&self, at: &Patch, squared: f32) -> f32 {
        self.area_lanes::<crate::kernel::lanes::Avx2>(at, squared)
    }

    #[inline(always)]
    fn area_lanes<L: Lanes>(&self, at: &Patch, squared: f32) -> f32 {
        let disc = Disc::<L> {
            centre: Triple::splat(at.position),
            normal: Triple::splat(at.normal),
            squared: L::splat(squared),
            thickness: L::splat(FLAT * squared.sqrt()),
        };
        let mut area = L::splat(0.0);
        // On the way down, of each level: the node, and which of its children are still to be visited.
        let mut path = [(0, 0); LEVELS];
        let top = self.levels.len() - 1;
        let Some(root) = self.levels[top].first() else { return 0.0 };
        path[top] = (0, disc.meets(root));
        let mut level = top;
        loop {
            let (node, met) = path[level];
            if met == 0 {
                if level == top {
                    break;
                }
                level += 1;
                continue;
            }
            path[level].1 = met & (met - 1);
            let child = node * WIDTH + met.trailing_zeros() as usize;
            if level == 0 {
                area = area + disc.area(&self.leaves[child]);
            } else {
                level -= 1;
                path[level] = (child, disc.meets(&self.levels[level][child]));
            }
        }
        area.store().into_iter().sum()
    }
}

impl<L: Lanes> Disc<L> {
    /// Which of a node's boxes come near enough.
    #[inline(always)]
    fn meets(&self, node: &Node) -> u32 {
        let zero = L::splat(0.0);
        let below = node.low.lanes::<L>().minus(self.centre);
        let above = self.centre.minus(node.high.lanes());
        // Zero first, so that what is not a number stays that.
        let x = zero.max(below.x.max(above.x));
        let y = zero.max(below.y.max(above.y));
        let z = zero.max(below.z.max(above.z));
        self.squared.ge(x * x + y * y + z * z)
    }

    /// The area of each of a leaf's patches that belongs to the disc, as [`Patch::shares`] says.
    #[inline(always)]
    fn area(&self, leaf: &Leaf) -> L {
        let apart = leaf.position.lanes().minus(self.centre);
        let counts = self.squared.ge(apart.dot(apart))
            & self.thickness.ge(apart.dot(self.normal).abs())
            & leaf.normal.lanes().dot(self.normal).gt(L::splat(SAME_SIDE));
        L::load(&leaf.area).or(counts, L::splat(0.0))
    }
}

impl Leaf {
    /// Of one to eight patches.
    fn new(patches: &[Patch]) -> Self {
        let absent = Patch { area: 0.0, ..patches[0] };
        let patches: [Patch; WIDTH] =
            std::array::from_fn(|i| patches.get(i).copied().unwrap_or(absent));
        Leaf {
            position: Triple::of(|lane| patches[lane].position),
            normal: Triple::of(|lane| patches[lane].normal),
            area: patches.map(|patch| patch.area),
        }
    }
}

impl Node {
    /// Of one to eight boxes, low corner first.
    fn new(boxes: &[(Vec3, Vec3)]) -> Self {
        let absent = (Vec3::NAN, Vec3::NAN);
        let boxes: [(Vec3, Vec3); WIDTH] =
            std::array::from_fn(|i| boxes.get(i).copied().unwrap_or(absent));
        Node { low: Triple::of(|lane| boxes[lane].0), high: Triple::of(|lane| boxes[lane].1) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::surface_sampling::uniform;

    /// Patches in a cube with a few normals, among them some at the same place.
    fn patches(count: u32) -> Vec<Patch> {
        let patch = |i| {
            let [x, y, z, _] = uniform(if i % 7 == 0 { 0 } else { i }, 3, 1);
            let normal = [Vec3::X, Vec3::Y, Vec3::new(0.6, 0.8, 0.0)][i as usize % 3];
            Patch { position: Vec3::new(x, y, z), normal, area: 1.0 + i as f32 }
        };
        (0..count).map(patch).collect()
    }

    #[test]
    fn areas_are_those_of_looking_at_every_patch() {
        let mut found = 0;
        for count in [1, 7, 8, 9, 64, 65, 700] {
            let patches = patches(count);
            let tree = PatchTree::new(patches.clone());
            for (i, at) in patches.iter().enumerate().step_by(1 + patches.len() / 50) {
                for radius in [0.0, 0.05, 0.3, 5.0] {
                    let squared = radius * radius;
                    let within = |patch: &&Patch| {
                        at.position.distance_squared(patch.position) <= squared
                            && at.shares(patch.position, patch.normal, radius)
                    };
                    let expected: f32 = patches.iter().filter(within).map(|p| p.area).sum();
                    let area = tree.area(at, squared);
                    assert!((area - expected).abs() <= 1e-5 * expected, "{count} {i} {radius}");
                    assert_eq!(area, tree.area_lanes::<Portable>(at, squared));
                    found += usize::from(expected > at.area);
                }
            }
        }
        assert!(found > 200, "{found}");
    }

    #[test]
    fn distances_beyond_all_bounds_are_no_trouble() {
        let far = |x: f32| Patch { position: Vec3::splat(x), normal: Vec3::Y, area: 2.0 };
        let tree = PatchTree::new(vec![far(-3e38), far(0.0), far(1e-30), far(3e38)]);
        assert_eq!(tree.area(&far(0.0), 1e-20), 4.0);
        assert_eq!(tree.area(&far(3e38), 0.0), 2.0);
        // Its opposite is farther away than numbers reach.
        assert_eq!(tree.area(&far(3e38), f32::INFINITY), 6.0);
        assert_eq!(tree.area(&far(f32::NAN), 1.0), 0.0);
        assert_eq!(PatchTree::new(Vec::new()).area(&far(0.0), 1.0), 0.0);
    }
}
