//! Surfels, a tree over them and a slow oracle, for the tests.

use super::{Gather, Gathered, MicroBuffer, Scratch, Settings, Work};
use crate::kernel::element::Receiver;
use crate::kernel::pbgi::hierarchy::{Bound, Entry, Hierarchy, Sent, Surfel};
use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// How the nodes of a [`Tree`] answer.
#[derive(Clone, Copy, PartialEq)]
pub enum Answers {
    /// From all their surfels.
    Exact,
    /// From spherical harmonics of three bands, written as a polynomial of degree two in the direction.
    Harmonics,
}

/// A binary tree by median splits.
pub struct Tree {
    pub surfels: Vec<Surfel>,
    nodes: Vec<Node>,
    /// Red, green, blue and area of each node, apart from what a walk reads.
    sums: Vec<[Quadratic; 4]>,
    answers: Answers,
}

struct Node {
    bound: Bound,
    surfels: [u32; 2],
    children: [u32; 2],
}

/// The projection of sums of clamped cosines onto three bands: 1/4 + c/2 + 5/32 (3 c^2 - 1) for each cosine c.
#[derive(Clone, Copy)]
struct Quadratic {
    constant: f32,
    linear: Vec3,
    square: Mat3,
}

impl Quadratic {
    const ZERO: Quadratic = Quadratic { constant: 0.0, linear: Vec3::ZERO, square: Mat3::ZERO };

    fn add(&mut self, weight: f32, normal: Vec3) {
        self.constant += weight * 3.0 / 32.0;
        self.linear += normal * (weight * 0.5);
        let outer = Mat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        self.square += outer * (weight * 15.0 / 32.0);
    }

    fn at(&self, d: Vec3) -> f32 {
        (self.constant + self.linear.dot(d) + d.dot(self.square * d)).max(0.0)
    }
}

impl Tree {
    pub fn of(mut surfels: Vec<Surfel>, answers: Answers) -> Tree {
        let (mut nodes, mut all_sums) = (Vec::new(), Vec::new());
        let mut open = vec![(0, surfels.len(), None)];
        while let Some((first, end, parent)) = open.pop() {
            if first == end {
                continue;
            }
            let own = &mut surfels[first..end];
            let low = own.iter().map(|s| s.position).reduce(Vec3::min).unwrap();
            let high = own.iter().map(|s| s.position).reduce(Vec3::max).unwrap();
            let center = (low + high) * 0.5;
            let reach = |s: &Surfel| s.position.distance(center) + s.radius;
            let bound = Bound { center, radius: own.iter().map(reach).fold(0.0, f32::max) };
            let mut sums = [Quadratic::ZERO; 4];
            for s in own.iter() {
                for (sum, colour) in
                    sums.iter_mut().zip([s.radiance.x, s.radiance.y, s.radiance.z, 1.0])
                {
                    sum.add(s.area * colour, s.normal);
                }
            }
            let node = nodes.len() as u32;
            nodes.push(Node { bound, surfels: [first as u32, end as u32], children: [node; 2] });
            all_sums.push(sums);
            if let Some((parent, side)) = parent {
                let parent: &mut Node = &mut nodes[parent];
                parent.children[side] = node;
            }
            if end - first > 1 {
                let axis = (high - low).max_position();
                let middle = (end - first) / 2;
                let key = |s: &Surfel| s.position[axis];
                own.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
                open.push((first, first + middle, Some((node as usize, 0))));
                open.push((first + middle, end, Some((node as usize, 1))));
            }
        }
        Tree { surfels, nodes, sums: all_sums, answers }
    }
}

impl Hierarchy for Tree {
    type Node = u32;

    fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    fn entry(&self, node: u32) -> Entry {
        let node = &self.nodes[node as usize];
        match node.surfels[1] - node.surfels[0] {
            1 => Entry::Leaf(self.surfels[node.surfels[0] as usize]),
            _ => Entry::Inner(node.bound),
        }
    }

    fn children(&self, node: u32, visit: impl FnMut(u32)) {
        self.nodes[node as usize].children.into_iter().for_each(visit);
    }

    fn sent(&self, node: u32, direction: Vec3) -> Sent {
        let sums = &self.sums[node as usize];
        let node = &self.nodes[node as usize];
        let [r, g, b, area] = match self.answers {
            Answers::Harmonics => sums.each_ref().map(|sum| sum.at(direction)),
            Answers::Exact => {
                let own = &self.surfels[node.surfels[0] as usize..node.surfels[1] as usize];
                let facing = |s: &Surfel| s.area * s.normal.dot(direction).max(0.0);
                let rgb: Vec3 = own.iter().map(|s| s.radiance * facing(s)).sum();
                [rgb.x, rgb.y, rgb.z, own.iter().map(facing).sum()]
            }
        };
        let radiance = if area > 0.0 { Vec3::new(r, g, b) / area } else { Vec3::ZERO };
        Sent { radiance, area }
    }
}

/// A surfel that stands for all of its disc.
pub fn disc(position: Vec3, normal: Vec3, radius: f32, radiance: Vec3) -> Surfel {
    Surfel { position, normal, radiance, area: PI * radius * radius, radius }
}

/// A rectangle of `count` x `count` surfels around `center`, spanned by two half edges; it looks along their cross
/// product. Surfels lie in the middle of their cells, moved by up to `jitter` of half a cell.
pub fn sheet(
    center: Vec3,
    edges: [Vec3; 2],
    count: u32,
    radiance: Vec3,
    jitter: f32,
) -> Vec<Surfel> {
    let cross = edges[0].cross(edges[1]);
    let area = 4.0 * cross.length() / (count * count) as f32;
    let cell = edges[0].length().max(edges[1].length()) * 2.0 / count as f32;
    let at = |i: u32, salt: u32| {
        let shift = (noise(i * 2 + salt) * 2.0 - 1.0) * jitter;
        ((if salt == 0 { i % count } else { i / count }) as f32 + 0.5 + 0.5 * shift) * 2.0
            / count as f32
            - 1.0
    };
    let surfel = |i: u32| Surfel {
        position: center + edges[0] * at(i, 0) + edges[1] * at(i, 1),
        normal: cross.normalize(),
        radiance,
        area,
        // Discs around jittered places of a square grid touch their diagonal neighbours.
        radius: cell * (0.5_f32.sqrt() + 0.5 * jitter),
    };
    (0..count * count).map(surfel).collect()
}

/// Discs of any colour, size up to `largest` and orientation, spread over the cube -3..=3.
pub fn soup(count: u32, largest: f32) -> Vec<Surfel> {
    let surfel = |i: u32| {
        let at = |salt| noise(i * 7 + salt) * 2.0 - 1.0;
        let position = Vec3::new(at(1), at(2), at(3)) * 3.0;
        let normal = Vec3::new(at(4), at(5), at(6)).normalize();
        let colour = Vec3::new(noise(i), noise(i + 3000), noise(i + 6000));
        disc(position, normal, largest * at(0).abs(), colour)
    };
    (0..count).map(surfel).collect()
}

/// A sphere of `count` surfels that look inwards (`side` = -1) or outwards (1), spread along a spiral.
pub fn sphere(center: Vec3, radius: f32, count: u32, radiance: Vec3, side: f32) -> Vec<Surfel> {
    let surfel = |i: u32| {
        let z = 1.0 - (2 * i + 1) as f32 / count as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let out = Vec3::new(r * cos, r * sin, z);
        let area = 4.0 * PI * radius * radius / count as f32;
        Surfel {
            position: center + out * radius,
            normal: out * side,
            radiance,
            area,
            radius: (area / PI).sqrt() * 1.4,
        }
    };
    (0..count).map(surfel).collect()
}

/// A number in [0, 1) for each index.
pub fn noise(index: u32) -> f32 {
    let mut bits = index.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
    bits = (bits ^ (bits >> 12)).wrapping_mul(0x297a_2d39);
    ((bits ^ (bits >> 15)) >> 8) as f32 / (1 << 24) as f32
}

/// A white diffuse receiver: it sends irradiance over pi.
pub fn white(position: Vec3, normal: Vec3) -> Receiver {
    Receiver::diffuse(position, normal, normal, Vec3::ONE)
}

/// Six walls of `count` x `count` surfels around the cube -1..=1; they look inwards.
pub fn room(count: u32, radiance: Vec3, jitter: f32) -> Vec<Surfel> {
    let wall = |out: Vec3| {
        let a = out.any_orthonormal_vector();
        sheet(out, [a, a.cross(out)], count, radiance, jitter)
    };
    Vec3::AXES.into_iter().flat_map(|axis| [wall(axis), wall(-axis)].concat()).collect()
}

/// What a receiver gathers from a tree before black.
pub fn gather<H: Hierarchy>(tree: &H, receiver: &Receiver, buffer: &MicroBuffer) -> Gathered {
    let settings = Settings::default();
    let gather = Gather { hierarchy: tree, buffer, settings, background: |_| Vec3::ZERO };
    gather.one(receiver, &mut Scratch::default(), &mut Work::default())
}

/// What a diffuse receiver gathers from discs with an opaque front and an invisible back before black, by `side` x `side` cosine-weighted rays.
pub fn cast(surfels: &[Surfel], receiver: &Receiver, side: u32) -> Vec3 {
    let tangent = receiver.normal.any_orthonormal_vector();
    let bitangent = receiver.normal.cross(tangent);
    let mut sum = Vec3::ZERO;
    for i in 0..side * side {
        let u = ((i % side) as f32 + 0.5) / side as f32;
        let turn = ((i / side) as f32 + 0.5) / side as f32 * 2.0 * PI;
        let (s, c) = turn.sin_cos();
        let d = (tangent * c + bitangent * s) * u.sqrt() + receiver.normal * (1.0 - u).sqrt();
        let mut nearest = (f32::INFINITY, Vec3::ZERO);
        for surfel in surfels {
            let to = surfel.position - receiver.position;
            let slope = surfel.normal.dot(d);
            let t = surfel.normal.dot(to) / slope;
            if slope < 0.0 && t > 1e-4 && t < nearest.0 && (d * t - to).length() <= surfel.radius {
                nearest = (t, surfel.radiance);
            }
        }
        sum += nearest.1;
    }
    sum / (side * side) as f32 * receiver.reflectance.albedo
}
