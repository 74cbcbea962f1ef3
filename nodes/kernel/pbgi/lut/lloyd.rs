//! The rounds of Lloyd: every vector to its nearest entry, every entry to the mean of its vectors.

use super::Tick;
use super::nearest::{DIMS, Quantizer};
use crate::node::Error;
use rayon::prelude::*;
use std::collections::HashSet;

/// Vectors of one piece of work and of one partial sum.
const CHUNK: usize = 4096;

/// What the entries are fitted to.
pub(super) struct Training<'a> {
    pub(super) vectors: &'a [f32],
    pub(super) dims: usize,
    pub(super) weights: Vec<f32>,
    /// For each vector the first that equals it.
    pub(super) first: Vec<u32>,
}

impl Training<'_> {
    /// The entries after up to `rounds` rounds, and the inertia before each.
    pub(super) fn lloyd(
        &self,
        mut entries: Vec<f32>,
        rounds: u32,
        tick: &Tick,
    ) -> Result<(Vec<f32>, Vec<f64>), Error> {
        let mut inertia: Vec<f64> = Vec::new();
        if entries.is_empty() || rounds == 0 {
            return Ok((entries, inertia));
        }
        let mut nearest = vec![0; self.weights.len()];
        let mut before = Vec::new();
        let mut table = Quantizer::new(&entries, self.dims)?;
        for round in 0..rounds {
            let beat = || tick(u64::from(round), u64::from(rounds));
            self.assign(&table, &mut nearest, round == 0, &beat)?;
            let squares = self.squares(&entries, &nearest);
            let total = self.weighted(&squares);
            if inertia.last().is_some_and(|&last| total >= last) {
                // Nothing but rounding is left to gain.
                return Ok((before, inertia));
            }
            inertia.push(total);
            let means = self.means(&entries, &nearest, &squares);
            before = std::mem::replace(&mut entries, means);
            if round + 1 < rounds {
                table.follow(&entries);
            }
        }
        Ok((entries, inertia))
    }

    /// Gives every vector its nearest entry, starting from that of the round before, or of the vector before in the first round.
    fn assign(
        &self,
        table: &Quantizer,
        nearest: &mut [u32],
        first: bool,
        beat: &(impl Fn() -> Result<(), Error> + Sync),
    ) -> Result<(), Error> {
        let vectors = self.vectors.par_chunks(CHUNK * self.dims);
        nearest.par_chunks_mut(CHUNK).zip(vectors).try_for_each(|(nearest, vectors)| {
            beat()?;
            let mut last = 0;
            for (nearest, vector) in nearest.iter_mut().zip(vectors.chunks_exact(self.dims)) {
                last = table.nearest(vector, if first { last } else { *nearest });
                *nearest = last;
            }
            Ok(())
        })
    }

    /// The squared distance of every vector from its entry.
    fn squares(&self, entries: &[f32], nearest: &[u32]) -> Vec<f64> {
        let square = |(vector, &at): (&[f32], &u32)| {
            let entry = &entries[at as usize * self.dims..(at as usize + 1) * self.dims];
            vector.iter().zip(entry).map(|(&x, &e)| (f64::from(x) - f64::from(e)).powi(2)).sum()
        };
        let vectors = self.vectors.par_chunks_exact(self.dims);
        vectors.zip(nearest).with_min_len(CHUNK).map(square).collect()
    }

    /// The sum over the vectors of weight times square.
    fn weighted(&self, squares: &[f64]) -> f64 {
        let sum = |(squares, weights): (&[f64], &[f32])| -> f64 {
            squares.iter().zip(weights).map(|(square, &weight)| f64::from(weight) * square).sum()
        };
        squares.chunks(CHUNK).zip(self.weights.chunks(CHUNK)).map(sum).sum()
    }

    /// The mean of the vectors of each entry, summed in the order of the vectors.
    fn means(&self, entries: &[f32], nearest: &[u32], squares: &[f64]) -> Vec<f32> {
        let (start, members) = by_entry(nearest, entries.len() / self.dims);
        let mut means = entries.to_vec();
        means.par_chunks_mut(self.dims).enumerate().with_min_len(16).for_each(|(at, mean)| {
            let members = &members[start[at] as usize..start[at + 1] as usize];
            let mut sums = [0.0; DIMS];
            let mut all = 0.0;
            for &i in members {
                let i = i as usize;
                let weight = f64::from(self.weights[i]);
                let vector = &self.vectors[i * self.dims..(i + 1) * self.dims];
                for (sum, &x) in sums.iter_mut().zip(vector) {
                    *sum += weight * f64::from(x);
                }
                all += weight;
            }
            if all > 0.0 {
                for (mean, sum) in mean.iter_mut().zip(sums) {
                    *mean = (sum / all) as f32;
                }
            }
        });
        let empty = (0..start.len() - 1).filter(|&at| start[at] == start[at + 1]);
        self.move_to_farthest(empty.collect(), &mut means, squares);
        means
    }

    /// Moves the `empty` entries to the vectors of largest weight times square, no two to equal vectors.
    fn move_to_farthest(&self, empty: Vec<usize>, entries: &mut [f32], squares: &[f64]) {
        if empty.is_empty() {
            return;
        }
        let cost = |(square, &weight): (&f64, &f32)| f64::from(weight) * square;
        let costs: Vec<f64> = squares.iter().zip(&self.weights).map(cost).collect();
        let mut order: Vec<u32> = (0..).zip(&costs).filter(|c| *c.1 > 0.0).map(|c| c.0).collect();
        order.sort_unstable_by(|&a, &b| {
            costs[b as usize].total_cmp(&costs[a as usize]).then(a.cmp(&b))
        });
        let mut taken = HashSet::new();
        let farthest = order.iter().filter(|&&i| taken.insert(self.first[i as usize]));
        for (at, &i) in empty.into_iter().zip(farthest) {
            let vector = &self.vectors[i as usize * self.dims..(i as usize + 1) * self.dims];
            entries[at * self.dims..(at + 1) * self.dims].copy_from_slice(vector);
        }
    }
}

/// The vectors of each of `count` entries, ascending: where each entry's begin (and the last end), and the vectors.
fn by_entry(nearest: &[u32], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; count + 1];
    for &at in nearest {
        start[at as usize + 1] += 1;
    }
    for at in 0..count {
        start[at + 1] += start[at];
    }
    let mut next = start.clone();
    let mut members = vec![0; nearest.len()];
    for (i, &at) in (0..).zip(nearest) {
        members[next[at as usize] as usize] = i;
        next[at as usize] += 1;
    }
    (start, members)
}

#[cfg(test)]
mod tests {
    use super::super::distinct::first_equals;
    use super::super::fixtures::{all, build, walk};
    use super::super::{KMeans, Seeding, Weighting, errors};
    use super::*;

    #[test]
    fn rounds_are_those_of_plain_lloyd() {
        let (dims, vectors) = (5, walk(3000, 5, 1));
        let rounds = |n| build(&vectors, dims, &KMeans { iterations: n, ..all(700) }).entries;
        let mut entries = rounds(0);
        let vector = |i: usize| &vectors[i * dims..(i + 1) * dims];
        for n in 1..6 {
            let table = Quantizer::new(&entries, dims).unwrap();
            let nearest: Vec<_> = (0..3000).map(|i| table.nearest_of_all(vector(i))).collect();
            for (at, entry) in (0..).zip(entries.chunks_exact_mut(dims)) {
                let members: Vec<_> = (0..3000).filter(|&i| nearest[i] == at).collect();
                assert!(!members.is_empty(), "the test would need moves of empty entries");
                for (d, x) in entry.iter_mut().enumerate() {
                    let sum: f64 = members.iter().map(|&i| f64::from(vector(i)[d])).sum();
                    *x = (sum / members.len() as f64) as f32;
                }
            }
            assert_eq!(entries, rounds(n));
        }
    }

    #[test]
    fn inertia_never_rises_and_training_helps() {
        let vectors = walk(20_000, 27, 3);
        for seeding in [Seeding::Random, Seeding::PlusPlus] {
            for weighting in [Weighting::None, Weighting::Luminance] {
                let settings = KMeans { seeding, weighting, iterations: 20, ..all(100) };
                let lut = build(&vectors, 27, &settings);
                assert!(lut.inertia.is_sorted_by(|a, b| a > b), "{:?}", lut.inertia);
                let drawn = build(&vectors, 27, &KMeans { iterations: 0, ..settings });
                assert!(drawn.inertia.is_empty() && drawn.entries.len() == lut.entries.len());
                let [before, after] =
                    [&drawn, &lut].map(|lut| errors(&vectors, &lut.entries, 27, 1.0).unwrap());
                assert!(after.l2 < 0.9 * before.l2, "{before:?} {after:?}");
            }
        }
    }

    #[test]
    fn one_entry_is_the_mean() {
        let lut = build(&[1.0, 2.0, 6.0, 0.0, 3.0, 0.0], 1, &all(1));
        assert_eq!(lut.entries, [2.0]);
    }

    #[test]
    fn an_entry_that_lost_its_vectors_moves_to_the_farthest() {
        let vectors = [0.0, 1.0, 2.0, 50.0, 50.0, 100.0];
        let training = Training {
            vectors: &vectors,
            dims: 1,
            weights: vec![1.0; 6],
            first: first_equals(&vectors, 1),
        };
        // The last three entries are nearest to nothing.
        let entries = [1.0, 500.0, 600.0, 700.0];
        let nearest = [0; 6];
        let squares = training.squares(&entries, &nearest);
        let moved = training.means(&entries, &nearest, &squares);
        assert_eq!(moved[1..], [100.0, 50.0, 0.0], "not twice to 50");
    }
}
