//! Spheres of inner nodes as they are stored: each within that of its parent, on a grid (Rusinkiewicz and Levoy 2000, section 3.2), so
//! that a walk from the root knows them. A stored sphere holds the sphere it stands for.

use super::super::hierarchy::Bound;
use super::super::topology::{Part, Topology};
use super::lattice::within;
use crate::kernel::lanes::prefetch;
use glam::Vec3;

/// Spheres and areas by the number of their inner node.
#[derive(Clone, Copy, Debug)]
pub enum Spheres<'a> {
    /// Three coordinates of the centre and the radius relative to the parent's sphere, 16 bits each; area 4 bytes: the 12 bytes that the paper
    /// counts for a node (its Table 1). The centre is within 2.7e-5 of the parent's radius.
    Fine(&'a [[u16; 4]], &'a [f32]),
    /// The same with 8 bits each, and area as a half float over a power of two: 6 bytes. The centre is within 6.9e-3 of the parent's radius,
    /// area within 2^-11 of itself.
    Coarse(&'a [[u8; 4]], &'a [u16], f32),
}

impl Spheres<'_> {
    /// The sphere of inner node `i` below a node with the sphere `parent`. That of the root is kept beside the tree.
    #[inline(always)]
    pub fn sphere(&self, i: usize, parent: Bound) -> Bound {
        match self {
            Spheres::Fine(codes, _) => FINE.decode(codes[i].map(u32::from), parent),
            Spheres::Coarse(codes, ..) => COARSE.decode(codes[i].map(u32::from), parent),
        }
    }

    /// Area of all surfels below inner node `i`.
    #[inline(always)]
    pub fn area(&self, i: usize) -> f32 {
        match self {
            Spheres::Fine(_, areas) => areas[i],
            Spheres::Coarse(_, areas, scale) => super::super::half::decode(areas[i]) / scale,
        }
    }
}

impl Spheres<'_> {
    /// Hints that the area of inner node `i` will be asked for soon.
    #[inline(always)]
    pub fn prefetch_area(&self, i: usize) {
        match self {
            Spheres::Fine(_, areas) => prefetch(&areas[i..=i]),
            Spheres::Coarse(_, areas, _) => prefetch(&areas[i..=i]),
        }
    }
}

/// Steps of codes of a sphere: from the middle to the surface of the parent's, for each coordinate; and of the whole radius.
#[derive(Clone, Copy)]
pub struct Grid {
    half: u32,
    whole: u32,
}

/// A number of a code.
pub trait Number: Copy + Default {
    /// The number `code`, which is within the range of the type.
    fn of(code: u32) -> Self;
}

impl Number for u8 {
    fn of(code: u32) -> u8 {
        code as u8
    }
}

impl Number for u16 {
    fn of(code: u32) -> u16 {
        code as u16
    }
}

/// 16 bits a number.
pub const FINE: Grid = Grid { half: 32_767, whole: 65_535 };
/// 8 bits a number.
pub const COARSE: Grid = Grid { half: 127, whole: 255 };

impl Grid {
    #[inline(always)]
    fn decode(self, [x, y, z, radius]: [u32; 4], parent: Bound) -> Bound {
        let offset = |code: u32| (code as f32 - self.half as f32 - 1.0) / self.half as f32;
        let center = parent.center + Vec3::new(offset(x), offset(y), offset(z)) * parent.radius;
        Bound { center, radius: radius as f32 / self.whole as f32 * parent.radius }
    }

    /// The smallest code of a sphere around `own` with the nearest centre; the parent's sphere itself where there is none.
    fn encode(self, own: Bound, parent: Bound) -> [u32; 4] {
        let half = self.half as f32;
        let code = |x: f32| ((x * half).round().clamp(-half, half) + half + 1.0) as u32;
        let [x, y, z] = within(own.center, parent).to_array().map(code);
        let center = self.decode([x, y, z, 0], parent).center;
        let needed = (center.as_dvec3() - own.center.as_dvec3()).length() + f64::from(own.radius);
        let ratio = (needed / f64::from(parent.radius) * f64::from(self.whole)) as u32;
        let fits =
            |radius: &u32| f64::from(self.decode([x, y, z, *radius], parent).radius) >= needed;
        match (ratio..=ratio.saturating_add(2).min(self.whole)).find(fits) {
            Some(radius) => [x, y, z, radius],
            None => self.whole_parent(),
        }
    }

    /// The code of the parent's own sphere.
    fn whole_parent(self) -> [u32; 4] {
        [self.half + 1, self.half + 1, self.half + 1, self.whole]
    }
}

/// Writes the code of each inner node of a tree whose root has the sphere `root` to `codes`, in numbers that [`Grid`] fits in. `own` gives the
/// sphere that a node has to hold; `leaf` is called for each leaf with the sphere of its parent as it will be decoded.
pub fn encode<T: Topology, C: Number>(
    topology: &T,
    root: Bound,
    own: impl Fn(usize) -> Bound,
    grid: Grid,
    codes: &mut [[C; 4]],
    mut leaf: impl FnMut(usize, Bound),
) {
    // The root stands in its own sphere, which is kept beside the tree.
    codes.fill(grid.whole_parent().map(C::of));
    let mut open: Vec<(T::Node, Bound)> = Vec::new();
    let mut visit = |node, bound, open: &mut Vec<(T::Node, Bound)>| match topology.part(node) {
        Part::Leaf(k) => leaf(k, bound),
        Part::Inner(_) => open.push((node, bound)),
    };
    if let Some(node) = topology.root() {
        visit(node, root, &mut open);
    }
    while let Some((node, bound)) = open.pop() {
        topology.children(node, |child| {
            let mut inside = bound;
            if let Part::Inner(i) = topology.part(child) {
                let code = grid.encode(own(i), bound);
                codes[i] = code.map(C::of);
                inside = grid.decode(code, bound);
            }
            visit(child, inside, &mut open);
        });
    }
}
