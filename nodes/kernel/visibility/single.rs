//! One ray at a time: the reference for packets, and the way of paths and photons.

use super::Hit;
use super::hierarchy::{Blas, Boxes, LEAF, Node};
use super::lanes::{Lanes, WIDTH};
use super::stack::Stack;
use super::triangle::{Planes, Three, barycentric, corners, dot, splat, store};

/// Smallest share of its largest coordinate that a coordinate of a direction is taken to have, so that its inverse
/// is finite. Over the ray's whole length it strays from the true ray by this share, far less than boxes forgive.
const THINNEST: f32 = 1e-18;

/// The largest coordinate.
#[inline(always)]
pub(super) fn length<L: Lanes>(d: Three<L>) -> L {
    d[0].abs().max(d[1].abs()).max(d[2].abs())
}

/// One divided by each coordinate of a direction of this `length`; finite even where the coordinate is zero.
#[inline(always)]
pub(super) fn inverse<L: Lanes>(d: Three<L>, length: L) -> Three<L> {
    let one = L::splat(1.0);
    let least = length.mul(L::splat(THINNEST)).max(L::splat(1e-37));
    [
        one.div(d[0].abs().max(least).flip(d[0])),
        one.div(d[1].abs().max(least).flip(d[1])),
        one.div(d[2].abs().max(least).flip(d[2])),
    ]
}

/// A ray in some frame: the points origin + t direction for t between `t_min` and `t_max`, both exclusive.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
    pub(super) t_min: f32,
    pub(super) t_max: f32,
}

/// What the leaves of a hierarchy stand for. A trait and not a closure, because its method must be inlined.
pub(super) trait Leaves {
    /// Meets leaf `leaf` with a ray that reaches as far as `reach`, and gives how far it reaches from then on: nearer
    /// if only nearer hits matter, negative if none does any more. Must be inlined.
    fn meet<L: Lanes>(&mut self, leaf: u32, reach: f32) -> f32;
}

/// Takes hits one by one and gives how far the ray reaches from then on, as [`Leaves::meet`].
pub(super) trait Sink {
    fn take(&mut self, hit: Hit) -> f32;
}

/// Walks a hierarchy from `root`, nearest children first, and gives how far the ray reaches in the end.
#[inline(always)]
pub(super) fn walk<L: Lanes>(
    nodes: &[Node],
    root: u32,
    ray: &Ray,
    mut reach: f32,
    leaves: &mut impl Leaves,
) -> f32 {
    if nodes.is_empty() && root & LEAF == 0 {
        return reach;
    }
    let origin = splat::<L>(ray.origin);
    let direction = splat::<L>(ray.direction);
    let inverse = inverse(direction, length(direction));
    let t_min = L::splat(ray.t_min);
    let mut stack = Stack::<(u32, f32)>::new((root, ray.t_min));
    while let Some((reference, entry)) = stack.pop() {
        if entry > reach {
            continue;
        }
        if reference & LEAF != 0 {
            reach = leaves.meet::<L>(reference ^ LEAF, reach);
            if reach < 0.0 {
                break;
            }
            continue;
        }
        let node = &nodes[reference as usize];
        let Boxes { low, high, present } = node.boxes(origin, L::splat(0.0));
        let (mut enter, mut leave) = (t_min, L::splat(reach));
        for k in 0..3 {
            let (a, b) = (low[k].mul(inverse[k]), high[k].mul(inverse[k]));
            enter = a.min(b).max(enter);
            leave = a.max(b).min(leave);
        }
        let mut hit = leave.ge(enter) & present;
        let entries = enter.store();
        // Farthest first onto the stack: insertion among at most eight.
        let mut order = [(0, 0.0); WIDTH];
        let mut count = 0;
        while hit != 0 {
            let lane = hit.trailing_zeros() as usize;
            hit &= hit - 1;
            let mut at = count;
            while at > 0 && order[at - 1].1 < entries[lane] {
                order[at] = order[at - 1];
                at -= 1;
            }
            order[at] = (node.child[lane], entries[lane]);
            count += 1;
        }
        for &child in &order[..count] {
            stack.push(child);
        }
    }
    reach
}

/// Puts the hits of a ray on a leaf's triangles to `sink`. A hit of a masked triangle counts only if
/// `keep(local triangle, u, v)`.
#[inline(always)]
pub(super) fn leaf<L: Lanes>(
    blas: &Blas,
    leaf: u32,
    ray: &Ray,
    mut reach: f32,
    keep: &impl Fn(u32, f32, f32) -> bool,
    sink: &mut impl Sink,
) -> f32 {
    let leaf = &blas.leaves[leaf as usize];
    let planes = Planes::<L>::around_point(leaf, corners(leaf, splat(ray.origin)));
    let direction = splat(ray.direction);
    let weights = planes.weights::<false>(direction);
    let facing = dot(planes.normal, direction);
    let inside = planes.inside(weights, length(direction));
    let within = facing.mul(L::splat(ray.t_max)).gt(planes.depth)
        & planes.depth.gt(facing.mul(L::splat(ray.t_min)));
    let mut hit = inside & within & facing.gt(L::splat(0.0)) & planes.usable;
    if hit == 0 {
        return reach;
    }
    let (weights, facing, depth) = (store(weights), facing.store(), planes.depth.store());
    while hit != 0 && reach >= 0.0 {
        let lane = hit.trailing_zeros() as usize % WIDTH;
        hit &= hit - 1;
        let (u, v) = barycentric([weights[0][lane], weights[1][lane], weights[2][lane]]);
        let triangle = leaf.index[lane];
        if leaf.masked >> lane & 1 == 0 || keep(triangle, u, v) {
            reach = sink.take(Hit { t: depth[lane] / facing[lane], triangle, u, v });
        }
    }
    reach
}
