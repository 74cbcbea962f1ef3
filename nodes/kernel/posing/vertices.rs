//! Vertices of an instance at one time: morphed and skinned.

use super::wide;
use crate::data::{Geometry, Poses, instance};
use crate::kernel::animation::rows;
use crate::node::Error;
use glam::{DMat3, DMat4, Vec3};

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

#[cfg(test)]
mod tests {
    use super::super::tests::{morphed, skinned};
    use super::super::{mirrored, poses};
    use super::*;
    use crate::data::{Scene, channel};
    use crate::kernel::animation::fixture::animate;
    use crate::kernel::meshes::geometry;
    use glam::DVec3;

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

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
}
