//! The cells of a micro-buffer: the hemisphere over a receiver cut into directions (Buchholz and Boubekeur 2012,
//! section 1.1: "Lambert-warped 2D buffers or clamped cube map buffers").
//!
//! Local coordinates throughout: the receiver at the origin, its normal along +Z.

use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_4, PI};

crate::choice! {
    /// How the hemisphere is cut into cells.
    pub enum Shape {
        /// The upper half of a cube: its top, and four sides that end at the horizon. Cells see about
        /// equal solid angles.
        Cube = "cube",
        /// A square wound onto the unit disc below the hemisphere (concentric map): cells are equal in
        /// cosine-weighted solid angle, so that each counts the same for a diffuse receiver.
        Lambert = "lambert",
    }
}

/// Finest resolution: beyond it a buffer is no longer small.
const FINEST: u32 = 1024;
/// A cell is measured at this many points a side.
const POINTS: u32 = 16;
/// Parts of a cell a side at most, and of a whole buffer: those of a fine buffer are its cells.
const PARTS: u32 = 4;
const ALL_PARTS: u32 = 64;
/// Rays of a cell with which large discs are cast, and where they pass through it: a turned square, so that an edge along
/// a cell's side meets them one by one.
pub(super) const RAYS: usize = 4;
const PASSAGES: [(f64, f64); RAYS] =
    [(0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875)];
/// Cells whose rays are tested together.
pub(super) const GROUP: usize = 8;

/// One cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Cosine-weighted mean of its directions, a unit vector.
    pub(super) direction: Vec3,
    /// Integral of the cosine over its solid angle; all cells make pi.
    pub(super) weight: f32,
}

/// Rays through [`GROUP`] cells: one component each for all of them, so that they are tested side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rays {
    pub(super) x: [f32; GROUP],
    pub(super) y: [f32; GROUP],
    pub(super) z: [f32; GROUP],
}

/// Where a direction meets a buffer: a patch and continuous cell coordinates on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) patch: usize,
    pub(super) u: f32,
    pub(super) v: f32,
}

/// A rectangle of cells, with a border one cell wide in `MicroBuffer::table`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    first: usize,
    columns: u32,
    pub(super) rows: u32,
}

/// Where the rows of a patch lie in a table, those of the borders among them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    pub(super) first: usize,
    pub(super) width: usize,
    height: usize,
}

impl Rows {
    /// Where column `i` lies in a row; the nearest for one beyond the borders, which are -1 and the number of columns.
    #[inline]
    pub(super) fn column(&self, i: i32) -> usize {
        (i.max(-1) + 1).min(self.width as i32 - 1) as usize
    }

    /// The same for rows in the patch.
    #[inline]
    pub(super) fn row(&self, j: i32) -> usize {
        (j.max(-1) + 1).min(self.height as i32 - 1) as usize
    }
}

/// The cells of a hemisphere, made once for all receivers.
#[derive(Clone, Debug)]
pub struct MicroBuffer {
    pub(super) shape: Shape,
    pub(super) resolution: u32,
    cells: Vec<Cell>,
    /// The squares that each cell is cut into, cell after cell.
    parts: Vec<Cell>,
    /// The cell at each place of each patch. A place of a border has the cell that lies there on the neighbouring patch,
    /// or beyond the horizon the cell above it.
    table: Vec<u32>,
    pub(super) patches: Vec<Patch>,
    /// For each cell its places in the table, those of cell c from `starts[c]` to `starts[c + 1]`.
    places: Vec<u32>,
    starts: Vec<u32>,
    /// For each group of cells the rays of all of them, first ray first. Places behind the last cell repeat it.
    rays: Vec<[Rays; RAYS]>,
}

impl MicroBuffer {
    /// A buffer of `resolution` cells a side, clamped to 1..=1024: 3 r^2 cells for an even cube, r^2 for Lambert's.
    pub fn new(shape: Shape, resolution: u32) -> Self {
        let resolution = resolution.clamp(1, FINEST);
        let mut patches = Vec::new();
        let mut first = 0;
        let sides = match shape {
            Shape::Cube => 5,
            Shape::Lambert => 1,
        };
        for patch in 0..sides {
            let rows = if patch == 0 { resolution } else { resolution.div_ceil(2) };
            patches.push(Patch { first, columns: resolution, rows });
            first += (resolution as usize + 2) * (rows as usize + 2);
        }
        let mut buffer = MicroBuffer {
            shape,
            resolution,
            cells: Vec::new(),
            parts: Vec::new(),
            table: vec![0; first],
            patches,
            places: Vec::new(),
            starts: Vec::new(),
            rays: Vec::new(),
        };
        buffer.measure();
        buffer.join();
        buffer.invert();
        buffer.aim();
        buffer
    }

    /// The number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Never: there is a cell at every resolution.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    #[inline]
    pub(super) fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// A cell in parts, for what differs within it.
    #[inline]
    pub(super) fn parts(&self, cell: usize) -> &[Cell] {
        let count = self.parts.len() / self.cells.len();
        &self.parts[cell * count..(cell + 1) * count]
    }

    pub(super) fn rays(&self) -> &[[Rays; RAYS]] {
        &self.rays
    }

    /// Solid angle, steradians, of the cells around a unit direction on or above the horizon.
    #[inline]
    pub(super) fn solid_angle(&self, direction: Vec3) -> f32 {
        let n = self.resolution as f32;
        match self.shape {
            Shape::Cube => {
                let [x, y, z] = [direction.x.abs(), direction.y.abs(), direction.z];
                let side = x.max(y);
                // A texel of area a at distance 1/m from the centre, seen at cosine m.
                match z >= side {
                    true => 4.0 / (n * n) * (z * z * z),
                    false => 2.0 / (n * self.patches[1].rows as f32) * (side * side * side),
                }
            }
            // The cells of the rim reach the horizon, where 1/cosine has no bound: the mean over their ring is taken.
            Shape::Lambert => {
                let rim = ((n - 1.0).sqrt() / n).clamp(f32::MIN_POSITIVE, 0.5);
                std::f32::consts::PI / (n * n * direction.z.max(rim))
            }
        }
    }

    /// Where a unit direction on or above the horizon meets the buffer.
    #[inline]
    pub(super) fn place(&self, d: Vec3) -> Place {
        let n = self.resolution as f32;
        let on = |patch, s: f32, t: f32| Place { patch, u: (s + 1.0) * 0.5 * n, v: t };
        match self.shape {
            Shape::Cube => {
                let (x, y) = (d.x.abs(), d.y.abs());
                if d.z >= x.max(y) {
                    return on(0, d.x / d.z, (d.y / d.z + 1.0) * 0.5 * n);
                }
                let rows = self.patches[1].rows as f32;
                let (side, s, reach) = match (x >= y, d.x > 0.0, d.y > 0.0) {
                    (true, true, _) => (1, d.y, x),
                    (true, false, _) => (3, -d.y, x),
                    (false, _, true) => (2, -d.x, y),
                    (false, _, false) => (4, d.x, y),
                };
                on(side, s / reach, d.z / reach * rows)
            }
            Shape::Lambert => {
                let (a, b) = unwound(d.x, d.y);
                on(0, a, (b + 1.0) * 0.5 * n)
            }
        }
    }

    /// Cells of the patch of `place` along both axes, and the cell at column `i` and row `j` of it, each from -1 (the
    /// border) to their number (the other border); what lies farther out is clamped.
    #[inline]
    pub(super) fn cell(&self, place: Place, i: i32, j: i32) -> usize {
        let rows = self.rows(place.patch);
        self.table[rows.first + rows.row(j) * rows.width + rows.column(i)] as usize
    }

    /// The rows of a patch in [`MicroBuffer::table`].
    #[inline]
    pub(super) fn rows(&self, patch: usize) -> Rows {
        let Patch { first, columns, rows } = self.patches[patch];
        Rows { first, width: columns as usize + 2, height: rows as usize + 2 }
    }

    /// The cell at each place of each patch and its borders.
    #[inline]
    pub(super) fn table(&self) -> &[u32] {
        &self.table
    }

    /// How far behind the table rows below a patch lie at most, those of a splat.
    pub(super) fn margin(&self) -> usize {
        2 * (self.resolution as usize + 2)
    }

    /// The places of a cell in the table.
    #[inline]
    pub(super) fn places_of(&self, cell: u32) -> &[u32] {
        let [start, end] = [0, 1].map(|k| self.starts[cell as usize + k] as usize);
        &self.places[start..end]
    }

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
    fn measure(&mut self) {
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
    fn join(&mut self) {
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
    fn invert(&mut self) {
        self.places = (0..self.table.len() as u32).collect();
        self.places.sort_by_key(|&place| self.table[place as usize]);
        let cell = |&place: &u32| self.table[place as usize] as usize;
        self.starts = (0..=self.cells.len())
            .map(|c| self.places.partition_point(|place| cell(place) < c) as u32)
            .collect();
    }

    /// Makes the rays of all cells.
    fn aim(&mut self) {
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

/// The concentric map from the square -1..=1 onto the unit disc: squares around the centre become circles, areas stay in
/// proportion (Shirley and Chiu 1997).
fn wound(a: f64, b: f64) -> (f64, f64) {
    if a == 0.0 && b == 0.0 {
        return (0.0, 0.0);
    }
    match a.abs() > b.abs() {
        true => {
            let (sin, cos) = libm::sincos(FRAC_PI_4 * b / a);
            (a * cos, a * sin)
        }
        false => {
            let (sin, cos) = libm::sincos(FRAC_PI_4 * a / b);
            (b * sin, b * cos)
        }
    }
}

/// The inverse of [`wound`].
#[inline]
fn unwound(x: f32, y: f32) -> (f32, f32) {
    let r = (x * x + y * y).sqrt();
    let angle = |ratio: f32| libm::atanf(ratio) * std::f32::consts::FRAC_2_PI * 2.0;
    if x.abs() > y.abs() {
        let a = r.copysign(x);
        (a, a * angle(y / x))
    } else if y != 0.0 {
        let b = r.copysign(y);
        (b * angle(x / y), b)
    } else {
        (0.0, 0.0)
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
    fn cells_and_rays_are_found_where_they_lie() {
        for shape in SHAPES {
            for resolution in [1, 2, 5, 8, 16] {
                let buffer = MicroBuffer::new(shape, resolution);
                let find = |d: Vec3| {
                    let place = buffer.place(d);
                    buffer.cell(place, place.u.floor() as i32, place.v.floor() as i32)
                };
                for (c, cell) in buffer.cells().iter().enumerate() {
                    assert_eq!(find(cell.direction), c, "{shape:?} {resolution}");
                    let group = &buffer.rays()[c / GROUP];
                    for rays in group {
                        let lane = c % GROUP;
                        let ray = Vec3::new(rays.x[lane], rays.y[lane], rays.z[lane]);
                        assert_eq!(find(ray), c, "{shape:?} {resolution}: {ray}");
                    }
                }
            }
        }
    }

    #[test]
    fn solid_angles_make_a_hemisphere() {
        for shape in SHAPES {
            let buffer = MicroBuffer::new(shape, 16);
            let cells = buffer.cells().iter();
            let sum: f32 = cells.map(|cell| buffer.solid_angle(cell.direction)).sum();
            // Lambert's cells at the rim are taken for smaller than they are: refined too much, never too little.
            let share = sum / std::f32::consts::TAU;
            assert!((0.85..1.05).contains(&share), "{shape:?}: {share}");
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
