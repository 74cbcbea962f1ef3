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

/// A column that waits, and in whose sums it counts.
struct Use<'a> {
    column: usize,
    user: usize,
    /// The first frame that it counts in, and its weight in that and those that follow.
    from: usize,
    weights: &'a [Vec3],
}

/// Columns of one tile that wait to be added to sums.
pub struct Waiting<'a> {
    columns: [TileColumn; TOGETHER],
    uses: Vec<Use<'a>>,
    count: usize,
}

impl<'a> Waiting<'a> {
    /// No columns yet.
    pub fn new() -> Self {
        Waiting { columns: [[Vec3::ZERO; Ends::CAPACITY]; TOGETHER], uses: Vec::new(), count: 0 }
    }

    /// Room for the next column, which may hold anything.
    pub fn room(&mut self) -> &mut TileColumn {
        &mut self.columns[self.count]
    }

    /// Says that the column just written in [`Waiting::room`] counts in sums of `user`: in those of the frames from
    /// `from` on, with a weight in each.
    pub fn count_in(&mut self, user: usize, from: usize, weights: &'a [Vec3]) {
        self.uses.push(Use { column: self.count, user, from, weights });
    }

    /// Keeps the column just written; true when there is no room for another.
    pub fn keep(&mut self) -> bool {
        self.count += 1;
        self.count == TOGETHER
    }

    /// Adds what waits to the sums, `[user][frame][pixel]` with `pixels` pixels a frame, from pixel `at` on, and waits
    /// for more. At most `pixels - at` pixels of the tile count.
    pub fn add(&mut self, sums: &mut [Vec<Vec3>], pixels: usize, at: usize) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.add_with_avx2(sums, pixels, at) };
        }
        self.add_lanes(sums, pixels, at);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_with_avx2(&mut self, sums: &mut [Vec<Vec3>], pixels: usize, at: usize) {
        self.add_lanes(sums, pixels, at);
    }

    #[inline(always)]
    fn add_lanes(&mut self, sums: &mut [Vec<Vec3>], pixels: usize, at: usize) {
        let len = (pixels - at).min(Ends::CAPACITY);
        let mut terms = Vec::with_capacity(TOGETHER);
        for (user, sums) in sums.iter_mut().enumerate() {
            for (frame, sum) in sums.chunks_exact_mut(pixels.max(1)).enumerate() {
                terms.clear();
                for uses in self.uses.iter().filter(|uses| uses.user == user) {
                    let weight = frame.checked_sub(uses.from).and_then(|k| uses.weights.get(k));
                    terms
                        .extend(weight.map(|weight| Term::new(&self.columns[uses.column], weight)));
                }
                add_terms(&mut sum[at..at + len], &terms);
            }
        }
        self.uses.clear();
        self.count = 0;
    }
}

impl Default for Waiting<'_> {
    fn default() -> Self {
        Waiting::new()
    }
}

/// What is added to the sum of one frame: a column as flat numbers, and its weight for each of a run of them.
struct Term<'a> {
    column: &'a [f32],
    weight: [f32; RUN],
}

impl<'a> Term<'a> {
    #[inline(always)]
    fn new(column: &'a TileColumn, weight: &Vec3) -> Self {
        let [x, y, z] = weight.to_array();
        let weight = [x, y, z, x, y, z, x, y, z, x, y, z, x, y, z, x, y, z, x, y, z, x, y, z];
        Term { column: bytemuck::cast_slice(column), weight }
    }
}

/// `sum += weight * column` for each term, per channel.
#[inline(always)]
fn add_terms(sum: &mut [Vec3], terms: &[Term<'_>]) {
    if terms.is_empty() {
        return;
    }
    let (runs, rest) = bytemuck::cast_slice_mut::<Vec3, f32>(sum).as_chunks_mut::<RUN>();
    for (r, run) in runs.iter_mut().enumerate() {
        let mut total = *run;
        for Term { column, weight } in terms {
            let column = &column[r * RUN..][..RUN];
            for ((total, weight), number) in total.iter_mut().zip(weight).zip(column) {
                *total += weight * number;
            }
        }
        *run = total;
    }
    let first = runs.len() * RUN;
    for (i, number) in rest.iter_mut().enumerate() {
        for Term { column, weight } in terms {
            *number += weight[i] * column[first + i];
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
        // The first serves frame 1 or both, the second its only one.
        let weights: Vec<Vec<Vec3>> = (0..2 * TOGETHER + 3)
            .map(|n| (0..2).map(|f| Vec3::new(n as f32, 0.5 * f as f32, -1.0)).collect())
            .collect();
        let mut waiting = Waiting::new();
        let mut sums = vec![vec![Vec3::ONE; 2 * pixels], vec![Vec3::ZERO; pixels]];
        let mut expected = sums.clone();
        for (n, weights) in weights.iter().enumerate() {
            let column: TileColumn =
                std::array::from_fn(|i| Vec3::new(i as f32, n as f32, 1.0 / (i + n + 1) as f32));
            *waiting.room() = column;
            let from = n % 2;
            for (user, from, weights) in [(0, from, &weights[from..]), (1, 0, &weights[..1])] {
                waiting.count_in(user, from, weights);
                for (k, weight) in weights.iter().enumerate() {
                    for i in 0..pixels - at {
                        expected[user][(from + k) * pixels + at + i] += *weight * column[i];
                    }
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
