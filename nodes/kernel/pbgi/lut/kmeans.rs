//! k-means (Lloyd) over node data vectors (Buchholz and Boubekeur 2012, section 3.2).

use super::distinct::first_equals;
use super::nearest::{DIMS, Quantizer, scale};
use super::{Tick, seeding};
use crate::node::Error;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashSet;

/// Vectors of one piece of work and of one partial sum.
const CHUNK: usize = 4096;
/// Weight by luminance is at least this part of the mean, so that dark vectors still count.
const DARK: f64 = 1e-2;

crate::choice! {
    /// Which vectors the entries start from.
    pub enum Seeding {
        /// Different vectors, all equally likely (the paper).
        Random = "random",
        /// Far from each other (k-means++): less error, and some seconds more.
        PlusPlus = "plus_plus",
    }
}

crate::choice! {
    /// How much each vector counts.
    pub enum Weighting {
        /// All the same (the paper).
        None = "none",
        /// In proportion to the luminance of its constant band.
        Luminance = "luminance",
    }
}

/// How to train a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KMeans {
    /// Entries wanted, at least 1 (the paper's l).
    pub entries: u32,
    /// Rounds of Lloyd, 10 to 20 in the paper; 0 leaves the entries where they start (the random table of figure 4).
    pub iterations: u32,
    /// Where the entries start.
    pub seeding: Seeding,
    /// How much each vector counts.
    pub weighting: Weighting,
    /// Vectors shorter than this part of the longest are left out, and an entry of zeros is added; 0 does neither.
    pub black: f32,
    /// Seed of the random draws.
    pub seed: u64,
}

impl Default for KMeans {
    fn default() -> Self {
        KMeans {
            entries: 1000,
            iterations: 10,
            seeding: Seeding::Random,
            weighting: Weighting::None,
            black: 1e-4,
            seed: 1,
        }
    }
}

/// A table of node data vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    /// The entries, `dims` numbers each: `min(wanted, distinct vectors)` of them, and then one of zeros if near-black vectors are
    /// left out. Never none.
    pub entries: Vec<f32>,
    /// Numbers of one entry.
    pub dims: usize,
    /// The sum over the vectors of weight times squared distance, before each round; it never rises. May end early.
    pub inertia: Vec<f64>,
    /// Near-black vectors that were left out.
    pub left_out: usize,
}

impl Lut {
    /// Trains a table on `vectors` of `dims` numbers each. An entry to which no vector is nearest moves to the vector that is
    /// farthest from its own. Without vectors the table has one entry of zeros.
    ///
    /// # Errors
    /// When the settings, `dims` (1 to 128; for weighting by luminance 3 or 4 times a square) or the vectors (finite, whole) are
    /// out of range, and those of `tick`.
    pub fn build(
        vectors: &[f32],
        dims: usize,
        settings: &KMeans,
        tick: &Tick,
    ) -> Result<Self, Error> {
        check(vectors, dims, settings)?;
        let bright = without_black(vectors, dims, settings.black);
        let left_out = (vectors.len() - bright.len()) / dims;
        let weights = weights(&bright, dims, settings.weighting)?;
        let first = first_equals(&bright, dims);
        let distinct: Vec<u32> =
            (0..).zip(&first).filter(|&(i, &first)| i == first).map(|(i, _)| i).collect();
        let count = distinct.len().min(settings.entries as usize);
        // An odd state is what the generator needs; it then differs for every seed.
        let mut random = Pcg64Mcg::new(u128::from(settings.seed) << 1 | 1);
        let seeds = match settings.seeding {
            Seeding::PlusPlus if count < distinct.len() => {
                let scale = scale(&bright);
                seeding::plus_plus(&bright, dims, &weights, scale, count, &mut random)
            }
            _ => seeding::random(&distinct, count, &mut random),
        };
        let entry = |&i: &u32| &bright[i as usize * dims..(i as usize + 1) * dims];
        let entries = seeds.iter().flat_map(entry).copied().collect();
        let training = Training { vectors: &bright, dims, weights, first };
        let (mut entries, inertia) = training.lloyd(entries, settings.iterations, tick)?;
        if settings.black > 0.0 || entries.is_empty() {
            entries.resize(entries.len() + dims, 0.0);
        }
        Ok(Lut { entries, dims, inertia, left_out })
    }
}

fn check(vectors: &[f32], dims: usize, settings: &KMeans) -> Result<(), Error> {
    if !(1..=DIMS).contains(&dims) {
        return Err(Error::invalid(format!("vectors have 1 to {DIMS} numbers, not {dims}")));
    }
    if !vectors.len().is_multiple_of(dims) || vectors.len() / dims > u32::MAX as usize {
        let numbers = vectors.len();
        return Err(Error::invalid(format!("{numbers} numbers are no vectors of {dims}")));
    }
    if vectors.iter().any(|x| !x.is_finite()) {
        return Err(Error::invalid("a vector to train on is not finite"));
    }
    if settings.entries == 0 || !(0.0..1.0).contains(&settings.black) {
        return Err(Error::invalid("a table has at least one entry, and black is within 0 and 1"));
    }
    Ok(())
}

/// The vectors whose norm is at least `black` times the largest and not zero; all if `black` is zero.
fn without_black(vectors: &[f32], dims: usize, black: f32) -> Cow<'_, [f32]> {
    if black == 0.0 {
        return vectors.into();
    }
    let norm = |v: &[f32]| v.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    let largest = vectors.chunks_exact(dims).map(norm).fold(0.0, f64::max);
    let bright = |v: &[f32]| norm(v) > 0.0 && norm(v) >= f64::from(black) * largest;
    if vectors.chunks_exact(dims).all(bright) {
        return vectors.into();
    }
    vectors.chunks_exact(dims).filter(|v| bright(v)).flatten().copied().collect()
}

/// One weight a vector, 1 on average at most twice.
fn weights(vectors: &[f32], dims: usize, weighting: Weighting) -> Result<Vec<f32>, Error> {
    let count = vectors.len() / dims;
    if weighting == Weighting::None {
        return Ok(vec![1.0; count]);
    }
    let square = |n: usize| n.isqrt().pow(2) == n;
    let functions = [3, 4]
        .into_iter()
        .find(|&parts| dims.is_multiple_of(parts) && square(dims / parts))
        .map(|parts| dims / parts)
        .ok_or_else(|| Error::invalid(format!("vectors of {dims} numbers have no luminance")))?;
    let luminance = |v: &[f32]| {
        let [r, g, b] = [v[0], v[functions], v[2 * functions]].map(|x| f64::from(x).max(0.0));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let mean = vectors.chunks_exact(dims).map(luminance).sum::<f64>() / count.max(1) as f64;
    if mean == 0.0 {
        return Ok(vec![1.0; count]);
    }
    Ok(vectors.chunks_exact(dims).map(|v| (luminance(v) / mean).max(DARK) as f32).collect())
}

/// What the entries are fitted to.
struct Training<'a> {
    vectors: &'a [f32],
    dims: usize,
    weights: Vec<f32>,
    /// For each vector the first that equals it.
    first: Vec<u32>,
}

impl Training<'_> {
    /// The entries after up to `rounds` rounds, and the inertia before each.
    fn lloyd(
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
    use super::super::errors;
    use super::super::fixtures::{noise, walk};
    use super::*;

    const QUIET: &Tick = &|_, _| Ok(());

    fn all(entries: u32) -> KMeans {
        KMeans { entries, black: 0.0, ..KMeans::default() }
    }

    fn build(vectors: &[f32], dims: usize, settings: &KMeans) -> Lut {
        Lut::build(vectors, dims, settings, QUIET).unwrap()
    }

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
    fn weight_moves_entries_to_what_is_bright() {
        let mut vectors = noise(4000 * 3, 1);
        vectors[..2000 * 3].iter_mut().for_each(|x| *x = 0.1 * *x + 5.0);
        let bright = |weighting| {
            let lut = build(&vectors, 3, &KMeans { weighting, seed: 2, ..all(50) });
            errors(&vectors[..2000 * 3], &lut.entries, 3, 1.0).unwrap().l2
        };
        assert!(bright(Weighting::Luminance) < bright(Weighting::None));
        assert!(
            Lut::build(&[1.0; 10], 5, &KMeans { weighting: Weighting::Luminance, ..all(1) }, QUIET)
                .is_err()
        );
    }

    #[test]
    fn as_many_entries_as_distinct_vectors_lose_nothing() {
        let mut vectors = walk(500, 27, 1);
        vectors.extend_from_within(..200 * 27);
        for seeding in [Seeding::Random, Seeding::PlusPlus] {
            for wanted in [500, 501, 100_000] {
                let lut = build(&vectors, 27, &KMeans { seeding, ..all(wanted) });
                assert_eq!(lut.entries.len(), 500 * 27);
                assert_eq!(errors(&vectors, &lut.entries, 27, 1.0).unwrap().largest, 0.0);
            }
        }
    }

    #[test]
    fn more_entries_than_sixteen_bits_number() {
        let vectors = noise(70_000 * 3, 1);
        for wanted in [65_536, 65_537] {
            let settings = KMeans { entries: wanted, iterations: 0, ..KMeans::default() };
            let lut = build(&vectors, 3, &settings);
            assert_eq!(lut.entries.len(), 3 * (wanted as usize + 1), "and one of zeros");
            assert_eq!(lut.entries, build(&vectors, 3, &settings).entries);
        }
    }

    #[test]
    fn one_entry_is_the_mean() {
        let lut = build(&[1.0, 2.0, 6.0, 0.0, 3.0, 0.0], 1, &all(1));
        assert_eq!(lut.entries, [2.0]);
    }

    #[test]
    fn near_black_vectors_are_left_out() {
        let mut vectors = walk(100, 27, 1);
        vectors[27 * 50..27 * 60].iter_mut().for_each(|x| *x *= 1e-6);
        vectors[27 * 70..27 * 71].fill(0.0);
        let lut = build(&vectors, 27, &KMeans { black: 1e-4, ..all(1000) });
        assert_eq!((lut.left_out, lut.entries.len()), (11, 27 * 90));
        assert_eq!(lut.entries[27 * 89..], [0.0; 27]);
        for vectors in [&[][..], &[0.0; 54]] {
            let lut = build(vectors, 27, &KMeans::default());
            assert_eq!(lut.entries, [0.0; 27]);
            assert!(lut.inertia.is_empty());
        }
        assert_eq!(build(&[], 27, &all(10)).entries, [0.0; 27], "never none");
    }

    #[test]
    fn an_outlier_has_an_entry_of_its_own() {
        let mut vectors = walk(1000, 9, 1);
        vectors[9 * 400..9 * 401].fill(1e9);
        for seeding in [Seeding::Random, Seeding::PlusPlus] {
            let lut = build(&vectors, 9, &KMeans { seeding, ..all(10) });
            assert!(lut.entries.chunks_exact(9).any(|entry| entry == [1e9; 9]), "{seeding:?}");
            assert!(lut.inertia.iter().all(|x| x.is_finite()));
        }
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

    #[test]
    fn equal_vectors_make_one_entry() {
        let lut = build(&[3.0; 9 * 1000], 9, &all(64));
        assert_eq!(lut.entries, [3.0; 9]);
        assert_eq!(lut.inertia, [0.0]);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let vectors = walk(9000, 36, 1);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let settings = KMeans { seeding: Seeding::PlusPlus, iterations: 4, ..all(300) };
            pool.install(|| build(&vectors, 36, &settings))
        };
        let one = run(1);
        assert_eq!(one, run(2));
        assert_eq!(one, run(5));
        assert_ne!(one, build(&vectors, 36, &KMeans { iterations: 4, seed: 2, ..all(300) }));
    }

    #[test]
    fn a_tick_can_stop_it_and_bad_input_is_refused() {
        let stop: &Tick = &|_, _| Err(Error::invalid("stopped"));
        assert!(Lut::build(&[1.0, 2.0], 1, &all(1), stop).is_err());
        let refused =
            |vectors: &[f32], dims, settings| Lut::build(vectors, dims, &settings, QUIET).is_err();
        assert!(refused(&[1.0], 0, all(1)) && refused(&[1.0; 3], 2, all(1)));
        assert!(refused(&[f32::NAN], 1, all(1)) && refused(&[1.0], 1, all(0)));
        assert!(refused(&[1.0], 1, KMeans { black: f32::NAN, ..all(1) }));
        assert!(refused(&[1.0; 200], 200, all(1)));
    }
}
