//! The nearest hits of up to 64 rays that share their origin: what a camera sees through a tile of pixels.

use super::hierarchy::{Bounds, Grown, LEAF, Leaf, Node};
use super::packet::{Packet, Turned, farthest_first};
use super::picked::{GROUPS, PerRay, RAYS, Source, groups};
use super::query::{FromPoint, Query, faces};
use super::stack::Stack;
use super::triangle::{Planes, Three, barycentric, corners, dot, splat, store};
use super::world::World;
use super::{Ends, Filter, Hit, Hits};
use crate::kernel::lanes::{Lanes, WIDTH, prefetch};
use glam::Vec3;

/// By how much of its distance a ray is looked at beyond the nearest hit so far: another at the same distance may be
/// of a smaller triangle, and its distance rounded the other way.
const BEYOND: f32 = 4.0 * f32::EPSILON;

/// Nearest hits along rays from `origin`.
pub(super) struct NearestFrom<'a> {
    pub(super) world: &'a World,
    pub(super) origin: Vec3,
    pub(super) directions: &'a Ends,
    pub(super) active: u64,
    pub(super) limits: &'a [[f32; Ends::CAPACITY]; 2],
    pub(super) filter: &'a Filter<'a>,
}

impl Query for NearestFrom<'_> {
    type Answer = Hits;

    #[inline(always)]
    fn answer<L: Lanes>(self) -> Hits {
        let Self { world, directions, filter, .. } = self;
        let mut hits = [None; Ends::CAPACITY];
        // Rays through different faces of a cube share no beam.
        for rays in faces::<L>(directions, [0.0; 3], self.active) {
            if rays == 0 {
                continue;
            }
            let source = FromPoint { ends: directions, origin: [0.0; 3] };
            let mut packet = Packet::empty(self.origin.to_array(), [0.0; 3]);
            packet.pick::<L>(rays, &source);
            let mut found = Found::new();
            for (ray, place) in packet.picked.places().enumerate() {
                found.limit(ray, [self.limits[0][place].max(0.0), self.limits[1][place]]);
            }
            let upper = (&*world.nodes, world.root, &world.bounds);
            walk::<L>(&packet, upper, packet.all(), &mut found, &Places { world, filter });
            for (place, hit) in packet.picked.places().zip(&found.hit) {
                hits[place] = *hit;
            }
        }
        hits
    }
}

/// What a packet's rays have hit so far.
struct Found {
    hit: Hits,
    /// Hits must be farther than this.
    start: PerRay,
    /// Where rays end: at first at their limit, then a little behind the nearest hit.
    end: PerRay,
}

impl Found {
    #[inline(always)]
    fn new() -> Self {
        // The ends of places without a ray are behind every box.
        Self { hit: [None; RAYS], start: [[0.0; WIDTH]; GROUPS], end: [[-1.0; WIDTH]; GROUPS] }
    }

    #[inline(always)]
    fn limit(&mut self, ray: usize, [start, end]: [f32; 2]) {
        let (group, lane) = (ray / WIDTH % GROUPS, ray % WIDTH);
        (self.start[group][lane], self.end[group][lane]) = (start, end);
    }

    #[inline(always)]
    fn limits(&self, ray: usize) -> [f32; 2] {
        let (group, lane) = (ray / WIDTH % GROUPS, ray % WIDTH);
        [self.start[group][lane], self.end[group][lane]]
    }

    /// Whether a hit would count, and replace what there is.
    #[inline(always)]
    fn wants(&self, ray: usize, t: f32, triangle: u32) -> bool {
        let [start, end] = self.limits(ray);
        let nearest = self.hit[ray % RAYS];
        t > start && nearest.map_or(t < end, |hit| (t, triangle) < (hit.t, hit.triangle))
    }

    #[inline(always)]
    fn take(&mut self, ray: usize, hit: Hit) {
        self.hit[ray % RAYS] = Some(hit);
        self.end[ray / WIDTH % GROUPS][ray % WIDTH] = hit.t + hit.t * BEYOND;
    }

    /// How far, in lengths of its vector, any ray still has to look.
    #[inline(always)]
    fn end<L: Lanes>(&self) -> f32 {
        let mut far = L::splat(0.0);
        for end in &self.end {
            far = L::load(end).max(far);
        }
        far.greatest()
    }

    /// How far the farthest ray of a packet still has to look, squared.
    #[inline(always)]
    fn farthest<L: Lanes>(&self, packet: &Packet<false>) -> f32 {
        let mut far = L::splat(0.0);
        for (group, end) in self.end.iter().enumerate() {
            let v = packet.picked.vectors::<L>(group);
            let end = L::load(end).max(L::splat(0.0));
            far = dot(v, v).mul(end).mul(end).max(far);
        }
        // A little more, for rounding.
        far.greatest() * (1.0 + 1e-5)
    }
}

/// What the leaves of a hierarchy stand for. A trait and not a closure, because its method must be inlined.
trait Leaves {
    /// Meets leaf `leaf` with `rays`; true if any of them hit something nearer.
    fn meet<L: Lanes>(
        &self,
        packet: &Packet<false>,
        leaf: u32,
        rays: u64,
        found: &mut Found,
    ) -> bool;
}

/// Walks a hierarchy from `root` with `rays`, a nearest child first. All boxes lie within `bounds`. True if any ray hit
/// something nearer.
#[inline(always)]
fn walk<L: Lanes>(
    packet: &Packet<false>,
    (nodes, root, bounds): (&[Node], u32, &Bounds),
    rays: u64,
    found: &mut Found,
    leaves: &impl Leaves,
) -> bool {
    if nodes.is_empty() && root & LEAF == 0 || rays == 0 {
        return false;
    }
    let origin = Grown::<L>::new(packet.origin, 0.0, bounds);
    let mut farthest = found.farthest::<L>(packet);
    let end = found.end::<L>();
    let beam = packet.beam.map(|beam| beam.reaching(end));
    let mut changed = false;
    let mut stack = Stack::<(f32, u32, u64)>::new((0.0, root, rays));
    while let Some((nearness, reference, rays)) = stack.pop() {
        if nearness > farthest {
            continue;
        }
        if reference & LEAF != 0 {
            if leaves.meet::<L>(packet, reference ^ LEAF, rays, found) {
                changed = true;
                farthest = found.farthest::<L>(packet);
            }
            continue;
        }
        let node = &nodes[reference as usize];
        let boxes = node.boxes(&origin);
        let met = match &beam {
            Some(beam) => beam.meets(&boxes),
            None => boxes.present,
        };
        if met == 0 {
            continue;
        }
        let through = packet.sort_rays(&boxes, met, rays, &found.end);
        let (order, count) = farthest_first(packet.nearness(&boxes), node, met, &through);
        for &(nearness, (child, rays)) in &order[..count] {
            if let Some(node) = nodes.get(child as usize) {
                prefetch(node);
            }
            stack.push((nearness, child, rays));
        }
    }
    changed
}

/// The leaves of the upper hierarchy.
struct Places<'a> {
    world: &'a World,
    filter: &'a Filter<'a>,
}

impl Leaves for Places<'_> {
    #[inline(always)]
    fn meet<L: Lanes>(
        &self,
        packet: &Packet<false>,
        leaf: u32,
        rays: u64,
        found: &mut Found,
    ) -> bool {
        let placed = &self.world.instances[leaf as usize];
        let (first, blas) = (placed.first_triangle, &*placed.blas);
        let lower = (&*blas.nodes, 0, &blas.bounds);
        let mesh = Mesh { first, leaves: &blas.leaves, filter: self.filter };
        let Some(to) = &placed.to_object else {
            return walk::<L>(packet, lower, rays, found, &mesh);
        };
        let mut inner = packet.turned(to);
        inner.pick::<L>(rays, &Turned { picked: &packet.picked, to });
        let mut inside = Found::new();
        for (ray, place) in inner.picked.places().enumerate() {
            inside.limit(ray, found.limits(place));
        }
        if !walk::<L>(&inner, lower, inner.all(), &mut inside, &mesh) {
            return false;
        }
        let mut changed = false;
        for (place, hit) in inner.picked.places().zip(&inside.hit) {
            if let Some(hit) = hit.filter(|hit| found.wants(place, hit.t, hit.triangle)) {
                found.take(place, hit);
                changed = true;
            }
        }
        changed
    }
}

/// The leaves of a mesh's hierarchy.
struct Mesh<'a> {
    first: u32,
    leaves: &'a [Leaf],
    filter: &'a Filter<'a>,
}

impl Leaves for Mesh<'_> {
    #[inline(always)]
    fn meet<L: Lanes>(
        &self,
        packet: &Packet<false>,
        leaf: u32,
        rays: u64,
        found: &mut Found,
    ) -> bool {
        let leaf = &self.leaves[leaf as usize];
        let corners = corners::<L>(leaf, splat(packet.origin));
        let met = match &packet.beam {
            Some(beam) => beam.reaching(f32::MAX).meets_triangles(&corners, L::splat(0.0)),
            None => u32::MAX,
        };
        if met == 0 {
            return false;
        }
        let planes = Planes::around_point(leaf, corners);
        let met = met & planes.usable;
        let stored = planes.store();
        let mut changed = false;
        let mut left = met;
        while left != 0 {
            let lane = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            let plane = Planes::<L>::only(&stored, lane);
            let mut groups = groups(rays);
            while groups != 0 {
                let group = groups.trailing_zeros() as usize % GROUPS;
                groups &= groups - 1;
                let x: Three<L> = packet.picked.vectors(group);
                let weights = plane.weights::<false>(x);
                let facing = dot(plane.normal, x);
                let hit = plane.inside(weights, L::load(&packet.length[group]))
                    & facing.mul(L::load(&found.end[group])).gt(plane.depth)
                    & facing.gt(L::splat(0.0));
                let mut hit = u64::from(hit) << (group * WIDTH) & rays;
                if hit == 0 {
                    continue;
                }
                let (weights, facing) = (store(weights), facing.store());
                while hit != 0 {
                    let ray = hit.trailing_zeros() as usize;
                    hit &= hit - 1;
                    let t = stored.depth[lane] / facing[ray % WIDTH];
                    let triangle = self.first.wrapping_add(leaf.index[lane]);
                    if !found.wants(ray, t, triangle) {
                        continue;
                    }
                    let (u, v) = barycentric(weights.map(|w| w[ray % WIDTH]));
                    if leaf.masked >> lane & 1 == 0 || (self.filter)(triangle, u, v) {
                        found.take(ray, Hit { t, triangle, u, v });
                        changed = true;
                    }
                }
            }
        }
        changed
    }
}
