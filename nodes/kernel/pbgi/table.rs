//! The 32x32x6 table of normals of the paper (Buchholz and Boubekeur 2012, section 4) beside the closed form that is used here: a table
//! is not faster than nine polynomials, and it is wrong by what this test shows.

use super::fixtures::unit_vectors;
use super::harmonics::cosine;
use glam::Vec3;

const SIDE: usize = 32;

/// Centre of the cell of a cube map that a direction falls into.
fn cell(d: Vec3) -> Vec3 {
    let axis = d.abs().max_position();
    let face = d[axis].abs();
    let mut at = Vec3::ZERO;
    for k in 0..3 {
        let side = SIDE as f32;
        let index = ((d[k] / face + 1.0) * 0.5 * side).floor().clamp(0.0, side - 1.0);
        at[k] = if k == axis { d[k].signum() } else { (index + 0.5) / side * 2.0 - 1.0 };
    }
    at.normalize()
}

#[test]
fn table_of_normals_is_wrong_by_up_to_four_percent() {
    let (mut worst, mut squares, mut total) = (0.0f32, 0.0f64, 0.0f64);
    for n in unit_vectors(20_000, 5) {
        let (exact, tabulated) = (cosine::<9>(n), cosine::<9>(cell(n)));
        let square: f32 = exact.iter().zip(&tabulated).map(|(a, b)| (a - b) * (a - b)).sum();
        let norm: f32 = exact.iter().map(|a| a * a).sum();
        worst = worst.max((square / norm).sqrt());
        squares += f64::from(square);
        total += f64::from(norm);
    }
    let mean = (squares / total).sqrt();
    println!(
        "table of 32x32x6 normals, 3 bands: relative error {mean:.4} (root mean square), {worst:.4} (greatest)"
    );
    assert!((0.01..0.03).contains(&mean), "{mean}");
    assert!((0.02..0.06).contains(&worst), "{worst}");
}
