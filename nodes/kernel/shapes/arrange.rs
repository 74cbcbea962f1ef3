//! Meshes, materials and nodes put together into a [`Scene`].

use super::Mesh;
use crate::data::{Scene, alpha, channel, instance};
use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};

/// A material without textures.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    /// Linear Rec. 709.
    pub base_colour: Vec3,
    /// 1 for metals, 0 otherwise.
    pub metallic: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Strength of the reflection that a dielectric has besides its base colour: 0 is matte, 1 glazed.
    pub specular: f32,
    /// Emitted radiance.
    pub emissive: Vec3,
}

impl Material {
    /// A matte surface.
    pub fn matte(base_colour: Vec3) -> Self {
        Material { base_colour, metallic: 0.0, roughness: 1.0, specular: 0.0, emissive: Vec3::ZERO }
    }
}

/// A scene in the making. Indices that its functions give count from 0 in order of the calls.
#[derive(Default)]
pub struct Arrangement {
    meshes: u32,
    primitives: Vec<(u32, u32, Mesh)>,
    targets: Vec<(u32, u32, Vec<[Vec3; 2]>)>,
    targets_of_mesh: Vec<u32>,
    materials: Vec<Material>,
    nodes: Vec<(Vec3, Quat, u32)>,
    instances: Vec<([u32; 3], [f32; 16])>,
    channels: Vec<(u32, u32, Vec<f32>, Vec<f32>)>,
    cameras: Vec<[f32; 5]>,
}

impl Arrangement {
    /// Adds a material.
    pub fn material(&mut self, material: Material) -> u32 {
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Adds a mesh whose primitives are given with their materials.
    pub fn mesh(&mut self, primitives: impl IntoIterator<Item = (Mesh, u32)>) -> u32 {
        let mesh = self.meshes;
        self.meshes += 1;
        self.targets_of_mesh.push(0);
        self.primitives
            .extend(primitives.into_iter().map(|(shape, material)| (mesh, material, shape)));
        mesh
    }

    /// Adds a morph target to the mesh that was added last, for its last primitive: what to add to the
    /// position and to the normal of every vertex.
    pub fn morph_target(&mut self, deltas: Vec<[Vec3; 2]>) {
        if let (Some(place), Some(primitive)) =
            (self.targets_of_mesh.last_mut(), self.primitives.len().checked_sub(1))
        {
            self.targets.push((primitive as u32, *place, deltas));
            *place += 1;
        }
    }

    /// Adds a node at the root, with as many morph weights (0 at rest) as `weights` says.
    pub fn node(&mut self, place: Vec3, rotation: Quat, weights: u32) -> u32 {
        self.nodes.push((place, rotation, weights));
        self.nodes.len() as u32 - 1
    }

    /// Shows a mesh at a node, moved by `offset` before the node's own transform.
    pub fn show(&mut self, mesh: u32, node: u32, offset: Affine3A) {
        self.instances.push(([node, mesh, instance::NO_SKIN], Mat4::from(offset).to_cols_array()));
    }

    /// Moves a node: `path` is one of [`channel`]'s, `times` are seconds, `values` those of the keys.
    /// Between keys values are linear.
    pub fn animate(&mut self, node: u32, path: u32, times: &[f32], values: Vec<f32>) {
        self.channels.push((node, path, times.to_vec(), values));
    }

    /// Adds a perspective camera at a node; the vertical field of view is in radians.
    pub fn camera(&mut self, node: u32, field_of_view: f32, near: f32, far: f32) {
        self.cameras.push([node as f32, field_of_view, 0.0, near, far]);
    }

    /// The scene. Without textures, skins and lights of its own; vertex colours are always there.
    pub fn finish(self) -> Scene {
        let mut position = Vec::new();
        let (mut normal, mut colour, mut triangle, mut primitive) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (mesh, material, shape) in &self.primitives {
            let (vertices, triangles) = (shape.position.len() as u32, shape.triangle.len() as u32);
            let first = position.len() as u32;
            primitive.push([*mesh, *material, triangle.len() as u32, triangles, first, vertices]);
            position.extend(&shape.position);
            normal.extend(&shape.normal);
            colour.extend(shape.colour.iter().map(|c| c.extend(1.0).to_array()));
            triangle.extend(shape.triangle.iter().map(|t| t.map(|v| v + first)));
        }
        let (mut morph_target, mut morph_position, mut morph_normal) =
            (Vec::new(), Vec::new(), Vec::new());
        for (primitive, place, deltas) in &self.targets {
            morph_target.push([*primitive, *place, morph_position.len() as u32]);
            morph_position.extend(deltas.iter().map(|d| d[0]));
            morph_normal.extend(deltas.iter().map(|d| d[1]));
        }
        let (mut node_weight, mut weights) = (Vec::new(), 0);
        for (_, _, count) in &self.nodes {
            node_weight.push([weights, *count]);
            weights += count;
        }
        let (mut channels, mut key_time, mut key_value) = (Vec::new(), Vec::new(), Vec::new());
        for (node, path, times, values) in &self.channels {
            let (first_key, first_value) = (key_time.len() as u32, key_value.len() as u32);
            channels.push([
                *node,
                *path,
                channel::LINEAR,
                first_key,
                times.len() as u32,
                first_value,
            ]);
            key_time.extend(times);
            key_value.extend(values);
        }
        const SAME: [f32; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let same: [f32; 18] = std::array::from_fn(|i| SAME[i % 6]);
        let (nodes, materials) = (&self.nodes, &self.materials);
        Scene {
            uv: vec![Vec2::ZERO; position.len()].into(),
            position: position.into(),
            normal: normal.into(),
            colour: colour.into(),
            joint: Default::default(),
            weight: Default::default(),
            triangle: triangle.into(),
            primitive: primitive.into(),
            morph_target: morph_target.into(),
            morph_position: morph_position.into(),
            morph_normal: morph_normal.into(),
            node_parent: vec![-1; nodes.len()].into(),
            node_translation: nodes.iter().map(|n| n.0).collect(),
            node_rotation: nodes.iter().map(|n| n.1.to_array()).collect(),
            node_scale: vec![Vec3::ONE; nodes.len()].into(),
            node_weight: node_weight.into(),
            rest_weight: vec![0.0; weights as usize].into(),
            instance: self.instances.iter().map(|i| i.0).collect(),
            instance_offset: self.instances.iter().map(|i| i.1).collect(),
            skin: Default::default(),
            skin_joint: Default::default(),
            skin_inverse_bind: Default::default(),
            channel: channels.into(),
            key_time: key_time.into(),
            key_value: key_value.into(),
            base_colour: materials.iter().map(|m| m.base_colour.extend(1.0).to_array()).collect(),
            metallic_roughness: materials.iter().map(|m| [m.metallic, m.roughness]).collect(),
            specular_factor: materials.iter().map(|m| m.specular).collect(),
            emissive: materials.iter().map(|m| m.emissive).collect(),
            alpha_mode: vec![[alpha::OPAQUE, 0.5]; materials.len()].into(),
            double_sided: vec![0; materials.len()].into(),
            material_texture: vec![[-1.0; 3]; materials.len()].into(),
            texture_transform: vec![same; materials.len()].into(),
            texture: Default::default(),
            texel: Default::default(),
            camera: self.cameras.into(),
            light: Default::default(),
        }
    }
}
