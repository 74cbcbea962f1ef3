//! Real spherical harmonics of one to five bands, and the clamped cosine in them: the function by which a node sends
//! light (Buchholz and Boubekeur 2012, section 3.1; coefficients by Ramamoorthi and Hanrahan 2001).
//!
//! Function l, m has index l(l + 1) + m. The basis is orthonormal over the sphere: a constant 1 has the single coefficient 2 sqrt(pi).

use crate::kernel::lanes::Lanes;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::{Add, Mul, Sub};

/// Most bands that are offered.
pub const MAX_BANDS: u32 = 5;

/// Number of functions of so many bands, their square.
pub const fn functions(bands: u32) -> usize {
    (bands * bands) as usize
}

/// Coefficients of the clamped cosine by band, relative to the basis at its axis: what a convolution with max(0, cos) multiplies
/// band l by. That of band 3 is zero, as are those of all further odd bands.
pub const COSINE: [f32; MAX_BANDS as usize] = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0];

/// Runs `$body` with `$f` a constant, the number of functions of `$bands` bands (limited to 1..=5).
macro_rules! with_functions {
    ($bands:expr, $f:ident => $body:expr) => {
        match $bands {
            0 | 1 => {
                const $f: usize = 1;
                $body
            }
            2 => {
                const $f: usize = 4;
                $body
            }
            3 => {
                const $f: usize = 9;
                $body
            }
            4 => {
                const $f: usize = 16;
                $body
            }
            _ => {
                const $f: usize = 25;
                $body
            }
        }
    };
}
pub(super) use with_functions;

/// What the basis functions can be evaluated in.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The number `value`, in each lane if there are several.
    fn of(value: f32) -> Self;
}

impl Number for f32 {
    #[inline(always)]
    fn of(value: f32) -> f32 {
        value
    }
}

impl<L: Lanes> Number for L {
    #[inline(always)]
    fn of(value: f32) -> L {
        L::splat(value)
    }
}

/// The `F` (1, 4, 9, 16 or 25) basis functions at a unit vector.
#[inline(always)]
pub fn basis<const F: usize>(d: Vec3) -> [f32; F] {
    basis_at(d.x, d.y, d.z)
}

/// The same at one unit vector a lane.
#[inline(always)]
pub fn basis_at<N: Number, const F: usize>(x: N, y: N, z: N) -> [N; F] {
    let c = N::of;
    let mut b = [c(0.0); F];
    b[0] = c(0.282_094_8);
    if F > 1 {
        b[1] = c(0.488_602_52) * y;
        b[2] = c(0.488_602_52) * z;
        b[3] = c(0.488_602_52) * x;
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if F > 4 {
        b[4] = c(1.092_548_4) * (x * y);
        b[5] = c(1.092_548_4) * (y * z);
        b[6] = c(0.315_391_57) * (c(3.0) * zz - c(1.0));
        b[7] = c(1.092_548_4) * (x * z);
        b[8] = c(0.546_274_2) * (xx - yy);
    }
    if F > 9 {
        b[9] = c(0.590_043_6) * y * (c(3.0) * xx - yy);
        b[10] = c(2.890_611_4) * (x * y) * z;
        b[11] = c(0.457_045_8) * y * (c(5.0) * zz - c(1.0));
        b[12] = c(0.373_176_34) * z * (c(5.0) * zz - c(3.0));
        b[13] = c(0.457_045_8) * x * (c(5.0) * zz - c(1.0));
        b[14] = c(1.445_305_7) * z * (xx - yy);
        b[15] = c(0.590_043_6) * x * (xx - c(3.0) * yy);
    }
    if F > 16 {
        b[16] = c(2.503_342_9) * (x * y) * (xx - yy);
        b[17] = c(1.770_130_8) * (y * z) * (c(3.0) * xx - yy);
        b[18] = c(0.946_174_7) * (x * y) * (c(7.0) * zz - c(1.0));
        b[19] = c(0.669_046_5) * (y * z) * (c(7.0) * zz - c(3.0));
        b[20] = c(0.105_785_55) * (zz * (c(35.0) * zz - c(30.0)) + c(3.0));
        b[21] = c(0.669_046_5) * (x * z) * (c(7.0) * zz - c(3.0));
        b[22] = c(0.473_087_35) * (xx - yy) * (c(7.0) * zz - c(1.0));
        b[23] = c(1.770_130_8) * (x * z) * (xx - c(3.0) * yy);
        b[24] = c(0.625_835_7) * (xx * (xx - c(3.0) * yy) - yy * (c(3.0) * xx - yy));
    }
    b
}

/// Coefficients of max(0, n.d) as a function of the unit vector d: how a disc with unit normal n sends diffuse light, and its
/// projected area, both for one unit of area.
#[inline(always)]
pub fn cosine<const F: usize>(n: Vec3) -> [f32; F] {
    let mut c = basis::<F>(n);
    let mut i = 0;
    for (l, factor) in COSINE.iter().enumerate() {
        for _ in 0..2 * l + 1 {
            if i < F {
                c[i] *= factor;
            }
            i += 1;
        }
    }
    c
}

/// The basis functions of `bands` bands at a unit vector.
pub fn evaluate(bands: u32, direction: Vec3) -> Vec<f32> {
    with_functions!(bands, F => basis::<F>(direction).to_vec())
}

/// The function of these coefficients at the direction at which `basis` was evaluated.
#[inline(always)]
pub fn dot<const F: usize>(coefficients: &[f32], basis: &[f32; F]) -> f32 {
    basis.iter().zip(coefficients).fold(0.0, |sum, (b, c)| sum + b * c)
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{directions, unit_vectors};
    use super::*;

    #[test]
    fn basis_is_orthonormal() {
        let quadrature = directions(64);
        let mut products = vec![[0.0f64; 25]; 25];
        for &(d, weight) in &quadrature {
            let b = basis::<25>(d);
            for (i, row) in products.iter_mut().enumerate() {
                for (j, sum) in row.iter_mut().enumerate() {
                    *sum += f64::from(b[i]) * f64::from(b[j]) * weight;
                }
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, &product) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < 2e-6, "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn cosine_is_its_projection_by_quadrature() {
        // Quadrature nodes are aligned with the kink only for the axis; for others the grid is fine enough.
        let quadrature = directions(400);
        for n in unit_vectors(6, 3) {
            let mut by_quadrature = [0.0f64; 25];
            for &(d, weight) in &quadrature {
                let lobe = f64::from(n.dot(d).max(0.0)) * weight;
                for (sum, b) in by_quadrature.iter_mut().zip(basis::<25>(d)) {
                    *sum += f64::from(b) * lobe;
                }
            }
            for (i, (q, c)) in by_quadrature.iter().zip(cosine::<25>(n)).enumerate() {
                assert!((q - f64::from(c)).abs() < 2e-5, "{n} {i}: {q} {c}");
            }
        }
    }

    #[test]
    fn fewer_bands_are_the_first_of_more() {
        let d = Vec3::new(0.36, -0.48, 0.8);
        let all = evaluate(5, d);
        for bands in 1..=5 {
            assert_eq!(evaluate(bands, d), all[..functions(bands)]);
        }
    }

    #[test]
    fn band_limited_cosine_is_near_the_cosine() {
        // Greatest error of the reconstruction over angles, by number of bands.
        for (bands, bound) in [(1, 0.76), (2, 0.26), (3, 0.0938), (4, 0.0938), (5, 0.0587)] {
            let mut worst = 0.0f32;
            for i in 0..=1000 {
                let (sin, cos) = (PI * i as f32 / 1000.0).sin_cos();
                let d = Vec3::new(sin, cos, 0.0);
                let lobe = with_functions!(bands, F => dot(&cosine::<F>(Vec3::Y), &basis::<F>(d)));
                worst = worst.max((lobe - d.y.max(0.0)).abs());
            }
            assert!(worst < bound && worst > 0.9 * bound, "{bands} bands: {worst}");
        }
    }
}
