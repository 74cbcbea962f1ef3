//! The triangle test, for eight triangles at once and any number of rays that share a point or a direction.
//!
//! A ray passes a triangle where it passes all three edges on the same side. What an edge contributes depends only on
//! its two ends and changes its sign, to the bit, when they are exchanged: two triangles that share an edge therefore
//! never both let a ray slip through it. That holds only as long as no product is fused into a sum. The distance
//! comes from the triangle's own normal: the triple product of the corners loses it for small far triangles.
//!
//! Where several triangles meet in a corner, their edges' signs may all err the same way round. A triangle therefore
//! forgives a ray that misses it by less than rounding may be to blame for, twice the forgiven share of the distance
//! being what boxes forgive.
//!
//! Nothing here is a closure: a closure can miss being inlined, and with it the instruction set.

use super::hierarchy::Leaf;
use crate::kernel::lanes::{Lanes, WIDTH};

/// Three coordinates, each of eight lanes.
pub(super) type Three<L> = [L; 3];

/// The product of each coordinate with the other's, summed in a fixed order.
#[inline(always)]
pub(super) fn dot<L: Lanes>(a: Three<L>, b: Three<L>) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

#[inline(always)]
fn cross<L: Lanes>(a: Three<L>, b: Three<L>) -> Three<L> {
    [
        a[1].mul(b[2]).sub(a[2].mul(b[1])),
        a[2].mul(b[0]).sub(a[0].mul(b[2])),
        a[0].mul(b[1]).sub(a[1].mul(b[0])),
    ]
}

#[inline(always)]
pub(super) fn sub<L: Lanes>(a: Three<L>, b: Three<L>) -> Three<L> {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn add<L: Lanes>(a: Three<L>, b: Three<L>) -> Three<L> {
    [a[0].add(b[0]), a[1].add(b[1]), a[2].add(b[2])]
}

#[inline(always)]
fn flip<L: Lanes>(a: Three<L>, sign: L) -> Three<L> {
    [a[0].flip(sign), a[1].flip(sign), a[2].flip(sign)]
}

#[inline(always)]
fn scaled<L: Lanes>(a: Three<L>, by: L) -> Three<L> {
    [a[0].mul(by), a[1].mul(by), a[2].mul(by)]
}

/// The same three numbers in every lane.
#[inline(always)]
pub(super) fn splat<L: Lanes>(v: [f32; 3]) -> Three<L> {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

/// The same three of the numbers, those of `lane`, in every lane.
#[inline(always)]
pub(super) fn splat_lane<L: Lanes>(v: &Three<[f32; WIDTH]>, lane: usize) -> Three<L> {
    splat([v[0][lane], v[1][lane], v[2][lane]])
}

/// Reads three times eight numbers.
#[inline(always)]
pub(super) fn load<L: Lanes>(v: [&[f32; WIDTH]; 3]) -> Three<L> {
    [L::load(v[0]), L::load(v[1]), L::load(v[2])]
}

/// As plain numbers.
#[inline(always)]
pub(super) fn store<L: Lanes>(v: Three<L>) -> Three<[f32; WIDTH]> {
    [v[0].store(), v[1].store(), v[2].store()]
}

/// The corners of a leaf's triangles relative to `origin`.
#[inline(always)]
pub(super) fn corners<L: Lanes>(leaf: &Leaf, origin: Three<L>) -> [Three<L>; 3] {
    let [a, b, c] = &leaf.vertex;
    [
        sub(load([&a[0], &a[1], &a[2]]), origin),
        sub(load([&b[0], &b[1], &b[2]]), origin),
        sub(load([&c[0], &c[1], &c[2]]), origin),
    ]
}

/// The weight that a ray may lack, per unit of a triangle's shortest side, the triangle's distance and the length of
/// the ray's direction (or of the edge's product with it). Lets a ray pass half of this share of its distance outside.
///
/// As small as corners allow: of rays aimed straight at a closed mesh's corners one in a thousand slips through when
/// nothing is forgiven, 3 in 100,000 at half of this and one in a million at this. Eight times as much makes 7 of
/// 100,000 random shadow rays stop at a triangle that they miss.
const FORGIVEN: f32 = 1.0 / (1 << 21) as f32;

/// The share that is forgiven of the product of a triangle's shortest side and its distance, and that of the side.
#[inline(always)]
pub(super) fn forgiven<L: Lanes>(leaf: &Leaf, a: Three<L>) -> (L, L) {
    let side = L::load(&leaf.side);
    let distance = a[0].abs().max(a[1].abs()).max(a[2].abs()).add(side);
    let share = side.mul(L::splat(FORGIVEN));
    (share.mul(distance), share)
}

/// Which lanes' weights all lack at most what is `forgiven`.
#[inline(always)]
pub(super) fn inside<L: Lanes>([a, b, c]: Three<L>, forgiven: L) -> u32 {
    a.min(b).min(c).add(forgiven).ge(L::splat(0.0))
}

/// For each edge of triangles, the one across from vertex i, the normal of the plane through it and the point that
/// the corners are relative to. Exchanging the edge's ends changes its sign, to the bit.
#[inline(always)]
pub(super) fn edges<L: Lanes>([a, b, c]: &[Three<L>; 3]) -> [Three<L>; 3] {
    [
        cross(add(*b, *c), sub(*c, *b)),
        cross(add(*c, *a), sub(*a, *c)),
        cross(add(*a, *b), sub(*b, *a)),
    ]
}

/// The planes of eight triangles, seen from the point that their corners are relative to.
pub(super) struct Plane<L> {
    pub(super) normal: Three<L>,
    /// Negative where the normal points towards the point.
    pub(super) sign: L,
    /// The distance in lengths of the normal.
    pub(super) depth: L,
    /// The triangles that a ray can hit at all: present, and not seen exactly edge-on.
    pub(super) usable: u32,
}

impl<L: Lanes> Plane<L> {
    #[inline(always)]
    pub(super) fn of(leaf: &Leaf, [a, b, c]: &[Three<L>; 3]) -> Self {
        let normal = cross(sub(*b, *a), sub(*c, *a));
        let sign = dot(normal, *a);
        let depth = sign.flip(sign);
        let usable = depth.gt(L::splat(0.0)) & ((1 << leaf.count) - 1);
        Self { normal, sign, depth, usable }
    }
}

/// What eight triangles ask of a ray, which is one vector X: its direction if rays share their origin, its origin if
/// they share their direction. Vertex i's weight is `edge[i] . X`, plus `offset[i]` if parallel; none may be negative
/// by more than `forgiven` lengths of X, and `normal . X` must exceed `depth`. All is turned so that this holds for
/// either side of a triangle.
#[derive(Clone, Copy)]
pub(super) struct Planes<L> {
    pub(super) edge: [Three<L>; 3],
    pub(super) offset: Three<L>,
    pub(super) forgiven: L,
    pub(super) normal: Three<L>,
    pub(super) depth: L,
    /// The triangles that a ray can hit at all: present, and not seen exactly edge-on.
    pub(super) usable: u32,
}

impl<L: Lanes> Planes<L> {
    /// For rays from the point that the corners are relative to. A ray with direction X meets the triangle's plane at
    /// t = `depth / (normal . X)`, so `normal . X > depth` says t < 1.
    #[inline(always)]
    pub(super) fn around_point(leaf: &Leaf, corners: [Three<L>; 3]) -> Self {
        let Plane { normal, sign, depth, usable } = Plane::of(leaf, &corners);
        let [a, b, c] = edges(&corners);
        Self {
            edge: [flip(a, sign), flip(b, sign), flip(c, sign)],
            offset: [L::splat(0.0); 3],
            forgiven: forgiven(leaf, corners[0]).0,
            normal: flip(normal, sign),
            depth,
            usable,
        }
    }

    /// For rays along `direction`. `normal . X > depth` says that the triangle lies ahead of the ray's origin X.
    #[inline(always)]
    pub(super) fn along(leaf: &Leaf, [a, b, c]: [Three<L>; 3], direction: Three<L>) -> Self {
        let normal = cross(sub(b, a), sub(c, a));
        let facing = dot(normal, direction);
        let zero = L::splat(0.0);
        let [m0, m1, m2] = [
            flip(cross(sub(c, b), direction), facing),
            flip(cross(sub(a, c), direction), facing),
            flip(cross(sub(b, a), direction), facing),
        ];
        let normal = scaled(flip(normal, facing), L::splat(-1.0));
        let twice = L::splat(-2.0);
        let length = direction[0].abs().max(direction[1].abs()).max(direction[2].abs());
        let (here, per_start) = forgiven(leaf, a);
        let here = here.mul(length);
        Self {
            // Sum of the ends minus twice the ray's origin, against the edge turned by the direction.
            edge: [scaled(m0, twice), scaled(m1, twice), scaled(m2, twice)],
            offset: [
                dot(m0, add(b, c)).add(here),
                dot(m1, add(c, a)).add(here),
                dot(m2, add(a, b)).add(here),
            ],
            forgiven: per_start.mul(length),
            normal,
            depth: dot(normal, a),
            usable: facing.flip(facing).gt(zero) & ((1 << leaf.count) - 1),
        }
    }

    /// The vertices' weights for X, not normalised.
    #[inline(always)]
    pub(super) fn weights<const PARALLEL: bool>(&self, x: Three<L>) -> Three<L> {
        let [a, b, c] = [dot(self.edge[0], x), dot(self.edge[1], x), dot(self.edge[2], x)];
        if PARALLEL { add([a, b, c], self.offset) } else { [a, b, c] }
    }

    /// The same planes with triangle `lane` in every lane.
    #[inline(always)]
    pub(super) fn only(lanes: &Planes<[f32; WIDTH]>, lane: usize) -> Self {
        Self {
            edge: [
                splat_lane(&lanes.edge[0], lane),
                splat_lane(&lanes.edge[1], lane),
                splat_lane(&lanes.edge[2], lane),
            ],
            offset: splat_lane(&lanes.offset, lane),
            forgiven: L::splat(lanes.forgiven[lane]),
            normal: splat_lane(&lanes.normal, lane),
            depth: L::splat(lanes.depth[lane]),
            usable: lanes.usable,
        }
    }

    /// The planes as plain numbers.
    #[inline(always)]
    pub(super) fn store(&self) -> Planes<[f32; WIDTH]> {
        Planes {
            edge: [store(self.edge[0]), store(self.edge[1]), store(self.edge[2])],
            offset: store(self.offset),
            forgiven: self.forgiven.store(),
            normal: store(self.normal),
            depth: self.depth.store(),
            usable: self.usable,
        }
    }

    /// Which lanes' weights are all as large as they must be. `length` is X's largest coordinate.
    #[inline(always)]
    pub(super) fn inside(&self, weights: Three<L>, length: L) -> u32 {
        inside(weights, self.forgiven.mul(length))
    }

    /// Which lanes are passed by X: bit i for triangle i, or for ray i of a group against one triangle.
    #[inline(always)]
    pub(super) fn passed<const PARALLEL: bool>(&self, x: Three<L>, length: L) -> u32 {
        self.inside(self.weights::<PARALLEL>(x), length) & dot(self.normal, x).gt(self.depth)
    }
}

/// Barycentric weights of vertices 1 and 2 from three weights of any common scale; forgiven ones count as none.
pub(super) fn barycentric(weights: [f32; 3]) -> (f32, f32) {
    let [a, b, c] = weights.map(|weight| weight.max(0.0));
    let sum = a + b + c;
    if sum > 0.0 { (b / sum, c / sum) } else { (0.0, 0.0) }
}
