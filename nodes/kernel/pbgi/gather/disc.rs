//! Rays from a receiver through all cells of its micro-buffer against one disc.

use super::buffer::{GROUP, MicroBuffer, RAYS, Rays};
use glam::Vec3;

/// A disc in a receiver's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// Its centre, seen from the receiver.
    pub(super) center: Vec3,
    /// Its unit normal, on the side that sends light.
    pub(super) normal: Vec3,
    pub(super) radius: f32,
}

impl Disc {
    /// Calls `cover` for each cell of which rays hit the disc, with the depth and the share of it.
    #[inline(always)]
    pub(super) fn cast(&self, buffer: &MicroBuffer, mut cover: impl FnMut(usize, f32, f32)) {
        for (group, rays) in buffer.rays().iter().enumerate() {
            let mut hits = [0.0_f32; GROUP];
            let mut depths = [0.0_f32; GROUP];
            for ray in rays {
                self.meet(ray, &mut hits, &mut depths);
            }
            if hits == [0.0; GROUP] {
                continue;
            }
            for lane in 0..GROUP.min(buffer.len() - group * GROUP) {
                if hits[lane] > 0.0 {
                    let coverage = hits[lane] / RAYS as f32;
                    let depth = depths[lane] / hits[lane];
                    cover(group * GROUP + lane, depth, coverage);
                }
            }
        }
    }

    /// Adds 1 to the hits of each ray that meets the disc, and its distance to the depths.
    #[inline(always)]
    fn meet(&self, rays: &Rays, hits: &mut [f32; GROUP], depths: &mut [f32; GROUP]) {
        let (c, n) = (self.center, self.normal);
        let plane = c.dot(n);
        // |t d - c|^2 <= r^2 with t = plane / slope, multiplied by slope^2.
        let beyond = c.length_squared() - self.radius * self.radius;
        for lane in 0..GROUP {
            let (x, y, z) = (rays.x[lane], rays.y[lane], rays.z[lane]);
            let slope = x * n.x + y * n.y + z * n.z;
            let along = x * c.x + y * c.y + z * c.z;
            let inside =
                plane * plane - 2.0 * plane * slope * along + beyond * slope * slope <= 0.0;
            let ahead = plane * slope > 0.0;
            let hit = if inside & ahead { 1.0 } else { 0.0 };
            let divisor = if inside & ahead { slope } else { 1.0 };
            hits[lane] += hit;
            depths[lane] += hit * (plane / divisor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::buffer::Shape;
    use super::super::fragments::Fragments;
    use super::*;
    use std::f32::consts::PI;

    fn irradiance(disc: Disc, buffer: &MicroBuffer) -> f32 {
        let mut fragments = Fragments::default();
        fragments.clear(buffer.len());
        disc.cast(buffer, |cell, depth, coverage| {
            fragments.cover(cell, depth, coverage, Vec3::ONE)
        });
        fragments.sort();
        let cells = buffer.cells().iter().enumerate();
        cells.map(|(c, cell)| fragments.composite(c, 1.0).0.x * cell.weight).sum()
    }

    #[test]
    fn a_parallel_disc_has_its_form_factor() {
        for shape in [Shape::Cube, Shape::Lambert] {
            let buffer = MicroBuffer::new(shape, 32);
            for (height, radius) in [(1.0, 1.0), (1.0, 3.0), (2.0, 1.0), (1e-6, 1e-6), (1e6, 1e6)] {
                let center = Vec3::Z * height;
                let disc = Disc { center, normal: Vec3::NEG_Z, radius };
                let expected = PI * radius * radius / (radius * radius + height * height);
                let found = irradiance(disc, &buffer);
                assert!((found / expected - 1.0).abs() < 0.03, "{shape:?} {found} {expected}");
            }
        }
    }

    #[test]
    fn a_disc_seen_edge_on_covers_nothing() {
        let buffer = MicroBuffer::new(Shape::Cube, 8);
        for (center, normal) in [(Vec3::X, Vec3::Z), (Vec3::Z, Vec3::X), (Vec3::ZERO, Vec3::X)] {
            let disc = Disc { center, normal, radius: 2.0 };
            disc.cast(&buffer, |_, _, _| panic!("{center} {normal}"));
        }
    }
}
