//! Places of surfels relative to the sphere of their parent, in two bytes: 40 steps along each axis, 64,000 cells (leaf format B of Buchholz and
//! Boubekeur 2012, Table 2, which leaves the code open).

use super::super::hierarchy::Bound;
use glam::Vec3;

/// Cells along an axis: the greatest number whose third power is below 2^16.
const SIDE: u32 = 40;

/// Greatest distance of a decoded place from the place, over the radius of the parent's sphere: half the diagonal of a cell. To it comes the rounding
/// of world coordinates to f32.
pub const ERROR: f32 = 0.043_301_27;

/// A place in units of the radius of a sphere, from its centre.
pub fn within(place: Vec3, sphere: Bound) -> Vec3 {
    if sphere.radius > 0.0 { (place - sphere.center) / sphere.radius } else { Vec3::ZERO }
}

/// The cell of a place in a sphere; of the nearest place for one outside.
pub fn encode(place: Vec3, sphere: Bound) -> u16 {
    let side = SIDE as f32;
    let cell = |x: f32| ((x + 1.0) * 0.5 * side).floor().clamp(0.0, side - 1.0) as u32;
    let [x, y, z] = within(place, sphere).to_array().map(cell);
    (x + SIDE * (y + SIDE * z)) as u16
}

/// The middle of a cell.
#[inline(always)]
pub fn decode(code: u16, sphere: Bound) -> Vec3 {
    let code = u32::from(code);
    let cell =
        Vec3::new((code % SIDE) as f32, (code / SIDE % SIDE) as f32, (code / (SIDE * SIDE)) as f32);
    sphere.center + ((cell + 0.5) * (2.0 / SIDE as f32) - 1.0) * sphere.radius
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::unit_vectors;
    use super::*;

    #[test]
    fn places_return_within_the_stated_error() {
        for center in [Vec3::ZERO, Vec3::splat(1e6)] {
            let sphere = Bound { center, radius: 3.0 };
            for (i, v) in unit_vectors(10_000, 1).into_iter().enumerate() {
                let place = center + v * (3.0 * i as f32 / 10_000.0);
                let error = decode(encode(place, sphere), sphere).distance(place);
                // A unit in the last place of a million is 1/16.
                let rounding = center.max_element() * f32::EPSILON * 2.0;
                assert!(error <= ERROR * 3.0 * 1.0001 + rounding, "{error} {rounding}");
            }
        }
    }

    #[test]
    fn a_point_sphere_holds_its_centre() {
        let sphere = Bound { center: Vec3::splat(7.0), radius: 0.0 };
        assert_eq!(decode(encode(sphere.center, sphere), sphere), sphere.center);
    }
}
