//! The cells of a micro-buffer: the hemisphere over a receiver cut into directions (Buchholz and Boubekeur 2012,
//! section 1.1: "Lambert-warped 2D buffers or clamped cube map buffers").
//!
//! Local coordinates throughout: the receiver at the origin, its normal along +Z.

mod making;

use glam::Vec3;
use std::f64::consts::FRAC_PI_4;

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
/// Rays of a cell with which large discs are cast.
pub(super) const RAYS: usize = 4;
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
}
