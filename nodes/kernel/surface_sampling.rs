//! Points on surfaces: stratified over triangles in proportion to a weight, uniform within each.

use crate::data::NONE;
use glam::Vec2;

/// A point on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World-level triangle.
    pub triangle: u32,
    /// Barycentric weights of its second and third corner.
    pub barycentric: Vec2,
    /// Weight of all triangles over (number of points times weight of this triangle): the share of
    /// the triangle for which the point stands.
    pub share: f32,
    /// A uniform number in [0, 1) that decided nothing else.
    pub spare: f32,
}

/// Largest number of points that one sequence of quasi-random numbers gives.
const SEQUENCE: u32 = 1 << 16;

/// `count` points: the i-th lies in the i-th of `count` equal strata of the summed `weights` (one a
/// triangle, not negative), so that near triangles share points evenly. Triangles of weight zero have
/// none. Empty when all weights are zero.
pub fn sample(weights: &[f64], count: u32, seed: u64) -> Vec<Point> {
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) || count == 0 {
        return Vec::new();
    }
    let mut points = Vec::with_capacity(count as usize);
    let (mut triangle, mut before) = (0, 0.0);
    for i in 0..count {
        let [jitter, u, v, spare] = uniform(i, 0, seed);
        let at = (f64::from(i) + f64::from(jitter)) / f64::from(count) * total;
        while triangle + 1 < weights.len() && before + weights[triangle] <= at {
            before += weights[triangle];
            triangle += 1;
        }
        let chosen = last_with_weight(weights, triangle);
        let root = u.sqrt();
        let barycentric = Vec2::new(root * (1.0 - v), root * v);
        let share = (total / (f64::from(count) * weights[chosen as usize])) as f32;
        points.push(Point { triangle: chosen, barycentric, share, spare });
    }
    points
}

/// Rounding can step onto a triangle without weight at the end: the one before it is meant.
fn last_with_weight(weights: &[f64], triangle: usize) -> u32 {
    (0..=triangle).rev().find(|&t| weights[t] > 0.0).map_or(NONE, |t| t as u32)
}

/// Four numbers in [0, 1) for `index`; `set` tells apart what they are for. Owen-scrambled Sobol
/// points in runs of 65,536, each run with a scramble of its own.
pub fn uniform(index: u32, set: u32, seed: u64) -> [f32; 4] {
    let run = index / SEQUENCE;
    let mixed = (seed ^ (seed >> 32)) as u32
        ^ set.wrapping_mul(0x9e37_79b9)
        ^ run.wrapping_mul(0x85eb_ca6b);
    sobol_burley::sample_4d(index % SEQUENCE, set % 64, mixed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_follow_the_weights() {
        let weights = [1.0, 0.0, 3.0, 0.0];
        let points = sample(&weights, 4000, 7);
        let on = |t: u32| points.iter().filter(|p| p.triangle == t).count();
        assert_eq!((on(0), on(1), on(3)), (1000, 0, 0));
        assert!((points[0].share - 4.0 / 4000.0).abs() < 1e-9);
        assert!(
            points
                .iter()
                .all(|p| p.barycentric.min_element() >= 0.0 && p.barycentric.element_sum() <= 1.0)
        );
        let centre = points.iter().map(|p| p.barycentric).sum::<Vec2>() / 4000.0;
        assert!((centre - Vec2::splat(1.0 / 3.0)).abs().max_element() < 0.005, "{centre}");
    }

    #[test]
    fn nothing_to_sample_gives_nothing() {
        assert!(sample(&[], 10, 1).is_empty() && sample(&[0.0, 0.0], 10, 1).is_empty());
        assert!(sample(&[f64::INFINITY], 10, 1).is_empty() && sample(&[1.0], 0, 1).is_empty());
    }

    #[test]
    fn runs_and_sets_differ() {
        assert_ne!(uniform(3, 0, 1), uniform(3, 1, 1));
        assert_ne!(uniform(3, 0, 1), uniform(3 + SEQUENCE, 0, 1));
        assert_ne!(uniform(3, 0, 1), uniform(3, 0, 2));
    }
}
