//! How a world answers queries.

use super::blocking::Blocker;
use super::hierarchy::Leaf;
use super::packet::{self, Packet, Turned};
use super::picked::{GROUPS, Source};
use super::single::{self, Ray, Sink};
use super::triangle::{Three, load, splat, sub};
use super::world::{Placed, World};
use super::{Ends, Filter, Hit};
use crate::kernel::lanes::{Lanes, Portable, WIDTH, prefetch};
use glam::Vec3;
use std::cell::Cell;

/// A query, written once for every instruction set.
pub(super) trait Query {
    /// What it gives.
    type Answer;
    /// Must be inlined, lest it be compiled without the instructions that `L` stands for.
    fn answer<L: Lanes>(self) -> Self::Answer;
}

/// Answers with the best instructions that the processor has.
#[inline]
pub(super) fn dispatch<Q: Query>(query: Q) -> Q::Answer {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("popcnt")
    {
        // SAFETY: the processor has just been found to have every feature that the function is compiled for.
        return unsafe { with_avx2(query) };
    }
    query.answer::<Portable>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,popcnt")]
fn with_avx2<Q: Query>(query: Q) -> Q::Answer {
    query.answer::<crate::kernel::lanes::Avx2>()
}

/// The leaves of the upper hierarchy to a single ray.
struct Instances<'a, S> {
    world: &'a World,
    ray: Ray,
    filter: &'a Filter<'a>,
    sink: S,
}

impl<S: Sink> Instances<'_, S> {
    #[inline(always)]
    fn trace<L: Lanes>(mut self) -> S {
        let (world, ray) = (self.world, self.ray);
        let tree = (&*world.nodes, world.root, &world.bounds);
        single::walk::<L>(tree, &ray, ray.t_max, &mut self);
        self.sink
    }
}

impl<S: Sink> single::Leaves for Instances<'_, S> {
    #[inline(always)]
    fn meet<L: Lanes>(&mut self, leaf: u32, reach: f32) -> f32 {
        let placed = &self.world.instances[leaf as usize];
        let ray = placed.localise(&self.ray);
        let (first, leaves) = (placed.first_triangle, &*placed.blas.leaves);
        let mut mesh = Mesh { first, leaves, ray, filter: self.filter, sink: &mut self.sink };
        let tree = (&*placed.blas.nodes, 0, &placed.blas.bounds);
        single::walk::<L>(tree, &ray, reach, &mut mesh)
    }

    #[inline(always)]
    fn prefetch(&self, leaf: u32) {
        if let Some(placed) = self.world.instances.get(leaf as usize) {
            prefetch(placed);
        }
    }
}

/// The leaves of a mesh's hierarchy to a single ray, in the mesh's frame.
struct Mesh<'a, S> {
    first: u32,
    leaves: &'a [Leaf],
    ray: Ray,
    filter: &'a Filter<'a>,
    sink: &'a mut S,
}

impl<S: Sink> single::Leaves for Mesh<'_, S> {
    #[inline(always)]
    fn meet<L: Lanes>(&mut self, leaf: u32, reach: f32) -> f32 {
        let (first, filter) = (self.first, self.filter);
        let keep = |triangle: u32, u, v| filter(first.wrapping_add(triangle), u, v);
        let sink = &mut Numbered { first, sink: &mut *self.sink };
        single::leaf::<L>(&self.leaves[leaf as usize], &self.ray, reach, &keep, sink)
    }

    #[inline(always)]
    fn prefetch(&self, leaf: u32) {
        if let Some(leaf) = self.leaves.get(leaf as usize) {
            prefetch(leaf);
        }
    }
}

/// Turns a mesh's triangle numbers into the world's.
struct Numbered<'a, S> {
    first: u32,
    sink: &'a mut S,
}

impl<S: Sink> Sink for Numbered<'_, S> {
    #[inline]
    fn take(&mut self, hit: Hit) -> f32 {
        self.sink.take(Hit { triangle: self.first.wrapping_add(hit.triangle), ..hit })
    }
}

/// The nearest hit of a ray.
pub(super) struct Closest<'a> {
    pub(super) world: &'a World,
    pub(super) ray: Ray,
    pub(super) filter: &'a Filter<'a>,
}

impl Query for Closest<'_> {
    type Answer = Option<Hit>;

    #[inline(always)]
    fn answer<L: Lanes>(self) -> Option<Hit> {
        let Closest { world, ray, filter } = self;
        Instances { world, ray, filter, sink: Nearest(None) }.trace::<L>().0
    }
}

struct Nearest(Option<Hit>);

impl Sink for Nearest {
    #[inline]
    fn take(&mut self, hit: Hit) -> f32 {
        let nearest = self.0.get_or_insert(hit);
        if (hit.t, hit.triangle) < (nearest.t, nearest.triangle) {
            *nearest = hit;
        }
        nearest.t
    }
}

/// Whether a ray hits anything.
pub(super) struct Blocked<'a> {
    pub(super) world: &'a World,
    pub(super) ray: Ray,
    pub(super) filter: &'a Filter<'a>,
}

impl Query for Blocked<'_> {
    type Answer = bool;

    #[inline(always)]
    fn answer<L: Lanes>(self) -> bool {
        let Blocked { world, ray, filter } = self;
        Instances { world, ray, filter, sink: Any(false) }.trace::<L>().0
    }
}

struct Any(bool);

impl Sink for Any {
    #[inline]
    fn take(&mut self, _: Hit) -> f32 {
        self.0 = true;
        -1.0
    }
}

/// Which of up to 64 rays hit anything: segments from the point `shared` to `ends`, or if `PARALLEL` rays from `ends`
/// along the direction `shared`.
pub(super) struct Bundle<'a, const PARALLEL: bool> {
    pub(super) world: &'a World,
    pub(super) shared: Vec3,
    pub(super) ends: &'a Ends,
    pub(super) active: u64,
    pub(super) blocker: &'a mut Blocker,
    pub(super) filter: &'a Filter<'a>,
}

impl<const PARALLEL: bool> Query for Bundle<'_, PARALLEL> {
    type Answer = u64;

    #[inline(always)]
    fn answer<L: Lanes>(self) -> u64 {
        let Bundle { world, ends, active, blocker, filter, .. } = self;
        let shared = self.shared.to_array();
        let mut left = active;
        let mut origin = shared;
        while PARALLEL && left != 0 {
            // Parallel rays are held relative to the first start that is a point at all.
            let ray = left.trailing_zeros() as usize;
            left &= left - 1;
            origin = [ends.xs[ray], ends.ys[ray], ends.zs[ray]];
            if origin.iter().all(|x| x.is_finite()) {
                break;
            }
        }
        let direction = if PARALLEL { shared } else { [0.0; 3] };
        // Rays through different faces of a cube share no beam; parallel ones always do.
        let faces =
            if PARALLEL { [active, 0, 0, 0, 0, 0] } else { faces::<L>(ends, origin, active) };
        let mut blocked = 0;
        for rays in faces {
            if rays == 0 {
                continue;
            }
            let source = FromPoint { ends, origin };
            let mut packet = Packet::<PARALLEL>::empty(origin, direction);
            packet.pick::<L>(rays, &source);
            let most = Cell::new(Blocker::default());
            let leaves = Places { world, packet: &packet, filter, most: &most };
            let known = match blocker.rays {
                0 => 0,
                _ => leaves.instance::<L>(blocker.instance, Some(blocker.leaf), packet.all()),
            };
            let left = packet.all() & !known;
            let World { nodes, root, bounds, .. } = world;
            let found = packet.walk::<L>((nodes, *root, bounds), left, &leaves);
            blocked |= packet.picked.back(known | found);
            *blocker = most.get();
        }
        blocked
    }
}

/// Points as vectors from `origin`.
pub(super) struct FromPoint<'a> {
    pub(super) ends: &'a Ends,
    pub(super) origin: [f32; 3],
}

impl Source for FromPoint<'_> {
    #[inline(always)]
    fn vectors<L: Lanes>(&self, group: usize) -> Three<L> {
        let Ends { xs, ys, zs } = self.ends;
        let group = group % GROUPS;
        let [x, y, z] = [xs, ys, zs].map(|axis| &axis.as_chunks().0[group]);
        sub(load([x, y, z]), splat(self.origin))
    }
}

/// The rays of `active` by the face of a cube around `origin` that their ends lie behind.
#[inline(always)]
pub(super) fn faces<L: Lanes>(ends: &Ends, origin: [f32; 3], active: u64) -> [u64; 6] {
    let [x0, y0, z0] = origin.map(L::splat);
    let zero = L::splat(0.0);
    let (xs, ys, zs) = (ends.xs.as_chunks().0, ends.ys.as_chunks().0, ends.zs.as_chunks().0);
    let [mut x_face, mut y_face, mut negative] = [0; 3];
    for (group, ((x, y), z)) in xs.iter().zip(ys).zip(zs).enumerate() {
        let (x, y, z) = (L::load(x).sub(x0), L::load(y).sub(y0), L::load(z).sub(z0));
        let (a, b, c) = (x.abs(), y.abs(), z.abs());
        let along_x = a.ge(b) & a.ge(c);
        let along_y = b.ge(c) & !along_x;
        let sign = zero.gt(x) & along_x | zero.gt(y) & along_y | zero.gt(z) & !along_x & !along_y;
        let shift = group * WIDTH;
        x_face |= u64::from(along_x) << shift;
        y_face |= u64::from(along_y & 0xff) << shift;
        negative |= u64::from(sign & 0xff) << shift;
    }
    let z_face = !x_face & !y_face;
    let [x, y, z] = [x_face & active, y_face & active, z_face & active];
    [x & !negative, x & negative, y & !negative, y & negative, z & !negative, z & negative]
}

/// The leaves of the upper hierarchy to a packet.
struct Places<'a, const PARALLEL: bool> {
    world: &'a World,
    packet: &'a Packet<PARALLEL>,
    filter: &'a Filter<'a>,
    /// The leaf that blocks the most rays so far.
    most: &'a Cell<Blocker>,
}

impl<const PARALLEL: bool> Places<'_, PARALLEL> {
    /// Which of `rays` are blocked by an instance, or by one of its leaves alone.
    #[inline(always)]
    fn instance<L: Lanes>(&self, instance: u32, only: Option<u32>, rays: u64) -> u64 {
        let Some(placed) = self.world.instances.get(instance as usize) else { return 0 };
        let Some(to) = &placed.to_object else {
            return self.trace::<L>((instance, placed), only, self.packet, rays);
        };
        let mut packet = self.packet.turned(to);
        packet.pick::<L>(rays, &Turned { picked: &self.packet.picked, to });
        packet.picked.back(self.trace::<L>((instance, placed), only, &packet, packet.all()))
    }

    #[inline(always)]
    fn trace<L: Lanes>(
        &self,
        (instance, placed): (u32, &Placed),
        only: Option<u32>,
        packet: &Packet<PARALLEL>,
        rays: u64,
    ) -> u64 {
        let (blas, first) = (&*placed.blas, placed.first_triangle);
        let Places { filter, most, .. } = *self;
        let faces = Faces { instance, first, leaves: &blas.leaves, packet, filter, most };
        match only {
            None => packet.walk::<L>((&blas.nodes, 0, &blas.bounds), rays, &faces),
            Some(leaf) if (leaf as usize) < blas.leaves.len() => {
                packet::Leaves::block::<L>(&faces, leaf, rays)
            }
            Some(_) => 0,
        }
    }
}

impl<const PARALLEL: bool> packet::Leaves for Places<'_, PARALLEL> {
    #[inline(always)]
    fn block<L: Lanes>(&self, leaf: u32, rays: u64) -> u64 {
        self.instance::<L>(leaf, None, rays)
    }

    #[inline(always)]
    fn prefetch(&self, leaf: u32) {
        if let Some(placed) = self.world.instances.get(leaf as usize) {
            prefetch(placed);
        }
    }
}

/// The leaves of a mesh's hierarchy to a packet, in the mesh's frame.
struct Faces<'a, const PARALLEL: bool> {
    instance: u32,
    first: u32,
    leaves: &'a [Leaf],
    packet: &'a Packet<PARALLEL>,
    filter: &'a Filter<'a>,
    most: &'a Cell<Blocker>,
}

impl<const PARALLEL: bool> packet::Leaves for Faces<'_, PARALLEL> {
    #[inline(always)]
    fn block<L: Lanes>(&self, leaf: u32, rays: u64) -> u64 {
        let (first, filter) = (self.first, self.filter);
        let keep = |triangle: u32, u, v| filter(first.wrapping_add(triangle), u, v);
        let blocked = self.packet.leaf::<L>(&self.leaves[leaf as usize], rays, &keep);
        let rays = blocked.count_ones();
        if rays > self.most.get().rays {
            self.most.set(Blocker { instance: self.instance, leaf, rays });
        }
        blocked
    }

    #[inline(always)]
    fn prefetch(&self, leaf: u32) {
        if let Some(leaf) = self.leaves.get(leaf as usize) {
            prefetch(leaf);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Blas, Build, Instance};
    use super::*;
    use glam::Affine3A;
    use std::sync::Arc;

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        // A wavy sheet seen edge-on and from above, as an instance that is turned.
        let at = |i: usize, j: usize| {
            Vec3::new(i as f32, (i as f32 * 0.7).sin() + (j as f32 * 0.9).cos(), j as f32) * 0.1
        };
        let triangles: Vec<[Vec3; 3]> = (0..1600)
            .map(|i| (i / 40, i % 40))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
                [[a, b, c], [b, d, c]]
            })
            .collect();
        let blas = Arc::new(Blas::new(&triangles, &[], Build::Fast));
        let to_world = Affine3A::from_rotation_y(0.4);
        let place =
            |first_triangle, to_world| Instance { blas: blas.clone(), to_world, first_triangle };
        let world = World::new(vec![place(0, Affine3A::IDENTITY), place(3200, to_world)]);
        let world = &world;
        let filter: &Filter = &|_, _, _| true;
        let mut answers = [0; 3];
        for k in 0..200usize {
            let wave = |scale: f32| (k as f32 * scale).sin();
            let shared = Vec3::new(wave(0.7), 0.3 * wave(0.3), wave(1.3)) * 3.0;
            let points: Vec<Vec3> = (0..64)
                .map(|i| at(i % 8 + k % 30, i / 8 + k % 29) + Vec3::Y * (0.02 * (i % 3) as f32))
                .collect();
            let (ends, active) = Ends::from_points(&points);
            let [mut a, mut b, mut c, mut d] = [Blocker::default(); 4];
            let ends = &ends;
            let from = |blocker| Bundle::<false> { world, shared, ends, active, blocker, filter };
            let along = |blocker| Bundle::<true> { world, shared, ends, active, blocker, filter };
            let (x, y) = (dispatch(from(&mut a)), dispatch(along(&mut b)));
            assert_eq!(x, from(&mut c).answer::<Portable>());
            assert_eq!(y, along(&mut d).answer::<Portable>());
            answers[0] += x.count_ones();
            answers[1] += y.count_ones();
            let direction = (points[k % 64] - shared).to_array();
            let ray =
                Ray { origin: shared.to_array(), direction, t_min: 0.0, t_max: f32::INFINITY };
            let closest = || Closest { world, ray, filter };
            let hit = dispatch(closest());
            assert_eq!(hit, closest().answer::<Portable>());
            answers[2] += u32::from(hit.is_some());
        }
        // Some are blocked and some are not, or nothing was compared.
        assert!(answers[0] > 1000 && answers[0] < 11_800, "{answers:?}");
        assert!(answers[1] > 1000 && answers[1] < 11_800, "{answers:?}");
        assert!(answers[2] > 100, "{answers:?}");
    }
}
