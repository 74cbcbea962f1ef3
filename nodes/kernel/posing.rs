//! Instances at one time: matrices, joint matrices, and deformed vertices (glTF 2.0, section 3.7).

mod bounds;
mod vertices;

pub use bounds::bounding_box;
pub use vertices::posed_vertices;

use super::animation::{Pose, rows};
use crate::data::{Poses, Primitive, Scene, instance};
use crate::node::Error;
use glam::{DMat3, DMat4};

/// Matrices and morph weights of all instances `seconds` after the start of the animation.
///
/// # Errors
/// As [`Pose::at`]; also when an instance or a skin names what does not exist, or a matrix is not finite.
pub fn poses(scene: &Scene, seconds: f64) -> Result<Poses, Error> {
    let pose = Pose::at(scene, seconds)?;
    if scene.instance_offset.len() != scene.instance.len() {
        return Err(Error::invalid("the arrays of the scene's instances differ in length"));
    }
    if scene.skin_inverse_bind.len() != scene.skin_joint.len() {
        return Err(Error::invalid("the scene has not one inverse bind matrix for each joint"));
    }
    let mut matrix = Vec::with_capacity(scene.instance.len());
    let mut weight_range = Vec::with_capacity(scene.instance.len());
    let mut joint_range = Vec::with_capacity(scene.instance.len());
    for (i, (&row, offset)) in scene.instance.iter().zip(&*scene.instance_offset).enumerate() {
        let node = row[0] as usize;
        let (Some(world), Some(&weights)) = (pose.world.get(node), scene.node_weight.get(node))
        else {
            return Err(Error::invalid(format!(
                "instance {i} is at node {node}, which does not exist"
            )));
        };
        if rows(&pose.weight, weights[0], weights[1] as usize).is_none() {
            return Err(Error::invalid(format!("node {node} has morph weights that do not exist")));
        }
        let skin = skin_of(scene, row);
        let joints = match skin {
            instance::NO_SKIN => [0, 0],
            skin => *scene.skin.get(skin as usize).ok_or_else(|| {
                Error::invalid(format!("instance {i} has skin {skin}, which does not exist"))
            })?,
        };
        if rows(&scene.skin_joint, joints[0], joints[1] as usize).is_none() {
            return Err(Error::invalid(format!("skin {skin} has joints that do not exist")));
        }
        let to_world =
            if skin == instance::NO_SKIN { *world * wide(offset) } else { DMat4::IDENTITY };
        matrix.push(narrow(&to_world).ok_or_else(|| {
            Error::invalid(format!(
                "the matrix of instance {i} (node {node}) is not finite at {seconds} s"
            ))
        })?);
        weight_range.push(weights);
        joint_range.push(joints);
    }
    let joint = scene.skin_joint.iter().zip(&*scene.skin_inverse_bind).map(|(&node, inverse)| {
        let world = pose.world.get(node as usize);
        let world =
            world.ok_or_else(|| Error::invalid(format!("joint node {node} does not exist")))?;
        let joint = narrow(&(*world * wide(inverse)));
        joint.ok_or_else(|| {
            Error::invalid(format!("joint node {node} is not finite at {seconds} s"))
        })
    });
    let joint = joint.collect::<Result<Vec<_>, _>>()?;
    Ok(Poses {
        matrix: matrix.into(),
        weight_range: weight_range.into(),
        weight: pose.weight.into(),
        joint_range: joint_range.into(),
        joint: joint.into(),
    })
}

/// The skin that deforms an instance (a row of [`Scene::instance`]): none either when its mesh has
/// no skin weights, so that it stays where its node is.
pub fn skin_of(scene: &Scene, [_, mesh, skin]: [u32; 3]) -> u32 {
    let weighted = |p: &[u32; 6]| {
        let Primitive { mesh: of, first_vertex, vertices, .. } = Primitive::from(*p);
        let weights = rows(&scene.weight, first_vertex, vertices as usize);
        of == mesh && weights.is_some_and(|weights| weights.iter().any(|w| *w != [0.0; 4]))
    };
    if skin != instance::NO_SKIN && scene.primitive.iter().any(weighted) {
        skin
    } else {
        instance::NO_SKIN
    }
}

/// Whether an instance's matrix mirrors: its triangles are then clockwise seen from the front, also in
/// what [`posed_vertices`] gives.
pub fn mirrored(poses: &Poses, instance: usize) -> bool {
    poses
        .matrix
        .get(instance)
        .is_some_and(|matrix| DMat3::from_mat4(wide(matrix)).determinant() < 0.0)
}

fn wide(matrix: &[f32; 16]) -> DMat4 {
    DMat4::from_cols_array(&matrix.map(f64::from))
}

fn narrow(matrix: &DMat4) -> Option<[f32; 16]> {
    let narrow = matrix.to_cols_array().map(|x| x as f32);
    narrow.iter().all(|x| x.is_finite()).then_some(narrow)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::{Array, channel};
    use crate::kernel::animation::fixture::{animate, nodes, triangle};
    use crate::kernel::meshes::geometry;
    use glam::{DVec3, Vec3};

    /// The triangle skinned to two joints: its vertices to the first, to both by half, to none.
    pub(super) fn skinned() -> Scene {
        let mut scene = triangle(&[(-1, Vec3::ZERO), (-1, Vec3::ZERO), (-1, Vec3::splat(5.0))]);
        scene.joint = vec![[0, 1, 0, 0]; 3].into();
        scene.weight = vec![[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0; 4]].into();
        scene.skin = vec![[0, 2]].into();
        scene.skin_joint = vec![0, 1].into();
        scene.skin_inverse_bind = vec![DMat4::IDENTITY.as_mat4().to_cols_array(); 2].into();
        scene.instance = vec![[2, 0, 0]].into();
        scene
    }

    pub(super) fn morphed(weight: f32) -> Scene {
        let mut scene = triangle(&[(-1, Vec3::ZERO)]);
        scene.node_weight = vec![[0, 1]].into();
        scene.rest_weight = vec![weight].into();
        scene.morph_target = vec![[0, 0, 0]].into();
        scene.morph_position = vec![Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::ZERO].into();
        scene.morph_normal = vec![Vec3::new(2.0, 0.0, 0.0), Vec3::ZERO, Vec3::ZERO].into();
        scene
    }

    #[test]
    fn a_skin_without_weights_leaves_the_mesh_at_its_node() {
        let mut scene = skinned();
        scene.weight = vec![[0.0; 4]; 3].into();
        assert_eq!(
            geometry(&scene, 0.0).unwrap().0.instance[0],
            [0, instance::NO_SKIN, instance::STATIC]
        );
        assert_eq!(poses(&scene, 0.0).unwrap().matrix[0][12..15], [5.0; 3]);
    }

    #[test]
    fn static_poses_have_equal_bytes_at_all_times() {
        let mut scene = triangle(&[(-1, Vec3::new(0.1, 0.2, 0.3))]);
        let q = [0.1, 0.2, 0.3, 0.9];
        animate(&mut scene, 0, channel::ROTATION, channel::LINEAR, &[0.0, 1.0], &[q, q].concat());
        scene.instance_offset =
            vec![DMat4::from_translation(DVec3::Y).as_mat4().to_cols_array()].into();
        let [a, b] = [0.1, 0.7].map(|t| crate::data::encode(&poses(&scene, t).unwrap()));
        assert_eq!(a, b);
        animate(
            &mut scene,
            0,
            channel::SCALE,
            channel::LINEAR,
            &[0.0, 1.0],
            &[1.0, 1.0, 1.0, 2.0, 1.0, 1.0],
        );
        assert_ne!(a, crate::data::encode(&poses(&scene, 0.7).unwrap()));
    }

    #[test]
    fn offsets_come_before_the_node() {
        let mut scene = triangle(&[(-1, Vec3::X)]);
        scene.node_scale = vec![Vec3::splat(2.0)].into();
        scene.instance_offset =
            vec![DMat4::from_translation(DVec3::Y).as_mat4().to_cols_array()].into();
        assert_eq!(poses(&scene, 0.0).unwrap().matrix[0][12..15], [1.0, 2.0, 0.0]);
    }

    #[test]
    fn what_does_not_fit_or_is_not_finite_is_an_error() {
        let text = |scene: &Scene| poses(scene, 0.0).unwrap_err().to_string();
        let mut scene = nodes(&[(-1, Vec3::splat(3e38)), (0, Vec3::splat(3e38))]);
        scene.instance = vec![[1, 0, u32::MAX]].into();
        scene.instance_offset = vec![DMat4::IDENTITY.as_mat4().to_cols_array()].into();
        assert!(text(&scene).contains("instance 0 (node 1) is not finite"));
        scene.instance = vec![[2, 0, u32::MAX]].into();
        assert!(text(&scene).contains("node 2"));
        let shapes = geometry(&skinned(), 0.0).unwrap().0;
        let other = Poses { joint_range: vec![[0, 1]].into(), ..poses(&skinned(), 0.0).unwrap() };
        assert!(
            posed_vertices(&shapes, &other, 0).is_err()
                && posed_vertices(&shapes, &other, 1).is_err()
        );
        let none = Poses { matrix: Array::default(), ..other };
        assert!(bounding_box(&shapes, &none).is_err());
    }
}
