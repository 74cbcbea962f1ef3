//! Joint numbers and weights of vertices.

use super::meshes::{Meshes, Part};
use crate::node::Error;
use gltf::json::mesh::Semantic;

/// Weights whose sum is this far from one were not rounded but wrong.
const TOLERANCE: f32 = 1e-3;

/// Appends the joints and weights of a primitive whose positions are already in `meshes`; gives one
/// more than the largest joint number that has a weight.
pub(super) fn append(meshes: &mut Meshes, part: &Part<'_>) -> Result<Option<u32>, Error> {
    let end = meshes.position.len();
    let start = end - part.rows.len();
    let joints = part.attribute(Semantic::Joints(0))?;
    let weights = part.attribute(Semantic::Weights(0))?;
    let (Some(joints), Some(weights)) = (joints, weights) else {
        if !meshes.weight.is_empty() {
            meshes.joint.resize(end, [0; 4]);
            meshes.weight.resize(end, [0.0; 4]);
        }
        return Ok(None);
    };
    if part.attribute(Semantic::Joints(1))?.is_some() {
        part.notes
            .count("primitives of which only the first four joints a vertex are used", &part.place);
    }
    let joints =
        joints.joints(&part.rows).map_err(|e| part.wrong(format_args!("JOINTS_0: {e}")))?;
    let mut weights: Vec<[f32; 4]> = part.vectors(&weights, true, "WEIGHTS_0")?;
    let repaired = weights.iter_mut().map(normalise).filter(|repaired| *repaired).count();
    part.notes.add("sets of skin weights normalised", repaired as u64, &part.place);

    let pairs = joints.as_flattened().iter().zip(weights.as_flattened());
    let needed =
        pairs.filter(|(_, weight)| **weight > 0.0).map(|(joint, _)| u32::from(*joint) + 1).max();
    meshes.joint.resize(start, [0; 4]);
    meshes.weight.resize(start, [0.0; 4]);
    meshes.joint.extend(joints);
    meshes.weight.extend(weights);
    Ok(needed)
}

/// Makes the weights sum to one; the first joint takes all where none has any. Says whether they
/// were wrong by more than rounding.
fn normalise(weights: &mut [f32; 4]) -> bool {
    let negative = weights.iter().any(|w| *w < 0.0);
    *weights = weights.map(|w| w.max(0.0));
    let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    if sum > 0.0 {
        *weights = weights.map(|w| (f64::from(w) / sum) as f32);
    } else {
        *weights = [1.0, 0.0, 0.0, 0.0];
    }
    negative || (sum - 1.0).abs() > f64::from(TOLERANCE)
}

#[cfg(test)]
mod tests {
    use super::normalise;

    #[test]
    fn weights_sum_to_one_and_repairs_are_told() {
        let mut cases =
            [[0.5, 0.5, 0.0, 0.0], [1.0, 1.0, 2.0, 0.0], [0.0; 4], [-1.0, 1.0, 0.0, 0.0]];
        assert_eq!(cases.each_mut().map(normalise), [false, true, true, true]);
        let right = [
            [0.5, 0.5, 0.0, 0.0],
            [0.25, 0.25, 0.5, 0.0],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ];
        assert_eq!(cases, right);
    }
}
