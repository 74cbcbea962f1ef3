//! The nearest entry of a table, exactly: the hint where it is near enough, and by a tree of boxes where it is not.

use super::best::{Best, LEAST, MARGIN};
use super::boxes::Boxes;
use super::centres::Centres;
use super::lanes::{Eight, GROUP, Lanes, WIDTH, pad, squared, squared_of_eight, wide};
use super::principal::{Principal, Projected};
use crate::node::Error;
use rayon::prelude::*;

/// Most entries of a vector.
pub const DIMS: usize = 128;
/// Tables up to this size are compared with entry by entry.
const SMALL: usize = 32;
/// Squares from here on may overflow.
const TOO_FAR: f32 = 1e37;
/// A table that answers which entry is nearest.
///
/// Nearest is the least squared distance in f32 as `lanes::squared` sums it, and the lowest index among equal ones: the answer is
/// that of comparing with every entry, whatever the hint.
pub struct Quantizer {
    /// Power of two that brings the largest entry to [1, 2), so that squares neither overflow nor underflow.
    scale: f32,
    centres: Centres,
    projected: Projected,
    boxes: Boxes,
    /// Lower bound, by entry, of the distance of all others from it.
    apart: Vec<f32>,
}

impl Quantizer {
    /// Takes a table of vectors of `dims` numbers (1 to 128).
    ///
    /// # Errors
    /// When the table is empty or has numbers that are not finite, or not whole vectors.
    pub fn new(entries: &[f32], dims: usize) -> Result<Self, Error> {
        if !(1..=DIMS).contains(&dims) {
            return Err(Error::invalid(format!("vectors have 1 to {DIMS} numbers, not {dims}")));
        }
        if entries.is_empty() || !entries.len().is_multiple_of(dims) {
            return Err(Error::invalid("a table has at least one entry, and whole entries"));
        }
        if entries.iter().any(|x| !x.is_finite()) {
            return Err(Error::invalid("a table entry is not finite"));
        }
        let scale = scale(entries);
        let centres = Centres::new(entries, dims, scale);
        let axes = Principal::new(&centres.padded, dims);
        let projected = Projected::new(axes, &centres);
        let boxes = Boxes::new(&projected.points);
        let mut table = Quantizer { scale, centres, projected, boxes, apart: Vec::new() };
        table.part();
        Ok(table)
    }

    /// Takes the same number of entries that lie near the ones before, faster than [`Quantizer::new`].
    pub(super) fn follow(&mut self, entries: &[f32]) {
        self.centres = Centres::new(entries, self.centres.dims, self.scale);
        self.projected.follow(&self.centres);
        self.boxes = Boxes::new(&self.projected.points);
        self.part();
    }

    /// Measures how far the entries are from each other.
    fn part(&mut self) {
        let count = self.centres.count as u32;
        let apart = (0..count).into_par_iter().with_min_len(WIDTH).map(|c| apart(self, c));
        self.apart = apart.collect();
    }

    /// The entry nearest to `vector`. A `hint` near the answer (that of the vector before, or of the parent) makes it fast; any
    /// number is allowed. A vector farther than any number in f32 from all entries, or not finite, has entry 0.
    pub fn nearest(&self, vector: &[f32], hint: u32) -> u32 {
        let mut x = [Eight::default(); DIMS / WIDTH];
        let lanes = self.centres.dims.div_ceil(WIDTH);
        let x = &mut x[..lanes];
        pad(vector, self.scale, x);
        if self.centres.count <= SMALL {
            return compare_with_all(self, x);
        }
        let hint = if (hint as usize) < self.centres.count { hint } else { 0 };
        match lanes {
            4 => search_4(self, x, hint),
            5 => search_5(self, x, hint),
            _ => search_any(self, x, hint),
        }
    }

    /// The entry nearest to `vector`, by comparing with every entry.
    pub fn nearest_of_all(&self, vector: &[f32]) -> u32 {
        let mut x = [Eight::default(); DIMS / WIDTH];
        pad(vector, self.scale, &mut x[..self.centres.dims.div_ceil(WIDTH)]);
        compare_with_all(self, &x)
    }
}

/// The power of two that brings the largest of `numbers` to [1, 2); 1 if all are zero.
pub fn scale(numbers: &[f32]) -> f32 {
    let largest = numbers.iter().fold(0.0f32, |a, x| a.max(x.abs()));
    let exponent = (largest.to_bits() >> 23) as i32 - 127;
    if largest > 0.0 {
        f32::from_bits(((127 - exponent.clamp(-126, 126)) as u32) << 23)
    } else {
        1.0
    }
}

wide! { fn apart(table: &Quantizer, centre: u32) -> f32 = nearest_other }
wide! { fn search_4(table: &Quantizer, x: &[Eight], hint: u32) -> u32 = search<4> }
wide! { fn search_5(table: &Quantizer, x: &[Eight], hint: u32) -> u32 = search<5> }
wide! { fn search_any(table: &Quantizer, x: &[Eight], hint: u32) -> u32 = search<0> }
wide! { fn compare_with_all(table: &Quantizer, x: &[Eight]) -> u32 = all }

/// Lower bound of the distance of the other entries from `centre`.
#[inline(always)]
fn nearest_other<L: Lanes>(table: &Quantizer, centre: u32) -> f32 {
    let Quantizer { centres, projected, boxes, .. } = table;
    let x = centres.get(centre, centres.dims.div_ceil(WIDTH));
    let other = boxes.beside(centre);
    if other == centre {
        return f32::INFINITY;
    }
    let [square, ..] = squared::<L>(x, [centres.get(other, x.len()); GROUP]);
    let mut best = Best::other_than::<L>(centre, centres, projected, x, (other, square));
    match boxes.search::<L>(&mut best) {
        true => (best.square.sqrt() * (1.0 - MARGIN) - LEAST).max(0.0),
        false => 0.0,
    }
}

/// `N` lanes a vector; 0 stands for any number of them.
#[inline(always)]
fn search<L: Lanes, const N: usize>(table: &Quantizer, x: &[Eight], hint: u32) -> u32 {
    let x = if N == 0 { x } else { &x[..N] };
    let [square, ..] = squared::<L>(x, [table.centres.get(hint, x.len()); GROUP]);
    if square.is_nan() || square >= TOO_FAR {
        return all::<L>(table, x);
    }
    // An entry that is as near as the hint is at most twice as far from the hint.
    if table.apart[hint as usize] > 2.0 * square.sqrt() * (1.0 + MARGIN) + LEAST {
        return hint;
    }
    let mut best = Best::new::<L>(&table.centres, &table.projected, x, (hint, square));
    if table.boxes.search::<L>(&mut best) {
        return best.entry;
    }
    all::<L>(table, x)
}

#[inline(always)]
fn all<L: Lanes>(table: &Quantizer, x: &[Eight]) -> u32 {
    let (mut best, mut square) = (0, f32::INFINITY);
    let mut least = L::splat(square);
    for (at, block) in table.centres.blocked.chunks_exact(table.centres.dims).enumerate() {
        let squares: L = squared_of_eight(x, block);
        if squares.less(least) != 0 {
            for (lane, other) in squares.store().into_iter().enumerate() {
                if other < square {
                    (best, square) = ((at * WIDTH + lane) as u32, other);
                }
            }
            least = L::splat(square);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{flat, noise, walk};
    use super::*;

    /// The definition: compare with every entry, in the order of [`super::super::lanes::squared`].
    fn plain(vector: &[f32], entries: &[f32], dims: usize) -> u32 {
        let square = |entry: &[f32]| {
            let mut s = [0f32; WIDTH];
            for (i, (x, e)) in vector.iter().zip(entry).enumerate() {
                s[i % WIDTH] += (x - e) * (x - e);
            }
            ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
        };
        let squares: Vec<f32> = entries.chunks_exact(dims).map(square).collect();
        (0..squares.len() as u32)
            .min_by(|&a, &b| squares[a as usize].total_cmp(&squares[b as usize]))
            .unwrap()
    }

    fn check(vectors: &[f32], entries: &[f32], dims: usize) {
        let table = Quantizer::new(entries, dims).unwrap();
        let mut last = 0;
        for (i, vector) in (0u32..).zip(vectors.chunks_exact(dims)) {
            let expected = plain(vector, entries, dims);
            last = table.nearest(vector, last);
            assert_eq!(last, expected);
            assert_eq!(table.nearest(vector, i.wrapping_mul(2_654_435_761)), expected, "any hint");
            assert_eq!(table.nearest_of_all(vector), expected);
        }
    }

    #[test]
    fn the_answer_is_that_of_comparing_with_all() {
        for (dims, count) in
            [(27, 3000), (36, 500), (9, 700), (100, 100), (4, 33), (1, 40), (27, 5), (3, 1)]
        {
            check(&walk(400, dims, 1), &walk(count, dims, 2), dims);
            check(&noise(100 * dims, 3), &noise(count * dims, 4), dims);
        }
    }

    #[test]
    fn far_vectors_have_the_same_answer() {
        let entries = flat(3000, 36, 1);
        for (by, far) in [(1.0, 0.0), (1.0, 0.3), (3.0, 0.0), (-1.0, 2.0), (1e4, -7.0), (1e12, 0.0)]
        {
            let vectors: Vec<f32> = flat(150, 36, 2).iter().map(|x| by * x + far).collect();
            check(&vectors, &entries, 36);
        }
    }

    #[test]
    fn degenerate_tables_have_the_same_answer() {
        let one_axis: Vec<f32> = noise(900, 1).into_iter().flat_map(|x| [0.0, x, 0.0]).collect();
        let steps: Vec<f32> = (0..600).map(|i| (i % 40) as f32).collect();
        let mut nearly_equal = noise(36, 2).repeat(200);
        nearly_equal.iter_mut().step_by(131).for_each(|x| *x *= 1.0 + f32::EPSILON);
        for (entries, dims) in [
            (noise(36, 1).repeat(200), 36),
            (nearly_equal, 36),
            (one_axis, 3),
            (steps, 1),
            (vec![0.0; 27 * 100], 27),
        ] {
            check(&noise(50 * dims, 3), &entries, dims);
            check(&entries, &entries, dims);
        }
    }

    #[test]
    fn numbers_of_all_sizes_have_the_same_answer() {
        let sizes = |from: f32, to: f32| -> Vec<f32> {
            let size = |(i, x): (usize, &f32)| x * if i / 9 % 2 == 0 { from } else { to };
            walk(300, 9, 1).iter().enumerate().map(size).collect()
        };
        for (from, to) in [(1e30, 1e30), (1e-30, 1e-30), (1e30, 1e-30), (1.0, 1e-18), (1e38, 1e19)]
        {
            let table = Quantizer::new(&sizes(from, to), 9).unwrap();
            for by in [from, to, 1e-38, 1e20, 1e38] {
                for (hint, vector) in (0..).step_by(7).zip(walk(100, 9, 2).chunks_exact(9)) {
                    let vector: Vec<f32> = vector.iter().map(|x| x * by).collect();
                    assert_eq!(table.nearest(&vector, hint), table.nearest_of_all(&vector));
                }
            }
        }
    }

    #[test]
    fn numbers_without_axes_have_the_same_answer() {
        // As many directions as numbers: boxes along some of them tell little.
        check(&noise(20 * 64, 3), &noise(6000 * 64, 1), 64);
        // All entries are about equally far from a vector in their midst.
        check(&[0.5; 64], &noise(6000 * 64, 1), 64);
    }

    #[test]
    fn the_lowest_of_equal_entries_is_taken() {
        let one = noise(27, 1);
        let entries: Vec<f32> = one.iter().copied().cycle().take(27 * 50).collect();
        let table = Quantizer::new(&entries, 27).unwrap();
        assert_eq!(table.nearest(&one, 49), 0);
        assert_eq!(table.nearest(&noise(27, 2), 30), 0);
        // On a grid, most distances are equal to several others.
        let grid: Vec<f32> =
            (0..4096).flat_map(|i| [i % 16, i / 16 % 16, i / 256]).map(|x| x as f32).collect();
        let between: Vec<f32> = grid.iter().map(|x| x + 0.5).collect();
        check(&between, &grid, 3);
    }

    #[test]
    fn scale_does_not_matter() {
        let (vectors, entries) = (walk(200, 27, 1), walk(300, 27, 2));
        let answers = |exponent: i32| -> Vec<u32> {
            let by = |all: &[f32]| all.iter().map(|x| x * 2f32.powi(exponent)).collect::<Vec<_>>();
            let table = Quantizer::new(&by(&entries), 27).unwrap();
            by(&vectors).chunks_exact(27).map(|v| table.nearest(v, 0)).collect()
        };
        for exponent in [-100, -40, 40, 100] {
            assert_eq!(answers(exponent), answers(0));
        }
    }

    #[test]
    fn an_entry_is_its_own_nearest() {
        let entries = walk(1000, 36, 5);
        let table = Quantizer::new(&entries, 36).unwrap();
        for (entry, i) in entries.chunks_exact(36).zip(0..) {
            assert_eq!(table.nearest(entry, 999 - i), i);
        }
    }

    #[test]
    fn what_is_not_a_number_or_too_far_has_entry_zero() {
        let table = Quantizer::new(&walk(100, 9, 1), 9).unwrap();
        for strange in [f32::NAN, f32::INFINITY, f32::MAX] {
            assert_eq!(table.nearest(&[strange; 9], 50), 0);
        }
        assert_eq!(Quantizer::new(&[0.0; 9 * 40], 9).unwrap().nearest(&[1.0; 9], 7), 0);
        for (entries, dims) in [(&[][..], 3), (&[1.0, 2.0], 3), (&[f32::NAN], 1), (&[1.0], 0)] {
            assert!(Quantizer::new(entries, dims).is_err());
        }
        assert!(Quantizer::new(&[0.0; 129], 129).is_err());
    }

    #[test]
    fn moved_entries_are_followed() {
        let mut entries = walk(6000, 9, 1);
        let vectors = walk(300, 9, 2);
        let mut table = Quantizer::new(&entries, 9).unwrap();
        for round in 0..6 {
            let by = noise(entries.len(), 10 + round);
            entries.iter_mut().zip(by).for_each(|(x, by)| *x += 0.02 * (by - 0.5));
            // One that jumps to the other end.
            let jump = round as usize * 700;
            entries.copy_within(0..9, (jump + 90) * 9);
            table.follow(&entries);
            for vector in vectors.chunks_exact(9) {
                assert_eq!(table.nearest(vector, (jump + 90) as u32), plain(vector, &entries, 9));
            }
        }
    }
}
