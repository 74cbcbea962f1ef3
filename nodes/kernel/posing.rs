//! Instances at one time: matrices, joint matrices, and deformed vertices (glTF 2.0, section 3.7).

use super::animation::{Pose, rows};
use crate::data::{Geometry, Poses, Primitive, Scene, instance};
use crate::node::Error;
use glam::{DMat3, DMat4, DVec3, Vec3};

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

/// Positions and normals of an instance over its mesh's range of vertices. Those of a deforming
/// instance are morphed, skinned and in world space; those of any other are the mesh's own, for the
/// caller to move by the instance's matrix. Normals are unit vectors or zero. A vertex without skin
/// weights stays on the instance's matrix.
///
/// # Errors
/// When the poses are not those of this geometry.
pub fn posed_vertices(
    geometry: &Geometry,
    poses: &Poses,
    instance: usize,
) -> Result<(Vec<Vec3>, Vec<Vec3>), Error> {
    let missing =
        || Error::invalid(format!("geometry and poses do not fit together at instance {instance}"));
    let &[mesh, skin, motion] = geometry.instance.get(instance).ok_or_else(missing)?;
    let &[_, _, first, count] = geometry.mesh.get(mesh as usize).ok_or_else(missing)?;
    let mut positions =
        rows(&geometry.position, first, count as usize).ok_or_else(missing)?.to_vec();
    let mut normals = rows(&geometry.normal, first, count as usize).ok_or_else(missing)?.to_vec();
    if motion != instance::DEFORMING {
        return Ok((positions, normals));
    }
    let &[first_weight, weights] = poses.weight_range.get(instance).ok_or_else(missing)?;
    let weights = rows(&poses.weight, first_weight, weights as usize).ok_or_else(missing)?;
    for &[of, place, first_delta, first_vertex, vertices] in
        geometry.morph_target.iter().filter(|t| t[0] == mesh)
    {
        let weight = weights.get(place as usize).copied().unwrap_or(0.0);
        let start =
            first_vertex.checked_sub(geometry.mesh[of as usize][2]).ok_or_else(missing)? as usize;
        for (to, deltas) in
            [(&mut positions, &geometry.morph_position), (&mut normals, &geometry.morph_normal)]
        {
            let deltas = rows(deltas, first_delta, vertices as usize).ok_or_else(missing)?;
            let to = to
                .get_mut(start..)
                .and_then(|to| to.get_mut(..deltas.len()))
                .ok_or_else(missing)?;
            if weight != 0.0 {
                to.iter_mut().zip(deltas).for_each(|(to, delta)| *to += *delta * weight);
            }
        }
    }
    let own = wide(poses.matrix.get(instance).ok_or_else(missing)?);
    let own_normal = for_normals(&own);
    if skin == instance::NO_SKIN {
        for (p, n) in positions.iter_mut().zip(&mut normals) {
            *p = own.transform_point3(p.as_dvec3()).as_vec3();
            *n = (own_normal * n.as_dvec3()).normalize_or_zero().as_vec3();
        }
        return Ok((positions, normals));
    }
    let &[first_joint, joints] = poses.joint_range.get(instance).ok_or_else(missing)?;
    let joints = rows(&poses.joint, first_joint, joints as usize).ok_or_else(missing)?;
    let matrices: Vec<DMat4> = joints.iter().map(wide).collect();
    let rows_of = rows(&geometry.joint, first, count as usize).ok_or_else(missing)?;
    let shares_of = rows(&geometry.weight, first, count as usize).ok_or_else(missing)?;
    for (i, (p, n)) in positions.iter_mut().zip(&mut normals).enumerate() {
        let mut blend = DMat4::ZERO;
        for (&joint, &share) in
            rows_of[i].iter().zip(&shares_of[i]).filter(|(_, share)| **share != 0.0)
        {
            blend += *matrices.get(usize::from(joint)).ok_or_else(missing)? * f64::from(share);
        }
        let (to_world, to_normal) =
            if shares_of[i] == [0.0; 4] { (own, own_normal) } else { (blend, for_normals(&blend)) };
        *p = to_world.transform_point3(p.as_dvec3()).as_vec3();
        *n = (to_normal * n.as_dvec3()).normalize_or_zero().as_vec3();
    }
    Ok((positions, normals))
}

/// Whether an instance's matrix mirrors: its triangles are then clockwise seen from the front, also in
/// what [`posed_vertices`] gives.
pub fn mirrored(poses: &Poses, instance: usize) -> bool {
    poses
        .matrix
        .get(instance)
        .is_some_and(|matrix| DMat3::from_mat4(wide(matrix)).determinant() < 0.0)
}

/// The inverse transpose up to a positive factor, which exists for singular matrices too.
fn for_normals(matrix: &DMat4) -> DMat3 {
    let m = DMat3::from_mat4(*matrix);
    let cofactors = DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    if m.determinant() < 0.0 { -cofactors } else { cofactors }
}

/// The box of the vertices that triangles use, world space, lower corner first; none without triangles.
///
/// # Errors
/// As [`posed_vertices`]; also when the box is not finite.
pub fn bounding_box(geometry: &Geometry, poses: &Poses) -> Result<Option<[DVec3; 2]>, Error> {
    let boxes: Vec<Bounds> = geometry
        .mesh
        .iter()
        .map(|mesh| {
            let corners = rows(&geometry.triangle, mesh[0], mesh[1] as usize)
                .unwrap_or_default()
                .as_flattened();
            corners
                .iter()
                .filter_map(|&v| geometry.position.get(v as usize))
                .fold(Bounds::NONE, Bounds::with)
        })
        .collect();
    let mut all = Bounds::NONE;
    for (i, &[mesh, _, motion]) in geometry.instance.iter().enumerate() {
        let missing =
            || Error::invalid(format!("geometry and poses do not fit together at instance {i}"));
        let row = geometry.mesh.get(mesh as usize).ok_or_else(missing)?;
        let corners =
            rows(&geometry.triangle, row[0], row[1] as usize).ok_or_else(missing)?.as_flattened();
        if corners.is_empty() {
            continue;
        }
        let matrix = wide(poses.matrix.get(i).ok_or_else(missing)?);
        let (positions, first, to_world) = if motion == instance::DEFORMING {
            (posed_vertices(geometry, poses, i)?.0, row[2] as usize, DMat4::IDENTITY)
        } else if all.contains(&boxes[mesh as usize].moved(&matrix)) {
            // Of many instances most lie inside; only those that may not are looked at vertex by vertex.
            continue;
        } else {
            (Vec::new(), 0, matrix)
        };
        let positions =
            if motion == instance::DEFORMING { &positions[..] } else { &geometry.position };
        for &vertex in corners {
            let place = (vertex as usize)
                .checked_sub(first)
                .and_then(|v| positions.get(v))
                .ok_or_else(missing)?;
            all = all.and(to_world.transform_point3(place.as_dvec3()));
        }
    }
    match all.0 {
        [low, high] if low.x > high.x => Ok(None),
        [low, high] if (high - low).as_vec3().is_finite() && low.as_vec3().is_finite() => {
            Ok(Some([low, high]))
        }
        _ => Err(Error::invalid("the bounding box of the scene is not finite")),
    }
}

#[derive(Clone, Copy)]
struct Bounds([DVec3; 2]);

impl Bounds {
    const NONE: Self = Bounds([DVec3::INFINITY, DVec3::NEG_INFINITY]);

    fn and(self, point: DVec3) -> Self {
        Bounds([self.0[0].min(point), self.0[1].max(point)])
    }

    fn with(self, point: &Vec3) -> Self {
        self.and(point.as_dvec3())
    }

    fn contains(&self, other: &Self) -> bool {
        other.0[0].cmpge(self.0[0]).all() && other.0[1].cmple(self.0[1]).all()
    }

    fn moved(&self, matrix: &DMat4) -> Self {
        let corner = |i: usize| DVec3::from_array(std::array::from_fn(|k| self.0[i >> k & 1][k]));
        (0..8).fold(Self::NONE, |all, i| all.and(matrix.transform_point3(corner(i))))
    }
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

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

    /// The triangle skinned to two joints: its vertices to the first, to both by half, to none.
    fn skinned() -> Scene {
        let mut scene = triangle(&[(-1, Vec3::ZERO), (-1, Vec3::ZERO), (-1, Vec3::splat(5.0))]);
        scene.joint = vec![[0, 1, 0, 0]; 3].into();
        scene.weight = vec![[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0; 4]].into();
        scene.skin = vec![[0, 2]].into();
        scene.skin_joint = vec![0, 1].into();
        scene.skin_inverse_bind = vec![DMat4::IDENTITY.as_mat4().to_cols_array(); 2].into();
        scene.instance = vec![[2, 0, 0]].into();
        scene
    }

    fn morphed(weight: f32) -> Scene {
        let mut scene = triangle(&[(-1, Vec3::ZERO)]);
        scene.node_weight = vec![[0, 1]].into();
        scene.rest_weight = vec![weight].into();
        scene.morph_target = vec![[0, 0, 0]].into();
        scene.morph_position = vec![Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::ZERO].into();
        scene.morph_normal = vec![Vec3::new(2.0, 0.0, 0.0), Vec3::ZERO, Vec3::ZERO].into();
        scene
    }

    fn posed(scene: &Scene, seconds: f64) -> (Vec<Vec3>, Vec<Vec3>) {
        let shapes = geometry(scene, 0.0).unwrap().0;
        posed_vertices(&shapes, &poses(scene, seconds).unwrap(), 0).unwrap()
    }

    #[test]
    fn two_joints_share_a_vertex() {
        // The second joint rises by 4 and its bind pose was 1 to the left.
        let mut scene = skinned();
        let bind = DMat4::from_translation(DVec3::X).as_mat4().to_cols_array();
        scene.skin_inverse_bind = vec![DMat4::IDENTITY.as_mat4().to_cols_array(), bind].into();
        let keys = [0.0, 0.0, 0.0, 0.0, 4.0, 0.0];
        animate(&mut scene, 1, channel::TRANSLATION, channel::LINEAR, &[0.0, 1.0], &keys);
        let at = poses(&scene, 1.0).unwrap();
        assert_eq!(at.matrix[0], DMat4::IDENTITY.as_mat4().to_cols_array());
        assert_eq!(
            (at.joint_range[0], at.joint[1][12..15].to_vec()),
            ([0, 2], vec![1.0, 4.0, 0.0])
        );
        let (positions, normals) = posed(&scene, 1.0);
        assert_eq!(positions, [Vec3::ZERO, Vec3::new(1.5, 2.0, 0.0), Vec3::Y]);
        assert_eq!(normals, [Vec3::Z; 3]);
        assert_eq!(geometry(&scene, 0.0).unwrap().0.instance[0], [0, 0, instance::DEFORMING]);
    }

    #[test]
    fn normals_of_skins_follow_the_inverse_transpose() {
        // Joint 0 is stretched along x by 2: a normal (1, 0, 1) becomes (1/2, 0, 1).
        let mut scene = skinned();
        scene.node_scale = vec![Vec3::new(2.0, 1.0, 1.0), Vec3::ONE, Vec3::ONE].into();
        scene.normal = vec![Vec3::new(HALF, 0.0, HALF), Vec3::ZERO, Vec3::Z].into();
        let (positions, normals) = posed(&scene, 0.0);
        assert!(normals[0].distance(Vec3::new(0.5, 0.0, 1.0).normalize()) < 1e-6);
        assert_eq!((positions[1], normals[1]), (Vec3::new(1.5, 0.0, 0.0), Vec3::ZERO));
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
    fn morph_targets_count_by_their_weight() {
        let (positions, normals) = posed(&morphed(0.5), 0.0);
        assert_eq!(positions, [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::Y]);
        assert!(normals[0].distance(Vec3::new(HALF, 0.0, HALF)) < 1e-6 && normals[1] == Vec3::Z);
        assert_eq!(geometry(&morphed(0.5), 0.0).unwrap().0.instance[0][2], instance::DEFORMING);
        assert_eq!(geometry(&morphed(0.0), 0.0).unwrap().0.instance[0][2], instance::STATIC);
        let mut moving = morphed(0.0);
        animate(&mut moving, 0, channel::WEIGHTS, channel::LINEAR, &[0.0, 1.0], &[0.0, 1.0]);
        assert_eq!(posed(&moving, 0.25).0[1], Vec3::new(1.5, 0.0, 0.0));
    }

    #[test]
    fn mirrored_instances_keep_their_normals() {
        let mut scene = morphed(1.0);
        scene.node_scale = vec![Vec3::new(1.0, -1.0, 1.0)].into();
        let (positions, normals) = posed(&scene, 0.0);
        assert_eq!((positions[2], normals[2]), (Vec3::NEG_Y, Vec3::Z));
        let at = poses(&scene, 0.0).unwrap();
        assert!(mirrored(&at, 0) && !mirrored(&poses(&skinned(), 0.0).unwrap(), 0));
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
