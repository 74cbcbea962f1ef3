//! Latitude-longitude maps of all directions, in the convention of [`Environment`](crate::data::Environment).
//!
//! u = 0.5 is +X, u = 0.25 is -Z, u = 0.75 is +Z; v = 0 is +Y and v = 1 is -Y.

use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The unit vector towards (u, v); u has period 1, v runs from 0 (up) to 1 (down).
pub fn direction(u: f64, v: f64) -> DVec3 {
    around(u, libm::cos(PI * v))
}

/// The unit vector towards longitude u whose height is `y` (-1 to 1).
pub fn around(u: f64, y: f64) -> DVec3 {
    let (sin, cos) = libm::sincos(TAU * (u - 0.5));
    let radius = (1.0 - y * y).max(0.0).sqrt();
    DVec3::new(radius * cos, y, radius * sin)
}

/// Where the map shows `direction` (of any length above 0): u and v, both in 0..=1.
pub fn uv(direction: DVec3) -> DVec2 {
    let d = direction.normalize_or(DVec3::Y);
    let u = 0.5 + libm::atan2(d.z, d.x) / TAU;
    DVec2::new(u.clamp(0.0, 1.0), libm::acos(d.y.clamp(-1.0, 1.0)) / PI)
}

/// Solid angle of one texel of row `row` of a map of the given width and height, steradians. All
/// rows together make 4 pi.
pub fn solid_angle(row: usize, width: usize, height: usize) -> f64 {
    (edge(row, height) - edge(row + 1, height)) * TAU / width as f64
}

/// Height (-1 to 1) of the upper edge of row `row`; of the lower edge of the last for `row = height`.
pub fn edge(row: usize, height: usize) -> f64 {
    // The middle and the ends are exact, so that half a sphere is exactly half the map.
    match 2 * row {
        0 => 1.0,
        twice if twice == height => 0.0,
        twice if twice == 2 * height => -1.0,
        _ => libm::cos(PI * row as f64 / height as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_lie_where_the_convention_says() {
        for (u, v, axis) in [
            (0.5, 0.5, DVec3::X),
            (0.25, 0.5, DVec3::NEG_Z),
            (0.75, 0.5, DVec3::Z),
            (0.0, 0.5, DVec3::NEG_X),
            (0.3, 0.0, DVec3::Y),
            (0.3, 1.0, DVec3::NEG_Y),
        ] {
            assert!(direction(u, v).abs_diff_eq(axis, 1e-12), "{u} {v}");
        }
    }

    #[test]
    fn uv_undoes_direction() {
        for i in 0..200 {
            let (u, v) = ((f64::from(i) * 0.618).fract(), (f64::from(i) + 0.5) / 200.0);
            assert!(uv(direction(u, v)).abs_diff_eq(DVec2::new(u, v), 1e-9), "{u} {v}");
        }
        assert!(uv(DVec3::ZERO).is_finite());
    }

    #[test]
    fn rows_fill_the_sphere() {
        for (width, height) in [(1, 1), (2, 1), (7, 5), (64, 32)] {
            let sum: f64 = (0..height).map(|r| solid_angle(r, width, height) * width as f64).sum();
            assert!((sum - 4.0 * PI).abs() < 1e-12, "{width} x {height}: {sum}");
        }
    }
}
