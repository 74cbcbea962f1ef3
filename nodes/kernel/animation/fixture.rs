//! Tiny scenes for tests.

use super::Pose;
use crate::data::{Array, Scene};
use glam::{DMat4, DVec3, Vec2, Vec3};

/// Nothing.
pub fn empty() -> Scene {
    Scene {
        position: Array::default(),
        normal: Array::default(),
        uv: Array::default(),
        colour: Array::default(),
        joint: Array::default(),
        weight: Array::default(),
        triangle: Array::default(),
        primitive: Array::default(),
        morph_target: Array::default(),
        morph_position: Array::default(),
        morph_normal: Array::default(),
        node_parent: Array::default(),
        node_translation: Array::default(),
        node_rotation: Array::default(),
        node_scale: Array::default(),
        node_weight: Array::default(),
        rest_weight: Array::default(),
        instance: Array::default(),
        instance_offset: Array::default(),
        skin: Array::default(),
        skin_joint: Array::default(),
        skin_inverse_bind: Array::default(),
        channel: Array::default(),
        key_time: Array::default(),
        key_value: Array::default(),
        base_colour: Array::default(),
        metallic_roughness: Array::default(),
        specular_factor: Array::default(),
        emissive: Array::default(),
        alpha_mode: Array::default(),
        double_sided: Array::default(),
        material_texture: Array::default(),
        texture_transform: Array::default(),
        texture: Array::default(),
        texel: Array::default(),
        camera: Array::default(),
        light: Array::default(),
    }
}

/// Nodes at the given places under the given parents, without rotation, scale or weights.
pub fn nodes(of: &[(i32, Vec3)]) -> Scene {
    Scene {
        node_parent: of.iter().map(|n| n.0).collect(),
        node_translation: of.iter().map(|n| n.1).collect(),
        node_rotation: vec![[0.0, 0.0, 0.0, 1.0]; of.len()].into(),
        node_scale: vec![Vec3::ONE; of.len()].into(),
        node_weight: vec![[0, 0]; of.len()].into(),
        ..empty()
    }
}

/// `nodes`, with the triangle (0,0,0) (1,0,0) (0,1,0) facing +Z as mesh 0, used by the last node.
pub fn triangle(of: &[(i32, Vec3)]) -> Scene {
    Scene {
        position: vec![Vec3::ZERO, Vec3::X, Vec3::Y].into(),
        normal: vec![Vec3::Z; 3].into(),
        uv: vec![Vec2::ZERO; 3].into(),
        triangle: vec![[0, 1, 2]].into(),
        primitive: vec![[0, 0, 0, 1, 0, 3]].into(),
        instance: vec![[of.len() as u32 - 1, 0, u32::MAX]].into(),
        instance_offset: vec![DMat4::IDENTITY.as_mat4().to_cols_array()].into(),
        base_colour: vec![[0.5, 0.5, 0.5, 1.0]].into(),
        metallic_roughness: vec![[0.0, 1.0]].into(),
        specular_factor: vec![0.0].into(),
        emissive: vec![Vec3::ZERO].into(),
        alpha_mode: vec![[0.0, 0.5]].into(),
        double_sided: vec![0].into(),
        material_texture: vec![[-1.0; 3]].into(),
        texture_transform: vec![[0.0; 18]].into(),
        ..nodes(of)
    }
}

/// Adds a channel.
pub fn animate(scene: &mut Scene, node: u32, path: u32, how: u32, time: &[f32], value: &[f32]) {
    let row = [
        node,
        path,
        how,
        scene.key_time.len() as u32,
        time.len() as u32,
        scene.key_value.len() as u32,
    ];
    scene.channel = scene.channel.iter().copied().chain([row]).collect();
    scene.key_time = scene.key_time.iter().chain(time).copied().collect();
    scene.key_value = scene.key_value.iter().chain(value).copied().collect();
}

/// Where a node is at a time, world space.
pub fn place(scene: &Scene, seconds: f64, node: usize) -> DVec3 {
    Pose::at(scene, seconds).unwrap().position(node).unwrap()
}
