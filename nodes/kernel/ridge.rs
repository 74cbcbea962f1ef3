//! Weights of representatives fitted to what the rows know, by ridge regression.
//!
//! The ratio of norms gives a representative the size of its cluster and knows nothing of the others. But the rows hold the
//! answer for the pixels they sample: the sum of all lights. So the columns' weights are multiplied by factors as close to 1
//! as brings their sum there close to that, which mends what clusters next to each other have too much and too little of.

/// Steps of conjugate gradients at most; what is left then is far below what the rows can tell.
const STEPS: usize = 200;

/// Square of the residual, of the target's, at which the search ends.
const CLOSE: f64 = 1e-12;

/// Columns on the rows, each times its weight.
pub struct Columns<'a> {
    /// The elements of each on the rows, and the weight of the whole.
    pub columns: Vec<(&'a [f32], f64)>,
}

impl Columns<'_> {
    /// Sum of the columns times `factors`, into `rows`.
    fn sum(&self, factors: &[f64], rows: &mut [f64]) {
        rows.fill(0.0);
        for ((column, weight), factor) in self.columns.iter().zip(factors) {
            let scale = weight * factor;
            rows.iter_mut().zip(*column).for_each(|(row, x)| *row += f64::from(*x) * scale);
        }
    }

    /// Each column's product with `rows`.
    fn products(&self, rows: &[f64]) -> Vec<f64> {
        let product = |(column, weight): &(&[f32], f64)| {
            weight * column.iter().zip(rows).map(|(x, row)| f64::from(*x) * row).sum::<f64>()
        };
        self.columns.iter().map(product).collect()
    }

    /// A factor for each column, 1 + d, with the least |M d - (target - M 1)|^2 + ridge |d|^2, where M has the weighted columns
    /// and `ridge` is `strength` times the mean square of a row. Never negative, as light is not; where that bites the sum is off
    /// the target. 1 where all is dark, or too large for double precision.
    pub fn factors(&self, target: &[f64], strength: f64) -> Vec<f64> {
        let ones = vec![1.0; self.columns.len()];
        let rows = target.len();
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let weighted = |(column, weight): &(&[f32], f64)| {
            weight * weight * column.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>()
        };
        let ridge = strength * self.columns.iter().map(weighted).sum::<f64>() / rows.max(1) as f64;
        if !(ridge > 0.0 && ridge.is_finite() && square(target).is_finite()) {
            return ones;
        }
        // Conjugate gradients on (M M^T + ridge) y = target - M 1, in which there are as many unknowns as rows; d = M^T y.
        let mut product = vec![0.0; rows];
        self.sum(&ones, &mut product);
        let mut residual: Vec<f64> = target.iter().zip(&product).map(|(t, p)| t - p).collect();
        let mut direction = residual.clone();
        let mut solution = vec![0.0; rows];
        let enough = CLOSE * square(target);
        let mut left = square(&residual);
        for _ in 0..STEPS {
            if left <= enough {
                break;
            }
            self.sum(&self.products(&direction), &mut product);
            product.iter_mut().zip(&direction).for_each(|(p, d)| *p += ridge * d);
            let along: f64 = direction.iter().zip(&product).map(|(d, p)| d * p).sum();
            let step = left / along;
            solution.iter_mut().zip(&direction).for_each(|(s, d)| *s += step * d);
            residual.iter_mut().zip(&product).for_each(|(r, p)| *r -= step * p);
            let before = std::mem::replace(&mut left, square(&residual));
            direction.iter_mut().zip(&residual).for_each(|(d, r)| *d = r + left / before * *d);
        }
        let factors: Vec<f64> =
            self.products(&solution).iter().map(|d| (1.0 + d).max(0.0)).collect();
        if factors.iter().all(|factor| factor.is_finite()) { factors } else { ones }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn off(columns: &Columns<'_>, factors: &[f64], target: &[f64]) -> f64 {
        let mut rows = vec![0.0; target.len()];
        columns.sum(factors, &mut rows);
        rows.iter().zip(target).map(|(row, t)| (row - t).powi(2)).sum::<f64>()
    }

    #[test]
    fn columns_of_their_own_rows_reach_the_target() {
        let columns = Columns { columns: vec![(&[1.0, 0.0, 0.0], 2.0), (&[0.0, 3.0, 0.0], 1.0)] };
        // The ridge is 1e-9 times 13 / 3.
        let factors = columns.factors(&[4.0, 1.5, 7.0], 1e-9);
        assert!((factors[0] - 2.0).abs() < 1e-6 && (factors[1] - 0.5).abs() < 1e-6, "{factors:?}");
        // By hand: 1 + 2 * 2 / (4 + r) and 1 - 3 * 1.5 / (9 + r) with r = 13 / 3.
        let factors = columns.factors(&[4.0, 1.5, 7.0], 1.0);
        assert!(
            (factors[0] - 1.48).abs() < 1e-9 && (factors[1] - 0.6625).abs() < 1e-9,
            "{factors:?}"
        );
    }

    #[test]
    fn dark_and_overflowing_columns_keep_their_weights() {
        let dark = Columns { columns: vec![(&[0.0, 0.0], 1.0)] };
        assert_eq!(dark.factors(&[1.0, 2.0], 0.03), [1.0]);
        assert_eq!(Columns { columns: Vec::new() }.factors(&[1.0], 0.03), [0.0; 0]);
        let huge = Columns { columns: vec![(&[f32::MAX, 1.0], 1e200)] };
        assert_eq!(huge.factors(&[1.0, 2.0], 0.03), [1.0]);
        let spread = Columns { columns: vec![(&[1e30, 1e-30], 1.0), (&[1e-30, 1e-30], 1.0)] };
        assert!(spread.factors(&[2e30, 1.0], 0.03).iter().all(|f| f.is_finite() && *f >= 0.0));
    }

    #[test]
    fn no_light_turns_negative() {
        let columns = Columns { columns: vec![(&[1.0, 1.0], 1.0), (&[0.0, 1.0], 1.0)] };
        assert_eq!(columns.factors(&[1.0, 0.0], 1e-6)[1], 0.0);
    }

    proptest! {
        #[test]
        fn the_sum_comes_no_farther_from_the_target(
            elements in prop::collection::vec(0.0f32..4.0, 60),
            off_by in prop::collection::vec(0.7f64..1.3, 6),
        ) {
            let columns = Columns { columns: elements.as_chunks::<6>().0.iter().map(|c| (&c[..], 1.0)).collect() };
            let mut target = [0.0; 6];
            columns.sum(&[1.0; 10], &mut target);
            target.iter_mut().zip(off_by).for_each(|(t, by)| *t *= by);
            let factors = columns.factors(&target, 0.03);
            prop_assert!(factors.len() == 10 && factors.iter().all(|f| *f >= 0.0));
            // What is cut off below zero can take the sum away again.
            if factors.iter().all(|f| *f > 0.0) {
                prop_assert!(off(&columns, &factors, &target) <= off(&columns, &[1.0; 10], &target) + 1e-9);
            }
        }
    }
}
