//! Procedural scenes: an atrium with colonnades in two finenesses, and trees on a terrain as instances.

use glam::{Affine3A, Quat, Vec3};
use std::f32::consts::TAU;

/// Meshes and where they stand. Scales are uniform.
pub struct Scene {
    pub name: &'static str,
    pub meshes: Vec<Vec<[Vec3; 3]>>,
    pub places: Vec<(usize, Affine3A)>,
    pub eye: Vec3,
    pub target: Vec3,
}

impl Scene {
    /// Triangles with every instance counted.
    pub fn triangles(&self) -> usize {
        self.places.iter().map(|(mesh, _)| self.meshes[*mesh].len()).sum()
    }
}

/// A small generator of its own, so that scenes and rays are fixed.
pub struct Random(pub u64);

impl Random {
    /// Uniform in [0, 1).
    pub fn next(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in 0..count.
    pub fn below(&mut self, count: usize) -> usize {
        (self.next() as f64 * count as f64) as usize
    }
}

/// The surface `at(u, v)` over the unit square in `nu` x `nv` cells.
fn patch(mesh: &mut Vec<[Vec3; 3]>, nu: usize, nv: usize, at: impl Fn(f32, f32) -> Vec3) {
    let point = |i: usize, j: usize| at(i as f32 / nu as f32, j as f32 / nv as f32);
    for i in 0..nu {
        for j in 0..nv {
            let [a, b] = [point(i, j), point(i + 1, j)];
            let [c, d] = [point(i, j + 1), point(i + 1, j + 1)];
            mesh.extend([[a, b, c], [b, d, c]]);
        }
    }
}

/// A profile turned about the vertical through `foot`: `radius(angle, height)` for heights from 0 to `height`.
fn turned(
    mesh: &mut Vec<[Vec3; 3]>,
    cells: [usize; 2],
    foot: Vec3,
    height: f32,
    radius: impl Fn(f32, f32) -> f32,
) {
    patch(mesh, cells[0], cells[1], |u, v| {
        let angle = TAU * (u % 1.0);
        let r = radius(angle, v);
        foot + Vec3::new(r * angle.cos(), height * v, r * angle.sin())
    });
}

/// Two storeys of galleries with fluted columns, balustrades, curtains and vases around a court of 24 m x 12 m.
/// Cells along each direction grow with `detail`; 1.1 gives about 300,000 triangles.
pub fn atrium(name: &'static str, detail: f32) -> Scene {
    let mut mesh = Vec::new();
    let cells = |n: f32| (n * detail).round().max(2.0) as usize;
    let bumpy = |a: f32, b: f32| 0.01 * ((a * 7.0).sin() * (b * 9.0).cos());
    let (x, z, storey) = (16.0, 9.0, 4.5);
    // The floors of the galleries, the ceiling and the walls.
    for level in 0..3 {
        let y = storey * level as f32;
        let open = level == 1;
        patch(&mut mesh, cells(110.0), cells(60.0), |u, v| {
            let (mut px, mut pz) = ((2.0 * u - 1.0) * x, (2.0 * v - 1.0) * z);
            if open {
                // A ring: the middle is pushed out to the court's border.
                let ring = (px.abs() / x).max(pz.abs() / z).max(1e-3);
                let scale = (0.72 + 0.28 * ring) / ring;
                (px, pz) = (px * scale, pz * scale);
            }
            Vec3::new(px, y + bumpy(px, pz), pz)
        });
    }
    for side in [-1.0, 1.0] {
        patch(&mut mesh, cells(110.0), cells(40.0), |u, v| {
            let (px, py) = ((2.0 * u - 1.0) * x, v * 2.0 * storey);
            Vec3::new(px, py, side * (z + 5.0 * bumpy(2.0 * px, py)))
        });
        patch(&mut mesh, cells(70.0), cells(40.0), |u, v| {
            let (pz, py) = ((2.0 * u - 1.0) * z, v * 2.0 * storey);
            Vec3::new(side * (x + 5.0 * bumpy(2.0 * pz, py)), py, pz)
        });
    }
    let mut feet = Vec::new();
    for i in 0..9 {
        let px = -11.5 + 23.0 * i as f32 / 8.0;
        feet.extend([(px, -6.0), (px, 6.0)]);
    }
    for j in 1..4 {
        let pz = -6.0 + 12.0 * j as f32 / 4.0;
        feet.extend([(-11.5, pz), (11.5, pz)]);
    }
    for (i, &(px, pz)) in feet.iter().enumerate() {
        for level in 0..2 {
            let foot = Vec3::new(px, storey * level as f32, pz);
            let around = [cells(48.0), cells(22.0)];
            turned(&mut mesh, around, foot, storey, |angle, v| {
                let swell = 0.18 * ((v - 0.5).abs() * 2.0).powi(12);
                0.3 - 0.05 * v + swell + 0.012 * (angle * 12.0).cos()
            });
        }
        // A vase in front of it and a curtain beside it.
        let inward = Vec3::new(px * 0.85, 0.0, pz * 0.8);
        turned(&mut mesh, [cells(24.0), cells(16.0)], inward, 0.9, |_, v| {
            0.1 + 0.25 * (v * 2.6).sin().abs()
        });
        if i % 2 == 0 && pz.abs() > 5.0 && i < 16 {
            patch(&mut mesh, cells(40.0), cells(24.0), |u, v| {
                let fold = 0.12 * (u * 40.0).sin() * (1.0 - 0.6 * v);
                Vec3::new(px + 0.5 + 1.8 * u, 1.2 + 3.0 * v, pz + fold)
            });
        }
    }
    for i in 0..180 {
        let t = i as f32 / 90.0;
        let (px, pz) = if i < 90 { (-11.4 + 22.8 * t, -6.3) } else { (34.2 - 22.8 * t, 6.3) };
        let foot = Vec3::new(px, storey, pz);
        turned(&mut mesh, [cells(10.0), cells(14.0)], foot, 0.9, |_, v| {
            0.04 + 0.05 * (v * 6.0).sin().abs()
        });
    }
    let eye = Vec3::new(-10.5, 2.2, 2.0);
    let target = Vec3::new(8.0, 3.4, -1.0);
    Scene { name, meshes: vec![mesh], places: vec![(0, Affine3A::IDENTITY)], eye, target }
}

/// 500 trees of about 16,000 triangles each on a hilly terrain.
pub fn trees(name: &'static str) -> Scene {
    let hill = |x: f32, z: f32| {
        1.5 * (x * 0.11).sin() * (z * 0.13).cos() + 0.4 * (x * 0.5 + z * 0.3).sin()
    };
    let mut terrain = Vec::new();
    patch(&mut terrain, 130, 130, |u, v| {
        let (x, z) = (80.0 * u - 40.0, 80.0 * v - 40.0);
        Vec3::new(x, hill(x, z), z)
    });
    let mut tree = Vec::new();
    turned(&mut tree, [16, 24], Vec3::ZERO, 2.0, |angle, v| {
        0.22 * (1.0 - 0.5 * v) + 0.02 * (angle * 5.0).cos()
    });
    let mut random = Random(11);
    for _ in 0..950 {
        // Leaves: bent quads all over a crown.
        let (angle, height) = (TAU * random.next(), random.next());
        let r = 1.3 * (1.0 - height * height).sqrt() * (0.4 + 0.6 * random.next());
        let centre = Vec3::new(r * angle.cos(), 1.3 + 2.4 * height, r * angle.sin());
        let axis = Vec3::new(random.next(), random.next(), random.next()) - 0.5;
        let turn = Quat::from_scaled_axis(axis * 6.0);
        patch(&mut tree, 4, 2, |u, v| {
            let bend = 0.06 * (u * 3.0).sin();
            centre + turn * Vec3::new(0.4 * (u - 0.5), bend, 0.2 * (v - 0.5))
        });
    }
    let mut places = vec![(0, Affine3A::IDENTITY)];
    for _ in 0..500 {
        let (x, z) = (76.0 * random.next() - 38.0, 76.0 * random.next() - 38.0);
        let scale = 0.7 + 0.6 * random.next();
        places.push((
            1,
            Affine3A::from_scale_rotation_translation(
                Vec3::splat(scale),
                Quat::from_rotation_y(TAU * random.next()),
                Vec3::new(x, hill(x, z), z),
            ),
        ));
    }
    let (eye, target) = (Vec3::new(-36.0, 9.0, -30.0), Vec3::new(6.0, 0.0, 4.0));
    Scene { name, meshes: vec![terrain, tree], places, eye, target }
}
