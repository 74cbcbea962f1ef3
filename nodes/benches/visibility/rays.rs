//! Which rays are traced: those between surface points that face each other, as rows and columns need them.

use crate::scenes::{Random, Scene};
use glam::{DAffine3, Vec2, Vec3};
use lightloom_nodes::kernel::visibility::{Hit, World};

/// Pixels that are looked at.
const SIZE: [usize; 2] = [640, 480];
/// Lights on the surfaces.
const LIGHTS: usize = 65_536;
/// How far points are lifted off their surface, metres.
const BIAS: f32 = 1e-3;

/// The distance of a nearest hit, infinite if there is none.
#[derive(Clone, Copy, PartialEq)]
pub struct Found(pub f32);

impl Found {
    /// Whether it is another hit, and not the same rounded another way: directions are about a metre long.
    pub fn differs(self, other: Self) -> bool {
        let (a, b) = (self.0, other.0);
        if a.is_finite() && b.is_finite() {
            (a - b).abs() > 1e-4 * a.abs().max(b.abs()).max(1.0)
        } else {
            a.is_finite() != b.is_finite()
        }
    }
}

/// Rays, axis by axis, the points they end in, and runs of them that share their origin.
#[derive(Default)]
pub struct Rays {
    pub origin: [Vec<f32>; 3],
    pub direction: [Vec<f32>; 3],
    pub end: [Vec<f32>; 3],
    pub runs: Vec<(Vec3, std::ops::Range<usize>)>,
}

impl Rays {
    pub fn len(&self) -> usize {
        self.end[0].len()
    }

    pub fn start(&self, i: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|k| self.origin[k][i]))
    }

    pub fn way(&self, i: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|k| self.direction[k][i]))
    }

    pub fn end(&self, i: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|k| self.end[k][i]))
    }

    fn push(&mut self, from: Vec3, to: Vec3) {
        for k in 0..3 {
            self.origin[k].push(from[k]);
            self.direction[k].push(to[k] - from[k]);
            self.end[k].push(to[k]);
        }
    }

    fn run(&mut self, shared: Vec3, ends: impl Iterator<Item = Vec3>) {
        let first = self.len();
        ends.for_each(|end| self.push(shared, end));
        self.runs.push((shared, first..self.len()));
    }
}

/// A point above a surface and the surface's normal there.
#[derive(Clone, Copy)]
struct Point {
    position: Vec3,
    normal: Vec3,
}

impl Point {
    fn on([a, b, c]: [Vec3; 3], u: f32, v: f32, away: Vec3) -> Self {
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let normal = if normal.dot(away) < 0.0 { -normal } else { normal };
        Self { position: a + (b - a) * u + (c - a) * v + normal * BIAS, normal }
    }

    fn faces(&self, other: &Self) -> bool {
        let way = other.position - self.position;
        way.dot(self.normal) > 0.0 && way.dot(other.normal) < 0.0
    }
}

/// What all kinds of rays of one scene are made of.
pub struct Points {
    /// In 8 x 8 tiles.
    pixels: Vec<Point>,
    /// In Morton order.
    lights: Vec<Point>,
    primary: Rays,
}

impl Points {
    /// Looks at the scene and puts lights on it.
    pub fn of(scene: &Scene, world: &World) -> Self {
        let mut primary = Rays::default();
        let mut pixels = Vec::new();
        let forward = (scene.target - scene.eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let up = right.cross(forward);
        for tile in 0..SIZE[0] * SIZE[1] / 64 {
            let corner = Vec2::new((tile % (SIZE[0] / 8)) as f32, (tile / (SIZE[0] / 8)) as f32);
            for i in 0..64 {
                let at = corner * 8.0 + Vec2::new((i % 8) as f32, (i / 8) as f32) + 0.5;
                let x = (2.0 * at.x - SIZE[0] as f32) / SIZE[1] as f32;
                let y = 1.0 - 2.0 * at.y / SIZE[1] as f32;
                let way = forward + (right * x + up * y) * 0.7;
                primary.push(scene.eye, scene.eye + way);
                let way = primary.way(primary.len() - 1);
                let hit = world.closest(scene.eye, way, 0.0, f32::INFINITY, &|_, _, _| true);
                pixels.extend(
                    hit.map(|hit| Point::on(corners(scene, hit.triangle), hit.u, hit.v, -way)),
                );
            }
        }
        Self { pixels, lights: lights(scene), primary }
    }

    /// From a light to all pixels that face it, for 8 lights; every third tile, another third each time.
    pub fn columns(&self) -> Rays {
        let mut rays = Rays::default();
        for k in 0..8 {
            let light = &self.lights[(2 * k + 1) * LIGHTS / 16];
            let tiles = self.pixels.chunks(64).skip(k % 3).step_by(3).flatten();
            rays.run(light.position, tiles.filter(|p| p.faces(light)).map(|p| p.position));
        }
        rays
    }

    /// From a pixel to all lights that face it, for 16 pixels.
    pub fn rows(&self) -> Rays {
        let mut rays = Rays::default();
        for k in 0..16 {
            let pixel = &self.pixels[(2 * k + 1) * self.pixels.len() / 32];
            let facing = self.lights.iter().filter(|light| light.faces(pixel));
            rays.run(pixel.position, facing.map(|light| light.position));
        }
        rays
    }

    /// From random pixels to random lights that face them.
    pub fn incoherent(&self) -> Rays {
        let mut rays = Rays::default();
        let mut random = Random(5);
        while rays.len() < 150_000 {
            let pixel = &self.pixels[random.below(self.pixels.len())];
            let light = &self.lights[random.below(LIGHTS)];
            if light.faces(pixel) {
                rays.push(pixel.position, light.position);
            }
        }
        rays
    }

    /// What looked at the scene.
    pub fn primary(&self) -> &Rays {
        &self.primary
    }

    /// From random pixels into their hemispheres, as photons go.
    pub fn bounces(&self) -> Rays {
        let mut rays = Rays::default();
        let mut random = Random(6);
        while rays.len() < 150_000 {
            let Point { position, normal } = self.pixels[random.below(self.pixels.len())];
            let way = Vec3::new(random.next(), random.next(), random.next()) * 2.0 - 1.0;
            if way.length_squared() < 1.0 && way.dot(normal) > 0.0 {
                rays.push(position, position + way);
            }
        }
        rays
    }
}

/// The corners in the world of a triangle that is numbered through all places.
fn corners(scene: &Scene, mut triangle: u32) -> [Vec3; 3] {
    for (mesh, to_world) in &scene.places {
        let mesh = &scene.meshes[*mesh];
        if let Some(corners) = mesh.get(triangle as usize) {
            return corners.map(|corner| to_world.transform_point3(corner));
        }
        triangle -= mesh.len() as u32;
    }
    unreachable!("a hit is of a triangle of the scene")
}

/// Whether any triangle of the scene lies between two points, in double precision.
pub fn blocked(scene: &Scene, from: Vec3, to: Vec3) -> bool {
    let (o, d) = (from.as_dvec3(), to.as_dvec3() - from.as_dvec3());
    let hits = |corners: &[Vec3; 3], to_world: &DAffine3| {
        let [a, b, c] = corners.map(|corner| to_world.transform_point3(corner.as_dvec3()));
        let (e, f, s) = (b - a, c - a, o - a);
        let (p, q) = (d.cross(f), s.cross(e));
        let det = e.dot(p);
        let (u, v, t) = (s.dot(p) / det, d.dot(q) / det, f.dot(q) / det);
        det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < 1.0
    };
    scene.places.iter().any(|(mesh, to_world)| {
        let [x, y, z] = [0, 1, 2].map(|k| to_world.matrix3.col(k).as_dvec3());
        let to_world = DAffine3::from_cols(x, y, z, to_world.translation.as_dvec3());
        scene.meshes[*mesh].iter().any(|corners| hits(corners, &to_world))
    })
}

/// Lights uniform over the area, on either side of it, sorted so that neighbours are close.
fn lights(scene: &Scene) -> Vec<Point> {
    let area = |t: &[Vec3; 3]| f64::from((t[1] - t[0]).cross(t[2] - t[0]).length());
    let sums = |areas: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
        let mut sum = 0.0;
        areas
            .map(|area| {
                sum += area;
                sum
            })
            .collect()
    };
    let of_mesh: Vec<Vec<f64>> =
        scene.meshes.iter().map(|mesh| sums(&mut mesh.iter().map(area))).collect();
    let total = |&(mesh, to_world): &(usize, glam::Affine3A)| {
        let scale = f64::from(to_world.matrix3.x_axis.length());
        of_mesh[mesh].last().copied().unwrap_or(0.0) * scale * scale
    };
    let of_place = sums(&mut scene.places.iter().map(total));
    let mut random = Random(3);
    let mut pick = |sums: &[f64]| {
        let x = f64::from(random.next()) + f64::from(random.next()) / f64::from(1 << 24);
        let x = x * sums.last().copied().unwrap_or(0.0);
        sums.partition_point(|s| *s <= x).min(sums.len() - 1)
    };
    let picked: Vec<(usize, usize)> = (0..LIGHTS)
        .map(|_| {
            let place = pick(&of_place);
            (place, pick(&of_mesh[scene.places[place].0]))
        })
        .collect();
    let mut lights: Vec<Point> = picked
        .into_iter()
        .map(|(place, triangle)| {
            let (mesh, to_world) = &scene.places[place];
            let corners = scene.meshes[*mesh][triangle].map(|v| to_world.transform_point3(v));
            let (mut u, mut v) = (random.next(), random.next());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = corners;
            let side = (b - a).cross(c - a) * if random.next() < 0.5 { -1.0 } else { 1.0 };
            Point::on(corners, u, v, side)
        })
        .collect();
    let low = lights.iter().fold(Vec3::INFINITY, |m, light| m.min(light.position));
    let high = lights.iter().fold(Vec3::NEG_INFINITY, |m, light| m.max(light.position));
    let extent = (high - low).max_element();
    lights.sort_by_cached_key(|light| morton((light.position - low) / extent));
    lights
}

/// Interleaved bits of a point in the unit cube.
fn morton(point: Vec3) -> u32 {
    let cells = point.to_array().map(|x| (x.clamp(0.0, 1.0) * 1023.0) as u32);
    (0..30).fold(0, |code, bit| code | (cells[bit % 3] >> (bit / 3) & 1) << bit)
}

/// The distance of a hit.
pub fn found(hit: Option<Hit>) -> Found {
    Found(hit.map_or(f32::INFINITY, |hit| hit.t))
}
