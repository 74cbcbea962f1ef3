//! What small scenes are put together from: surfaces, shapes, an eye, lights.

use glam::{Mat4, Vec2, Vec3};
use lightloom_nodes as nodes;
use nodes::data::{Camera, Geometry, LightKind, Lights, Materials, Poses, alpha, instance};
use nodes::kernel::element::Light;
use nodes::kernel::light_list::LightList;
use nodes::node::Item;

/// Three corners and a material.
pub type Triangle = ([Vec3; 3], u32);

/// Lambertian materials without textures: albedo and emitted radiance.
pub fn materials(surfaces: &[(Vec3, Vec3)]) -> Materials {
    let n = surfaces.len();
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    Materials {
        base_colour: surfaces.iter().map(|(a, _)| [a.x, a.y, a.z, 1.0]).collect(),
        metallic_roughness: vec![[0.0, 1.0]; n].into(),
        specular_factor: vec![0.0; n].into(),
        emissive: surfaces.iter().map(|(_, e)| *e).collect(),
        alpha_mode: vec![[alpha::OPAQUE, 0.5]; n].into(),
        double_sided: vec![0; n].into(),
        material_texture: vec![[-1.0; 3]; n].into(),
        texture_transform: vec![std::array::from_fn(|i| identity[i % 6]); n].into(),
        texture: Vec::new().into(),
        texel: Vec::new().into(),
    }
}

/// One mesh of flat triangles for each part, the first static, the others moved by their matrices.
pub fn soups(parts: &[Vec<Triangle>]) -> Geometry {
    let position: Vec<Vec3> = parts.iter().flatten().flat_map(|t| t.0).collect();
    let finite = || position.iter().copied().filter(|p| p.is_finite());
    let low = finite().reduce(Vec3::min).unwrap_or_default();
    let high = finite().reduce(Vec3::max).unwrap_or_default();
    let diagonal = (high - low).length();
    let mut mesh = Vec::new();
    let mut first = 0;
    for part in parts {
        let count = part.len() as u32;
        mesh.push([first, count, 3 * first, 3 * count]);
        first += count;
    }
    let motion = |i: usize| if i == 0 { instance::STATIC } else { instance::RIGID };
    Geometry {
        normal: vec![Vec3::ZERO; position.len()].into(),
        uv: vec![Vec2::ZERO; position.len()].into(),
        position: position.into(),
        colour: Vec::new().into(),
        joint: Vec::new().into(),
        weight: Vec::new().into(),
        triangle: (0..first).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        triangle_material: parts.iter().flatten().map(|t| t.1).collect(),
        mesh: mesh.into(),
        morph_target: Vec::new().into(),
        morph_position: Vec::new().into(),
        morph_normal: Vec::new().into(),
        instance: (0..parts.len()).map(|i| [i as u32, instance::NO_SKIN, motion(i)]).collect(),
        centre: (low + high) * 0.5,
        diagonal,
        bias: 1e-4 * diagonal,
    }
}

/// One matrix an instance.
pub fn poses(matrices: &[Mat4]) -> Poses {
    Poses {
        matrix: matrices.iter().map(Mat4::to_cols_array).collect(),
        weight_range: vec![[0, 0]; matrices.len()].into(),
        weight: Vec::new().into(),
        joint_range: vec![[0, 0]; matrices.len()].into(),
        joint: Vec::new().into(),
    }
}

/// The parallelogram at `corner` with sides `u` and `v`; front: u x v.
pub fn quad(corner: Vec3, u: Vec3, v: Vec3, material: u32) -> [Triangle; 2] {
    [
        ([corner, corner + u, corner + u + v], material),
        ([corner, corner + u + v, corner + v], material),
    ]
}

/// A square plane at y = 0 around the origin, facing up, of material 0.
pub fn plane(side: f32) -> Vec<Triangle> {
    quad(Vec3::new(-0.5, 0.0, -0.5) * side, Vec3::Z * side, Vec3::X * side, 0).to_vec()
}

/// The outside of a box, of material 0.
pub fn block(low: Vec3, size: Vec3) -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    let sides =
        [(low + y, z, x), (low, x, z), (low, y, x), (low + z, x, y), (low, z, y), (low + x, y, z)];
    sides.into_iter().flat_map(|(corner, u, v)| quad(corner, u, v, 0)).collect()
}

/// The inside of the unit cube: material 0, with a wall of material 1 and one of material 2.
pub fn room() -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let sides = [(Vec3::ZERO, z, x, 0), (y, x, z, 0), (Vec3::ZERO, x, y, 0), (z, y, x, 0)];
    let walls = [(Vec3::ZERO, y, z, 1), (x, z, y, 2)];
    sides.into_iter().chain(walls).flat_map(|(corner, u, v, m)| quad(corner, u, v, m)).collect()
}

/// A unit sphere of 20 x 4^levels triangles, facing inwards, of material 0.
pub fn sphere(levels: u32) -> Vec<Triangle> {
    let octant = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let corners = [Vec3::X * side(0), Vec3::Y * side(1), Vec3::Z * side(2)];
        // Inwards: the mirrored octants turn round.
        if side(0) * side(1) * side(2) > 0.0 {
            [corners[0], corners[2], corners[1]]
        } else {
            corners
        }
    };
    let mut faces: Vec<[Vec3; 3]> = (0..8).map(octant).collect();
    for _ in 0..levels {
        let quarter = |[a, b, c]: [Vec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(quarter).collect();
    }
    faces.into_iter().map(|face| (face, 0)).collect()
}

/// A perspective camera that looks from `eye` to `at` with the given tangent of half its height.
pub fn look(eye: Vec3, at: Vec3, tangent: f32) -> Camera {
    let forward = (at - eye).normalize();
    let across = if forward.y.abs() > 0.99 { Vec3::NEG_Z } else { Vec3::Y };
    let right = forward.cross(across).normalize();
    Camera {
        eye,
        right,
        up: right.cross(forward),
        forward,
        half_height_tangent: tangent,
        half_height: 0.0,
        clip: [0.0, f32::MAX],
    }
}

/// A light of a kind at a place, pointing somewhere, without cone and clamp.
pub fn lamp(kind: LightKind, position: Vec3, direction: Vec3, emission: Vec3) -> Light {
    Light { kind, position, direction, emission, cone: Vec2::ZERO, clamp: 0.0 }
}

/// A list of lights that are the same in every frame.
pub fn lights(all: &[Light]) -> Item<Lights> {
    let mut list = LightList::new();
    all.iter().for_each(|light| list.push(light));
    list.finish(true).into()
}

/// The list with every emission times `factor`.
pub fn scaled(lights: &Lights, factor: f32) -> Item<Lights> {
    let emission = lights.emission.iter().map(|e| *e * factor).collect();
    Lights { emission, ..lights.clone() }.into()
}
