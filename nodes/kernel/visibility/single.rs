//! One ray at a time: the reference for packets, and the way of paths and photons.

use super::Hit;
use super::hierarchy::{Bounds, Grown, LEAF, Leaf, Node};
use super::stack::Stack;
use super::triangle::{
    Plane, Three, barycentric, corners, dot, edges, forgiven, inside, splat, store,
};
use crate::kernel::lanes::{Lanes, WIDTH, prefetch};

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

    /// Hints that leaf `leaf` will be met soon.
    fn prefetch(&self, leaf: u32);
}

/// Takes hits one by one and gives how far the ray reaches from then on, as [`Leaves::meet`].
pub(super) trait Sink {
    fn take(&mut self, hit: Hit) -> f32;
}

/// The slab test of one ray against a node's eight boxes.
struct Slabs<L> {
    /// Per axis, whether boxes are entered through their low side.
    forward: [bool; 3],
    /// The ray's origin as seen from where boxes are entered and left.
    enter: Three<L>,
    leave: Three<L>,
    inverse: Three<L>,
    t_min: L,
}

impl<L: Lanes> Slabs<L> {
    #[inline(always)]
    fn new(ray: &Ray, bounds: &Bounds) -> Self {
        let Grown { low, high } = Grown::<L>::new(ray.origin, 0.0, bounds);
        let (mut enter, mut leave) = (low, high);
        let forward = ray.direction.map(f32::is_sign_positive);
        for k in 0..3 {
            if !forward[k] {
                (enter[k], leave[k]) = (high[k], low[k]);
            }
        }
        let direction = splat::<L>(ray.direction);
        let inverse = inverse(direction, length(direction));
        Self { forward, enter, leave, inverse, t_min: L::splat(ray.t_min) }
    }

    /// Which boxes are met before `reach`, and where they are entered.
    #[inline(always)]
    fn pass(&self, node: &Node, reach: f32) -> (u32, L) {
        let (mut enter, mut leave) = (self.t_min, L::splat(reach));
        for k in 0..3 {
            let (low, high) = (&node.low[k], &node.high[k]);
            let (near, far) = if self.forward[k] { (low, high) } else { (high, low) };
            enter = L::load(near).sub(self.enter[k]).mul(self.inverse[k]).max(enter);
            leave = L::load(far).sub(self.leave[k]).mul(self.inverse[k]).min(leave);
        }
        (leave.ge(enter) & ((1 << node.count) - 1), enter)
    }
}

/// Walks a hierarchy from `root`, a nearest child first, and gives how far the ray reaches in the end. All boxes lie
/// within `bounds`.
#[inline(always)]
pub(super) fn walk<L: Lanes>(
    (nodes, root, bounds): (&[Node], u32, &Bounds),
    ray: &Ray,
    mut reach: f32,
    leaves: &mut impl Leaves,
) -> f32 {
    if root & LEAF != 0 {
        return leaves.meet::<L>(root ^ LEAF, reach);
    }
    if nodes.is_empty() {
        return reach;
    }
    let slabs = Slabs::<L>::new(ray, bounds);
    let mut stack = Stack::<(u32, f32)>::new((root, ray.t_min));
    while let Some((mut reference, entry)) = stack.pop() {
        if entry > reach {
            continue;
        }
        while reference & LEAF == 0 {
            let node = &nodes[reference as usize];
            let (mut hit, enter) = slabs.pass(node, reach);
            if hit == 0 {
                break;
            }
            let lane = hit.trailing_zeros() as usize % WIDTH;
            hit &= hit - 1;
            if hit == 0 {
                reference = node.child[lane];
                continue;
            }
            let entries = enter.store();
            // The nearest next, the others onto the stack.
            let mut next = (node.child[lane], entries[lane]);
            while hit != 0 {
                let lane = hit.trailing_zeros() as usize % WIDTH;
                hit &= hit - 1;
                let other = (node.child[lane], entries[lane]);
                let nearer = other.1 < next.1;
                let later = if nearer { next } else { other };
                next = if nearer { other } else { next };
                if later.0 & LEAF != 0 {
                    leaves.prefetch(later.0 ^ LEAF);
                } else if let Some(node) = nodes.get(later.0 as usize) {
                    prefetch(node);
                }
                stack.push(later);
            }
            reference = next.0;
        }
        if reference & LEAF != 0 {
            reach = leaves.meet::<L>(reference ^ LEAF, reach);
            if reach < 0.0 {
                break;
            }
        }
    }
    reach
}

/// Puts the hits of a ray on a leaf's triangles to `sink`. A hit of a masked triangle counts only if
/// `keep(local triangle, u, v)`.
#[inline(always)]
pub(super) fn leaf<L: Lanes>(
    leaf: &Leaf,
    ray: &Ray,
    mut reach: f32,
    keep: &impl Fn(u32, f32, f32) -> bool,
    sink: &mut impl Sink,
) -> f32 {
    let corners = corners(leaf, splat(ray.origin));
    let direction = splat(ray.direction);
    let plane = Plane::<L>::of(leaf, &corners);
    let facing = dot(plane.normal, direction).flip(plane.sign);
    let within = facing.mul(L::splat(ray.t_max)).gt(plane.depth)
        & plane.depth.gt(facing.mul(L::splat(ray.t_min)));
    let mut hit = within & facing.gt(L::splat(0.0)) & plane.usable;
    if hit == 0 {
        return reach;
    }
    // The weights that planes around a point give to the bit: turning an edge or what comes of it is the same.
    let [a, b, c] = edges(&corners);
    let weights = [
        dot(a, direction).flip(plane.sign),
        dot(b, direction).flip(plane.sign),
        dot(c, direction).flip(plane.sign),
    ];
    hit &= inside(weights, forgiven(leaf, corners[0]).0.mul(length(direction)));
    if hit == 0 {
        return reach;
    }
    let (weights, facing, depth) = (store(weights), facing.store(), plane.depth.store());
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
