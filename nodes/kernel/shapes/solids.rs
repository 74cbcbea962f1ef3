//! Boxes, turned solids and closed rings.

use super::{Solid, area_vector};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// The box between two corners with its edges cut off at `bevel` metres from each side (44 triangles).
pub fn bevelled_box(low: Vec3, high: Vec3, bevel: f32) -> Solid {
    let (centre, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let inset = half - Vec3::splat(bevel.min(half.min_element() * 0.49));
    // Vertex 3 corner + axis lies on the face of that axis; bit k of `corner` is the sign along axis k.
    let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
    let mut solid = Solid::default();
    for corner in 0..8 {
        for axis in 0..3 {
            let along = |k| sign(corner, k) * if k == axis { half[k] } else { inset[k] };
            solid.position.push(centre + Vec3::new(along(0), along(1), along(2)));
        }
    }
    let vertex = |corner: usize, axis: usize| (3 * corner + axis) as u32;
    for axis in 0..3 {
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        for side in [0, 1 << axis] {
            solid.quad([side, side | u, side | u | v, side | v].map(|corner| vertex(corner, axis)));
        }
        // The bevels along `axis` between the faces of the other two, one for each pair of signs.
        for (a, b) in [(0, 0), (u, 0), (0, v), (u, v)] {
            let (near, far) = (a | b, a | b | 1 << axis);
            let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
            solid.quad([
                vertex(near, first),
                vertex(far, first),
                vertex(far, second),
                vertex(near, second),
            ]);
        }
    }
    solid.triangle.extend((0..8).map(|corner| [0, 1, 2].map(|axis| vertex(corner, axis))));
    for i in 0..solid.triangle.len() {
        let triangle = solid.triangle[i];
        let middle: Vec3 = triangle.iter().map(|&v| solid.position[v as usize] - centre).sum();
        if area_vector(&solid, &triangle).dot(middle) < 0.0 {
            solid.triangle[i].swap(1, 2);
        }
    }
    solid
}

/// A profile turned about the Y axis: `profile` lists (radius, height) from the bottom up, `sides` is
/// the number of faces around (at least 3). Ends of a radius above 0 are closed by a flat disc.
pub fn lathe(profile: &[Vec2], sides: usize) -> Solid {
    let sides = sides.max(3);
    let mut rings = profile.to_vec();
    let closed = |end: Option<&Vec2>| end.filter(|p| p.x > 0.0).map(|p| Vec2::new(0.0, p.y));
    rings.splice(0..0, closed(profile.first()));
    rings.extend(closed(profile.last()));
    let mut solid = Solid::default();
    let mut starts = Vec::new();
    for ring in &rings {
        starts.push(solid.position.len());
        for side in 0..if ring.x > 0.0 { sides } else { 1 } {
            let (sin, cos) = libm::sincosf(side as f32 / sides as f32 * TAU);
            solid.position.push(Vec3::new(ring.x * cos, ring.y, -ring.x * sin));
        }
    }
    for (pair, start) in rings.windows(2).zip(starts.windows(2)) {
        for side in 0..sides {
            let next = (side + 1) % sides;
            match (pair[0].x > 0.0, pair[1].x > 0.0) {
                (true, true) => {
                    let at = [start[0] + side, start[0] + next, start[1] + next, start[1] + side];
                    solid.quad(at.map(|v| v as u32));
                }
                (false, true) => solid
                    .triangle
                    .push([start[0], start[1] + next, start[1] + side].map(|v| v as u32)),
                (true, false) => solid
                    .triangle
                    .push([start[0] + side, start[0] + next, start[1]].map(|v| v as u32)),
                (false, false) => {}
            }
        }
    }
    solid
}

/// A ball about the origin with `rings` bands of faces from pole to pole and twice as many around.
pub fn ball(radius: f32, rings: usize) -> Solid {
    let rings = rings.max(2);
    let point = |ring: usize| match ring {
        0 => Vec2::new(0.0, -radius),
        ring if ring == rings => Vec2::new(0.0, radius),
        ring => Vec2::from_angle(PI * (ring as f32 / rings as f32 - 0.5)) * radius,
    };
    lathe(&(0..=rings).map(point).collect::<Vec<_>>(), 2 * rings)
}

/// A closed band: an ellipse swept around a closed path. `frame` maps 0..1 to the path's point and the
/// half axes of the ellipse there (period 1; `u x v` along the path); `segments` run along, `sides` around.
pub fn ring(frame: impl Fn(f32) -> [Vec3; 3], segments: usize, sides: usize) -> Solid {
    let (segments, sides) = (segments.max(3), sides.max(3));
    let mut solid = Solid::default();
    for segment in 0..segments {
        let [centre, u, v] = frame(segment as f32 / segments as f32);
        solid.position.extend((0..sides).map(|side| {
            let (sin, cos) = libm::sincosf(side as f32 / sides as f32 * TAU);
            centre + u * cos + v * sin
        }));
    }
    for segment in 0..segments {
        let (here, there) = (segment * sides, (segment + 1) % segments * sides);
        for side in 0..sides {
            let next = (side + 1) % sides;
            solid.quad([here + side, here + next, there + next, there + side].map(|v| v as u32));
        }
    }
    solid
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_closed;
    use super::*;

    #[test]
    fn boxes_are_closed_and_a_little_smaller_for_their_bevel() {
        let volume = assert_closed("box", &bevelled_box(Vec3::ONE, Vec3::new(2.0, 3.0, 4.0), 0.1));
        assert!((5.8..6.0).contains(&volume), "{volume}");
        assert_closed("flat box", &bevelled_box(Vec3::ZERO, Vec3::new(2.0, 0.01, 4.0), 0.1));
    }

    #[test]
    fn turned_solids_are_closed_with_and_without_poles() {
        let volume = assert_closed("ball", &ball(1.0, 20));
        assert!((volume - 4.0 / 3.0 * PI).abs() < 0.06, "{volume}");
        assert_closed("coarse ball", &ball(0.1, 0));
        let volume = assert_closed("drum", &lathe(&[Vec2::new(1.0, 0.0), Vec2::new(1.0, 2.0)], 64));
        assert!((volume - TAU).abs() < 0.03, "{volume}");
    }

    #[test]
    fn rings_are_closed() {
        let frame = |t: f32| {
            let (sin, cos) = (t * TAU).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            [out * 2.0, out * 0.5, Vec3::Y * 0.25]
        };
        let volume = assert_closed("ring", &ring(frame, 200, 40));
        assert!((volume - TAU * 2.0 * TAU / 2.0 * 0.125).abs() < 0.05, "{volume}");
    }
}
