//! Which triangles bound closed solids.
//!
//! Materials are often double-sided although their meshes are closed: light that is gathered on both
//! sides of such a triangle is wasted on the inside of the solid, and leaks out of it. A mesh is
//! taken as a solid when each of its edges is passed as often in one direction as in the other, and
//! it encloses a volume. In doubt both sides are seen: that costs work, while a side that is left
//! out wrongly stays black.

mod meshes;
mod nesting;

use glam::Vec3;
use meshes::{Meshes, weld};

/// No vertex or no component.
const NONE: u32 = u32::MAX;

/// The sides of a triangle that can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// Part of an open surface, or of a closed one with other surfaces within: it may be a room.
    Both,
    /// Of a closed solid whose front faces look outward.
    Front,
    /// Of a closed solid that is inside out: its front faces look inward.
    Back,
}

/// The sides that can be seen of every triangle. `corners` gives the corners of a triangle below
/// `triangles`, world space, counter-clockwise from the front; it is asked several times.
///
/// Corners meet where their coordinates are equal to the last bit, and triangles belong together
/// where they share an edge. The order of the triangles does not matter but for rounding in the
/// volume. A closed mesh counts as open when the bounding box of another mesh lies in its own: it
/// may be a room that is seen from within, and walls have no thickness. An empty room cannot be
/// told from a solid. A triangle with two corners in one point is seen like those it touches. It is
/// [`Seen::Both`] where a coordinate is not finite, and for all when there are more than 2³²/3
/// triangles.
pub fn seen(corners: impl Fn(u32) -> [Vec3; 3], triangles: u32) -> Vec<Seen> {
    if triangles > u32::MAX / 3 {
        return vec![Seen::Both; triangles as usize];
    }
    // The largest array serves the corners first, then the edges.
    let mut key = Vec::with_capacity(3 * triangles as usize);
    let (vertex, vertices) = weld(&corners, triangles, &mut key);
    let meshes = Meshes::new(&vertex, &mut key);
    drop(key);
    let verdict = meshes.verdicts(&corners);

    let mut at_vertex = vec![None; vertices];
    for (of, &mesh) in vertex.iter().zip(&meshes.mesh) {
        if mesh != NONE {
            for &v in of {
                let known = &mut at_vertex[v as usize];
                *known = agreed(*known, Some(verdict[mesh as usize]));
            }
        }
    }
    let touching = |of: &[u32; 3]| {
        let known = of.iter().filter_map(|&v| at_vertex.get(v as usize).copied());
        known.fold(None, agreed).unwrap_or(Seen::Both)
    };
    let one = |(of, &mesh)| if mesh == NONE { touching(of) } else { verdict[mesh as usize] };
    vertex.iter().zip(&meshes.mesh).map(one).collect()
}

/// What two meshes that touch have in common.
fn agreed(a: Option<Seen>, b: Option<Seen>) -> Option<Seen> {
    match (a, b) {
        (Some(a), Some(b)) if a != b => Some(Seen::Both),
        _ => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::{Seen, seen};
    use glam::{Vec3, vec3};

    type Triangle = [Vec3; 3];

    fn verdicts(triangles: &[Triangle]) -> Vec<Seen> {
        seen(|t| triangles[t as usize], triangles.len() as u32)
    }

    fn all(triangles: &[Triangle], expected: Seen) {
        assert_eq!(verdicts(triangles), vec![expected; triangles.len()]);
    }

    fn quad([a, b, c, d]: [Vec3; 4]) -> [Triangle; 2] {
        [[a, b, c], [a, c, d]]
    }

    /// Two triangles a face, fronts outward; the last face is that of high z.
    fn cube(low: Vec3, size: f32) -> Vec<Triangle> {
        let at = |n: usize| low + size * vec3((n & 1) as f32, (n >> 1 & 1) as f32, (n >> 2) as f32);
        let faces =
            [[0, 2, 3, 1], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [4, 5, 7, 6]];
        faces.into_iter().flat_map(|face| quad(face.map(at))).collect()
    }

    fn turned(triangles: &[Triangle]) -> Vec<Triangle> {
        triangles.iter().map(|&[a, b, c]| [a, c, b]).collect()
    }

    #[test]
    fn a_solid_is_seen_from_outside() {
        for low in [Vec3::ZERO, Vec3::splat(-0.5), vec3(1e4, -2e4, 3e4)] {
            let cube = cube(low, 1.0);
            all(&cube, Seen::Front);
            all(&turned(&cube), Seen::Back);
        }
        all(&[], Seen::Both);
    }

    #[test]
    fn the_sign_of_zero_does_not_open_a_solid() {
        let mut cube = cube(Vec3::ZERO, 1.0);
        cube[0] = cube[0].map(|c| Vec3::select(c.cmpeq(Vec3::ZERO), Vec3::splat(-0.0), c));
        all(&cube, Seen::Front);
    }

    #[test]
    fn open_and_flat_surfaces_are_seen_from_both_sides() {
        let cube = cube(Vec3::ZERO, 1.0);
        all(&cube[..10], Seen::Both);
        all(&cube[..11], Seen::Both);
        all(&cube[..2], Seen::Both);
        all(&[&cube[..2], &turned(&cube[..2])].concat(), Seen::Both);
        // Both sides modelled: no volume either.
        all(&[&cube[..], &turned(&cube)].concat(), Seen::Both);
        // One face that looks the other way.
        all(&[&turned(&cube[..2]), &cube[2..]].concat(), Seen::Both);
        // A plate is a solid unless it is thin beyond all use.
        let plate = |thickness: f32| {
            let flat = |t: &Triangle| t.map(|c| c * vec3(1.0, 1.0, thickness));
            cube.iter().map(flat).collect::<Vec<_>>()
        };
        all(&plate(1e-4), Seen::Front);
        all(&plate(1e-7), Seen::Both);
    }

    #[test]
    fn solids_may_touch() {
        let first = cube(Vec3::ZERO, 1.0);
        for low in [vec3(1.0, 1.0, 0.0), Vec3::ONE, vec3(1.0, 0.0, 0.0)] {
            all(&[first.clone(), cube(low, 1.0)].concat(), Seen::Front);
        }
        // In a vertex each keeps its own orientation.
        let found = verdicts(&[first, turned(&cube(Vec3::ONE, 1.0))].concat());
        assert_eq!(found, [[Seen::Front; 12], [Seen::Back; 12]].concat());
    }

    #[test]
    fn a_closed_mesh_around_another_may_be_a_room() {
        let room = cube(Vec3::ZERO, 10.0);
        let inner = cube(Vec3::splat(4.0), 1.0);
        for room in [turned(&room), room] {
            let found = verdicts(&[inner.clone(), room].concat());
            assert_eq!(found, [[Seen::Front; 12], [Seen::Both; 12]].concat());
        }
    }

    #[test]
    fn rooms_are_found_among_many_solids() {
        // 12³ cubes in a grid, some with a sheet in them.
        let places =
            (0..1728).map(|n| vec3((n % 12) as f32, (n / 12 % 12) as f32, (n / 144) as f32));
        let is_room = |n: usize| n % 7 == 3;
        let mut triangles = Vec::new();
        let mut expected = Vec::new();
        for (n, low) in places.enumerate() {
            triangles.extend(cube(2.0 * low, 1.0));
            expected.extend([if is_room(n) { Seen::Both } else { Seen::Front }; 12]);
            if is_room(n) {
                triangles.extend_from_slice(&cube(2.0 * low + 0.25, 0.5)[..2]);
                expected.extend([Seen::Both; 2]);
            }
        }
        assert_eq!(verdicts(&triangles), expected);
    }

    #[test]
    fn triangles_without_area_go_with_what_they_touch() {
        let solid = cube(Vec3::ZERO, 1.0);
        let far = cube(Vec3::splat(5.0), 1.0);
        let extra = [
            [Vec3::ZERO, Vec3::ZERO, Vec3::X],
            [Vec3::X, Vec3::X, Vec3::X],
            [Vec3::ZERO, Vec3::ZERO, Vec3::splat(9.0)],
            [Vec3::splat(5.0), Vec3::splat(5.0), Vec3::ZERO],
            [Vec3::splat(9.0); 3],
        ];
        let found = verdicts(&[&extra[..], &solid, &turned(&far)].concat());
        let (front, both) = (Seen::Front, Seen::Both);
        assert_eq!(found[..5], [front, front, front, both, both]);
        assert_eq!(found[5..], [[Seen::Front; 12], [Seen::Back; 12]].concat());
    }

    #[test]
    fn what_is_not_finite_is_open() {
        for wrong in [f32::NAN, f32::INFINITY] {
            let mut triangles = [cube(Vec3::ZERO, 1.0), cube(Vec3::splat(3.0), 1.0)].concat();
            triangles[4][1].y = wrong;
            let found = verdicts(&triangles);
            assert_eq!(found, [[Seen::Both; 12], [Seen::Front; 12]].concat());
            all(&[[Vec3::splat(wrong); 3]], Seen::Both);
        }
    }

    #[test]
    fn a_vertex_in_the_middle_of_an_edge_opens_a_mesh() {
        let cube = cube(Vec3::ZERO, 1.0);
        let split = |[a, b, c]: Triangle| [[a, a.midpoint(b), c], [a.midpoint(b), b, c]];
        all(&[&split(cube[0])[..], &cube[1..]].concat(), Seen::Both);
        // A triangle without area between the three closes it.
        let [a, b, _] = cube[0];
        let filler = [a, b, a.midpoint(b)];
        all(&[&split(cube[0])[..], &[filler], &cube[1..]].concat(), Seen::Front);
    }

    #[test]
    fn the_order_of_the_triangles_does_not_matter() {
        let mut triangles = cube(Vec3::ZERO, 10.0);
        triangles.extend(cube(Vec3::splat(4.0), 1.0));
        triangles.extend(turned(&cube(Vec3::splat(5.0), 1.0)));
        triangles.extend_from_slice(&cube(Vec3::splat(20.0), 1.0)[2..]);
        triangles.push([Vec3::splat(5.0), Vec3::splat(5.0), Vec3::ZERO]);
        let expected = verdicts(&triangles);
        assert!([Seen::Both, Seen::Front, Seen::Back].iter().all(|s| expected.contains(s)));
        // A prime number of triangles, so that every step reaches all of them.
        let count = triangles.len();
        assert_eq!(count, 47);
        for step in 1..count {
            let order: Vec<_> = (0..count).map(|n| (n * step + 3) % count).collect();
            let permuted: Vec<_> = order.iter().map(|&n| triangles[n]).collect();
            let wanted: Vec<_> = order.iter().map(|&n| expected[n]).collect();
            assert_eq!(verdicts(&permuted), wanted);
        }
    }
}
