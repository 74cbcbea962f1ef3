//! What stands, turns and hangs in the pavilion: plinth and sculpture, a cloth, small things, lanterns.

use super::{INDIGO, KEYS, MADDER, PLAIN, Pavilion, SAFFRON, WHITE};
use crate::data::channel;
use crate::kernel::shapes::{
    Arrangement, Displacement, Material, Mesh, ball, bevelled_box, lathe, plaited_trefoil, ring,
    sheet,
};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Middle of the plinth.
const SCULPTURE: Vec3 = Vec3::new(0.9, 0.0, 0.0);
/// Middle of the cloth's rod, and its turn about the vertical.
const ROD: Vec3 = Vec3::new(3.4, 4.4, 0.8);
const ROD_TURN: f32 = -FRAC_PI_2 - 0.1;

impl Pavilion {
    /// Plinth, metal balls, balls of yarn, a jar, a bench, lanterns.
    pub(super) fn things(&self, scene: &mut Arrangement, node: u32) {
        let stone = scene.material(Material::matte(Vec3::splat(0.5)));
        let metal = |colour| Material { metallic: 1.0, roughness: 0.3, ..Material::matte(colour) };
        let gold = scene.material(metal(Vec3::new(0.8, 0.58, 0.24)));
        let steel = scene.material(metal(Vec3::new(0.66, 0.66, 0.68)));
        let yarn = scene.material(Material::matte(Vec3::splat(0.8)));
        let lamp =
            Material { emissive: Vec3::new(2.4, 1.25, 0.4), ..Material::matte(Vec3::splat(0.5)) };
        let lamp = scene.material(lamp);
        let turned = |profile: &[(f32, f32)], sides| {
            lathe(&profile.iter().copied().map(Vec2::from).collect::<Vec<_>>(), self.steps(sides))
        };
        let mut plinth = Mesh::default();
        let steps =
            [(0.8, -0.04), (0.8, 0.12), (0.76, 0.16), (0.55, 0.16), (0.55, 0.5), (0.51, 0.54)];
        plinth.add(&turned(&steps, 64.0).at(SCULPTURE), 30.0, PLAIN);
        let ball = |radius, rings| ball(radius, self.steps(rings));
        let mut rods = Mesh::default();
        let place = Affine3A::from_rotation_translation(Quat::from_rotation_y(ROD_TURN), ROD);
        for (low, high) in [
            ([-0.75, -0.025, -0.025], [0.75, 0.025, 0.025]),
            ([-0.6, 0.0, -0.006], [-0.588, 0.4, 0.006]),
            ([0.588, 0.0, -0.006], [0.6, 0.4, 0.006]),
        ] {
            rods.add(&bevelled_box(low.into(), high.into(), 0.004).moved(place), 10.0, PLAIN);
        }
        rods.add(&turned(&[(0.025, 0.5), (0.025, 1.1)], 16.0).at(SCULPTURE), 30.0, PLAIN);
        let mut golden = Mesh::default();
        golden.add(&ball(0.34, 32.0).at(Vec3::new(0.1, 0.338, 1.45)), 60.0, PLAIN);
        let mut steely = Mesh::default();
        steely.add(&ball(0.2, 24.0).at(Vec3::new(-0.75, 0.198, 0.75)), 60.0, PLAIN);
        let mut small = Mesh::default();
        let balls = [
            (0.15, -1.0, -0.85, SAFFRON),
            (0.13, -0.7, -0.98, INDIGO * 1.6),
            (0.12, -0.74, -0.68, MADDER),
            (0.1, -1.25, -0.55, WHITE),
        ];
        for (radius, x, z, colour) in balls {
            small.add(&ball(radius, 16.0).at(Vec3::new(x, radius - 0.002, z)), 60.0, colour);
        }
        let jar = [
            (0.16, -0.01),
            (0.17, 0.02),
            (0.27, 0.3),
            (0.29, 0.45),
            (0.24, 0.62),
            (0.13, 0.72),
            (0.12, 0.78),
            (0.17, 0.84),
            (0.15, 0.85),
            (0.1, 0.78),
            (0.1, 0.7),
        ];
        small.add(
            &turned(&jar, 40.0).at(Vec3::new(2.5, 0.0, 2.1)),
            50.0,
            SAFFRON.lerp(MADDER, 0.5),
        );
        let mut lights = Mesh::default();
        let mut frames = Mesh::default();
        for (x, y, z) in
            [(-2.4, 2.35, -2.45), (0.0, 2.35, -2.45), (2.4, 2.35, -2.45), (4.8, 2.35, -2.45)]
        {
            let place = Vec3::new(x, y, z);
            lights.add(
                &turned(&[(0.1, 0.0), (0.14, 0.07), (0.14, 0.21), (0.1, 0.28)], 24.0).at(place),
                50.0,
                PLAIN,
            );
            let cap = [(0.13, 0.27), (0.13, 0.3), (0.04, 0.35), (0.012, 0.37), (0.012, 2.3)];
            frames.add(&turned(&cap, 16.0).at(place), 30.0, PLAIN);
        }
        let mesh = scene.mesh([
            (plinth, stone),
            (golden, gold),
            (steely, steel),
            (small, yarn),
            (lights, lamp),
            (frames, steel),
            (rods, steel),
        ]);
        scene.show(mesh, node, Affine3A::IDENTITY);
    }

    /// Three ribbons plaited around a trefoil knot; a sixth of a turn.
    pub(super) fn sculpture(&self, scene: &mut Arrangement) {
        let colours = [SAFFRON, INDIGO.lerp(Vec3::splat(0.5), 0.15), WHITE];
        let strands = colours.iter().enumerate().map(|(k, colour)| {
            let mut mesh = Mesh::default();
            mesh.add(
                &ring(|t| plaited_trefoil(k, t), self.steps(840.0), self.steps(10.0)),
                60.0,
                PLAIN,
            );
            (mesh, Material::matte(*colour))
        });
        let parts: Vec<_> =
            strands.map(|(mesh, material)| (mesh, scene.material(material))).collect();
        let mesh = scene.mesh(parts);
        let node = scene.node(SCULPTURE + Vec3::Y * 1.75, Quat::IDENTITY, 0);
        scene.show(mesh, node, Affine3A::IDENTITY);
        let (times, shares) = self.keys();
        let turn = |share: &f32| Quat::from_rotation_y(-1.85 + PI / 3.0 * share).to_array();
        scene.animate(node, channel::ROTATION, &times, shares.iter().flat_map(turn).collect());
    }

    /// A striped cloth whose wave runs down it: two modes a quarter of a period apart, and a sway.
    pub(super) fn cloth(&self, scene: &mut Arrangement) {
        let cloth = scene.material(Material::matte(Vec3::splat(0.8)));
        let cells = [self.steps(44.0), self.steps(64.0)];
        let folds: Displacement = |x, y| 0.035 * libm::sinf(TAU * 3.0 * x) * (0.4 + 0.6 * y);
        let modes: [Displacement; 3] = [
            |x, y| 0.14 * y * libm::sinf(TAU * (0.9 * y + 0.2 * x)),
            |x, y| 0.14 * y * libm::cosf(TAU * (0.9 * y + 0.2 * x)),
            |x, y| 0.08 * y * libm::cosf(PI * x),
        ];
        let (mesh, deltas) = sheet(Vec2::new(1.3, 2.5), cells, folds, &modes, stripe);
        let mesh = scene.mesh([(mesh, cloth)]);
        deltas.into_iter().for_each(|d| scene.morph_target(d));
        let node = scene.node(ROD, Quat::from_rotation_y(ROD_TURN), 3);
        scene.show(mesh, node, Affine3A::IDENTITY);
        let (times, shares) = self.keys();
        let weights = |share: &f32| {
            let (sin, cos) = libm::sincosf(TAU * share);
            [cos, -sin, libm::sinf(TAU * share + 1.0)]
        };
        let mut values: Vec<f32> = shares.iter().flat_map(weights).collect();
        values.copy_within(..3, 3 * (KEYS - 1));
        scene.animate(node, channel::WEIGHTS, &times, values);
    }
}

/// The cloth's colour at a height from 0 (top) to 1.
fn stripe(y: f32) -> Vec3 {
    match (y * 25.0) as u32 {
        2 | 4 | 20 | 22 => WHITE,
        3 | 21 => INDIGO,
        10 | 14 => SAFFRON,
        11..=13 => WHITE,
        _ => MADDER,
    }
}
