//! Which vectors a table is trained on, and how much each counts.

use crate::node::Error;
use std::borrow::Cow;

/// Weight by luminance is at least this part of the mean, so that dark vectors still count.
const DARK: f64 = 1e-2;

crate::choice! {
    /// How much each vector counts.
    pub enum Weighting {
        /// All the same (the paper).
        None = "none",
        /// In proportion to the luminance of its constant band.
        Luminance = "luminance",
    }
}

/// The vectors whose norm is at least `black` times the largest and not zero; all if `black` is zero.
pub(super) fn without_black(vectors: &[f32], dims: usize, black: f32) -> Cow<'_, [f32]> {
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
pub(super) fn weights(
    vectors: &[f32],
    dims: usize,
    weighting: Weighting,
) -> Result<Vec<f32>, Error> {
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

#[cfg(test)]
mod tests {
    use super::super::fixtures::{QUIET, all, build, noise, walk};
    use super::super::{KMeans, Lut, errors};
    use super::*;

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
}
