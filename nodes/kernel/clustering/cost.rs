//! The cost of a cluster, `W^2 - |s|^2` (Hašan 2008, section 4.3.1 and the low-rank form of section 5).

use std::ops::Range;

use super::{Beat, Tensor, lanes};

/// Below this share of W^2 a cost is computed again in its centred form, free of cancellation.
const TIGHT: f64 = 1e-4;

/// Squared distance of two normalized columns that the rounding of their f32 entries alone can make: (2^-24)^2 = 3.6e-15, with
/// a margin. Columns as close as this count as parallel.
pub const ROUNDING: f64 = 1e-14;

/// Lights between two calls of `beat`.
const BEAT: usize = 64;

/// A cluster in the tensor: its lights, ascending, by its frames.
#[derive(Clone)]
pub struct Rectangle<'a> {
    pub lights: &'a [u32],
    pub frames: Range<usize>,
}

/// `W^2 - |s|^2` from the weight W and the squared norm of s; never negative.
pub fn plain(weight: f64, norm: f64) -> f64 {
    (weight * weight - norm).max(0.0)
}

/// The cost itself if it is large enough to be trusted, else the centred form, which is exactly zero if all columns are parallel.
pub fn refined<E>(
    cost: f64,
    weight: f64,
    tensor: &Tensor,
    rectangle: &Rectangle,
    beat: &Beat<E>,
) -> Result<f64, E> {
    if cost >= TIGHT * weight * weight {
        return Ok(cost);
    }
    centred(weight, &sum(tensor, rectangle, beat)?, tensor, rectangle, beat)
}

/// The sum s of the columns of a cluster.
pub fn sum<E>(tensor: &Tensor, rectangle: &Rectangle, beat: &Beat<E>) -> Result<Vec<f64>, E> {
    let mut sum = vec![0.0; tensor.rows()];
    for lights in rectangle.lights.chunks(BEAT) {
        beat()?;
        for &light in lights {
            for column in
                tensor.slab(light as usize, rectangle.frames.clone()).chunks(tensor.rows())
            {
                lanes::add(&mut sum, column);
            }
        }
    }
    Ok(sum)
}

/// `(W + |s|) / 2 * sum w |x - s/|s||^2`, equal to `W^2 - |s|^2` because `W - x . s/|s|` summed with weights is half that sum.
fn centred<E>(
    weight: f64,
    sum: &[f64],
    tensor: &Tensor,
    rectangle: &Rectangle,
    beat: &Beat<E>,
) -> Result<f64, E> {
    let norm = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm == 0.0 {
        return Ok(0.0);
    }
    let centre: Vec<f64> = sum.iter().map(|x| x / norm).collect();
    let mut spread = 0.0;
    for lights in rectangle.lights.chunks(BEAT) {
        beat()?;
        for &light in lights {
            let norms = tensor.norms(light as usize, rectangle.frames.clone());
            let slab = tensor.slab(light as usize, rectangle.frames.clone());
            for (&w, column) in norms.iter().zip(slab.chunks(tensor.rows())) {
                if w > 0.0 {
                    let distance = lanes::distance(column, 1.0 / w, &centre);
                    spread += if distance > ROUNDING { w * distance } else { 0.0 };
                }
            }
        }
    }
    Ok(0.5 * (weight + norm) * spread)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{never, noise, tensor_of};
    use super::*;

    /// The papers' double sum over pairs of columns, unordered.
    fn double_sum(tensor: &Tensor, rectangle: &Rectangle) -> f64 {
        let mut columns = Vec::new();
        for &light in rectangle.lights {
            for frame in rectangle.frames.clone() {
                let w = tensor.norms(light as usize, frame..frame + 1)[0];
                let column = tensor.column(light as usize, frame).iter();
                columns.push((
                    w,
                    column.map(|&x| if w > 0.0 { f64::from(x) / w } else { 0.0 }).collect(),
                ));
            }
        }
        let mut total = 0.0;
        for (i, (w_p, x_p)) in columns.iter().enumerate() {
            for (w_q, x_q) in &columns[..i] {
                let x_p: &Vec<f64> = x_p;
                let apart: f64 =
                    x_p.iter().zip(x_q).map(|(a, b): (_, &f64)| (a - b) * (a - b)).sum();
                total += w_p * w_q * apart;
            }
        }
        total
    }

    fn whole_cost(tensor: &Tensor) -> (f64, f64, f64) {
        let lights: Vec<u32> = (0..tensor.lights() as u32).collect();
        let whole = Rectangle { lights: &lights, frames: 0..tensor.frames() };
        let weight: f64 =
            (0..tensor.lights()).flat_map(|j| tensor.norms(j, 0..tensor.frames())).sum();
        let norm: f64 = sum(tensor, &whole, &never).unwrap().iter().map(|x| x * x).sum();
        let plain = plain(weight, norm);
        let refined = refined(plain, weight, tensor, &whole, &never).unwrap();
        (refined, plain / (weight * weight), double_sum(tensor, &whole))
    }

    #[test]
    fn both_forms_equal_the_double_sum() {
        // Spread of the columns, and how exact the cost must be: the entries themselves are rounded to f32.
        for (spread, tolerance) in
            [(1.0, 1e-12), (1e-1, 1e-11), (1e-2, 1e-11), (1e-3, 1e-10), (1e-4, 1e-9)]
        {
            let tensor = tensor_of(60, 13, 3, |j, i, k| {
                (1.0 + j as f32) * (1.0 + (i % 3) as f32 + spread * noise(j, i, k))
            });
            let (refined, share, expected) = whole_cost(&tensor);
            assert!(expected > 0.0);
            assert!((refined / expected - 1.0).abs() < tolerance, "{spread}: {refined} {expected}");
            assert_eq!(
                share < TIGHT,
                spread < 0.05,
                "spread {spread} takes the intended form: {share}"
            );
        }
    }

    #[test]
    fn parallel_columns_cost_nothing() {
        for n in [1, 2, 1000] {
            let tensor = tensor_of(n, 9, 2, |j, i, _| (0.1 + i as f32) * (j % 7 + 1) as f32 / 3.0);
            assert_eq!(whole_cost(&tensor).0, 0.0);
        }
    }

    #[test]
    fn a_dim_column_beside_a_bright_one_costs_what_the_double_sum_says() {
        let tensor = tensor_of(2, 4, 1, |j, i, _| match (j, i) {
            (0, 0) => 1e15,
            (1, 1) => 1e-3,
            _ => 0.0,
        });
        let (refined, _, expected) = whole_cost(&tensor);
        assert!((refined / expected - 1.0).abs() < 1e-12, "{refined} {expected}");
    }
}
