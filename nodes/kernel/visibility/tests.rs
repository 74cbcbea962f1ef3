//! Packets against single rays, single rays against brute force in double precision.

use super::*;
use glam::{Affine3A, DVec3, Quat};
use std::sync::Arc;

const OPAQUE: &Filter = &|_, _, _| true;

fn blocked_from(world: &World, origin: Vec3, ends: &Ends, active: u64) -> u64 {
    world.occluded_from(origin, ends, active, &mut Blocker::default(), OPAQUE)
}

fn blocked_along(world: &World, direction: Vec3, starts: &Ends, active: u64) -> u64 {
    world.occluded_parallel(direction, starts, active, &mut Blocker::default(), OPAQUE)
}

/// A small generator of its own, so that the tests fix their scenes.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// In the cube from -1 to 1.
    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

fn soup(seed: u64, count: usize, size: f32) -> Vec<[Vec3; 3]> {
    let mut random = Random(seed);
    let triangle = |_| {
        let centre = random.point();
        std::array::from_fn(|_| centre + random.point() * size)
    };
    (0..count).map(triangle).collect()
}

fn world(triangles: &[[Vec3; 3]], masked: &[bool]) -> World {
    let blas = Arc::new(Blas::new(triangles, masked, Build::Medium));
    World::new(vec![Instance { blas, to_world: Affine3A::IDENTITY, first_triangle: 0 }])
}

/// Solves for t and the weights in f64; also says how far from the edge and the ends the hit is.
fn brute(triangle: &[Vec3; 3], origin: Vec3, direction: Vec3) -> Option<(f64, DVec3)> {
    let [a, b, c] = triangle.map(|v| v.as_dvec3());
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let (e, f) = (b - a, c - a);
    let p = d.cross(f);
    let det = e.dot(p);
    let s = o - a;
    let q = s.cross(e);
    let (u, v) = (s.dot(p) / det, d.dot(q) / det);
    (det != 0.0).then(|| (f.dot(q) / det, DVec3::new(1.0 - u - v, u, v)))
}

#[test]
fn closest_agrees_with_brute_force() {
    for (seed, scale, offset) in
        [(1, 1.0, 0.0), (2, 1e-6, 0.0), (3, 1e6, 0.0), (4, 1.0, 1e3), (5, 100.0, 1e6)]
    {
        let place = |p: Vec3| p * scale + Vec3::splat(offset);
        let triangles: Vec<_> = soup(seed, 600, 0.2).iter().map(|t| t.map(place)).collect();
        let world = world(&triangles, &[]);
        let mut random = Random(seed + 100);
        let (mut hits, mut doubtful) = (0, 0);
        for _ in 0..1500 {
            let origin = place(random.point() * 1.5);
            let direction = random.point() * scale;
            let mut sure = true;
            let mut best: Option<(f64, u32)> = None;
            for (i, triangle) in triangles.iter().enumerate() {
                let Some((t, weights)) = brute(triangle, origin, direction) else { continue };
                let margin = weights.min_element();
                if margin.abs() < 1e-3 || t.abs() < 1e-3 {
                    sure = false;
                }
                if margin >= 0.0 && t > 0.0 && best.is_none_or(|(b, _)| t < b) {
                    best = Some((t, i as u32));
                }
            }
            let found = world.closest(origin, direction, 0.0, f32::INFINITY, OPAQUE);
            assert_eq!(found.is_some(), world.occluded_along(origin, direction, OPAQUE));
            if let (Some(hit), Some((t, triangle))) = (found, best)
                && hit.triangle == triangle
            {
                hits += 1;
                assert!((f64::from(hit.t) - t).abs() <= 1e-3 * t.abs(), "{hit:?} {t}");
            } else if found.map(|h| h.triangle) != best.map(|b| b.1) {
                assert!(!sure, "{seed}: {found:?} {best:?}");
                doubtful += 1;
            }
        }
        assert!(hits > 250 && doubtful < 5, "{seed}: {hits} {doubtful}");
    }
}

/// The packet's answers that differ from the single ray's, and how many were asked.
fn differing(world: &World, points: &[Vec3], filter: &Filter) -> (u32, u32) {
    let (mut differ, mut asked) = (0, 0);
    let mut blocker = Blocker::default();
    for (i, chunk) in points.chunks(64).enumerate() {
        let (ends, all) = Ends::from_points(chunk);
        let active = all & !(0x9111_0000_0421_8000u64.rotate_left(i as u32));
        let shared = points[(i * 977 + 13) % points.len()];
        let [mut none, mut also_none] = [Blocker::default(); 2];
        let from = world.occluded_from(shared, &ends, active, &mut none, filter);
        let parallel = world.occluded_parallel(shared, &ends, active, &mut also_none, filter);
        // What blocked other rays decides nothing.
        assert_eq!(world.occluded_from(shared, &ends, active, &mut blocker, filter), from);
        assert_eq!(world.occluded_parallel(shared, &ends, active, &mut blocker, filter), parallel);
        assert_eq!((from | parallel) & !active, 0);
        for (lane, &point) in chunk.iter().enumerate().filter(|(l, _)| active >> l & 1 != 0) {
            let single = world.occluded(shared, point, filter);
            let along = world.occluded_along(point, shared, filter);
            differ += u32::from(single != (from >> lane & 1 != 0));
            differ += u32::from(along != (parallel >> lane & 1 != 0));
            asked += 2;
        }
    }
    (differ, asked)
}

/// Points in tiles, so that packets are coherent, with a share of incoherent ones.
fn points(seed: u64, count: usize) -> Vec<Vec3> {
    let mut random = Random(seed);
    let mut centre = Vec3::ZERO;
    (0..count)
        .map(|i| {
            if i % 64 == 0 {
                centre = random.point() * 1.2;
            }
            let near = centre + random.point() * 0.1;
            if i % 512 < 384 { near } else { random.point() * 1.3 }
        })
        .collect()
}

#[test]
fn packets_agree_with_single_rays() {
    for (seed, count, size) in
        [(1, 0, 1.0), (2, 1, 1.0), (3, 9, 0.7), (4, 500, 0.1), (5, 8000, 0.03)]
    {
        let triangles = soup(seed, count, size);
        for scale in [1.0, 1e-6, 1e6] {
            let triangles: Vec<_> = triangles.iter().map(|t| t.map(|p| p * scale)).collect();
            let points: Vec<_> = points(seed, 6000).iter().map(|p| *p * scale).collect();
            let (differ, asked) = differing(&world(&triangles, &[]), &points, OPAQUE);
            assert!(differ * 20_000 <= asked, "{seed} {scale}: {differ} of {asked}");
        }
    }
}

#[test]
fn degenerate_scenes_agree() {
    let mut random = Random(9);
    // A flat grid, everything twice, slivers, and what must be left out; points on its vertices and planes too.
    let mut triangles = Vec::new();
    for i in 0..400 {
        let corner =
            Vec3::new((i % 20) as f32, 0.0, (i / 20) as f32) * 0.1 - Vec3::new(1.0, 0.0, 1.0);
        let [x, z] = [Vec3::X * 0.1, Vec3::Z * 0.1];
        triangles
            .extend([[corner, corner + x, corner + z], [corner + x, corner + x + z, corner + z]]);
    }
    triangles.extend(triangles.clone());
    triangles.extend((0..200).map(|_| {
        let (p, q) = (random.point(), random.point());
        [p, q, (p + q) * 0.5 + Vec3::splat(1e-6)]
    }));
    triangles.extend([
        [Vec3::ONE; 3],
        [Vec3::NAN, Vec3::X, Vec3::Y],
        [Vec3::ZERO, Vec3::X, Vec3::INFINITY],
    ]);
    let mut points = points(3, 3000);
    for i in 0..3000 {
        let p = random.point();
        points.push(match i % 6 {
            0 => (p * 10.0).round() * 0.1,
            1 => Vec3::new(p.x, 0.0, 0.0),
            2 => Vec3::new(p.x, 0.0, p.z),
            3 => Vec3::Y * p.y,
            4 => Vec3::ZERO,
            _ if i % 18 == 5 => Vec3::new(f32::NAN, p.y, f32::INFINITY),
            _ => p * 1e9,
        });
    }
    let world = world(&triangles, &[]);
    let (differ, asked) = differing(&world, &points, OPAQUE);
    assert!(differ * 1000 <= asked, "{differ} of {asked}");
    // Through grid vertices and along grid edges, straight down: never a leak.
    for i in 1..19 {
        for j in 1..19 {
            let above = Vec3::new(i as f32, 10.0, j as f32) * 0.1 - Vec3::new(1.0, 0.0, 1.0);
            assert!(world.occluded_along(above, Vec3::NEG_Y, OPAQUE));
            let below = above - Vec3::Y * 3.0;
            assert!(world.occluded(above, below, OPAQUE));
            let (ends, mask) = Ends::from_points(&[below]);
            assert_eq!(blocked_from(&world, above, &ends, mask), 1);
            let (starts, mask) = Ends::from_points(&[above]);
            assert_eq!(blocked_along(&world, Vec3::NEG_Y, &starts, mask), 1);
        }
    }
}

#[test]
fn nothing_is_hit_in_an_empty_world() {
    let (ends, all) = Ends::from_points(&[Vec3::ONE; 64]);
    assert_eq!(all, u64::MAX);
    for world in [World::new(Vec::new()), world(&[], &[]), world(&[[Vec3::X; 3]], &[])] {
        assert_eq!(world.closest(Vec3::ZERO, Vec3::X, 0.0, f32::INFINITY, OPAQUE), None);
        assert!(!world.occluded(Vec3::ZERO, Vec3::X, OPAQUE));
        assert_eq!(blocked_from(&world, Vec3::ZERO, &ends, all), 0);
        assert_eq!(blocked_along(&world, Vec3::X, &ends, all), 0);
    }
}

#[test]
fn instances_agree_with_the_same_triangles_flattened() {
    let mesh = soup(3, 800, 0.2);
    let blas = Arc::new(Blas::new(&mesh, &[], Build::Fast));
    let mut random = Random(4);
    let mut places = vec![Affine3A::IDENTITY, Affine3A::from_translation(Vec3::X * 2.0)];
    places.extend((0..6).map(|_| {
        Affine3A::from_scale_rotation_translation(
            Vec3::new(0.5, -1.5, 1.0),
            Quat::from_scaled_axis(random.point() * 3.0),
            random.point() * 2.0,
        )
    }));
    let mut instances = Vec::new();
    let mut flat = Vec::new();
    for &to_world in &places {
        let first_triangle = flat.len() as u32;
        flat.extend(mesh.iter().map(|t| t.map(|p| to_world.transform_point3(p))));
        instances.push(Instance { blas: blas.clone(), to_world, first_triangle });
    }
    let flattened = Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0));
    instances.push(Instance { blas: blas.clone(), to_world: flattened, first_triangle: 0 });
    let (world, flat) = (World::new(instances), world(&flat, &[]));
    assert_eq!(world.skipped(), 1);
    assert!(world.bytes() < 2 * blas.bytes() && flat.bytes() > 6 * blas.bytes());
    let points: Vec<_> = points(8, 4000).iter().map(|p| *p * 2.5).collect();
    let (differ, asked) = differing(&world, &points, OPAQUE);
    assert!(differ * 2000 <= asked, "{differ} of {asked}");
    let mut differ = 0;
    for pair in points.windows(2) {
        let ray = |w: &World| w.closest(pair[0], pair[1] - pair[0], 0.0, f32::INFINITY, OPAQUE);
        differ += u32::from(ray(&world).map(|h| h.triangle) != ray(&flat).map(|h| h.triangle));
    }
    assert!(differ < 4, "{differ}");
}

#[test]
fn only_masked_triangles_ask_the_filter() {
    let triangles = soup(5, 900, 0.2);
    let masked: Vec<bool> = (0..900).map(|i| i % 3 != 0).collect();
    let keep = |triangle: u32, u: f32, v: f32| {
        assert!(!triangle.is_multiple_of(3) && u >= 0.0 && v >= 0.0 && u + v <= 1.0001);
        triangle % 3 == 1
    };
    let halved = world(&triangles, &masked);
    // The same with what the filter takes away made degenerate.
    let rest: Vec<_> = triangles
        .iter()
        .enumerate()
        .map(|(i, t)| if i % 3 == 2 { [t[0]; 3] } else { *t })
        .collect();
    let rest = world(&rest, &[]);
    let points = points(6, 4000);
    for pair in points.windows(2) {
        let (from, way) = (pair[0], pair[1] - pair[0]);
        let found = halved.closest(from, way, 0.0, 9.0, &keep);
        assert_eq!(found, rest.closest(from, way, 0.0, 9.0, OPAQUE));
    }
    let (differ, asked) = differing(&halved, &points, &keep);
    assert!(differ * 20_000 <= asked, "{differ} of {asked}");
    assert_ne!(
        points.windows(2).filter(|p| halved.occluded(p[0], p[1], &keep)).count(),
        points.windows(2).filter(|p| halved.occluded(p[0], p[1], OPAQUE)).count(),
    );
}

#[test]
fn of_coincident_triangles_the_first_is_closest() {
    let one = [Vec3::new(-1.0, -1.0, 1.0), Vec3::new(3.0, -1.0, 1.0), Vec3::new(-1.0, 3.0, 1.0)];
    let world = world(&[one; 100], &[]);
    let hit = world.closest(Vec3::ZERO, Vec3::Z, 0.0, 2.0, OPAQUE);
    assert_eq!(hit, Some(Hit { t: 1.0, triangle: 0, u: 0.25, v: 0.25 }));
    // Both ends are excluded.
    assert_eq!(world.closest(Vec3::ZERO, Vec3::Z, 1.0, 2.0, OPAQUE), None);
    assert_eq!(world.closest(Vec3::ZERO, Vec3::Z, 0.0, 1.0, OPAQUE), None);
    assert!(!world.occluded(Vec3::ZERO, Vec3::Z, OPAQUE));
    assert!(!world.occluded(Vec3::Z, Vec3::ZERO, OPAQUE));
    assert!(world.occluded(Vec3::ZERO, Vec3::Z * 1.01, OPAQUE));
}

/// A closed sphere of 20,000 triangles.
fn sphere(centre: Vec3, radius: f32) -> Vec<[Vec3; 3]> {
    let (rings, sectors) = (100, 101);
    let at = |ring: usize, sector: usize| {
        let theta = std::f32::consts::PI * ring as f32 / rings as f32;
        let phi = std::f32::consts::TAU * (sector % sectors) as f32 / sectors as f32;
        let around = if ring == 0 || ring == rings { 0.0 } else { theta.sin() };
        centre + radius * Vec3::new(around * phi.cos(), theta.cos(), around * phi.sin())
    };
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [at(ring, sector), at(ring, sector + 1)];
            let [c, d] = [at(ring + 1, sector), at(ring + 1, sector + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    triangles
}

#[test]
fn a_closed_sphere_does_not_leak() {
    for (centre, radius) in [(Vec3::ZERO, 1.0), (Vec3::splat(1e4), 30.0), (Vec3::ONE, 1e-4)] {
        let triangles = sphere(centre, radius);
        assert!(triangles.len() >= 20_000);
        let world = world(&triangles, &[]);
        let mut targets: Vec<Vec3> = Vec::new();
        let mut random = Random(7);
        for triangle in triangles.iter().step_by(3) {
            // Straight at vertices and edges, then at the inside.
            let [a, b, c] = *triangle;
            targets.extend([a, a + (b - a) * random.next(), (a + b + c) / 3.0]);
        }
        let outside = |p: Vec3| centre + (p - centre) * 3.0;
        for chunk in targets.chunks(64) {
            let points: Vec<Vec3> = chunk.iter().map(|p| outside(*p)).collect();
            let (ends, all) = Ends::from_points(&points);
            assert_eq!(blocked_from(&world, centre, &ends, all), all, "{centre} {radius}");
            for &end in &points {
                assert!(world.occluded(centre, end, OPAQUE));
            }
            let starts: Vec<Vec3> = chunk.iter().map(|p| centre + (*p - centre) * 0.5).collect();
            let (starts, all) = Ends::from_points(&starts);
            let direction = chunk[0] - centre;
            assert_eq!(blocked_along(&world, direction, &starts, all), all);
        }
    }
}

#[test]
fn rays_at_corners_do_not_leak() {
    let mut leaks = 0;
    for (centre, radius) in [(Vec3::ZERO, 1.0), (Vec3::new(50.0, -3.0, 7.0), 10.0)] {
        let triangles = sphere(centre, radius);
        let world = world(&triangles, &[]);
        let mut random = Random(11);
        for _ in 0..8 {
            let eye = centre + (random.point() - Vec3::splat(0.5)) * radius;
            for [corner, ..] in &triangles {
                leaks += u32::from(!world.occluded(eye, eye + (*corner - eye) * 3.0, OPAQUE));
            }
        }
    }
    assert_eq!(leaks, 0);
}

#[test]
fn the_nearest_of_a_packet_are_those_of_single_rays() {
    let filter: &Filter = &|triangle, u, _| !triangle.is_multiple_of(3) || u > 0.2;
    let (mut differ, mut hits, mut asked) = (0, 0, 0);
    for (seed, count, size) in [(1, 0, 1.0), (2, 1, 1.0), (4, 500, 0.1), (5, 8000, 0.03)] {
        for scale in [1.0, 1e-6, 1e6] {
            let triangles = soup(seed, count, size);
            let masked: Vec<bool> = (0..count).map(|i| i % 2 == 0).collect();
            let triangles: Vec<_> = triangles.iter().map(|t| t.map(|p| p * scale)).collect();
            let blas = Arc::new(Blas::new(&triangles, &masked, Build::Medium));
            let turned = Affine3A::from_rotation_translation(
                Quat::from_rotation_x(0.7),
                Vec3::new(0.5, 0.1, -0.3) * scale,
            );
            let place = |to_world, first_triangle| Instance {
                blas: blas.clone(),
                to_world,
                first_triangle,
            };
            let world = World::new(vec![place(Affine3A::IDENTITY, 0), place(turned, count as u32)]);
            let points = points(seed, 3000);
            for (i, chunk) in points.chunks(64).enumerate() {
                let origin = points[(i * 977 + 13) % points.len()] * scale;
                let directions: Vec<Vec3> = chunk.iter().map(|p| *p * scale - origin).collect();
                let (ends, all) = Ends::from_points(&directions);
                let active = all & !(0x9111_0000_0421_8000u64.rotate_left(i as u32));
                let limits = [std::array::from_fn(|i| 0.01 * (i % 7) as f32 - 0.01), {
                    std::array::from_fn(|i| if i % 2 == 0 { f32::INFINITY } else { 1.5 })
                }];
                let found = world.closest_from(origin, &ends, active, &limits, filter);
                for (lane, &direction) in directions.iter().enumerate() {
                    let single =
                        world.closest(origin, direction, limits[0][lane], limits[1][lane], filter);
                    let expected = single.filter(|_| active >> lane & 1 == 1);
                    differ += u32::from(found[lane] != expected);
                    hits += u32::from(expected.is_some());
                    asked += 1;
                }
            }
        }
    }
    assert!(hits > 5000 && asked > 2 * hits, "{hits} of {asked}");
    assert!(differ * 20_000 <= asked, "{differ} of {asked}");
}
