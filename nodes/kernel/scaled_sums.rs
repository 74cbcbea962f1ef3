//! Sums of scaled columns of the lighting tensor, tile by tile, for all frames that the columns serve
//! (Hašan et al. 2008, section 4.5, where the scale is an element of the reconstruction matrix).

use super::visibility::Ends;
use glam::Vec3;

/// Columns that are added together: each number of a sum is read and written once for all of them.
const TOGETHER: usize = 16;

/// Numbers of eight pixels, a whole number of vectors of four and of eight.
const RUN: usize = 24;

/// One tile's part of a column.
pub type TileColumn = [Vec3; Ends::CAPACITY];

/// What is added to the sum of one frame: a column of those at hand, and its weight.
type Term = (usize, Vec3);

/// Columns of one tile that wait to be added to sums.
pub struct Waiting {
    columns: [TileColumn; TOGETHER],
    /// For each sum `[user][frame]`, its terms in the order in which they came.
    terms: Vec<Vec<Vec<Term>>>,
    count: usize,
}

impl Waiting {
    /// No columns yet; `frames` are the numbers of frames of each user.
    pub fn new(frames: impl Iterator<Item = usize>) -> Self {
        let terms = frames.map(|frames| vec![Vec::with_capacity(TOGETHER); frames]).collect();
        Waiting { columns: [[Vec3::ZERO; Ends::CAPACITY]; TOGETHER], terms, count: 0 }
    }

    /// Room for the next column, which may hold anything.
    pub fn room(&mut self) -> &mut TileColumn {
        &mut self.columns[self.count]
    }

    /// Says that the column just written in [`Waiting::room`] counts in the sum of `user` and `frame`.
    pub fn term(&mut self, user: usize, frame: usize, weight: Vec3) {
        self.terms[user][frame].push((self.count, weight));
    }

    /// Keeps the column just written; true when there is no room for another.
    pub fn keep(&mut self) -> bool {
        self.count += 1;
        self.count == TOGETHER
    }

    /// Adds what waits to the sums, `[user][frame][pixel]` with `pixels` pixels a frame, from pixel `at` on, and waits
    /// for more. At most `pixels - at` pixels of the tile count.
    pub fn add(&mut self, sums: &mut [Vec<Vec3>], pixels: usize, at: usize) {
        let len = (pixels - at).min(Ends::CAPACITY);
        for (terms, sums) in self.terms.iter_mut().zip(sums) {
            for (terms, sum) in terms.iter_mut().zip(sums.chunks_exact_mut(pixels.max(1))) {
                add_terms(&mut sum[at..at + len], &self.columns, terms);
                terms.clear();
            }
        }
        self.count = 0;
    }
}

/// `sum += weight * column` for each term, per channel.
fn add_terms(sum: &mut [Vec3], columns: &[TileColumn; TOGETHER], terms: &[Term]) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has just been found to have what the function is compiled for.
        return unsafe { add_terms_with_avx2(sum, columns, terms) };
    }
    add_terms_lanes(sum, columns, terms);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn add_terms_with_avx2(sum: &mut [Vec3], columns: &[TileColumn; TOGETHER], terms: &[Term]) {
    add_terms_lanes(sum, columns, terms);
}

#[inline(always)]
fn add_terms_lanes(sum: &mut [Vec3], columns: &[TileColumn; TOGETHER], terms: &[Term]) {
    if terms.is_empty() {
        return;
    }
    let pattern = |weight: Vec3| -> [f32; RUN] { std::array::from_fn(|i| weight[i % 3]) };
    let (runs, rest) = bytemuck::cast_slice_mut::<Vec3, f32>(sum).as_chunks_mut::<RUN>();
    for (r, run) in runs.iter_mut().enumerate() {
        let mut total = *run;
        for &(column, weight) in terms {
            let column: &[f32] = bytemuck::cast_slice(&columns[column]);
            let (column, weight) = (&column[r * RUN..][..RUN], pattern(weight));
            (0..RUN).for_each(|i| total[i] += weight[i] * column[i]);
        }
        *run = total;
    }
    let first = runs.len() * RUN;
    for (i, number) in rest.iter_mut().enumerate() {
        for &(column, weight) in terms {
            let column: &[f32] = bytemuck::cast_slice(&columns[column]);
            *number += weight[i % 3] * column[first + i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_pixels() {
        // Two users, of two frames and one; a tile of 11 pixels behind 64 others.
        let (pixels, at) = (75, 64);
        let mut waiting = Waiting::new([2, 1].into_iter());
        let mut sums = vec![vec![Vec3::ONE; 2 * pixels], vec![Vec3::ZERO; pixels]];
        let mut expected = sums.clone();
        let weight = |n: usize, f: usize| Vec3::new(n as f32, 0.5 * f as f32, -1.0);
        for n in 0..2 * TOGETHER + 3 {
            let column: TileColumn =
                std::array::from_fn(|i| Vec3::new(i as f32, n as f32, 1.0 / (i + n + 1) as f32));
            *waiting.room() = column;
            for (user, frame) in [(0, n % 2), (1, 0)] {
                waiting.term(user, frame, weight(n, frame));
                for i in 0..pixels - at {
                    expected[user][frame * pixels + at + i] += weight(n, frame) * column[i];
                }
            }
            if waiting.keep() {
                waiting.add(&mut sums, pixels, at);
            }
        }
        waiting.add(&mut sums, pixels, at);
        assert_eq!(sums, expected);
    }
}
