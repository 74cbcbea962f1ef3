//! k-means over node data vectors (Buchholz and Boubekeur 2012, section 3.2): the table, and how it is trained.

use super::distinct::first_equals;
use super::lloyd::Training;
use super::nearest::{DIMS, scale};
use super::weighting::{Weighting, weights, without_black};
use super::{Tick, seeding};
use crate::node::Error;
use rand_pcg::Pcg64Mcg;

crate::choice! {
    /// Which vectors the entries start from.
    pub enum Seeding {
        /// Different vectors, all equally likely (the paper).
        Random = "random",
        /// Far from each other (k-means++): less error, and some seconds more.
        PlusPlus = "plus_plus",
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

#[cfg(test)]
mod tests {
    use super::super::errors;
    use super::super::fixtures::{QUIET, all, build, noise, walk};
    use super::*;

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
