//! Three ribbons plaited around a trefoil knot.

use glam::Vec3;
use std::f32::consts::TAU;

/// Radii of the torus on which the knot lies, metres; it stands in the plane of x and y.
const TORUS: [f32; 2] = [0.65, 0.3];
/// How far strands swing sideways and outward, and how often along the knot.
const SWING: [f32; 2] = [0.14, 0.062];
const CROSSINGS: f32 = 15.0;
/// Half thickness and half width of a ribbon.
const RIBBON: [f32; 2] = [0.025, 0.07];

/// Strand 0, 1 or 2 of the plait, as a frame for [`ring`](super::ring): its point at `t` (0..1, period
/// 1) and the half axes of its section. Strands stay apart; all lie within 1.2 m of the origin.
pub fn plaited_trefoil(strand: usize, t: f32) -> [Vec3; 3] {
    let point = |t: f32| {
        let [centre, out, side] = trefoil(t);
        let phase = TAU * (CROSSINGS * t + strand as f32 / 3.0);
        centre + side * (SWING[0] * libm::sinf(phase)) + out * (SWING[1] * libm::sinf(2.0 * phase))
    };
    let along = (point(t + 1e-3) - point(t - 1e-3)).normalize();
    let out = trefoil(t)[1].reject_from_normalized(along).normalize();
    [point(t), out * RIBBON[0], along.cross(out) * RIBBON[1]]
}

/// The knot that winds twice about the axis and three times about the tube: its point, the torus'
/// normal there, and the direction square to that and to the knot.
fn trefoil(t: f32) -> [Vec3; 3] {
    let ((sin, cos), (lift, reach)) = (libm::sincosf(2.0 * TAU * t), libm::sincosf(3.0 * TAU * t));
    let [major, minor] = TORUS;
    let (around, radial) = (Vec3::new(-sin, cos, 0.0), Vec3::new(cos, sin, 0.0));
    let out = radial * reach + Vec3::Z * lift;
    let turn = Vec3::Z * reach - radial * lift;
    let along = around * (2.0 * (major + minor * reach)) + turn * (3.0 * minor);
    [radial * major + out * minor, out, along.normalize().cross(out)]
}

#[cfg(test)]
mod tests {
    use super::super::{ring, tests::assert_closed};
    use super::*;

    #[test]
    fn strands_are_closed_and_within_reach() {
        for strand in 0..3 {
            let solid = ring(|t| plaited_trefoil(strand, t), 600, 8);
            assert_closed("strand", &solid);
            assert!(solid.position.iter().all(|p| p.length() < 1.2));
        }
    }

    #[test]
    fn strands_pass_over_and_under_each_other_without_touching() {
        let centres =
            |strand| (0..2000).map(move |i| plaited_trefoil(strand, i as f32 / 2000.0)[0]);
        let second: Vec<Vec3> = centres(1).collect();
        let nearest = centres(0)
            .map(|p| second.iter().map(|q| p.distance(*q)).fold(f32::MAX, f32::min))
            .fold(f32::MAX, f32::min);
        assert!(nearest > 2.0 * RIBBON[0], "{nearest}");
    }
}
