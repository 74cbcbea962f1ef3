//! A generated scene rich in indirect light: a weaver's pavilion in the late afternoon, 12 x 6 x 5 m.
//!
//! Two arcades, a saffron wall and an indigo wall, a slatted roof; in the middle three ribbons plaited
//! around a trefoil knot turn on a plinth, a cloth waves, lanterns glow in the shade. Made for a sun at
//! an elevation of 35 degrees and an azimuth of 40, the defaults of `Sky` and `SunLights`.

mod building;
mod furnishings;

use crate::data::{Scene, channel};
use crate::kernel::shapes::Arrangement;
use crate::node::{Ctx, Error, Node, Sizes};
use glam::{Quat, Vec3};

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
/// Tint of vertices that leave their material's colour alone.
const PLAIN: Vec3 = Vec3::ONE;
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
