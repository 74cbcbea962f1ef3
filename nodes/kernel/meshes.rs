//! The meshes of a scene as [`Geometry`], and how each instance moves.

use super::animation::{moving, rows};
use super::posing::{bounding_box, poses, skin_of};
use crate::data::{Geometry, Primitive, Scene, channel, instance};
use crate::node::Error;
use glam::DVec3;

/// The geometry of `scene`, with a shadow bias of `bias` times the diagonal of its bounding box at
/// time 0, and that box, lower corner first (a point at the origin when there are no triangles).
///
/// # Errors
/// When the scene's arrays do not fit together, a node is its own ancestor, the box is not finite, or
/// there are more triangles than 32 bits can number.
pub fn geometry(scene: &Scene, bias: f32) -> Result<(Geometry, [DVec3; 2]), Error> {
    check_lengths(scene)?;
    let mut primitives: Vec<(usize, Primitive)> = Vec::with_capacity(scene.primitive.len());
    primitives.extend(scene.primitive.iter().map(|row| Primitive::from(*row)).enumerate());
    primitives.sort_by_key(|(_, primitive)| primitive.mesh);
    let used = scene.instance.iter().map(|instance| instance[1]);
    let meshes = primitives
        .iter()
        .map(|(_, p)| p.mesh)
        .chain(used)
        .max()
        .map_or(0, |last| last as usize + 1);
    let mut mesh = vec![[0; 4]; meshes];
    let mut triangle = Vec::with_capacity(scene.triangle.len());
    let mut triangle_material = Vec::with_capacity(scene.triangle.len());
    for (number, p) in &primitives {
        let corners = triangles_of(scene, *number, p)?;
        let row: &mut [u32; 4] = &mut mesh[p.mesh as usize];
        if row[1] == 0 && row[3] == 0 {
            *row = [triangle.len() as u32, 0, p.first_vertex, 0];
        }
        let end = (row[2] + row[3]).max(p.first_vertex + p.vertices);
        row[1] += p.triangles;
        row[2] = row[2].min(p.first_vertex);
        row[3] = end - row[2];
        triangle.extend_from_slice(corners);
        triangle_material.resize(triangle.len(), p.material);
    }
    let shapes = Geometry {
        position: scene.position.clone(),
        normal: scene.normal.clone(),
        uv: scene.uv.clone(),
        colour: scene.colour.clone(),
        joint: scene.joint.clone(),
        weight: scene.weight.clone(),
        triangle: triangle.into(),
        triangle_material: triangle_material.into(),
        morph_target: morph_targets(scene)?.into(),
        morph_position: scene.morph_position.clone(),
        morph_normal: scene.morph_normal.clone(),
        instance: instances(scene, &mesh)?.into(),
        mesh: mesh.into(),
        centre: glam::Vec3::ZERO,
        diagonal: 1.0,
        bias: 0.0,
    };
    let [low, high] = bounding_box(&shapes, &poses(scene, 0.0)?)?.unwrap_or_default();
    let diagonal = match (high - low).length() as f32 {
        // A point has no size to take the bias from.
        0.0 => 1.0,
        diagonal if diagonal.is_finite() => diagonal,
        _ => return Err(Error::invalid("the bounding box of the scene is not finite")),
    };
    let centre = ((low + high) / 2.0).as_vec3();
    Ok((Geometry { centre, diagonal, bias: bias * diagonal, ..shapes }, [low, high]))
}

fn check_lengths(scene: &Scene) -> Result<(), Error> {
    let vertices = scene.position.len();
    let full = [("normal", scene.normal.len()), ("uv", scene.uv.len())];
    let partial = [
        ("colour", scene.colour.len()),
        ("joint", scene.joint.len()),
        ("weight", scene.weight.len()),
    ];
    let wrong = full
        .into_iter()
        .chain(partial.into_iter().filter(|(_, n)| *n > 0))
        .find(|(_, n)| *n != vertices);
    match wrong {
        Some((name, n)) => Err(Error::invalid(format!(
            "the scene has {vertices} vertices, but {n} rows of {name}"
        ))),
        None if scene.joint.len() != scene.weight.len() => {
            Err(Error::invalid("the scene has joints without weights, or weights without joints"))
        }
        None => Ok(()),
    }
}

fn triangles_of<'a>(
    scene: &'a Scene,
    number: usize,
    p: &Primitive,
) -> Result<&'a [[u32; 3]], Error> {
    let wrong =
        |what: &str| Error::invalid(format!("primitive {number} has {what} that do not exist"));
    let corners = rows(&scene.triangle, p.first_triangle, p.triangles as usize)
        .ok_or_else(|| wrong("triangles"))?;
    rows(&scene.position, p.first_vertex, p.vertices as usize).ok_or_else(|| wrong("vertices"))?;
    let own = p.first_vertex..p.first_vertex + p.vertices;
    if !corners.as_flattened().iter().all(|vertex| own.contains(vertex)) {
        return Err(Error::invalid(format!(
            "primitive {number} has triangles between vertices that are not its own"
        )));
    }
    if p.material as usize >= scene.base_colour.len() {
        return Err(Error::invalid(format!(
            "primitive {number} has material {}, which does not exist",
            p.material
        )));
    }
    Ok(corners)
}

fn morph_targets(scene: &Scene) -> Result<Vec<[u32; 5]>, Error> {
    let row = |(number, &[primitive, place, first]): (usize, &[u32; 3])| {
        let p = scene.primitive.get(primitive as usize).map(|row| Primitive::from(*row));
        let p = p.filter(|p| {
            let deltas = [&scene.morph_position, &scene.morph_normal];
            deltas.into_iter().all(|deltas| rows(deltas, first, p.vertices as usize).is_some())
        });
        let p = p.ok_or_else(|| {
            Error::invalid(format!("morph target {number} names what does not exist"))
        })?;
        Ok([p.mesh, place, first, p.first_vertex, p.vertices])
    };
    scene.morph_target.iter().enumerate().map(row).collect()
}

fn instances(scene: &Scene, mesh: &[[u32; 4]]) -> Result<Vec<[u32; 3]>, Error> {
    let moving = moving(scene)?;
    let mut morphing = vec![false; moving.len()];
    for (morphs, &[first, count]) in morphing.iter_mut().zip(&*scene.node_weight) {
        *morphs = rows(&scene.rest_weight, first, count as usize)
            .is_some_and(|w| w.iter().any(|&w| w != 0.0));
    }
    for row in scene.channel.iter().filter(|row| row[1] == channel::WEIGHTS) {
        morphing[row[0] as usize] = true;
    }
    let mut targets = vec![false; mesh.len()];
    for target in scene.morph_target.iter() {
        targets[scene.primitive[target[0] as usize][0] as usize] = true;
    }
    let total: u64 = scene.instance.iter().map(|row| u64::from(mesh[row[1] as usize][1])).sum();
    if total >= u64::from(u32::MAX) {
        return Err(Error::invalid(format!(
            "the instances have {total} triangles, more than 32 bits can number"
        )));
    }
    let motion = |(i, row): (usize, &[u32; 3])| {
        let [node, of, _] = *row;
        let moves = moving.get(node as usize);
        let moves = moves.ok_or_else(|| {
            Error::invalid(format!("instance {i} is at node {node}, which does not exist"))
        })?;
        let skin = skin_of(scene, *row);
        let deforms =
            skin != instance::NO_SKIN || (targets[of as usize] && morphing[node as usize]);
        let motion = match (deforms, moves) {
            (true, _) => instance::DEFORMING,
            (false, true) => instance::RIGID,
            (false, false) => instance::STATIC,
        };
        Ok([of, skin, motion])
    };
    scene.instance.iter().enumerate().map(motion).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::animation::fixture::{animate, empty, triangle};
    use glam::{DMat4, Vec3};

    #[test]
    fn measures_what_is_used_where_it_stands() {
        // A second vertex range and a far vertex that no triangle uses.
        let mut scene = triangle(&[(-1, Vec3::new(2.0, 0.0, 0.0)), (0, Vec3::ZERO)]);
        scene.position = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::splat(1e6)].into();
        scene.normal = vec![Vec3::Z; 4].into();
        scene.uv = vec![glam::Vec2::ZERO; 4].into();
        scene.primitive = vec![[0, 0, 0, 1, 0, 4]].into();
        let (shapes, [low, high]) = geometry(&scene, 0.5).unwrap();
        assert_eq!((low, high), (DVec3::new(2.0, 0.0, 0.0), DVec3::new(3.0, 1.0, 0.0)));
        assert_eq!((shapes.centre, shapes.diagonal), (Vec3::new(2.5, 0.5, 0.0), 2_f32.sqrt()));
        assert_eq!((shapes.bias, shapes.mesh[0]), (0.5 * 2_f32.sqrt(), [0, 1, 0, 4]));
    }

    #[test]
    fn rotated_instances_have_exact_boxes() {
        let mut scene = triangle(&[(-1, Vec3::ZERO)]);
        let (s, c) = 22.5_f32.to_radians().sin_cos();
        scene.node_rotation = vec![[0.0, 0.0, s, c]].into();
        scene.instance = vec![[0, 0, u32::MAX]; 3].into();
        scene.instance_offset = vec![DMat4::IDENTITY.as_mat4().to_cols_array(); 3].into();
        let [low, high] = geometry(&scene, 0.0).unwrap().1;
        let half = 0.5_f64.sqrt();
        assert!(low.distance(DVec3::new(-half, 0.0, 0.0)) < 1e-6);
        assert!(high.distance(DVec3::new(half, half, 0.0)) < 1e-6);
    }

    #[test]
    fn primitives_of_a_mesh_stand_together() {
        let mut scene = triangle(&[(-1, Vec3::ZERO)]);
        scene.triangle = vec![[0, 1, 2], [2, 1, 0], [1, 2, 0]].into();
        scene.primitive = vec![[1, 0, 2, 1, 0, 3], [0, 0, 0, 1, 0, 3], [1, 0, 1, 1, 0, 3]].into();
        scene.instance = vec![[0, 2, u32::MAX]].into();
        let shapes = geometry(&scene, 0.0).unwrap().0;
        assert_eq!(shapes.triangle[..], [[0, 1, 2], [1, 2, 0], [2, 1, 0]]);
        assert_eq!(shapes.mesh[..], [[0, 1, 0, 3], [1, 2, 0, 3], [0; 4]]);
        assert_eq!((shapes.diagonal, shapes.centre), (1.0, Vec3::ZERO));
    }

    #[test]
    fn motion_comes_from_the_node_or_an_ancestor() {
        let mut scene = triangle(&[(-1, Vec3::ZERO), (0, Vec3::ZERO)]);
        let motion = |scene: &Scene| geometry(scene, 0.0).unwrap().0.instance[0][2];
        assert_eq!(motion(&scene), instance::STATIC);
        let keys = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        animate(&mut scene, 0, channel::TRANSLATION, channel::LINEAR, &[0.0, 1.0], &keys);
        assert_eq!(motion(&scene), instance::RIGID);
    }

    #[test]
    fn an_empty_scene_is_legal_and_broken_ones_are_errors() {
        let (shapes, corners) = geometry(&empty(), 1e-4).unwrap();
        assert_eq!((shapes.diagonal, shapes.bias, corners), (1.0, 1e-4, [DVec3::ZERO; 2]));
        let broken = |change: fn(&mut Scene)| {
            let mut scene = triangle(&[(-1, Vec3::ZERO)]);
            change(&mut scene);
            geometry(&scene, 0.0).map(|_| ()).unwrap_err().to_string()
        };
        assert!(broken(|s| s.triangle = vec![[0, 1, 3]].into()).contains("not its own"));
        assert!(broken(|s| s.primitive = vec![[0, 1, 0, 1, 0, 3]].into()).contains("material 1"));
        assert!(
            broken(|s| s.primitive = vec![[0, 0, 0, 2, 0, 3]].into()).contains("triangles that")
        );
        assert!(broken(|s| s.normal = vec![Vec3::Z].into()).contains("1 rows of normal"));
        assert!(broken(|s| s.morph_target = vec![[0, 0, 0]].into()).contains("morph target 0"));
        assert!(broken(|s| s.instance = vec![[1, 0, u32::MAX]].into()).contains("node 1"));
        assert!(
            broken(|s| s.position = vec![Vec3::MIN, Vec3::MAX, Vec3::ZERO].into())
                .contains("not finite")
        );
    }
}
