//! A generated scene rich in indirect light: a weaver's pavilion in the late afternoon, 12 x 6 x 5 m.
//!
//! Two arcades, a saffron wall and an indigo wall, a slatted roof; in the middle three ribbons plaited
//! around a trefoil knot turn on a plinth, a cloth waves, lanterns glow in the shade. Made for a sun at
//! an elevation of 35 degrees and an azimuth of 40, the defaults of `Sky` and `SunLights`.

use crate::data::{Scene, channel};
use crate::kernel::shapes::{
    Arrangement, Displacement, Material, Mesh, Solid, ball, bevelled_box, extruded, lathe,
    plaited_trefoil, ring, sheet,
};
use crate::node::{Ctx, Error, Node, Sizes};
use glam::{Affine3A, Quat, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

crate::params! {
    /// A pavilion with colour bleeding, moving and deforming things, metal and lanterns; no files.
    pub struct Pavilion {
        /// Fineness of curved shapes; about 80,000 triangles at 1, in proportion to its square.
        detail: f32 = 1.0, 0.2..=8.0;
        /// Length of the animation; the cloth's wave repeats after it.
        seconds: f32 = 2.0, 0.01..=3600.0;
    }
}

const WHITE: Vec3 = Vec3::new(0.75, 0.73, 0.69);
const SAFFRON: Vec3 = Vec3::new(0.78, 0.36, 0.07);
const INDIGO: Vec3 = Vec3::new(0.08, 0.12, 0.42);
const MADDER: Vec3 = Vec3::new(0.62, 0.08, 0.06);
const WOOD: Vec3 = Vec3::new(0.38, 0.21, 0.11);
/// Tint of vertices that leave their material's colour alone.
const PLAIN: Vec3 = Vec3::ONE;
/// Distance of the columns, and their number in a row.
const BAY: f32 = 2.4;
const COLUMNS: usize = 6;
/// Middle of the plinth.
const SCULPTURE: Vec3 = Vec3::new(0.9, 0.0, 0.0);
/// Middle of the cloth's rod, and its turn about the vertical.
const ROD: Vec3 = Vec3::new(3.4, 4.4, 0.8);
const ROD_TURN: f32 = -FRAC_PI_2 - 0.1;
/// Keys of every animation.
const KEYS: usize = 25;

impl Node for Pavilion {
    const KIND: &'static str = "Pavilion";
    const VERSION: u32 = 1;
    type In = ();
    type Out = Scene;

    fn memory(&self, _: &Sizes) -> u64 {
        (32e6 * (1.0 + self.detail * self.detail)) as u64
    }

    fn run(&self, (): (), ctx: &Ctx) -> Result<Scene, Error> {
        let mut scene = Arrangement::default();
        let still = scene.node(Vec3::ZERO, Quat::IDENTITY, 0);
        ctx.tick(0, 3)?;
        self.building(&mut scene, still);
        ctx.tick(1, 3)?;
        self.things(&mut scene, still);
        ctx.tick(2, 3)?;
        self.sculpture(&mut scene);
        self.cloth(&mut scene);
        self.camera(&mut scene);
        Ok(scene.finish())
    }
}

impl Pavilion {
    fn steps(&self, at_one: f32) -> usize {
        (at_one * self.detail).round().max(3.0) as usize
    }

    /// Times of the keys and, for each, the share of the animation that has passed.
    fn keys(&self) -> (Vec<f32>, Vec<f32>) {
        let shares: Vec<f32> = (0..KEYS).map(|k| k as f32 / (KEYS - 1) as f32).collect();
        (shares.iter().map(|s| s * self.seconds).collect(), shares)
    }

    fn building(&self, scene: &mut Arrangement, node: u32) {
        let [white, saffron, indigo, wood] =
            [WHITE, SAFFRON, INDIGO, WOOD].map(|c| scene.material(Material::matte(c)));
        let floor = scene.material(Material::matte(Vec3::splat(0.72)));
        let block = |low: [f32; 3], high: [f32; 3]| bevelled_box(low.into(), high.into(), 0.02);
        let solid = |parts: &[([f32; 3], [f32; 3])]| {
            let mut mesh = Mesh::default();
            parts.iter().for_each(|(low, high)| mesh.add(&block(*low, *high), 10.0, PLAIN));
            mesh
        };
        let mut plaster = solid(&[
            ([-6.5, -0.2, -3.5], [-6.1, 4.95, 3.7]),
            ([-6.6, 4.62, -3.6], [6.6, 4.9, -1.45]),
            ([-6.6, 4.62, 1.9], [6.6, 4.9, 3.8]),
        ]);
        for z in [-1.95, 3.0] {
            plaster.add(&self.arcade().at(Vec3::new(0.0, 0.0, z)), 30.0, PLAIN);
        }
        let saffron_wall = solid(&[([-6.3, -0.2, -3.45], [6.3, 4.7, -3.05])]);
        let mut indigo_wall = Mesh::default();
        let turned = Affine3A::from_translation(Vec3::new(6.1, 0.0, 0.0))
            * Affine3A::from_rotation_y(FRAC_PI_2);
        indigo_wall.add(&self.gate().moved(turned), 30.0, PLAIN);
        let mut roof = Mesh::default();
        for i in 0..29 {
            let x = -5.88 + 0.42 * i as f32;
            roof.add(&block([x - 0.04, 4.7, -1.7], [x + 0.04, 4.96, 2.15]), 10.0, PLAIN);
        }
        // The pergola over the terrace lies across the hall's slats, so that their stripes weave.
        for i in 0..11 {
            let z = 3.75 + 0.28 * i as f32;
            roof.add(&block([-6.5, 3.36, z], [6.5, 3.52, z + 0.05]), 10.0, PLAIN);
        }
        for i in 0..COLUMNS {
            let x = BAY * (i as f32 - (COLUMNS - 1) as f32 / 2.0);
            roof.add(&block([x - 0.07, 3.22, 3.3], [x + 0.07, 3.38, 6.75]), 10.0, PLAIN);
            roof.add(&block([x - 0.07, -0.1, 6.5], [x + 0.07, 3.24, 6.64]), 10.0, PLAIN);
        }
        let garden =
            solid(&[([9.1, -0.2, -3.6], [9.4, 1.45, 7.45]), ([-6.6, -0.2, 7.2], [9.25, 1.3, 7.5])]);
        let clay = scene.material(Material::matte(Vec3::new(0.6, 0.3, 0.17)));
        let parts = [
            (plaster, white),
            (garden, clay),
            (saffron_wall, saffron),
            (indigo_wall, indigo),
            (roof, wood),
            (tiles(), floor),
        ];
        let mesh = scene.mesh(parts);
        scene.show(mesh, node, Affine3A::IDENTITY);

        let mut column = Mesh::default();
        column.add(&self.column(), 35.0, PLAIN);
        let mesh = scene.mesh([(column, white)]);
        for z in [-1.77, 3.18] {
            for i in 0..COLUMNS {
                let x = BAY * (i as f32 - (COLUMNS - 1) as f32 / 2.0);
                scene.show(mesh, node, Affine3A::from_translation(Vec3::new(x, 0.0, z)));
            }
        }
    }

    /// The wall over a row of columns, 0.36 m thick, with a round arch in every bay.
    fn arcade(&self) -> Solid {
        let (radius, spring, top) = (0.93, 2.55, 4.66);
        let end = BAY * (COLUMNS - 1) as f32 / 2.0 + 0.25;
        let mut outline = vec![Vec2::new(end, top), Vec2::new(-end, top), Vec2::new(-end, spring)];
        let steps = self.steps(20.0);
        for bay in 0..COLUMNS - 1 {
            let middle = BAY * (bay as f32 - (COLUMNS - 2) as f32 / 2.0);
            outline.extend((0..=steps).map(|i| {
                let (sin, cos) = libm::sincosf(PI * i as f32 / steps as f32);
                Vec2::new(middle - radius * cos, spring + radius * sin.max(0.0))
            }));
        }
        outline.push(Vec2::new(end, spring));
        extruded(&outline, 0.36)
    }

    /// The end wall with its arched door.
    fn gate(&self) -> Solid {
        let (left, right, spring, top) = (-2.55, -1.45, 1.9, 4.7);
        let (middle, radius, steps) =
            ((left + right) / 2.0, (right - left) / 2.0, self.steps(20.0));
        let mut outline = vec![Vec2::new(-3.6, -0.2), Vec2::new(left, -0.2)];
        outline.extend((0..=steps).map(|i| {
            let (sin, cos) = libm::sincosf(PI * i as f32 / steps as f32);
            Vec2::new(middle - radius * cos, spring + radius * sin.max(0.0))
        }));
        outline.extend([(right, -0.2), (3.5, -0.2), (3.5, top), (-3.6, top)].map(Vec2::from));
        extruded(&outline, 0.4)
    }

    fn column(&self) -> Solid {
        let mut profile = vec![(0.27, -0.05), (0.27, 0.1), (0.25, 0.12), (0.25, 0.2), (0.2, 0.26)];
        profile.extend((0..=8).map(|i| {
            let t = i as f32 / 8.0;
            (0.185 - 0.035 * t * t, 0.3 + 1.95 * t)
        }));
        profile.extend([
            (0.18, 2.29),
            (0.18, 2.34),
            (0.155, 2.37),
            (0.22, 2.46),
            (0.25, 2.48),
            (0.25, 2.56),
        ]);
        lathe(&profile.into_iter().map(Vec2::from).collect::<Vec<_>>(), self.steps(28.0))
    }

    /// Plinth, metal balls, balls of yarn, a jar, a bench, lanterns.
    fn things(&self, scene: &mut Arrangement, node: u32) {
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
    fn sculpture(&self, scene: &mut Arrangement) {
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
    fn cloth(&self, scene: &mut Arrangement) {
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

    /// A dolly along the hall that swings towards the colonnade.
    fn camera(&self, scene: &mut Arrangement) {
        let place =
            |share: f32| Vec3::new(-4.8 + 0.6 * share, 1.45 + 0.05 * share, 1.8 - 0.65 * share);
        let look = |share: f32| {
            let to = Vec3::new(1.2, 1.4, 0.0) - place(share);
            let side = to.cross(Vec3::Y).normalize();
            let back = -to.normalize();
            Quat::from_mat3(&glam::Mat3::from_cols(side, back.cross(side), back))
        };
        let node = scene.node(place(0.0), look(0.0), 0);
        let (times, shares) = self.keys();
        let moves = shares.iter().flat_map(|s| place(*s).to_array()).collect();
        scene.animate(node, channel::TRANSLATION, &times, moves);
        let turns = shares.iter().flat_map(|s| look(*s).to_array()).collect();
        scene.animate(node, channel::ROTATION, &times, turns);
        scene.camera(node, 46_f32.to_radians(), 0.05, 200.0);
    }
}

/// Pale tiles of 0.8 m on a bed, from the saffron wall to the terrace outside.
fn tiles() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.add(
        &bevelled_box(Vec3::new(-6.7, -0.4, -3.7), Vec3::new(9.6, -0.03, 7.6), 0.02),
        10.0,
        Vec3::splat(0.6),
    );
    for i in 0..16 {
        for k in 0..12 {
            let low = Vec3::new(-6.4 + 0.8 * i as f32, -0.05, -3.2 + 0.8 * k as f32);
            let high = low + Vec3::new(0.79, 0.05, 0.79);
            // A fixed, uneven pattern of slightly different tiles.
            let tone = 0.88 + 0.03 * ((i * 7 + k * 11 + i * k * 5) % 5) as f32;
            mesh.add(&bevelled_box(low, high, 0.008), 10.0, Vec3::new(1.0, 0.965, 0.9) * tone);
        }
    }
    mesh
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Channel, Primitive};

    fn scene(detail: f32) -> Scene {
        Pavilion { detail, seconds: 2.0 }.run((), &Ctx::default()).unwrap()
    }

    fn triangles(scene: &Scene) -> u32 {
        let of_mesh = |mesh: u32| -> u32 {
            let primitives = scene.primitive.iter().map(|p| Primitive::from(*p));
            primitives.filter(|p| p.mesh == mesh).map(|p| p.triangles).sum()
        };
        scene.instance.iter().map(|i| of_mesh(i[1])).sum()
    }

    #[test]
    fn it_has_as_many_triangles_as_it_says() {
        assert!((70_000..110_000).contains(&triangles(&scene(1.0))), "{}", triangles(&scene(1.0)));
        let coarse = triangles(&scene(0.2));
        assert!((5_000..25_000).contains(&coarse), "{coarse}");
    }

    #[test]
    fn indices_are_in_range_and_triangles_have_area() {
        for detail in [0.2, 1.0] {
            let scene = scene(detail);
            let (vertices, nodes) = (scene.position.len(), scene.node_parent.len());
            assert!(
                scene.position.iter().chain(scene.morph_position.iter()).all(|p| p.is_finite())
            );
            assert!(scene.normal.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
            for p in scene.primitive.iter().map(|p| Primitive::from(*p)) {
                assert!((p.material as usize) < scene.base_colour.len());
                let rows = p.first_triangle as usize..(p.first_triangle + p.triangles) as usize;
                let own = p.first_vertex..p.first_vertex + p.vertices;
                for t in &scene.triangle[rows] {
                    assert!(t.iter().all(|v| own.contains(v) && (*v as usize) < vertices));
                    let [a, b, c] = t.map(|v| scene.position[v as usize].as_dvec3());
                    let area = (b - a).cross(c - a);
                    assert!(area.length() > 1e-8, "{a} {b} {c}");
                    // Shading normals are on the triangle's own side.
                    assert!(
                        t.iter().all(|v| scene.normal[*v as usize].as_dvec3().dot(area) > 0.0),
                        "{a} {b} {c}"
                    );
                }
            }
            assert!(scene.instance.iter().all(|i| (i[0] as usize) < nodes));
            for target in scene.morph_target.iter() {
                let vertices = Primitive::from(scene.primitive[target[0] as usize]).vertices;
                assert!(target[2] + vertices <= scene.morph_position.len() as u32);
            }
        }
    }

    #[test]
    fn surfaces_reflect_at_most_four_fifths() {
        let scene = scene(0.2);
        for p in scene.primitive.iter().map(|p| Primitive::from(*p)) {
            let base = Vec3::from_slice(&scene.base_colour[p.material as usize]);
            for colour in
                &scene.colour[p.first_vertex as usize..(p.first_vertex + p.vertices) as usize]
            {
                let albedo = base * Vec3::from_slice(colour);
                assert!(albedo.max_element() <= 0.8 && albedo.min_element() >= 0.0, "{albedo}");
            }
        }
    }

    #[test]
    fn the_cloth_loops_and_camera_and_sculpture_move_steadily() {
        let scene = scene(0.2);
        let channels: Vec<Channel> = scene.channel.iter().map(|c| Channel::from(*c)).collect();
        let paths = [channel::ROTATION, channel::WEIGHTS, channel::TRANSLATION, channel::ROTATION];
        assert_eq!(channels.iter().map(|c| c.path).collect::<Vec<_>>(), paths);
        for c in &channels {
            let numbers = [3, 4, 3, 3][c.path as usize];
            let times = &scene.key_time[c.first_key as usize..][..KEYS];
            let values = &scene.key_value[c.first_value as usize..][..KEYS * numbers];
            assert!(
                times.windows(2).all(|t| t[0] < t[1]) && (times[0], times[KEYS - 1]) == (0.0, 2.0)
            );
            let (first, last) = (&values[..numbers], &values[(KEYS - 1) * numbers..]);
            assert_eq!(first == last, c.path == channel::WEIGHTS);
            for keys in values.chunks_exact(numbers).collect::<Vec<_>>().windows(2) {
                let step: f32 =
                    keys[0].iter().zip(keys[1]).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt();
                assert!(step > 0.0 && step < 0.5, "{step}");
            }
        }
    }

    #[test]
    fn equal_parameters_give_equal_bytes() {
        assert!(crate::data::encode(&scene(0.4)) == crate::data::encode(&scene(0.4)));
    }
}
