//! How a micro-buffer is made: its cells measured, its patches joined at their borders, its rays aimed.

use super::{Cell, GROUP, MicroBuffer, Patch, Place, RAYS, Rays, Shape, wound};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// A cell is measured at this many points a side.
const POINTS: u32 = 16;
/// Parts of a cell a side at most, and of a whole buffer: those of a fine buffer are its cells.
const PARTS: u32 = 4;
const ALL_PARTS: u32 = 64;
/// Where the rays of a cell pass through it: a turned square, so that an edge along its side meets them one by one.
const PASSAGES: [(f64, f64); RAYS] =
    [(0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875)];

impl MicroBuffer {
    /// The direction at cell coordinates of a patch, and solid angle per unit of its coordinates, both up to a factor.
    fn warp(&self, patch: usize, u: f64, v: f64) -> (DVec3, f64) {
        let Patch { columns, rows, .. } = self.patches[patch];
        let s = 2.0 * u / f64::from(columns) - 1.0;
        let t = v / f64::from(rows);
        match (self.shape, patch) {
            (Shape::Lambert, _) => {
                let (x, y) = wound(s, 2.0 * t - 1.0);
                let z = (1.0 - x * x - y * y).max(0.0).sqrt();
                (DVec3::new(x, y, z), 1.0 / z.max(1e-9))
            }
            (Shape::Cube, side) => {
                // Area per unit of (u, v), in units in which a side of the cube is 2.
                let (point, area) = match side {
                    0 => (DVec3::new(s, 2.0 * t - 1.0, 1.0), 2.0),
                    1 => (DVec3::new(1.0, s, t), 1.0),
                    2 => (DVec3::new(-s, 1.0, t), 1.0),
                    3 => (DVec3::new(-1.0, -s, t), 1.0),
                    _ => (DVec3::new(s, -1.0, t), 1.0),
                };
                let share = 2.0 * area / (f64::from(columns) * f64::from(rows));
                (point.normalize(), share / point.length().powi(3))
            }
        }
    }

    /// The integrals of direction and of one, weighted by the cosine, over a square of cell coordinates of a patch.
    fn integrate(&self, patch: usize, [u, v]: [f64; 2], size: f64, points: u32) -> (DVec3, f64) {
        let (mut mean, mut weight) = (DVec3::ZERO, 0.0);
        for (b, a) in (0..points).flat_map(|b| (0..points).map(move |a| (b, a))) {
            let at =
                |from: f64, point: u32| from + size * (f64::from(point) + 0.5) / f64::from(points);
            let (direction, density) = self.warp(patch, at(u, a), at(v, b));
            mean += direction * (direction.z * density);
            weight += direction.z * density;
        }
        (mean, weight)
    }

    /// Makes the cells and enters them into the middle of the table.
    pub(super) fn measure(&mut self) {
        let (mut sums, mut parts) = (Vec::new(), Vec::new());
        let side = (ALL_PARTS / self.resolution).clamp(1, PARTS);
        let side = 1 << side.ilog2();
        let size = 1.0 / f64::from(side);
        for (p, patch) in self.patches.iter().enumerate() {
            for (j, i) in (0..patch.rows).flat_map(|j| (0..patch.columns).map(move |i| (j, i))) {
                let (mut mean, mut weight) = (DVec3::ZERO, 0.0);
                for (b, a) in (0..side).flat_map(|b| (0..side).map(move |a| (b, a))) {
                    let [u, v] = [(i, a), (j, b)]
                        .map(|(cell, part)| f64::from(cell) + size * f64::from(part));
                    let part = self.integrate(p, [u, v], size, POINTS / side);
                    mean += part.0;
                    weight += part.1;
                    parts.push(part);
                }
                let place = patch.first + (j as usize + 1) * (patch.columns as usize + 2);
                self.table[place + i as usize + 1] = sums.len() as u32;
                sums.push((mean, weight));
            }
        }
        // What the points miss of the integrals is shared out, so that the whole is exact.
        let scale = PI / sums.iter().map(|sum| sum.1).sum::<f64>();
        let cell = |(mean, weight): (DVec3, f64)| Cell {
            direction: mean.normalize_or(DVec3::Z).as_vec3(),
            weight: (weight * scale) as f32,
        };
        self.cells = sums.into_iter().map(cell).collect();
        self.parts = parts.into_iter().map(cell).collect();
    }

    /// Enters the borders of the patches into the table.
    pub(super) fn join(&mut self) {
        for p in 0..self.patches.len() {
            let Patch { first, columns, rows } = self.patches[p];
            let (columns, rows) = (columns as i32, rows as i32);
            for (j, i) in (-1..=rows).flat_map(|j| (-1..=columns).map(move |i| (j, i))) {
                if (0..columns).contains(&i) && (0..rows).contains(&j) {
                    continue;
                }
                let place = match self.shape {
                    Shape::Lambert => Place { patch: p, u: i as f32, v: j as f32 },
                    Shape::Cube => {
                        let (direction, _) = self.warp(p, f64::from(i) + 0.5, f64::from(j) + 0.5);
                        self.place(direction.as_vec3())
                    }
                };
                let within = self.patches[place.patch];
                let i_there = (place.u.floor() as i32).clamp(0, within.columns as i32 - 1);
                let j_there = (place.v.floor() as i32).clamp(0, within.rows as i32 - 1);
                let at = first + (j + 1) as usize * (columns as usize + 2) + (i + 1) as usize;
                self.table[at] = self.cell(place, i_there, j_there) as u32;
            }
        }
    }

    /// Lists the places of each cell.
    pub(super) fn invert(&mut self) {
        self.places = (0..self.table.len() as u32).collect();
        self.places.sort_by_key(|&place| self.table[place as usize]);
        let cell = |&place: &u32| self.table[place as usize] as usize;
        self.starts = (0..=self.cells.len())
            .map(|c| self.places.partition_point(|place| cell(place) < c) as u32)
            .collect();
    }

    /// Makes the rays of all cells.
    pub(super) fn aim(&mut self) {
        let mut rays: Vec<[Vec3; RAYS]> = Vec::with_capacity(self.cells.len());
        for (p, patch) in self.patches.iter().enumerate() {
            for (j, i) in (0..patch.rows).flat_map(|j| (0..patch.columns).map(move |i| (j, i))) {
                rays.push(std::array::from_fn(|k| {
                    let (a, b) = PASSAGES[k];
                    self.warp(p, f64::from(i) + a, f64::from(j) + b).0.as_vec3()
                }));
            }
        }
        let last = rays.len() - 1;
        self.rays = (0..rays.len().div_ceil(GROUP))
            .map(|group| {
                std::array::from_fn(|k| {
                    let ray = |lane: usize| rays[(group * GROUP + lane).min(last)][k];
                    Rays {
                        x: std::array::from_fn(|lane| ray(lane).x),
                        y: std::array::from_fn(|lane| ray(lane).y),
                        z: std::array::from_fn(|lane| ray(lane).z),
                    }
                })
            })
            .collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPES: [Shape; 2] = [Shape::Cube, Shape::Lambert];

    #[test]
    fn cells_fill_the_hemisphere() {
        for shape in SHAPES {
            for resolution in [1, 2, 3, 8, 13, 32] {
                let buffer = MicroBuffer::new(shape, resolution);
                let weight: f64 = buffer.cells().iter().map(|c| f64::from(c.weight)).sum();
                assert!((weight - PI).abs() < 1e-4, "{shape:?} {resolution}: {weight}");
                assert!(buffer.cells().iter().all(|c| c.direction.z > 0.0 && c.weight > 0.0));
                assert!(buffer.cells().iter().all(|c| (c.direction.length() - 1.0).abs() < 1e-5));
            }
        }
        assert_eq!(MicroBuffer::new(Shape::Cube, 8).len(), 192);
        assert_eq!(MicroBuffer::new(Shape::Lambert, 0).len(), 1);
    }

    #[test]
    fn lamberts_cells_weigh_the_same() {
        let buffer = MicroBuffer::new(Shape::Lambert, 9);
        for cell in buffer.cells() {
            assert!((cell.weight * 81.0 - std::f32::consts::PI).abs() < 1e-5);
        }
    }

    #[test]
    fn borders_lead_to_the_neighbouring_patch() {
        let buffer = MicroBuffer::new(Shape::Cube, 8);
        // Around each place at a patch's edge, the cells beyond the edge look in nearly the same direction.
        for cell in buffer.cells() {
            let place = buffer.place(cell.direction);
            let (i, j) = (place.u.floor() as i32, place.v.floor() as i32);
            for (a, b) in [(-1, 0), (1, 0), (0, -1), (0, 1), (1, 1), (-1, 1)] {
                let neighbour = buffer.cells()[buffer.cell(place, i + a, j + b)];
                assert!(neighbour.direction.dot(cell.direction) > 0.87, "{place:?} {a} {b}");
            }
        }
    }
}
