//! A ground under a scene that has none, to catch its shadows and bounce its light.

use crate::data::{Array, Element, Scene, alpha};
use crate::kernel::meshes;
use crate::node::{Ctx, Error, Item, Node};
use glam::{DVec3, Vec2, Vec3};

/// How far it lies below the lowest point, as a share of the diagonal: not in the plane of a floor
/// that the scene may have.
const GAP: f64 = 1e-4;

crate::params! {
    /// The scene with a horizontal, diffuse quad below its lowest point at time 0, facing up.
    pub struct Ground {
        /// How far it reaches beyond the bounding box, as a multiple of the box's diagonal. The
        /// quad counts in the size of the geometry, from which the shadow bias is taken.
        margin: f32 = 1.0, 0.0..=100.0;
        /// Diffuse reflectance, linear RGB, each 0 to 1.
        albedo: [f32; 3] = [0.5; 3];
    }
}

crate::inputs! {
    /// Inputs of [`Ground`].
    pub struct GroundIn {
        /// The scene.
        scene: Item<Scene>,
    }
}

impl Node for Ground {
    const KIND: &'static str = "Ground";
    const VERSION: u32 = 1;
    type In = GroundIn;
    type Out = Scene;

    fn check(&self, problems: &mut crate::node::Problems) {
        if !self.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            problems.report("albedo", "expected three numbers from 0 to 1");
        }
    }

    fn run(&self, input: GroundIn, _: &Ctx) -> Result<Scene, Error> {
        let scene = &*input.scene;
        let (geometry, [low, high]) = meshes::geometry(scene, 0.0)?;
        let diagonal = f64::from(geometry.diagonal);
        let beyond = DVec3::new(1.0, 0.0, 1.0) * f64::from(self.margin) * diagonal;
        let (low, high, y) = (low - beyond, high + beyond, low.y - GAP * diagonal);
        let corners = [(low.x, high.z), (high.x, high.z), (high.x, low.z), (low.x, low.z)];
        let [r, g, b] = self.albedo;
        let vertex = scene.position.len() as u32;
        let primitive = [
            geometry.mesh.len() as u32,
            scene.base_colour.len() as u32,
            scene.triangle.len() as u32,
            2,
            vertex,
            4,
        ];
        let identity = glam::Mat4::IDENTITY.to_cols_array();
        let per_vertex = |rows: usize| if rows == 0 { 0 } else { 4 };
        Ok(Scene {
            position: with(&scene.position, &corners.map(|(x, z)| DVec3::new(x, y, z).as_vec3())),
            normal: with(&scene.normal, &[Vec3::Y; 4]),
            uv: with(&scene.uv, &[Vec2::ZERO; 4]),
            colour: with(&scene.colour, &vec![[1.0; 4]; per_vertex(scene.colour.len())]),
            joint: with(&scene.joint, &vec![[0; 4]; per_vertex(scene.joint.len())]),
            weight: with(&scene.weight, &vec![[0.0; 4]; per_vertex(scene.weight.len())]),
            triangle: with(
                &scene.triangle,
                &[[0, 1, 2], [0, 2, 3]].map(|t| t.map(|v: u32| vertex + v)),
            ),
            primitive: with(&scene.primitive, &[primitive]),
            node_parent: with(&scene.node_parent, &[-1]),
            node_translation: with(&scene.node_translation, &[Vec3::ZERO]),
            node_rotation: with(&scene.node_rotation, &[[0.0, 0.0, 0.0, 1.0]]),
            node_scale: with(&scene.node_scale, &[Vec3::ONE]),
            node_weight: with(&scene.node_weight, &[[0, 0]]),
            instance: with(
                &scene.instance,
                &[[scene.node_parent.len() as u32, primitive[0], u32::MAX]],
            ),
            instance_offset: with(&scene.instance_offset, &[identity]),
            base_colour: with(&scene.base_colour, &[[r, g, b, 1.0]]),
            metallic_roughness: with(&scene.metallic_roughness, &[[0.0, 1.0]]),
            specular_factor: with(&scene.specular_factor, &[0.0]),
            emissive: with(&scene.emissive, &[Vec3::ZERO]),
            alpha_mode: with(&scene.alpha_mode, &[[alpha::OPAQUE, 0.5]]),
            double_sided: with(&scene.double_sided, &[0]),
            material_texture: with(&scene.material_texture, &[[-1.0; 3]]),
            texture_transform: with(
                &scene.texture_transform,
                &[std::array::from_fn(|i| if i % 6 == 0 || i % 6 == 4 { 1.0 } else { 0.0 })],
            ),
            ..scene.clone()
        })
    }
}

fn with<T: Element>(array: &Array<T>, more: &[T]) -> Array<T> {
    array.iter().chain(more).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::instance;
    use crate::kernel::animation::fixture::{empty, triangle};

    fn run(scene: Scene) -> Scene {
        Ground::default().run(GroundIn { scene: scene.into() }, &Ctx::default()).unwrap()
    }

    #[test]
    fn the_ground_lies_below_and_faces_up() {
        let mut scene = triangle(&[(-1, Vec3::new(0.0, 5.0, 0.0))]);
        scene.joint = vec![[0; 4]; 3].into();
        scene.weight = vec![[0.0; 4]; 3].into();
        let (geometry, [low, high]) = meshes::geometry(&run(scene), 1e-4).unwrap();
        let d = 2_f64.sqrt();
        assert!(low.distance(DVec3::new(-d, 5.0 - GAP * d, -d)) < 1e-6);
        assert!(high.distance(DVec3::new(1.0 + d, 6.0, d)) < 1e-6);
        assert!(geometry.diagonal < 4.0 * d as f32);
        assert_eq!(geometry.instance[1], [1, instance::NO_SKIN, instance::STATIC]);
        assert_eq!((geometry.mesh[1], geometry.triangle_material[1]), ([1, 2, 3, 4], 1));
        for &[a, b, c] in &geometry.triangle[1..] {
            let [a, b, c] = [a, b, c].map(|v| geometry.position[v as usize]);
            assert_eq!((b - a).cross(c - a).normalize(), Vec3::Y);
        }
    }

    #[test]
    fn the_rest_of_the_scene_stays() {
        let before = triangle(&[(-1, Vec3::ZERO)]);
        let after = run(before.clone());
        assert_eq!(
            (&after.position[..3], &after.primitive[..1]),
            (&before.position[..], &before.primitive[..])
        );
        assert_eq!(after.texture_transform[1][..6], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!(run(empty()).triangle.len(), 2);
    }
}
