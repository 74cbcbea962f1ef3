//! Small scenes for tests: plain materials, quads, a room with a box, lights and receivers in it.

use super::element::Receiver;
use super::stage::Stage;
use crate::data::{Geometry, LightKind, Lights, Materials, Poses, alpha, instance};
use crate::node::{Ctx, Item};
use glam::{Mat4, Vec2, Vec3};
use std::sync::Arc;

/// Lambertian materials of the given albedos, without textures.
pub fn plain_materials(albedos: &[Vec3]) -> Materials {
    let n = albedos.len();
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let transforms: [f32; 18] = std::array::from_fn(|i| identity[i % 6]);
    Materials {
        base_colour: albedos.iter().map(|a| [a.x, a.y, a.z, 1.0]).collect(),
        metallic_roughness: vec![[0.0, 1.0]; n].into(),
        specular_factor: vec![0.0; n].into(),
        emissive: vec![Vec3::ZERO; n].into(),
        alpha_mode: vec![[alpha::OPAQUE, 0.5]; n].into(),
        double_sided: vec![0; n].into(),
        material_texture: vec![[-1.0; 3]; n].into(),
        texture_transform: vec![transforms; n].into(),
        texture: Vec::new().into(),
        texel: Vec::new().into(),
    }
}

/// One static mesh of flat triangles, each with its material.
pub fn soup(triangles: &[([Vec3; 3], u32)]) -> Geometry {
    let position: Vec<Vec3> = triangles.iter().flat_map(|t| t.0).collect();
    let low = position.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = position.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let diagonal = (high - low).length();
    let (count, vertices) = (triangles.len() as u32, position.len() as u32);
    Geometry {
        normal: vec![Vec3::ZERO; position.len()].into(),
        uv: vec![Vec2::ZERO; position.len()].into(),
        position: position.into(),
        colour: Vec::new().into(),
        joint: Vec::new().into(),
        weight: Vec::new().into(),
        triangle: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        triangle_material: triangles.iter().map(|t| t.1).collect(),
        mesh: vec![[0, count, 0, vertices]].into(),
        morph_target: Vec::new().into(),
        morph_position: Vec::new().into(),
        morph_normal: Vec::new().into(),
        instance: vec![[0, instance::NO_SKIN, instance::STATIC]].into(),
        centre: (low + high) * 0.5,
        diagonal,
        bias: 1e-4 * diagonal,
    }
}

/// The pose of one instance that stays where it is.
pub fn still() -> Poses {
    Poses {
        matrix: vec![Mat4::IDENTITY.to_cols_array()].into(),
        weight_range: vec![[0, 0]].into(),
        weight: Vec::new().into(),
        joint_range: vec![[0, 0]].into(),
        joint: Vec::new().into(),
    }
}

/// Two triangles that fill the parallelogram at `corner` with sides `u` and `v`; front: u x v.
pub fn quad(corner: Vec3, u: Vec3, v: Vec3, material: u32) -> [([Vec3; 3], u32); 2] {
    [
        ([corner, corner + u, corner + u + v], material),
        ([corner, corner + u + v, corner + v], material),
    ]
}

/// The stage of a soup of triangles.
pub fn stage_of(geometry: Geometry, materials: Materials) -> Arc<Stage> {
    let parts = (Item::from(geometry), Item::from(materials), Item::from(still()));
    Stage::of(&Ctx::default(), &parts.0, &parts.1, &parts.2).expect("a sound scene")
}

/// The triangles of a unit room, its walls facing inwards, with a box in it.
pub fn room() -> Vec<([Vec3; 3], u32)> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut all = Vec::new();
    all.extend(quad(Vec3::ZERO, z, x, 0));
    all.extend(quad(y, x, z, 0));
    all.extend(quad(Vec3::ZERO, x, y, 0));
    all.extend(quad(z, y, x, 0));
    all.extend(quad(Vec3::ZERO, y, z, 1));
    all.extend(quad(x, z, y, 2));
    let (low, s) = (Vec3::new(0.3, 0.0, 0.3), 0.35);
    all.extend(quad(low + y * s, z * s, x * s, 0));
    all.extend(quad(low, y * s, x * s, 0));
    all.extend(quad(low + z * s, x * s, y * s, 0));
    all.extend(quad(low, z * s, y * s, 0));
    all.extend(quad(low + x * s, y * s, z * s, 0));
    all
}

/// The stage of [`room`] with grey, red and green walls.
pub fn room_stage() -> Arc<Stage> {
    let albedos = [Vec3::splat(0.7), Vec3::new(0.7, 0.1, 0.1), Vec3::new(0.1, 0.7, 0.1)];
    stage_of(soup(&room()), plain_materials(&albedos))
}

fn random(index: u32, dimension: u32, seed: u32) -> f32 {
    sobol_burley::sample(index, dimension, seed)
}

/// `count` cosine lights spread over the surfaces of the unit room, facing inwards.
pub fn cosine_lights(count: usize, seed: u32) -> Lights {
    let stage = room_stage();
    let place = |i: usize| {
        let at = |d| random(i as u32, d, seed);
        let triangle = ((at(0) * stage.triangles() as f32) as u32).min(stage.triangles() - 1);
        let root = at(1).sqrt();
        stage.surface(triangle, root * (1.0 - at(2)), root * at(2))
    };
    let surfaces: Vec<_> = (0..count).map(place).collect();
    Lights {
        kind: vec![LightKind::Cosine as u8; count].into(),
        position: surfaces.iter().map(|s| s.position).collect(),
        direction: surfaces.iter().map(|s| s.facet).collect(),
        emission: surfaces.iter().map(|s| s.reflectance.albedo).collect(),
        cone: vec![Vec2::ZERO; count].into(),
        clamp: vec![0.05; count].into(),
        identity: 1,
    }
}

/// `count` receivers on the surfaces of a stage.
pub fn room_receivers(stage: &Stage, count: usize, seed: u32) -> Vec<Receiver> {
    let place = |i: usize| {
        let at = |d| random(i as u32, d, seed);
        let triangle = ((at(0) * stage.triangles() as f32) as u32).min(stage.triangles() - 1);
        let root = at(1).sqrt();
        let s = stage.surface(triangle, root * (1.0 - at(2)), root * at(2));
        Receiver::diffuse(s.position, s.normal, s.facet, s.reflectance.albedo)
    };
    (0..count).map(place).collect()
}
