//! What a receiver sees, painted front to back: sorted once for all cells, so that each cell is composited as it is covered and
//! what lies behind a full one costs nothing more. The result has the bits of [`Fragments`](super::fragments::Fragments).

use super::buffer::MicroBuffer;
use super::fragments::closed;
use crate::kernel::lanes::WIDTH;
use glam::Vec3;

/// Something that covers cells, in the numbers that lanes give for a receiver:
///
/// - what is small: a patch and a place on it (u, v), around which it covers a square of twice `half` cells a side, a
///   share in cosine-weighted solid angle, and radiance (red, green, blue); or
/// - a part of a disc: [`PART`], a cell, zero, zero, how much of the cell, and radiance.
pub(super) type Layer = [f32; WIDTH];

/// What the first number of a part of a disc is. Cells are fewer than the 2^24 that its second can tell apart.
pub(super) const PART: f32 = -1.0;

/// What one receiver sees; kept from receiver to receiver, so that gathering allocates nothing.
#[derive(Debug, Default)]
pub(super) struct Layers {
    list: Vec<Layer>,
    /// Depth and index of each.
    order: Vec<u64>,
}

impl Layers {
    pub(super) fn clear(&mut self) {
        self.list.clear();
        self.order.clear();
    }

    /// Adds a layer at a depth, which must not be negative; of equal depths the one that comes first is in front.
    #[inline(always)]
    pub(super) fn push(&mut self, depth: f32, layer: Layer) {
        // A depth that is no number is nowhere.
        if depth >= 0.0 {
            // The bits of floats that are not negative are in the order of the floats.
            let index = self.list.len() as u64;
            self.order.push(u64::from(depth.to_bits()) << 32 | index);
            self.list.push(layer);
        }
    }
}

/// What is painted so far of a cell.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(super) struct Painted {
    /// Radiance times coverage.
    pub(super) radiance: Vec3,
    sum: f32,
    /// The share that is covered.
    pub(super) covered: f32,
    /// The weight of the cell.
    weight: f32,
}

impl Painted {
    /// Covers a share of the cell; says whether that fills it.
    #[inline(always)]
    fn cover(&mut self, coverage: f32, radiance: Vec3, full: f32) -> bool {
        // A coverage that is no number is none.
        if coverage > 0.0 {
            self.sum += coverage;
            let now = closed(self.sum, full);
            self.radiance += radiance * (now - self.covered);
            self.covered = now;
        }
        self.covered >= 1.0
    }
}

/// The cells of one receiver.
#[derive(Debug, Default)]
pub(super) struct Painting {
    cells: Vec<Painted>,
    /// 1 at each place of the buffer's table whose cell is not full, so that a row of a splat is asked for at once; a few more
    /// places, so that the last can be read as others are.
    open: Vec<u8>,
}

/// Most cells of a splat along an axis.
const SIDE: usize = 3;
/// Bits from row to row of a splat's flags.
const ROW: usize = 20;

impl Painting {
    /// Paints layers into cells that are empty, full from a coverage of `full` on. Cells of which `hidden` says so stay
    /// empty. Gives the number of parts of cells that were painted.
    #[inline(always)]
    pub(super) fn paint(
        &mut self,
        layers: &mut Layers,
        buffer: &MicroBuffer,
        full: f32,
        hidden: impl Fn(Vec3) -> bool,
    ) -> u64 {
        let Painting { cells, open } = self;
        cells.clear();
        cells.extend(buffer.cells().iter().map(|cell| Painted {
            radiance: Vec3::ZERO,
            sum: 0.0,
            covered: if hidden(cell.direction) { 1.0 } else { 0.0 },
            weight: cell.weight,
        }));
        open.clear();
        open.extend(
            buffer.table().iter().map(|&cell| u8::from(cells[cell as usize].covered < 1.0)),
        );
        open.resize(open.len() + buffer.margin() + size_of::<u32>(), 0);
        let mut left = cells.iter().filter(|cell| cell.covered < 1.0).count();
        let mut parts = 0;
        layers.order.sort_unstable();
        for &key in &layers.order {
            if left == 0 {
                break;
            }
            let [patch, u, v, half, share, red, green, blue] = layers.list[key as u32 as usize];
            let radiance = Vec3::new(red, green, blue);
            if patch == PART {
                let number = u as u32;
                let cell = &mut cells[number as usize];
                if cell.covered < 1.0 {
                    parts += 1;
                    if cell.cover(share, radiance, full) {
                        left -= 1;
                        buffer.places_of(number).iter().for_each(|&at| open[at as usize] = 0);
                    }
                }
                continue;
            }
            let rows = buffer.rows(patch as usize);
            let (low_u, high_u) = (u - half, u + half);
            let (low_v, high_v) = (v - half, v + half);
            let (start, end) = (rows.column(below(low_u)), rows.column(below(high_u)));
            let (top, bottom) = (rows.row(below(low_v)), rows.row(below(high_v)));
            // The lowest bit of each byte, as many as there are columns.
            let columns = 0x01_01_01 >> (8 * (SIDE - 1 - (end - start).min(SIDE - 1)));
            let at: [usize; SIDE] =
                std::array::from_fn(|k| rows.first + (top + k) * rows.width + start);
            let mut flags = (0..SIDE).fold(0, |flags, k| {
                let row = open[at[k]..].first_chunk().map_or(0, |&b| u32::from_le_bytes(b));
                let row = if top + k <= bottom { row & columns } else { 0 };
                flags | u64::from(row) << (ROW * k)
            });
            let shares: [f32; SIDE] = std::array::from_fn(|k| {
                let i = (start + k) as f32 - 1.0;
                share * (high_u.min(i + 1.0) - low_u.max(i))
            });
            while flags != 0 {
                let bit = flags.trailing_zeros() as usize;
                flags &= flags - 1;
                let (row, column) = (bit / ROW, bit % ROW / 8);
                let number = buffer.table()[at[row] + column];
                let cell = &mut cells[number as usize];
                // A border can lead to a cell that this splat has just filled.
                if cell.covered < 1.0 {
                    parts += 1;
                    let j = (top + row) as f32 - 1.0;
                    let tall = high_v.min(j + 1.0) - low_v.max(j);
                    let coverage = shares[column] * tall / cell.weight;
                    if cell.cover(coverage, radiance, full) {
                        left -= 1;
                        buffer.places_of(number).iter().for_each(|&at| open[at as usize] = 0);
                    }
                }
            }
        }
        parts
    }

    /// The cells, in their order.
    pub(super) fn cells(&self) -> &[Painted] {
        &self.cells
    }
}

/// The integer below a cell coordinate, which is at least -1. Without SSE4.1 `floor` is a call.
#[inline]
pub(super) fn below(coordinate: f32) -> i32 {
    (coordinate + 1.0) as i32 - 1
}
