//! Morph targets: what their weights add to positions and normals.

use super::meshes::{Meshes, Part, row};
use crate::node::Error;
use glam::Vec3;

/// Appends the targets of a primitive that is about to be pushed to `meshes`.
pub(super) fn append(meshes: &mut Meshes, part: &Part<'_>) -> Result<(), Error> {
    let targets = part.primitive.targets.as_deref().unwrap_or_default();
    for (place, target) in targets.iter().enumerate() {
        if target.positions.is_none() && target.normals.is_none() {
            continue;
        }
        let deltas = |index: Option<_>, name: &str| -> Result<Vec<Vec3>, Error> {
            let Some(index): Option<gltf::json::Index<gltf::json::Accessor>> = index else {
                return Ok(vec![Vec3::ZERO; part.rows.len()]);
            };
            let name = format!("targets[{place}].{name}");
            let accessor = part.vertices(index.value(), &name)?;
            let vectors: Vec<[f32; 3]> = part.vectors(&accessor, false, &name)?;
            Ok(vectors.into_iter().map(Vec3::from).collect())
        };
        let first = row(meshes.morph_position.len(), "morph deltas")?;
        meshes.morph_position.extend(deltas(target.positions, "POSITION")?);
        meshes.morph_normal.extend(deltas(target.normals, "NORMAL")?);
        let primitive = row(meshes.primitive.len(), "primitives")?;
        meshes.morph_target.push([primitive, row(place, "morph targets")?, first]);
    }
    Ok(())
}
