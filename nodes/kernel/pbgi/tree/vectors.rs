//! The vectors of inner nodes: one each, or an index each into a table of representative ones (Buchholz and Boubekeur 2012, section 3).

use super::super::bits;
use super::super::harmonics::{basis, basis_at, dot, functions, with_functions};
use super::super::stream::dimensions;
use crate::kernel::lanes::{Lanes, Triple};
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

    /// [`Vectors::sent`] towards one unit vector a lane, the same bits.
    #[inline(always)]
    pub fn sent_to_each<L: Lanes>(&self, i: usize, directions: Triple<L>) -> (Triple<L>, L) {
        let row = self.row(i);
        with_functions!(self.bands, F => sent_to_each::<L, F>(row, directions))
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

#[inline(always)]
fn sent_to_each<L: Lanes, const F: usize>(row: &[f32], d: Triple<L>) -> (Triple<L>, L) {
    debug_assert_eq!(row.len(), 4 * F);
    let at = basis_at::<L, F>(d.x, d.y, d.z);
    let none = L::splat(0.0);
    let share = channel(&row[3 * F..], &at);
    let mean = L::splat(row[3 * F]) * at[0];
    let divisor = (mean * L::splat(LEAST)).max(share);
    let faces = share.gt(none);
    let x = (channel(row, &at) / divisor).or(faces, none);
    let y = (channel(&row[F..], &at) / divisor).or(faces, none);
    let z = (channel(&row[2 * F..], &at) / divisor).or(faces, none);
    (Triple { x, y, z }, share)
}

/// The function of the first `F` coefficients where the basis was evaluated, not negative; no closure, which would not be compiled for the
/// instruction set of its surroundings.
#[inline(always)]
fn channel<L: Lanes, const F: usize>(coefficients: &[f32], at: &[L; F]) -> L {
    let mut sum = L::splat(0.0);
    for (&c, &b) in coefficients.iter().zip(at) {
        sum = sum + b * L::splat(c);
    }
    sum.max(L::splat(0.0))
}

/// Bytes of one unquantized vector without its part for projected area, as the paper counts: colours only.
pub const fn colour_bytes(bands: u32) -> u64 {
    4 * 3 * functions(bands) as u64
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::unit_vectors;
    use super::*;
    use crate::kernel::lanes::{Portable, WIDTH};

    #[test]
    fn eight_receivers_are_sent_what_each_alone_is() {
        let noise = unit_vectors(2000, 11);
        let rows: Vec<f32> = noise.iter().flat_map(|v| v.to_array()).collect();
        let packed = bits::pack((0..50).map(|i| i * 7 % 40), 6);
        for bands in 1..=5 {
            for indices in [None, Some(Indices { packed: &packed, width: 6 })] {
                let vectors = Vectors { bands, rows: &rows, indices };
                let mut sends = 0;
                for (i, directions) in noise.as_chunks::<WIDTH>().0.iter().take(50).enumerate() {
                    let (radiance, share) =
                        vectors.sent_to_each(i, Triple::<Portable>::load(directions));
                    let (radiance, share) = (radiance.store(), share.store());
                    for lane in 0..WIDTH {
                        let alone = vectors.sent(i, directions[lane]);
                        assert_eq!((radiance[lane], share[lane]), alone, "{bands} {i} {lane}");
                        sends += u32::from(alone.1 > 0.0);
                    }
                }
                assert!((1..400).contains(&sends), "{sends}");
            }
        }
    }
}
