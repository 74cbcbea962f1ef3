//! Flat outlines given a thickness.

use super::Solid;
use glam::{Vec2, Vec3};

/// The plate between z = 0 and z = `thickness` whose outline in x and y is the simple polygon
/// `outline`, counter-clockwise, without three neighbouring corners in line.
pub fn extruded(outline: &[Vec2], thickness: f32) -> Solid {
    let count = outline.len() as u32;
    let mut solid = Solid::default();
    for z in [0.0, thickness] {
        solid.position.extend(outline.iter().map(|p| Vec3::new(p.x, p.y, z)));
    }
    for [a, b, c] in triangulated(outline) {
        solid.triangle.extend([[c, b, a], [a + count, b + count, c + count]]);
    }
    for i in 0..count {
        let next = (i + 1) % count;
        solid.quad([i, next, next + count, i + count]);
    }
    solid
}

/// Cuts off ears, the best-shaped first, so that thin triangles stay few.
fn triangulated(outline: &[Vec2]) -> Vec<[u32; 3]> {
    let mut left: Vec<usize> = (0..outline.len()).collect();
    let mut triangles = Vec::with_capacity(outline.len().saturating_sub(2));
    while left.len() >= 3 {
        let count = left.len();
        let ear = |i: usize| [left[(i + count - 1) % count], left[i], left[(i + 1) % count]];
        let best = (0..count)
            .map(|i| (i, shape(outline, ear(i), &left)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        // A simple polygon always has an ear; one that is not simple ends here without its rest.
        let Some((i, _)) = best.filter(|(_, shape)| *shape > 0.0) else { break };
        triangles.push(ear(i).map(|v| v as u32));
        left.remove(i);
    }
    triangles
}

/// Twice the area over the longest edge squared; 0 when this is no ear of the polygon `left`.
fn shape(outline: &[Vec2], ear: [usize; 3], left: &[usize]) -> f32 {
    let [a, b, c] = ear.map(|v| outline[v]);
    let area = (b - a).perp_dot(c - a);
    let inside = |p: Vec2| {
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).perp_dot(p - *from) >= 0.0)
    };
    if area <= 1e-7 || left.iter().any(|&v| !ear.contains(&v) && inside(outline[v])) {
        return 0.0;
    }
    area / (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared())
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_closed;
    use super::*;

    #[test]
    fn concave_plates_are_closed_and_have_their_volume() {
        let points =
            |list: &[(f32, f32)]| list.iter().map(|&(x, y)| Vec2::new(x, y)).collect::<Vec<_>>();
        let square = points(&[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]);
        assert!((assert_closed("square", &extruded(&square, 0.5)) - 0.5).abs() < 1e-6);
        let gate = [
            (0.0, 0.0),
            (1.0, 0.0),
            (1.0, 2.0),
            (2.0, 2.0),
            (2.0, 0.0),
            (3.0, 0.0),
            (3.0, 3.0),
            (0.0, 3.0),
        ];
        assert!((assert_closed("gate", &extruded(&points(&gate), 2.0)) - 14.0).abs() < 1e-5);
    }

    #[test]
    fn an_outline_that_crosses_itself_ends() {
        let bow = [Vec2::ZERO, Vec2::ONE, Vec2::X, Vec2::Y];
        assert!(extruded(&bow, 1.0).position.len() == 8);
        assert!(extruded(&[], 1.0).position.is_empty());
    }
}
