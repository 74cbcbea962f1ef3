//! The vectors of inner nodes: one each, or an index each into a table of representative ones (Buchholz and Boubekeur 2012, section 3).

use super::super::bits;
use super::super::harmonics::{basis, dot, functions, with_functions};
use super::super::stream::dimensions;
use glam::Vec3;

/// Vectors by the number of their inner node.
#[derive(Clone, Copy, Debug)]
pub struct Vectors<'a> {
    /// Bands of their spherical harmonics, 1 to 5.
    pub bands: u32,
    /// Vectors of [`dimensions`] numbers: of the nodes, or the table.
    pub rows: &'a [f32],
    /// For each node the row it has; none where each has its own.
    pub indices: Option<Indices<'a>>,
}

/// Packed indices ([`bits`]).
#[derive(Clone, Copy, Debug)]
pub struct Indices<'a> {
    /// As [`bits::pack`] gives them.
    pub packed: &'a [u64],
    /// Bits of each.
    pub width: u32,
}

/// Least share of the mean projected area by which radiance is divided: where less faces a direction, the ringing of few bands decides.
const LEAST: f32 = 1.0 / 16.0;

impl Vectors<'_> {
    /// The vector of inner node `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[f32] {
        let row =
            self.indices.map_or(i, |indices| bits::get(indices.packed, indices.width, i) as usize);
        let length = dimensions(self.bands);
        &self.rows[row * length..(row + 1) * length]
    }

    /// Mean radiance that inner node `i` sends towards a unit vector, and the share of its area that faces it (the mean of the clamped
    /// cosines). Neither is negative. Where the share vanishes, their product does so continuously.
    #[inline(always)]
    pub fn sent(&self, i: usize, direction: Vec3) -> (Vec3, f32) {
        let row = self.row(i);
        with_functions!(self.bands, F => sent::<F>(row, direction))
    }
}

#[inline(always)]
fn sent<const F: usize>(row: &[f32], direction: Vec3) -> (Vec3, f32) {
    debug_assert_eq!(row.len(), 4 * F);
    let at = basis::<F>(direction);
    let channel = |k: usize| dot(&row[k * F..(k + 1) * F], &at).max(0.0);
    let share = channel(3);
    let mean = row[3 * F] * at[0];
    let divisor = share.max(mean * LEAST);
    if share > 0.0 {
        (Vec3::new(channel(0), channel(1), channel(2)) / divisor, share)
    } else {
        (Vec3::ZERO, 0.0)
    }
}

/// Bytes of one unquantized vector without its part for projected area, as the paper counts: colours only.
pub const fn colour_bytes(bands: u32) -> u64 {
    4 * 3 * functions(bands) as u64
}
