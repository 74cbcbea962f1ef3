//! The walk for eight receivers at once: a node is decoded once for all that look at it, and what it sends is evaluated in lanes.
//! Each receiver meets the nodes that [`Cut`] walks to for it alone, in the same order, and sees the same bits of them.

use super::Work;
use super::buffer::MicroBuffer;
use super::cut::{CLOSE, Cut, HORIZON, NEAR, SPLAT};
use super::painting::{Layers, PART};
use super::places::Places;
use crate::kernel::lanes::{Lanes, Triple, WIDTH};
use crate::kernel::pbgi::hierarchy::{Bound, Entry, Hierarchy, Surfel};
use glam::Vec3;
use std::f32::consts::PI;

/// The walk of up to eight receivers.
struct Packet<'a, 'b, L, H: Hierarchy> {
    hierarchy: &'a H,
    buffer: &'a MicroBuffer,
    factor: f32,
    /// One of each receiver; the last is repeated.
    cuts: [&'b Cut<'a, H>; WIDTH],
    origin: Triple<L>,
    normal: Triple<L>,
    facet: Triple<L>,
    /// The axes of the frames.
    axes: [Triple<L>; 3],
    slack: L,
}

/// Something small, seen from each receiver.
struct Seen<L, N> {
    /// Unit, local.
    direction: Triple<L>,
    distance: L,
    /// How many cells its outline is large.
    cells: L,
    /// The receivers to which it is shown.
    shown: u32,
    sender: Sender<L, N>,
}

enum Sender<L, N> {
    /// An inner node, and the directions from it to the receivers.
    Node(N, Triple<L>),
    /// What a leaf sends, and the solid angles that it covers.
    Leaf(Vec3, L),
}

/// What is seen and not yet shown: what nodes send comes from all over memory, and is on its way while the walk goes on.
type Waiting<L, N> = Vec<Seen<L, N>>;

/// Most that wait.
const WAITING: usize = 16;

/// Walks down to the nodes that each of 1 to 8 receivers sees, and adds what they cover to its layers, which must be as many as the cuts. `stack`
/// comes and goes empty.
#[inline(always)]
pub(super) fn walk<L: Lanes, H: Hierarchy>(
    cuts: &[Cut<'_, H>],
    stack: &mut Vec<(H::Node, u32)>,
    layers: &mut [Layers],
    work: &mut Work,
) {
    let Some(last) = cuts.last() else { return };
    let all = (1 << cuts.len().min(WIDTH)) - 1;
    let packet = Packet::<L, H>::of(std::array::from_fn(|i| cuts.get(i).unwrap_or(last)));
    let mut waiting = Waiting::with_capacity(WAITING);
    stack.extend(packet.hierarchy.root().map(|root| (root, all)));
    while let Some((node, mask)) = stack.pop() {
        work.visited += u64::from(mask.count_ones());
        match packet.hierarchy.entry(node) {
            Entry::Leaf(surfel) => packet.leaf(&surfel, mask, &mut waiting, layers, work),
            Entry::Inner(bound) => {
                let refined = packet.inner(node, bound, mask, &mut waiting);
                if refined != 0 {
                    packet.hierarchy.children(node, |child| stack.push((child, refined)));
                }
            }
        }
        if waiting.len() == WAITING {
            packet.show(&mut waiting, layers, work);
        }
    }
    packet.show(&mut waiting, layers, work);
}

impl<'a, 'b, L: Lanes, H: Hierarchy> Packet<'a, 'b, L, H> {
    #[inline(always)]
    fn of(cuts: [&'b Cut<'a, H>; WIDTH]) -> Self {
        let each = |of: fn(&Cut<'a, H>) -> Vec3| Triple::<L>::load(&cuts.map(of));
        Packet {
            hierarchy: cuts[0].hierarchy,
            buffer: cuts[0].buffer,
            factor: cuts[0].settings.factor,
            cuts,
            origin: each(|c| c.origin),
            normal: each(|c| c.normal),
            facet: each(|c| c.facet),
            axes: [each(|c| c.frame.x), each(|c| c.frame.y), each(|c| c.frame.z)],
            slack: L::load(&cuts.map(|c| c.slack)),
        }
    }

    #[inline(always)]
    fn local(&self, v: Triple<L>) -> Triple<L> {
        let [x, y, z] = self.axes;
        Triple { x: x.dot(v), y: y.dot(v), z: z.dot(v) }
    }

    /// Where the centre of something small lies clearly above the receiver's plane.
    #[inline(always)]
    fn rises(&self, direction: Triple<L>, to: Triple<L>, distance: L) -> u32 {
        let horizon = L::splat(HORIZON);
        direction.z.gt(horizon) & to.dot(self.facet).gt(horizon * distance + self.slack)
    }

    /// Has an inner node shown to those for whom it is small enough; gives those who need its children.
    #[inline(always)]
    fn inner(
        &self,
        node: H::Node,
        bound: Bound,
        mask: u32,
        waiting: &mut Waiting<L, H::Node>,
    ) -> u32 {
        let number = L::splat;
        let zero = number(0.0);
        let to = Triple::splat(bound.center).minus(self.origin);
        let rise = to.dot(self.facet);
        let mask = mask
            & (to.dot(self.normal) + number(bound.radius)).gt(zero)
            & (rise + number(bound.radius)).gt(self.slack);
        if mask == 0 {
            return 0;
        }
        let radius = bound.radius * bound.radius;
        let squared = to.dot(to);
        let far = mask & squared.ge(number(CLOSE * CLOSE * radius)) & squared.gt(zero);
        if far == 0 {
            return mask;
        }
        let distance = squared.sqrt();
        let mut direction = self.local(to).over(distance);
        direction.z = direction.z.max(zero);
        let angle = self.buffer.solid_angles(direction);
        let most = angle * number(self.factor);
        let small = far & (most * squared).gt(number(PI * radius));
        let shown = small & self.rises(direction, to, distance);
        if shown != 0 {
            self.hierarchy.prefetch(node);
            let back = to.over(distance).negated();
            let outline = number(PI * bound.radius * bound.radius) / (distance * distance);
            let (cells, sender) = (outline / angle, Sender::Node(node, back));
            waiting.push(Seen { direction, distance, cells, shown, sender });
        }
        mask & !small
    }

    #[inline(always)]
    fn leaf(
        &self,
        surfel: &Surfel,
        mask: u32,
        waiting: &mut Waiting<L, H::Node>,
        layers: &mut [Layers],
        work: &mut Work,
    ) {
        let number = L::splat;
        let zero = number(0.0);
        let to = Triple::splat(surfel.position).minus(self.origin);
        let normal = Triple::splat(surfel.normal);
        let cosine = normal.dot(to).negated();
        let mask = mask
            & rise(surfel, to, self.normal).gt(zero)
            & rise(surfel, to, self.facet).gt(self.slack)
            & !zero.ge(cosine);
        if mask == 0 {
            return;
        }
        let squared = to.dot(to);
        let radius = surfel.radius * surfel.radius;
        let distance = squared.sqrt();
        let mut direction = self.local(to).over(distance.max(number(f32::MIN_POSITIVE)));
        direction.x = direction.x.max(number(-1.0));
        direction.y = direction.y.max(number(-1.0));
        direction.z = direction.z.max(zero);
        let angle = self.buffer.solid_angles(direction);
        let few = number(SPLAT) * angle * squared;
        let near = mask & (number(NEAR * NEAR * radius).gt(squared) | number(PI * radius).gt(few));
        if near != 0 {
            // Layers keep the order of the walk.
            self.show(waiting, layers, work);
        }
        let mut casting = near;
        while casting != 0 {
            let lane = casting.trailing_zeros() as usize;
            casting &= casting - 1;
            let cut = self.cuts[lane];
            if let Some(disc) = cut.disc(surfel, surfel.position - cut.origin) {
                work.cast += 1;
                disc.cast(self.buffer, |cell, depth, coverage| {
                    let [red, green, blue] = surfel.radiance.to_array();
                    let cell = cell as f32;
                    layers[lane].push(depth, [PART, cell, 0.0, 0.0, coverage, red, green, blue]);
                });
            }
        }
        let shown = mask & !near & self.rises(direction, to, distance);
        if shown != 0 {
            let outline = number(PI * radius) / squared;
            let covered = number(surfel.area) * (cosine / distance) / squared;
            let (cells, sender) = (outline / angle, Sender::Leaf(surfel.radiance, covered));
            waiting.push(Seen { direction, distance, cells, shown, sender });
        }
    }

    /// Shows all that waits.
    #[inline(always)]
    fn show(&self, waiting: &mut Waiting<L, H::Node>, layers: &mut [Layers], work: &mut Work) {
        for seen in waiting.drain(..) {
            work.splatted += u64::from(seen.shown.count_ones());
            let (radiance, covered, shown) = match seen.sender {
                Sender::Leaf(radiance, covered) => (Triple::splat(radiance), covered, seen.shown),
                Sender::Node(node, back) => {
                    let (radiance, area) = self.hierarchy.sent_to_each(node, back, seen.shown);
                    let covered = area / (seen.distance * seen.distance);
                    (radiance, covered, seen.shown & area.gt(L::splat(0.0)))
                }
            };
            self.splat(&seen, covered, radiance, shown, layers);
        }
    }

    /// As `Cut::splat`.
    #[inline(always)]
    fn splat(
        &self,
        seen: &Seen<L, H::Node>,
        covered: L,
        radiance: Triple<L>,
        mut shown: u32,
        layers: &mut [Layers],
    ) {
        let number = L::splat;
        let half = number(0.5) * seen.cells.sqrt().max(number(1.0)).min(number(2.0));
        let share = covered.min(number(4.0 * PI)) * seen.direction.z / (number(4.0) * half * half);
        let Places { patch, u, v } = self.buffer.places(seen.direction, shown);
        let Triple { x: red, y: green, z: blue } = radiance;
        let each = L::transpose([patch, u, v, half, share, red, green, blue]);
        let distance = seen.distance.store();
        while shown != 0 {
            let lane = shown.trailing_zeros() as usize;
            shown &= shown - 1;
            layers[lane].push(distance[lane], each[lane]);
        }
    }
}

/// How far a tilted disc rises along an axis.
#[inline(always)]
fn rise<L: Lanes>(surfel: &Surfel, to: Triple<L>, axis: Triple<L>) -> L {
    let cosine = Triple::splat(surfel.normal).dot(axis);
    let sine = (L::splat(1.0) - cosine * cosine).max(L::splat(0.0)).sqrt();
    to.dot(axis) + L::splat(surfel.radius) * sine
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::*;
    use super::super::{Gather, Gathered, MicroBuffer, Scratch, Settings, Shape, Work};
    use crate::kernel::brdf::Reflectance;
    use crate::kernel::element::Receiver;
    use crate::kernel::lanes::Portable;
    use glam::Vec3;

    fn bits(g: &Gathered) -> [[u32; 3]; 3] {
        [g.radiance, Vec3::splat(g.open), g.unoccluded].map(|v| v.to_array().map(f32::to_bits))
    }

    /// Near each other and far apart, matt and glossy, with shading normals that lean off the facet.
    fn receivers(count: u32) -> Vec<Receiver> {
        let receiver = |i: u32| {
            let at = |salt: u32| noise(i * 5 + salt) - 0.5;
            let facet = Vec3::new(at(3), at(0), at(4)).normalize();
            let normal = (facet + Vec3::new(at(1), at(2), at(0)) * 0.4).normalize();
            let near = Vec3::new(at(0), at(1), at(2)) * if i.is_multiple_of(3) { 4.0 } else { 0.1 };
            let albedo = Vec3::new(0.7, 0.5, 0.2);
            let specular = Vec3::splat(if i.is_multiple_of(2) { 0.04 } else { 0.0 });
            let reflectance = Reflectance { albedo, specular, roughness: 0.3 };
            Receiver { position: near, normal, facet, to_eye: normal, reflectance }
        };
        (0..count).map(receiver).collect()
    }

    #[test]
    fn each_receiver_gathers_what_it_gathers_alone() {
        let mut surfels = soup(600, 0.3);
        surfels.extend(sphere(Vec3::ZERO, 4.0, 3000, Vec3::new(1.0, 0.5, 2.0), -1.0));
        // A last packet that is not full.
        let receivers = receivers(77);
        let background = |d: Vec3| Vec3::new(0.1, 0.2, d.y.max(0.0));
        for (answers, shape, resolution, factor) in [
            (Answers::Harmonics, Shape::Cube, 8, 1.0),
            (Answers::Harmonics, Shape::Cube, 5, 3.0),
            (Answers::Exact, Shape::Lambert, 9, 2.0),
            (Answers::Harmonics, Shape::Cube, 1, 0.0),
        ] {
            let tree = Tree::of(surfels.clone(), answers);
            let buffer = MicroBuffer::new(shape, resolution);
            let settings = Settings { factor, ..Settings::default() };
            let gather = Gather { hierarchy: &tree, buffer: &buffer, settings, background };
            let (together, work) = gather.all(&receivers, |_, _| Ok::<_, ()>(())).unwrap();
            let (mut scratch, mut alone) = (Scratch::default(), Work::default());
            for (i, (found, receiver)) in together.iter().zip(&receivers).enumerate() {
                let expected = gather.one(receiver, &mut scratch, &mut alone);
                assert_eq!(bits(found), bits(&expected), "{shape:?} {factor} {i}");
            }
            assert_eq!(
                (work.visited, work.splatted, work.cast),
                (alone.visited, alone.splatted, alone.cast)
            );
            assert!(work.cast > 0 && work.fragments <= alone.fragments);
            let mut plain = vec![Gathered::default(); receivers.len()];
            for chosen in [[3, 50, 4, 6, 76], [70, 71, 5, 9, 0]] {
                gather.few_in::<Portable>(
                    &receivers,
                    &chosen,
                    &mut plain,
                    &mut scratch,
                    &mut alone,
                );
                for i in chosen.map(|i| i as usize) {
                    assert_eq!(bits(&plain[i]), bits(&together[i]), "{shape:?} {factor} {i}");
                }
            }
        }
    }
}
