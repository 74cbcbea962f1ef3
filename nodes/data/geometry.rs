//! What of a scene is needed to trace and shade it: shapes, materials, poses.

use super::Array;
use crate::artifact;
use glam::{Vec2, Vec3};

/// Columns and values of [`Geometry::instance`].
pub mod instance {
    /// No skin.
    pub const NO_SKIN: u32 = u32::MAX;
    /// Its vertices are the mesh's own at all times, and its matrix never changes.
    pub const STATIC: u32 = 0;
    /// Its matrix changes over time.
    pub const RIGID: u32 = 1;
    /// Its vertices change over time: it is skinned or morphed.
    pub const DEFORMING: u32 = 2;
}

/// Values of [`Materials::alpha_mode`]'s first column.
pub mod alpha {
    /// Alpha is ignored.
    pub const OPAQUE: f32 = 0.0;
    /// Transparent where alpha is below the cutoff.
    pub const MASK: f32 = 1.0;
    /// Light passes as if the surface were not there (transmissive glass).
    pub const ABSENT: f32 = 2.0;
}

artifact! {
    /// The shapes of a scene and where they are used; the same at all times. World-level triangle
    /// numbers count the triangles of instance 0, then those of instance 1, and so on.
    pub struct Geometry {
        /// `[vertex, 3]` in the space of the mesh.
        position: Array<Vec3>,
        /// `[vertex, 3]` unit normals; zero for flat shading.
        normal: Array<Vec3>,
        /// `[vertex, 2]`.
        uv: Array<Vec2>,
        /// `[vertex, 4]` linear; empty when there are none.
        colour: Array<[f32; 4]>,
        /// `[vertex, 4]`; empty when nothing is skinned.
        joint: Array<[u16; 4]>,
        /// `[vertex, 4]`; empty when nothing is skinned.
        weight: Array<[f32; 4]>,
        /// `[triangle, 3]` vertices; the triangles of a mesh stand together.
        triangle: Array<[u32; 3]>,
        /// `[triangle]` materials.
        triangle_material: Array<u32>,
        /// `[mesh, 4]`: first triangle, triangles, first vertex, vertices.
        mesh: Array<[u32; 4]>,
        /// `[target, 5]`: mesh, place among the mesh's morph weights, first delta, first vertex, vertices.
        morph_target: Array<[u32; 5]>,
        /// `[delta, 3]`.
        morph_position: Array<Vec3>,
        /// `[delta, 3]`.
        morph_normal: Array<Vec3>,
        /// `[instance, 3]`: mesh, skin or [`instance::NO_SKIN`], motion ([`instance`]).
        instance: Array<[u32; 3]>,
        /// Centre of the bounding box at time 0, world space.
        centre: Vec3,
        /// Diagonal of the bounding box at time 0, metres; 1 when there are no triangles.
        diagonal: f32,
        /// Distance along the normal by which shadow rays start and end off a surface, metres.
        bias: f32,
    }
}

artifact! {
    /// Where every instance is at one time: matrices and morph weights, not deformed vertices.
    pub struct Poses {
        /// `[instance, 16]` column-major, mesh space to world space (identity for skinned instances,
        /// whose joint matrices already reach the world).
        matrix: Array<[f32; 16]>,
        /// `[instance, 2]`: first of its morph weights, and how many.
        weight_range: Array<[u32; 2]>,
        /// Morph weights.
        weight: Array<f32>,
        /// `[instance, 2]`: first of its joint matrices, and how many.
        joint_range: Array<[u32; 2]>,
        /// `[joint, 16]` column-major, mesh space to world space.
        joint: Array<[f32; 16]>,
    }
}

artifact! {
    /// The materials of a scene: metallic-roughness as in glTF 2.0, with their textures.
    pub struct Materials {
        /// `[material, 4]` linear base colour and alpha.
        base_colour: Array<[f32; 4]>,
        /// `[material, 2]`: metallic, perceptual roughness.
        metallic_roughness: Array<[f32; 2]>,
        /// `[material]` strength of the dielectric reflectance of 0.04; 0 is exactly Lambertian.
        specular_factor: Array<f32>,
        /// `[material, 3]` emitted radiance, W/(m^2 sr).
        emissive: Array<Vec3>,
        /// `[material, 2]`: mode ([`alpha`]), cutoff.
        alpha_mode: Array<[f32; 2]>,
        /// `[material]` 1 where it emits from both faces.
        double_sided: Array<u8>,
        /// `[material, 3]` textures of base colour, metallic-roughness, emission; -1 none.
        material_texture: Array<[f32; 3]>,
        /// `[material, 18]` three affine texture transforms.
        texture_transform: Array<[f32; 18]>,
        /// `[texture, 3]`: first texel, width, height.
        texture: Array<[u32; 3]>,
        /// `[texel, 4]` as stored in the image: sRGB-encoded colours, linear alpha.
        texel: Array<[u8; 4]>,
    }
}
