//! Triangles that hang together by their edges: whether their meshes are closed, and what they enclose.

use super::nesting::{Extent, Nesting};
use super::{NONE, Seen};
use glam::Vec3;

/// The smallest volume of a solid, as part of its area to the power of 3/2 (0.094 for a ball). A
/// sheet folded onto itself is closed too but encloses nothing: both its sides are seen.
const LEAST_VOLUME: f64 = 1e-6;

/// The vertices of every triangle, and how many there are; [`NONE`] for all three when a coordinate
/// is not finite.
pub(super) fn weld(
    corners: &impl Fn(u32) -> [Vec3; 3],
    triangles: u32,
    key: &mut Vec<u128>,
) -> (Vec<[u32; 3]>, usize) {
    for triangle in 0..triangles {
        let corners = corners(triangle);
        if corners.iter().all(|c| c.is_finite()) {
            for (number, corner) in (3 * triangle..).zip(corners) {
                // Adding zero makes the negative zero positive.
                let [x, y, z] = (corner + Vec3::ZERO).to_array().map(|c| u128::from(c.to_bits()));
                key.push(x << 96 | y << 64 | z << 32 | u128::from(number));
            }
        }
    }
    key.sort_unstable();
    let mut vertex = vec![[NONE; 3]; triangles as usize];
    let mut vertices = 0;
    for place in key.chunk_by(|a, b| a >> 32 == b >> 32) {
        for &corner in place {
            let corner = corner as u32;
            vertex[corner as usize / 3][corner as usize % 3] = vertices;
        }
        vertices += 1;
    }
    (vertex, vertices as usize)
}

/// Triangles that hang together by their edges.
pub(super) struct Meshes {
    /// `[triangle]`; [`NONE`] for triangles with two corners in one point.
    pub(super) mesh: Vec<u32>,
    /// `[mesh]`
    closed: Vec<bool>,
}

impl Meshes {
    pub(super) fn new(vertex: &[[u32; 3]], key: &mut Vec<u128>) -> Self {
        key.clear();
        // A triangle with two equal corners passes its one edge to and fro: without it the others
        // are as closed as with it.
        let flat = |[a, b, c]: [u32; 3]| a == b || b == c || c == a;
        for (triangle, &[a, b, c]) in (0_u128..).zip(vertex) {
            if !flat([a, b, c]) {
                key.extend([(a, b), (b, c), (c, a)].map(|(from, to)| {
                    let ends = u128::from(from.min(to)) << 32 | u128::from(from.max(to));
                    ends << 64 | triangle << 32 | u128::from(from < to)
                }));
            }
        }
        key.sort_unstable();
        let triangle = |edge: u128| (edge >> 32) as u32;
        let mut parent: Vec<u32> = (0..vertex.len() as u32).collect();
        let mut open = Vec::new();
        for edge in key.chunk_by(|a, b| a >> 64 == b >> 64) {
            let first = triangle(edge[0]);
            for &other in &edge[1..] {
                join(&mut parent, first, triangle(other));
            }
            let forward = edge.iter().filter(|&e| e & 1 == 1).count();
            if 2 * forward != edge.len() {
                open.push(first);
            }
        }
        // A root is the first triangle of its mesh, so that its number is known to the others.
        let mut mesh = vec![NONE; vertex.len()];
        let mut meshes = 0;
        let whole = (0..).zip(vertex).filter(|&(_, &of)| !flat(of));
        for (triangle, _) in whole {
            let root = root(&mut parent, triangle);
            if root == triangle {
                mesh[triangle as usize] = meshes;
                meshes += 1;
            } else {
                mesh[triangle as usize] = mesh[root as usize];
            }
        }
        let mut closed = vec![true; meshes as usize];
        for triangle in open {
            closed[mesh[triangle as usize] as usize] = false;
        }
        Meshes { mesh, closed }
    }

    /// The sides that are seen of every mesh.
    pub(super) fn verdicts(&self, corners: &impl Fn(u32) -> [Vec3; 3]) -> Vec<Seen> {
        let used = || (0..).zip(&self.mesh).filter(|&(_, &m)| m != NONE);
        let mut extent = vec![Extent::NOTHING; self.closed.len()];
        for (triangle, &mesh) in used() {
            let extent = &mut extent[mesh as usize];
            for corner in corners(triangle) {
                extent.low = extent.low.min(corner);
                extent.high = extent.high.max(corner);
            }
        }
        let mut volume = vec![0.0; self.closed.len()];
        let mut area = vec![0.0; self.closed.len()];
        for (triangle, &mesh) in used().filter(|&(_, &m)| self.closed[m as usize]) {
            let mesh = mesh as usize;
            // From a point near the mesh, lest a small solid far from the origin is lost in rounding.
            let centre = (extent[mesh].low.as_dvec3() + extent[mesh].high.as_dvec3()) / 2.0;
            let [a, b, c] = corners(triangle).map(|corner| corner.as_dvec3() - centre);
            let across = (b - a).cross(c - a);
            volume[mesh] += a.dot(across) / 6.0;
            area[mesh] += across.length() / 2.0;
        }
        let nesting = Nesting::new(&extent);
        let verdict = |mesh: usize| {
            let least = LEAST_VOLUME * area[mesh] * area[mesh].sqrt();
            let solid = self.closed[mesh] && volume[mesh].abs() > least;
            match volume[mesh] > 0.0 {
                _ if !solid || nesting.encloses_another(&extent[mesh]) => Seen::Both,
                true => Seen::Front,
                false => Seen::Back,
            }
        };
        (0..self.closed.len()).map(verdict).collect()
    }
}

/// The first of the triangles joined with this one.
fn root(parent: &mut [u32], mut triangle: u32) -> u32 {
    while parent[triangle as usize] != triangle {
        let above = parent[parent[triangle as usize] as usize];
        parent[triangle as usize] = above;
        triangle = above;
    }
    triangle
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}
