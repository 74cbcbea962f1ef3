//! A scene as it was read or generated: everything, at all times.

use super::Array;
use crate::artifact;
use glam::{Vec2, Vec3};

artifact! {
    /// A moment of the shot.
    pub struct Time {
        /// Seconds since the start of the animation.
        seconds: f64,
    }
}

/// Columns of [`Scene::primitive`].
pub struct Primitive {
    /// Mesh it belongs to.
    pub mesh: u32,
    /// Its material.
    pub material: u32,
    /// First of its rows in [`Scene::triangle`].
    pub first_triangle: u32,
    /// Number of triangles.
    pub triangles: u32,
    /// First of its vertices.
    pub first_vertex: u32,
    /// Number of vertices.
    pub vertices: u32,
}

impl From<[u32; 6]> for Primitive {
    fn from([mesh, material, first_triangle, triangles, first_vertex, vertices]: [u32; 6]) -> Self {
        Primitive { mesh, material, first_triangle, triangles, first_vertex, vertices }
    }
}

/// Columns of [`Scene::channel`]: what an animation channel moves, and how.
pub struct Channel {
    /// Animated node.
    pub node: u32,
    /// Animated property: one of [`channel::TRANSLATION`], `ROTATION`, `SCALE`, `WEIGHTS`.
    pub path: u32,
    /// One of [`channel::STEP`], `LINEAR`, `CUBIC`.
    pub interpolation: u32,
    /// First of its rows in [`Scene::key_time`].
    pub first_key: u32,
    /// Number of keys.
    pub keys: u32,
    /// First of its numbers in [`Scene::key_value`].
    pub first_value: u32,
}

impl From<[u32; 6]> for Channel {
    fn from([node, path, interpolation, first_key, keys, first_value]: [u32; 6]) -> Self {
        Channel { node, path, interpolation, first_key, keys, first_value }
    }
}

/// Values of the columns of [`Channel`].
pub mod channel {
    /// Three numbers a key.
    pub const TRANSLATION: u32 = 0;
    /// A quaternion x, y, z, w a key.
    pub const ROTATION: u32 = 1;
    /// Three numbers a key.
    pub const SCALE: u32 = 2;
    /// As many numbers a key as the node's mesh has morph targets.
    pub const WEIGHTS: u32 = 3;
    /// The value of the last key.
    pub const STEP: u32 = 0;
    /// Linear between keys; rotations on the great arc.
    pub const LINEAR: u32 = 1;
    /// Cubic Hermite; each key has in-tangent, value, out-tangent.
    pub const CUBIC: u32 = 2;
}

artifact! {
    /// A whole scene in glTF's terms, units (metres, seconds, radians) and axes (+Y up, right-handed);
    /// colours are linear Rec. 709. An index of -1 means none.
    pub struct Scene {
        /// `[vertex, 3]` in the space of the mesh.
        position: Array<Vec3>,
        /// `[vertex, 3]` unit normals; zero where the file has none (flat shading).
        normal: Array<Vec3>,
        /// `[vertex, 2]` of the texture coordinate set that the primitive's material uses.
        uv: Array<Vec2>,
        /// `[vertex, 4]` linear vertex colours; empty when no vertex of the scene has one.
        colour: Array<[f32; 4]>,
        /// `[vertex, 4]` rows of the skin's joint list; empty when nothing is skinned.
        joint: Array<[u16; 4]>,
        /// `[vertex, 4]` normalised skin weights, all zero on unskinned vertices; empty with `joint`.
        weight: Array<[f32; 4]>,
        /// `[triangle, 3]` vertices, counter-clockwise seen from the front.
        triangle: Array<[u32; 3]>,
        /// `[primitive, 6]`: see [`Primitive`]. Sorted by mesh.
        primitive: Array<[u32; 6]>,
        /// `[target, 3]`: primitive, place among the mesh's morph weights, first row in the deltas
        /// (one row for each vertex of the primitive).
        morph_target: Array<[u32; 3]>,
        /// `[delta, 3]` added to positions, times the weight.
        morph_position: Array<Vec3>,
        /// `[delta, 3]` added to normals, times the weight.
        morph_normal: Array<Vec3>,

        /// `[node]` parents; a parent may stand before or after its children, never in a cycle.
        node_parent: Array<i32>,
        /// `[node, 3]` at rest.
        node_translation: Array<Vec3>,
        /// `[node, 4]` unit quaternions x, y, z, w at rest.
        node_rotation: Array<[f32; 4]>,
        /// `[node, 3]` at rest.
        node_scale: Array<Vec3>,
        /// `[node, 2]`: first of its morph weights in `rest_weight`, and how many.
        node_weight: Array<[u32; 2]>,
        /// Morph weights at rest.
        rest_weight: Array<f32>,
        /// `[instance, 3]`: node, mesh, skin (as u32; `u32::MAX` without a skin).
        instance: Array<[u32; 3]>,
        /// `[instance, 16]` column-major matrix applied before the node's own (EXT_mesh_gpu_instancing).
        instance_offset: Array<[f32; 16]>,
        /// `[skin, 2]`: first of its joints, and how many.
        skin: Array<[u32; 2]>,
        /// Nodes that are joints, skin after skin.
        skin_joint: Array<u32>,
        /// `[joint, 16]` column-major inverse bind matrices, parallel to `skin_joint`.
        skin_inverse_bind: Array<[f32; 16]>,

        /// `[channel, 6]`: see [`Channel`].
        channel: Array<[u32; 6]>,
        /// Seconds, increasing within a channel.
        key_time: Array<f32>,
        /// Values of the keys, channel after channel.
        key_value: Array<f32>,

        /// `[material, 4]` linear base colour and alpha.
        base_colour: Array<[f32; 4]>,
        /// `[material, 2]`: metallic, roughness (perceptual; alpha of the lobe is its square).
        metallic_roughness: Array<[f32; 2]>,
        /// `[material]` strength of the dielectric reflectance of 0.04: 1, or the factor of
        /// KHR_materials_specular; a dielectric of strength 0 is exactly Lambertian.
        specular_factor: Array<f32>,
        /// `[material, 3]` emitted radiance, strength included.
        emissive: Array<Vec3>,
        /// `[material, 2]`: mode (see [`alpha`](super::alpha)), cutoff.
        alpha_mode: Array<[f32; 2]>,
        /// `[material]` 1 where it emits from both faces.
        double_sided: Array<u8>,
        /// `[material, 3]` textures of base colour, metallic-roughness (G rough, B metal), emission; -1 none.
        material_texture: Array<[f32; 3]>,
        /// `[material, 18]` three affine texture transforms, each `u' = a u + b v + c, v' = d u + e v + f`.
        texture_transform: Array<[f32; 18]>,
        /// `[texture, 3]`: first texel, width, height.
        texture: Array<[u32; 3]>,
        /// `[texel, 4]` as stored: sRGB-encoded for base colour and emission, linear alpha.
        texel: Array<[u8; 4]>,

        /// `[camera, 5]`: node, vertical field of view (radians; 0 for orthographic), half height
        /// (orthographic, else 0), near, far (infinity is `f32::MAX`).
        camera: Array<[f32; 5]>,
        /// `[light, 7]`: node, kind (0 point, 1 spot, 2 directional), colour times intensity (3;
        /// W/sr or W/m^2), cosine of the inner cone, cosine of the outer cone.
        light: Array<[f32; 7]>,
    }
}
