//! The pavilion's building: walls, arcades, columns, roof and floor.

use super::{INDIGO, PLAIN, Pavilion, SAFFRON, WHITE};
use crate::kernel::shapes::{Arrangement, Material, Mesh, Solid, bevelled_box, extruded, lathe};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI};

const WOOD: Vec3 = Vec3::new(0.38, 0.21, 0.11);
/// Distance of the columns, and their number in a row.
const BAY: f32 = 2.4;
const COLUMNS: usize = 6;

impl Pavilion {
    pub(super) fn building(&self, scene: &mut Arrangement, node: u32) {
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
