//! A generated scene with one rare colour: a hare and a bird in a meadow of 10 x 10 m, and twenty small
//! mushrooms whose pink caps are less than a thousandth of all surfaces.
//!
//! Made for Figure 6 of Buchholz and Boubekeur (2012): a table that is learned from too few surfels has
//! no pink. The sun of `Sky` and `SunLights` at an elevation of 35 degrees and an azimuth of 40 suits it.

use crate::data::{Scene, channel};
use crate::kernel::shapes::{Arrangement, Material, Mesh, Solid, ball, lathe};
use crate::node::{Ctx, Error, Node, Sizes};
use glam::{Affine3A, Quat, Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f32::consts::{PI, TAU};

crate::params! {
    /// A meadow with a hare, a bird, trees, grass and a few pink mushrooms; no files.
    pub struct Meadow {
        /// Fineness of curved shapes; about 70,000 triangles at 1, grass included.
        detail: f32 = 1.0, 0.2..=8.0;
        /// Number of blades of grass.
        grass: u32 = 4000, 0..=1_000_000;
        /// Length of the animation, in which the bird hops once.
        seconds: f32 = 2.0, 0.01..=3600.0;
        /// Seed of where grass and leaves are.
        seed: u64 = 1;
    }
}

const SOIL: Vec3 = Vec3::new(0.3, 0.33, 0.13);
const GREEN: Vec3 = Vec3::new(0.2, 0.42, 0.07);
const LEAF: Vec3 = Vec3::new(0.24, 0.36, 0.08);
const BARK: Vec3 = Vec3::new(0.3, 0.2, 0.13);
const FUR: Vec3 = Vec3::new(0.62, 0.55, 0.48);
const BLUE: Vec3 = Vec3::new(0.12, 0.28, 0.62);
const BEAK: Vec3 = Vec3::new(0.75, 0.45, 0.06);
const STONE: Vec3 = Vec3::new(0.5, 0.49, 0.46);
const STEM: Vec3 = Vec3::new(0.78, 0.74, 0.66);
const PINK: Vec3 = Vec3::new(0.8, 0.1, 0.42);
/// Half of the meadow's side.
const REACH: f32 = 5.0;
/// Where the hare and the bird are.
const HARE: Vec2 = Vec2::new(0.34, -0.15);
const BIRD: Vec2 = Vec2::new(-0.5, 0.05);
/// Number of mushrooms, and the radius of the largest cap.
const MUSHROOMS: usize = 20;
const CAP: f32 = 0.034;
/// Keys of the animations.
const KEYS: usize = 13;

impl Node for Meadow {
    const KIND: &'static str = "Meadow";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Scene;

    fn memory(&self, _: &Sizes) -> u64 {
        (32e6 * (1.0 + self.detail * self.detail)) as u64 + 1000 * u64::from(self.grass)
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<Scene, Error> {
        ctx.tick(0, 1)?;
        let mut scene = Arrangement::default();
        let still = scene.node(Vec3::ZERO, Quat::IDENTITY, 0);
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let matte = scene.material(Material::matte(Vec3::ONE));
        let mut land = Mesh::default();
        land.add(&self.ground(), 60.0, SOIL);
        self.grass(&mut land, &mut random);
        self.stones(&mut land);
        self.trees(&mut land, &mut random);
        self.hare(&mut land);
        self.mushrooms(&mut land);
        let mesh = scene.mesh([(land, matte)]);
        scene.show(mesh, still, Affine3A::IDENTITY);
        self.bird(&mut scene, matte);
        self.camera(&mut scene);
        Ok(scene.finish())
    }
}

/// Height of the ground, metres.
fn height(at: Vec2) -> f32 {
    let wave = |a: f32, b: f32, phase: f32| libm::sinf(a * at.x + b * at.y + phase);
    0.16 * wave(0.8, 0.3, 0.4) + 0.12 * wave(-0.5, 1.1, 2.0) + 0.025 * wave(3.1, 1.7, 0.0)
}

/// The point of the ground at `at`, raised by `above`.
fn on(at: Vec2, above: f32) -> Vec3 {
    Vec3::new(at.x, height(at) + above, at.y)
}

impl Meadow {
    fn steps(&self, at_one: f32) -> usize {
        (at_one * self.detail).round().max(3.0) as usize
    }

    /// A ball stretched along the axes, turned, and moved.
    fn blob(&self, size: [f32; 3], turn: Quat, place: Vec3) -> Solid {
        let by = Affine3A::from_scale_rotation_translation(size.into(), turn, place);
        ball(1.0, self.steps(16.0)).moved(by)
    }

    fn ground(&self) -> Solid {
        let cells = self.steps(90.0);
        let mut solid = Solid::default();
        let at = |i: usize| REACH * (2.0 * i as f32 / cells as f32 - 1.0);
        for i in 0..(cells + 1) * (cells + 1) {
            solid.position.push(on(Vec2::new(at(i % (cells + 1)), at(i / (cells + 1))), 0.0));
        }
        for cell in 0..cells * cells {
            let a = (cell / cells * (cells + 1) + cell % cells) as u32;
            let below = a + cells as u32 + 1;
            solid.triangle.extend([[a, below, below + 1], [a, below + 1, a + 1]]);
        }
        solid
    }

    /// Blades: thin upright tetrahedra that stand in the ground.
    fn grass(&self, land: &mut Mesh, random: &mut Pcg64Mcg) {
        for _ in 0..self.grass {
            let mut number = |low: f32, high: f32| low + (high - low) * random.random::<f32>();
            let at = Vec2::new(number(-REACH, REACH), number(-REACH, REACH));
            let (turn, tall, tone) = (number(0.0, TAU), number(0.05, 0.2), number(0.7, 1.15));
            let lean = Vec2::new(number(-0.3, 0.3), number(-0.3, 0.3)) * tall;
            let foot = |k: f32| {
                let (sin, cos) = libm::sincosf(turn + k * TAU / 3.0);
                on(at + Vec2::new(cos, sin) * 0.008, -0.01)
            };
            let position = vec![foot(0.0), foot(1.0), foot(2.0), on(at + lean, tall)];
            let triangle = vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
            land.add(&Solid { position, triangle }, 10.0, GREEN * tone);
        }
    }

    fn stones(&self, land: &mut Mesh) {
        for (x, z, size) in [(1.25, -0.75, 0.3), (-1.6, -1.0, 0.42), (0.85, 0.62, 0.1)] {
            let turn = Quat::from_rotation_y(x * 3.0) * Quat::from_rotation_z(0.3);
            let place = on(Vec2::new(x, z), 0.2 * size);
            land.add(&self.blob([size, 0.7 * size, 0.8 * size], turn, place), 60.0, STONE);
        }
    }

    fn trees(&self, land: &mut Mesh, random: &mut Pcg64Mcg) {
        for (x, z, tall) in [(-1.9, -2.2, 2.6), (2.4, -2.9, 3.1), (0.2, -4.0, 2.8)] {
            let foot = on(Vec2::new(x, z), -0.1);
            let trunk = [(0.16, 0.0), (0.1, 0.3), (0.08, 0.6 * tall), (0.03, 0.9 * tall)];
            let trunk = lathe(&trunk.map(Vec2::from), self.steps(12.0));
            land.add(&trunk.at(foot), 50.0, BARK);
            for _ in 0..24 {
                let mut number = |low: f32, high: f32| low + (high - low) * random.random::<f32>();
                let (turn, up, out) = (number(0.0, TAU), number(-1.0, 1.0), number(0.4, 1.0));
                let (sin, cos) = libm::sincosf(turn);
                let flat = (1.0 - up * up).sqrt() * out;
                let place = Vec3::new(0.75 * cos * flat, 0.6 * up * out, 0.75 * sin * flat);
                let size = number(0.2, 0.32);
                let crown =
                    ball(size, self.steps(7.0)).at(foot + place + Vec3::Y * (0.8 * tall));
                land.add(&crown, 60.0, LEAF * number(0.8, 1.2));
            }
        }
    }

    fn hare(&self, land: &mut Mesh) {
        let foot = on(HARE, 0.0);
        let tilt = |degrees: f32| Quat::from_rotation_x(degrees.to_radians());
        let parts = [
            ([0.13, 0.17, 0.2], tilt(-35.0), [0.0, 0.17, 0.0]),
            ([0.09, 0.09, 0.105], tilt(10.0), [0.0, 0.37, 0.12]),
            ([0.025, 0.12, 0.035], tilt(-12.0), [0.045, 0.54, 0.07]),
            ([0.025, 0.12, 0.035], tilt(-22.0), [-0.045, 0.53, 0.06]),
            ([0.05, 0.05, 0.05], Quat::IDENTITY, [0.0, 0.1, -0.2]),
            ([0.045, 0.05, 0.11], Quat::IDENTITY, [0.08, 0.04, 0.13]),
            ([0.045, 0.05, 0.11], Quat::IDENTITY, [-0.08, 0.04, 0.13]),
        ];
        for (size, turn, place) in parts {
            land.add(&self.blob(size, turn, foot + Vec3::from(place)), 60.0, FUR);
        }
    }

    /// Mushrooms in a spiral around the place before the hare.
    fn mushrooms(&self, land: &mut Mesh) {
        for i in 0..MUSHROOMS {
            let (sin, cos) = libm::sincosf(i as f32 * 2.399_963);
            let out = 0.16 + 0.1 * (i as f32).sqrt();
            let at = Vec2::new(0.02, 0.62) + Vec2::new(cos, 0.75 * sin) * out;
            let cap = CAP * (0.65 + 0.35 * (i * 7 % MUSHROOMS) as f32 / MUSHROOMS as f32);
            let tall = 2.2 * cap;
            let stem = [(0.3 * cap, -0.02), (0.24 * cap, 0.5 * tall), (0.3 * cap, tall)];
            land.add(&lathe(&stem.map(Vec2::from), self.steps(10.0)).at(on(at, 0.0)), 50.0, STEM);
            // A dome with a flat underside.
            let mut dome = vec![Vec2::new(0.2 * cap, 0.0), Vec2::new(cap, -0.1 * cap)];
            let rings = self.steps(6.0);
            dome.extend((0..=rings).map(|k| {
                let (sin, cos) = libm::sincosf(PI / 2.0 * k as f32 / rings as f32);
                Vec2::new(cap * cos.max(0.0), 0.75 * cap * sin)
            }));
            land.add(&lathe(&dome, self.steps(16.0)).at(on(at, tall)), 50.0, PINK);
        }
    }

    /// The bird, at a node of its own: it hops once.
    fn bird(&self, scene: &mut Arrangement, material: u32) {
        let mut mesh = Mesh::default();
        let turn = |x: f32, z: f32| Quat::from_euler(glam::EulerRot::XYZ, x, 0.0, z);
        let parts = [
            ([0.09, 0.085, 0.13], turn(-0.35, 0.0), [0.0, 0.13, 0.0], BLUE),
            ([0.06, 0.06, 0.065], turn(0.0, 0.0), [0.0, 0.235, 0.085], BLUE),
            ([0.02, 0.06, 0.11], turn(-0.5, 0.25), [0.085, 0.14, -0.03], BLUE * 0.7),
            ([0.02, 0.06, 0.11], turn(-0.5, -0.25), [-0.085, 0.14, -0.03], BLUE * 0.7),
            ([0.03, 0.012, 0.1], turn(0.5, 0.0), [0.0, 0.09, -0.16], BLUE * 0.7),
            ([0.016, 0.014, 0.045], turn(0.1, 0.0), [0.0, 0.23, 0.16], BEAK),
            ([0.01, 0.05, 0.01], turn(0.0, 0.0), [0.035, 0.03, 0.01], BEAK),
            ([0.01, 0.05, 0.01], turn(0.0, 0.0), [-0.035, 0.03, 0.01], BEAK),
        ];
        for (size, turn, place, colour) in parts {
            mesh.add(&self.blob(size, turn, place.into()), 60.0, colour);
        }
        let mesh = scene.mesh([(mesh, material)]);
        let node = scene.node(on(BIRD, 0.0), Quat::from_rotation_y(0.5), 0);
        scene.show(mesh, node, Affine3A::IDENTITY);
        let (times, shares) = self.keys();
        let hop = |s: &f32| on(BIRD + Vec2::X * (0.2 * s), 0.6 * s * (1.0 - s)).to_array();
        scene.animate(node, channel::TRANSLATION, &times, shares.iter().flat_map(hop).collect());
    }

    /// A camera near the ground that moves slowly aside.
    fn camera(&self, scene: &mut Arrangement) {
        let place = |share: f32| on(Vec2::new(-0.35 + 0.25 * share, 2.1), 0.42);
        let to = on(Vec2::new(0.0, 0.3), 0.16) - place(0.5);
        let side = to.cross(Vec3::Y).normalize();
        let back = -to.normalize();
        let look = Quat::from_mat3(&glam::Mat3::from_cols(side, back.cross(side), back));
        let node = scene.node(place(0.0), look, 0);
        let (times, shares) = self.keys();
        let moves = shares.iter().flat_map(|s| place(*s).to_array()).collect();
        scene.animate(node, channel::TRANSLATION, &times, moves);
        scene.camera(node, 38_f32.to_radians(), 0.02, 200.0);
    }

    /// Times of the keys and, for each, the share of the animation that has passed.
    fn keys(&self) -> (Vec<f32>, Vec<f32>) {
        let shares: Vec<f32> = (0..KEYS).map(|k| k as f32 / (KEYS - 1) as f32).collect();
        (shares.iter().map(|s| s * self.seconds).collect(), shares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(detail: f32) -> Scene {
        Meadow { detail, ..Meadow::default() }.run((), &Ctx::default()).unwrap()
    }

    /// Areas of all triangles and of the pink ones.
    fn areas(scene: &Scene) -> [f64; 2] {
        scene.triangle.iter().fold([0.0, 0.0], |[all, pink], t| {
            let [a, b, c] = t.map(|v| scene.position[v as usize].as_dvec3());
            let area = 0.5 * (b - a).cross(c - a).length();
            let of_cap = scene.colour[t[0] as usize][..3] == PINK.to_array();
            [all + area, if of_cap { pink + area } else { pink }]
        })
    }

    #[test]
    fn pink_is_rarer_than_a_thousandth() {
        for detail in [0.3, 1.0] {
            let [all, pink] = areas(&scene(detail));
            assert!((0.0003..0.001).contains(&(pink / all)), "{pink} of {all}");
        }
    }

    #[test]
    fn triangles_have_area_and_normals_on_their_own_side() {
        for detail in [0.2, 1.0] {
            let scene = scene(detail);
            assert_eq!(scene.colour.len(), scene.position.len());
            for t in scene.triangle.iter() {
                let [a, b, c] = t.map(|v| scene.position[v as usize].as_dvec3());
                let area = (b - a).cross(c - a);
                assert!(area.length() > 1e-10, "{a} {b} {c}");
                assert!(
                    t.iter().all(|v| scene.normal[*v as usize].as_dvec3().dot(area) > 0.0),
                    "{a} {b} {c}"
                );
            }
        }
    }

    #[test]
    fn equal_parameters_give_equal_bytes_and_the_seed_counts() {
        let bytes = |seed| {
            let meadow = Meadow { detail: 0.3, seed, ..Meadow::default() };
            crate::data::encode(&meadow.run((), &Ctx::default()).unwrap())
        };
        assert!(bytes(1) == bytes(1) && bytes(1) != bytes(2));
    }
}
