//! What quantization loses (Buchholz and Boubekeur 2012, figure 4).

use super::Balanced;
use rayon::prelude::*;

/// Vectors of one partial sum.
const CHUNK: usize = 4096;

/// Error of vectors replaced by their nearest table entries, in the units of the vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Mean over vectors of the mean absolute error of their numbers.
    pub l1: f64,
    /// Mean over vectors of the Euclidean length of the error.
    pub l2: f64,
    /// Largest Euclidean length of the error.
    pub largest: f64,
}

/// The errors of `vectors` under a table of `entries`, both of `dims` numbers each, when colours are multiplied by `balance` to find the
/// nearest; zero where there are no vectors.
///
/// # Errors
/// Those of [`Balanced::new`].
pub fn errors(
    vectors: &[f32],
    entries: &[f32],
    dims: usize,
    balance: f32,
) -> Result<Errors, crate::node::Error> {
    let table = Balanced::new(entries, dims, balance)?;
    let of_chunk = |chunk: &[f32]| {
        let mut sums = Errors::default();
        let mut nearest = 0;
        for vector in chunk.chunks_exact(dims) {
            nearest = table.nearest(vector, nearest);
            let entry = &entries[nearest as usize * dims..(nearest as usize + 1) * dims];
            let (mut absolute, mut square) = (0.0, 0.0);
            for (&x, &e) in vector.iter().zip(entry) {
                let d = f64::from(x) - f64::from(e);
                absolute += d.abs();
                square += d * d;
            }
            sums.l1 += absolute / dims as f64;
            sums.l2 += square.sqrt();
            sums.largest = sums.largest.max(square.sqrt());
        }
        sums
    };
    let chunks: Vec<Errors> = vectors.par_chunks(CHUNK * dims).map(of_chunk).collect();
    let count = (vectors.len() / dims).max(1) as f64;
    let total = chunks.iter().fold(Errors::default(), |a, b| Errors {
        l1: a.l1 + b.l1,
        l2: a.l2 + b.l2,
        largest: a.largest.max(b.largest),
    });
    Ok(Errors { l1: total.l1 / count, l2: total.l2 / count, ..total })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_by_hand() {
        let found = errors(&[3.0, 4.0, 10.0, 10.0], &[0.0, 0.0, 10.0, 10.0], 2, 1.0).unwrap();
        assert_eq!(found, Errors { l1: 1.75, l2: 2.5, largest: 5.0 });
        assert_eq!(errors(&[], &[1.0], 1, 1.0).unwrap(), Errors::default());
        assert!(errors(&[1.0], &[], 1, 1.0).is_err());
    }
}
