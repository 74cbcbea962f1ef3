//! Nodes: parents, transforms at rest, and which of them the default scene shows.

use super::container::Document;
use super::notes::Notes;
use super::transform::{self, Trs};
use crate::node::Error;
use glam::{DQuat, Vec3};
use gltf::json;

/// All nodes of a file, in its order.
pub(super) struct Hierarchy {
    /// Parent of each; -1 for roots.
    pub(super) parent: Vec<i32>,
    pub(super) rest: Vec<Trs>,
    /// Nodes of the default scene, increasing.
    pub(super) shown: Vec<usize>,
}

impl Hierarchy {
    /// Reads the nodes; an error when they are not trees.
    pub(super) fn read(document: &Document, notes: &Notes) -> Result<Self, Error> {
        let nodes = &document.nodes;
        // Cameras and lights name their node in a column of f32.
        if nodes.len() > 1 << 24 {
            return Err(Error::invalid(format!(
                "{} nodes, expected at most {}",
                nodes.len(),
                1 << 24
            )));
        }
        let parent = parents(nodes)?;
        let roots: Vec<usize> = (0..nodes.len()).filter(|n| parent[*n] < 0).collect();
        let reached = descendants(nodes, &roots);
        if let Some(lost) = reached.iter().position(|reached| !reached) {
            // Every node off the trees hangs on a cycle: enough steps up end on it.
            let on_cycle = (0..nodes.len()).fold(lost, |node, _| parent[node] as usize);
            return Err(Error::invalid(format!("nodes[{on_cycle}] is its own ancestor")));
        }
        let shown = match &document.roots {
            None => (0..nodes.len()).collect(),
            Some(roots) => {
                if let Some(missing) = roots.iter().find(|root| **root >= nodes.len()) {
                    return Err(Error::invalid(format!(
                        "the default scene: nodes[{missing}] does not exist"
                    )));
                }
                let reached = descendants(nodes, roots);
                (0..nodes.len()).filter(|n| reached[*n]).collect()
            }
        };
        let rest = nodes
            .iter()
            .enumerate()
            .map(|(i, node)| rest(node, &format!("nodes[{i}]"), notes))
            .collect();
        Ok(Hierarchy { parent, rest: Result::from_iter::<Vec<_>>(rest)?, shown })
    }
}

fn children(node: &json::Node) -> impl Iterator<Item = usize> {
    node.children.iter().flatten().map(|child| child.value())
}

fn parents(nodes: &[json::Node]) -> Result<Vec<i32>, Error> {
    let mut parent = vec![-1_i32; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for child in children(node) {
            let wrong = |what: String| {
                Error::invalid(format!("nodes[{child}], a child of nodes[{i}], {what}"))
            };
            let slot = parent.get_mut(child).ok_or_else(|| wrong("does not exist".into()))?;
            if *slot >= 0 {
                return Err(wrong(format!("is already a child of nodes[{slot}]")));
            }
            *slot = i as i32;
        }
    }
    Ok(parent)
}

/// Which nodes stand below `roots`, those included; ends on cycles too.
fn descendants(nodes: &[json::Node], roots: &[usize]) -> Vec<bool> {
    let mut reached = vec![false; nodes.len()];
    let mut open = roots.to_vec();
    while let Some(node) = open.pop() {
        if !std::mem::replace(&mut reached[node], true) {
            open.extend(children(&nodes[node]));
        }
    }
    reached
}

fn rest(node: &json::Node, place: &str, notes: &Notes) -> Result<Trs, Error> {
    let wrong = || Error::invalid(format!("{place} has a transform that is not finite"));
    if let Some(matrix) = &node.matrix {
        if !matrix.iter().all(|v| v.is_finite()) {
            return Err(wrong());
        }
        let (trs, exact) = transform::decompose(matrix);
        notes.add(
            "node matrices replaced by the nearest translation, rotation and scale",
            u64::from(!exact),
            place,
        );
        return if trs.scale.is_finite() { Ok(trs) } else { Err(wrong()) };
    }
    let translation = node.translation.map_or(Vec3::ZERO, Vec3::from);
    let scale = node.scale.map_or(Vec3::ONE, Vec3::from);
    let given = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |r| r.0);
    if !translation.is_finite() || !scale.is_finite() || !given.iter().all(|v| v.is_finite()) {
        return Err(wrong());
    }
    let (rotation, right) = unit_rotation(given);
    notes.add("node rotations normalised", u64::from(!right), place);
    Ok(Trs { translation, rotation, scale })
}

/// A unit quaternion along `q` (the identity for zero), and whether `q` was one but for rounding.
pub(super) fn unit_rotation(q: [f32; 4]) -> ([f32; 4], bool) {
    let wide = DQuat::from_array(q.map(f64::from));
    let length = wide.length();
    if length == 0.0 {
        return ([0.0, 0.0, 0.0, 1.0], false);
    }
    ((wide / length).as_quat().to_array(), (length - 1.0).abs() < 1e-3)
}
