//! Unit vectors in two bytes: the octahedron unfolded onto a square.

use glam::{Vec2, Vec3};

/// Codes a unit vector: of the cells around its place in the square the one that decodes nearest to it.
pub fn encode(v: Vec3) -> [u8; 2] {
    let sum = v.abs().element_sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return [127; 2];
    }
    let flat = v.truncate() / sum;
    let p = if v.z < 0.0 { fold(flat) } else { flat };
    let low = ((p + 1.0) * 127.0).floor().clamp(Vec2::ZERO, Vec2::splat(253.0));
    let [x, y] = low.to_array().map(|c| c as u8);
    let near = [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]];
    let likeness = |code: &[u8; 2]| decode(*code).dot(v);
    near.into_iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))).unwrap_or([127; 2])
}

/// The unit vector of a code, within 0.017 radians of the coded one.
#[inline(always)]
pub fn decode(code: [u8; 2]) -> Vec3 {
    let p = Vec2::new(f32::from(code[0]), f32::from(code[1])) / 127.0 - 1.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let flat = if z < 0.0 { fold(p) } else { p };
    flat.extend(z).normalize()
}

/// Turns the corners of the square under the octahedron, or back.
#[inline(always)]
fn fold(p: Vec2) -> Vec2 {
    Vec2::new((1.0 - p.y.abs()).copysign(p.x), (1.0 - p.x.abs()).copysign(p.y))
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::unit_vectors;
    use super::*;

    #[test]
    fn unit_vectors_return_within_the_stated_error() {
        let mut worst = 0.0f32;
        for v in unit_vectors(200_000, 6) {
            worst = worst.max(decode(encode(v)).distance(v));
        }
        assert!(worst < 0.017 && worst > 0.005, "{worst}");
        for v in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert_eq!(decode(encode(v)), v);
        }
        assert!(
            decode(encode(Vec3::NAN)).is_normalized() && decode(encode(Vec3::ZERO)).is_normalized()
        );
    }
}
