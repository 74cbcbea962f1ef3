//! Colours and projected area as parts of one vector: distances between vectors must not depend on the exposure.

use super::nearest::{DIMS, Quantizer, scale};
use crate::node::Error;
use std::borrow::Cow;

/// Share of a vector's numbers that are colours: three channels of four.
fn colours(dims: usize) -> usize {
    dims / 4 * 3
}

/// The power of two by which the colours of `vectors` of `dims` numbers (red, green, blue, projected area) are to be multiplied, so that
/// they are on average about as long as the projected area; 1 where one of the two vanishes.
pub fn balance(vectors: &[f32], dims: usize) -> f32 {
    let (mut colour, mut area) = (0.0, 0.0);
    let square =
        |numbers: &[f32]| numbers.iter().map(|x| f64::from(*x) * f64::from(*x)).sum::<f64>();
    for vector in vectors.chunks_exact(dims) {
        let (of_colours, of_area) = vector.split_at(colours(dims));
        colour += square(of_colours);
        area += square(of_area);
    }
    let ratio = (area / colour).sqrt() as f32;
    // `scale` brings the inverse to [1, 2).
    if ratio > 0.0 && ratio.is_finite() { scale(&[1.0 / ratio]) } else { 1.0 }
}

/// Vectors with their colours multiplied by `balance`; a division by it is exact.
pub fn balanced(vectors: &[f32], dims: usize, balance: f32) -> Cow<'_, [f32]> {
    if balance == 1.0 {
        return vectors.into();
    }
    let mut vectors = vectors.to_vec();
    for vector in vectors.chunks_exact_mut(dims) {
        vector[..colours(dims)].iter_mut().for_each(|x| *x *= balance);
    }
    vectors.into()
}

/// A [`Quantizer`] that compares vectors with their colours multiplied.
pub struct Balanced {
    table: Quantizer,
    dims: usize,
    balance: f32,
}

impl Balanced {
    /// Takes a table of vectors of `dims` numbers as they are, not multiplied.
    ///
    /// # Errors
    /// Those of [`Quantizer::new`].
    pub fn new(entries: &[f32], dims: usize, balance: f32) -> Result<Self, Error> {
        let table = Quantizer::new(&balanced(entries, dims, balance), dims)?;
        Ok(Balanced { table, dims, balance })
    }

    /// The entry nearest to `vector`, as [`Quantizer::nearest`].
    #[inline]
    pub fn nearest(&self, vector: &[f32], hint: u32) -> u32 {
        if self.balance == 1.0 {
            return self.table.nearest(vector, hint);
        }
        let mut x = [0.0; DIMS];
        let x = &mut x[..self.dims];
        x.copy_from_slice(vector);
        x[..colours(self.dims)].iter_mut().for_each(|x| *x *= self.balance);
        self.table.nearest(x, hint)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::noise;
    use super::*;

    #[test]
    fn exposure_does_not_change_the_answer() {
        let (vectors, entries) = (noise(500 * 36, 1), noise(60 * 36, 2));
        let exposed = |numbers: &[f32], by: f32| balanced(numbers, 36, by).into_owned();
        let plain = Balanced::new(&entries, 36, balance(&vectors, 36)).unwrap();
        for by in [2f32.powi(-30), 2f32.powi(20)] {
            let (bright, table) = (exposed(&vectors, by), exposed(&entries, by));
            assert_eq!(balance(&bright, 36) * by, balance(&vectors, 36));
            let table = Balanced::new(&table, 36, balance(&bright, 36)).unwrap();
            for (a, b) in vectors.chunks_exact(36).zip(bright.chunks_exact(36)) {
                assert_eq!(plain.nearest(a, 0), table.nearest(b, 5));
            }
        }
    }

    #[test]
    fn parts_come_to_about_the_same_length() {
        // Colours 100 times as long, one number each.
        let vectors = [60.0, 80.0, 0.0, 1.0];
        assert_eq!(balance(&vectors, 4), 1.0 / 64.0);
        assert_eq!(balance(&[0.0, 0.0, 0.0, 1.0], 4), 1.0);
        assert_eq!(balance(&[1.0, 0.0, 0.0, 0.0], 4), 1.0);
        assert_eq!(balance(&[], 4), 1.0);
    }
}
