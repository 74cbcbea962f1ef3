//! The walk through a hierarchy for one receiver: which nodes it sees, and what they cover of its micro-buffer.

use super::buffer::MicroBuffer;
use super::disc::Disc;
use super::fragments::Fragments;
use super::frame::Frame;
use super::painting::below;
use super::{Settings, Work};
use crate::kernel::element::Receiver;
use crate::kernel::pbgi::hierarchy::{Bound, Entry, Hierarchy, Sent, Surfel};
use glam::Vec3;
use std::f32::consts::PI;

/// A node closer than this many of its radii is refined whatever its solid angle.
pub(super) const CLOSE: f32 = 1.5;
/// A leaf closer than this many radii of its disc is near: cast, not splatted.
pub(super) const NEAR: f32 = 2.0;
/// A leaf larger than this many cells is cast, too: a splat is at most two cells wide.
pub(super) const SPLAT: f32 = 4.0;
/// Sine of the height above the horizon below which a splatted node counts as lying on the receiver's own plane.
pub(super) const HORIZON: f32 = 0.01;
/// Distance, in radii, of a disc's plane from a receiver that lies on the disc.
const COPLANAR: f32 = 1e-3;
/// The same on a convex surface: the discs of the neighbours float above a receiver between them, look the other way, and
/// would shadow it; of a surface with two faces the backs of the neighbours look at it.
const FLOATING: f32 = 0.25;
/// How far, in distances, such a back may be from an arc of one surface through it and the receiver: what stands just
/// before the receiver is off it by twice the sine of its height.
const RISEN: f32 = 0.25;

/// One receiver's walk.
pub(super) struct Cut<'a, H: Hierarchy> {
    pub(super) hierarchy: &'a H,
    pub(super) buffer: &'a MicroBuffer,
    pub(super) settings: &'a Settings,
    pub(super) origin: Vec3,
    pub(super) normal: Vec3,
    pub(super) facet: Vec3,
    pub(super) frame: Frame,
    /// What coordinates may be off by where they are this large.
    pub(super) slack: f32,
}

/// Something small seen from the receiver.
struct Seen {
    /// Unit, local.
    direction: Vec3,
    distance: f32,
    /// Solid angle of its outline, steradians.
    outline: f32,
    /// Solid angle of what it covers, steradians.
    covered: f32,
    radiance: Vec3,
}

impl<'a, H: Hierarchy> Cut<'a, H> {
    pub(super) fn new(
        hierarchy: &'a H,
        buffer: &'a MicroBuffer,
        settings: &'a Settings,
        receiver: &Receiver,
        frame: Frame,
    ) -> Self {
        let slack = 4.0 * f32::EPSILON * receiver.position.abs().max_element();
        let (origin, normal, facet) = (receiver.position, receiver.normal, receiver.facet);
        Cut { hierarchy, buffer, settings, origin, normal, facet, frame, slack }
    }

    /// Walks down to the nodes whose solid angle is small enough and covers the cells in which they are seen. `stack`
    /// comes and goes empty.
    pub(super) fn walk(
        &self,
        stack: &mut Vec<H::Node>,
        fragments: &mut Fragments,
        work: &mut Work,
    ) {
        stack.extend(self.hierarchy.root());
        while let Some(node) = stack.pop() {
            work.visited += 1;
            match self.hierarchy.entry(node) {
                Entry::Leaf(surfel) => self.leaf(&surfel, fragments, work),
                Entry::Inner(bound) => {
                    let to = bound.center - self.origin;
                    // Written so that a bound that is no number is below the horizon.
                    let above = to.dot(self.normal) + bound.radius > 0.0
                        && to.dot(self.facet) + bound.radius > self.slack;
                    if !above {
                        continue;
                    }
                    match self.small(to, bound) {
                        Some(direction) => self.inner(node, direction, to, bound, fragments, work),
                        None => self.hierarchy.children(node, |child| stack.push(child)),
                    }
                }
            }
        }
    }

    /// The local unit direction to an inner node that needs no refinement.
    #[inline]
    fn small(&self, to: Vec3, bound: Bound) -> Option<Vec3> {
        let squared = to.length_squared();
        let radius = bound.radius * bound.radius;
        if !(squared >= CLOSE * CLOSE * radius && squared > 0.0) {
            return None;
        }
        let mut direction = self.frame.local(to) / squared.sqrt();
        direction.z = direction.z.max(0.0);
        let most = self.buffer.solid_angle(direction) * self.settings.factor;
        (PI * radius < most * squared).then_some(direction)
    }

    /// Whether the centre of something small lies clearly above the receiver's plane.
    #[inline]
    fn rises(&self, direction: Vec3, to: Vec3, distance: f32) -> bool {
        direction.z > HORIZON && to.dot(self.facet) > HORIZON * distance + self.slack
    }

    fn inner(
        &self,
        node: H::Node,
        direction: Vec3,
        to: Vec3,
        bound: Bound,
        fragments: &mut Fragments,
        work: &mut Work,
    ) {
        let distance = to.length();
        if !self.rises(direction, to, distance) {
            return;
        }
        work.splatted += 1;
        let towards = to / distance;
        let Sent { radiance, area } = self.hierarchy.sent(node, -towards);
        if area > 0.0 {
            let squared = distance * distance;
            let outline = PI * bound.radius * bound.radius / squared;
            let covered = area / squared;
            self.splat(Seen { direction, distance, outline, covered, radiance }, fragments);
        }
    }

    fn leaf(&self, surfel: &Surfel, fragments: &mut Fragments, work: &mut Work) {
        let to = surfel.position - self.origin;
        // How far a tilted disc rises above its centre.
        let rise = |normal: Vec3| {
            let cosine = surfel.normal.dot(normal);
            to.dot(normal) + surfel.radius * (1.0 - cosine * cosine).max(0.0).sqrt()
        };
        if !(rise(self.normal) > 0.0 && rise(self.facet) > self.slack) {
            return;
        }
        let cosine = -surfel.normal.dot(to);
        if cosine <= 0.0 {
            return;
        }
        let squared = to.length_squared();
        let radius = surfel.radius * surfel.radius;
        let distance = squared.sqrt();
        let direction = (self.frame.local(to) / distance.max(f32::MIN_POSITIVE))
            .max(Vec3::new(-1.0, -1.0, 0.0));
        let few = SPLAT * self.buffer.solid_angle(direction) * squared;
        if squared < NEAR * NEAR * radius || PI * radius > few {
            if let Some(disc) = self.disc(surfel, to) {
                work.cast += 1;
                disc.cast(self.buffer, |cell, depth, coverage| {
                    fragments.cover(cell, depth, coverage, surfel.radiance);
                });
            }
        } else if self.rises(direction, to, distance) {
            work.splatted += 1;
            let cosine = cosine / distance;
            let radiance = surfel.radiance;
            let outline = PI * radius / squared;
            let covered = surfel.area * cosine / squared;
            self.splat(Seen { direction, distance, outline, covered, radiance }, fragments);
        }
    }

    /// A large leaf at `to` from the receiver, in its frame; none where the receiver lies on it.
    pub(super) fn disc(&self, surfel: &Surfel, to: Vec3) -> Option<Disc> {
        let (center, normal) = (self.frame.local(to), self.frame.local(surfel.normal));
        (!self.lies_on(surfel, to)).then_some(Disc { center, normal, radius: surfel.radius })
    }

    /// Whether the receiver lies on a large disc, or under one of its own convex surface, or above the centre of one that
    /// stands out over the edge between them: neither lights nor shadows it. A wall's discs whose centres are below the
    /// floor are not missed: those above reach down to it.
    fn lies_on(&self, surfel: &Surfel, to: Vec3) -> bool {
        let under = to.dot(surfel.normal);
        let along = surfel.normal.dot(self.facet);
        let arc = to.dot(self.facet - surfel.normal).abs() <= RISEN * to.length();
        let floats = along > 0.5 && under > 0.0 || along < -0.5 && under < 0.0 && arc;
        to.dot(self.facet) <= self.slack
            || under.abs() <= COPLANAR * surfel.radius + self.slack
            || (floats && under.abs() <= FLOATING * surfel.radius)
    }

    /// Covers the cells below a square of the outline's size, but one to two cells a side: what it covers is shared out
    /// in proportion to overlap. Shares are counted in cosine-weighted solid angle, so that a node that nothing hides
    /// gives a diffuse receiver exactly what it sends.
    #[inline]
    fn splat(&self, seen: Seen, fragments: &mut Fragments) {
        let cells = seen.outline / self.buffer.solid_angle(seen.direction);
        let half = 0.5 * cells.sqrt().clamp(1.0, 2.0);
        let place = self.buffer.place(seen.direction);
        let (low_u, high_u) = (place.u - half, place.u + half);
        let (low_v, high_v) = (place.v - half, place.v + half);
        let share = seen.covered.min(4.0 * PI) * seen.direction.z / (4.0 * half * half);
        for j in below(low_v)..=below(high_v) {
            let tall = high_v.min((j + 1) as f32) - low_v.max(j as f32);
            for i in below(low_u)..=below(high_u) {
                let wide = high_u.min((i + 1) as f32) - low_u.max(i as f32);
                let cell = self.buffer.cell(place, i, j);
                let coverage = share * wide * tall / self.buffer.cells()[cell].weight;
                fragments.cover(cell, seen.distance, coverage, seen.radiance);
            }
        }
    }
}
