//! The box around all instances at one time.

use super::{posed_vertices, wide};
use crate::data::{Geometry, Poses, instance};
use crate::kernel::animation::rows;
use crate::node::Error;
use glam::{DMat4, DVec3, Vec3};

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
