//! The nodes of a scene at one time: node hierarchy and morph weights (glTF 2.0, section 3.5), moved
//! by the channels of an animation.
//!
//! In f64, with square roots as the only function that is not plain arithmetic: sines differ between
//! mathematical libraries, square roots do not.

#[cfg(test)]
pub(crate) mod fixture;
mod track;

pub use track::{along_arc, cos_sin};

use crate::data::{Scene, channel};
use crate::node::Error;
use glam::{DMat4, DQuat, DVec3};
use track::{Track, quaternion};

/// A scene's nodes at one time.
#[derive(Clone, Debug)]
pub struct Pose {
    /// `[node]` from the node's space to the world's.
    pub world: Vec<DMat4>,
    /// Morph weights of all nodes, addressed like [`Scene::rest_weight`].
    pub weight: Vec<f32>,
}

impl Pose {
    /// The pose `seconds` after the start of the animation: before a channel's first key its first
    /// value, after its last key its last; what has no channel is at rest. Where two channels move
    /// the same thing, the later one counts.
    ///
    /// # Errors
    /// When a node is its own ancestor, or a number names a row that does not exist.
    pub fn at(scene: &Scene, seconds: f64) -> Result<Self, Error> {
        let order = parents_first(scene)?;
        let mut translation: Vec<_> = scene.node_translation.iter().map(|t| t.as_dvec3()).collect();
        let mut rotation: Vec<_> = scene.node_rotation.iter().map(|r| r.map(f64::from)).collect();
        let mut scale: Vec<_> = scene.node_scale.iter().map(|s| s.as_dvec3()).collect();
        let mut weight = scene.rest_weight.to_vec();
        for number in 0..scene.channel.len() {
            let track = Track::new(scene, number)?;
            let value = track.at(seconds);
            match (track.path, value.as_slice()) {
                (channel::TRANSLATION, &[x, y, z]) => translation[track.node] = DVec3::new(x, y, z),
                (channel::ROTATION, &[x, y, z, w]) => rotation[track.node] = [x, y, z, w],
                (channel::SCALE, &[x, y, z]) => scale[track.node] = DVec3::new(x, y, z),
                _ => {
                    let first = scene.node_weight[track.node][0] as usize;
                    for (to, from) in weight[first..].iter_mut().zip(value) {
                        *to = from as f32;
                    }
                }
            }
        }
        let mut world = vec![DMat4::IDENTITY; order.len()];
        for node in order {
            let turn = DQuat::from_array(quaternion(rotation[node]));
            let local =
                DMat4::from_scale_rotation_translation(scale[node], turn, translation[node]);
            world[node] = parent(scene, node)?.map_or(local, |above| world[above] * local);
        }
        Ok(Pose { world, weight })
    }

    /// Where a node is, world space; none when it is not finite.
    pub fn position(&self, node: usize) -> Option<DVec3> {
        self.world
            .get(node)
            .map(|world| world.w_axis.truncate())
            .filter(|p| p.as_vec3().is_finite())
    }

    /// The unit vector along which a node's camera looks or its light shines, its -Z axis, whatever
    /// the scale; none when a scale of zero leaves no direction.
    pub fn forward(&self, node: usize) -> Option<DVec3> {
        self.world.get(node).and_then(|world| (-world.z_axis.truncate()).try_normalize())
    }

    /// Unit vectors to the right, up and forward of a node's camera: orthogonal and right-handed also
    /// under scaled and mirrored parents; none when a scale of zero leaves no such frame.
    pub fn frame(&self, node: usize) -> Option<[DVec3; 3]> {
        let forward = self.forward(node)?;
        let up = self.world[node].y_axis.truncate().try_normalize()?;
        let right = forward.cross(up).try_normalize()?;
        Some([right, right.cross(forward), forward])
    }
}

/// `[node]` whether its world matrix changes over time: a channel whose keys differ moves it or an ancestor.
///
/// # Errors
/// As [`Pose::at`].
pub fn moving(scene: &Scene) -> Result<Vec<bool>, Error> {
    let mut moving = vec![false; scene.node_parent.len()];
    let order = parents_first(scene)?;
    for number in 0..scene.channel.len() {
        let track = Track::new(scene, number)?;
        moving[track.node] |= track.path != channel::WEIGHTS && track.varies();
    }
    for node in order {
        moving[node] |= parent(scene, node)?.is_some_and(|above| moving[above]);
    }
    Ok(moving)
}

fn parent(scene: &Scene, node: usize) -> Result<Option<usize>, Error> {
    let nodes = scene.node_parent.len();
    match usize::try_from(scene.node_parent[node]) {
        Err(_) => Ok(None),
        Ok(above) if above < nodes => Ok(Some(above)),
        Ok(above) => Err(Error::invalid(format!(
            "node {node} has parent {above}, but there are {nodes} nodes"
        ))),
    }
}

/// All nodes, each after its parent.
fn parents_first(scene: &Scene) -> Result<Vec<usize>, Error> {
    let nodes = scene.node_parent.len();
    let columns = [scene.node_translation.len(), scene.node_rotation.len(), scene.node_scale.len()];
    if columns != [nodes; 3] || scene.node_weight.len() != nodes {
        return Err(Error::invalid("the arrays of the scene's nodes differ in length"));
    }
    let mut placed = vec![false; nodes];
    let mut order = Vec::with_capacity(nodes);
    let mut chain = Vec::new();
    for start in 0..nodes {
        let mut at = Some(start);
        while let Some(node) = at.filter(|&node| !placed[node]) {
            if chain.len() == nodes {
                return Err(Error::invalid(format!("node {node} is its own ancestor")));
            }
            chain.push(node);
            at = parent(scene, node)?;
        }
        while let Some(node) = chain.pop() {
            placed[node] = true;
            order.push(node);
        }
    }
    Ok(order)
}

/// `count` elements from `first` on, if there are as many.
pub(crate) fn rows<T>(of: &[T], first: u32, count: usize) -> Option<&[T]> {
    of.get(first as usize..)?.get(..count)
}

#[cfg(test)]
mod tests {
    use super::fixture::{animate, nodes, place};
    use super::*;
    use glam::Vec3;

    #[test]
    fn parents_may_stand_after_children_but_not_in_a_cycle() {
        let mut scene = nodes(&[(2, Vec3::X), (-1, Vec3::Y), (1, Vec3::Z)]);
        scene.node_scale = vec![Vec3::ONE, Vec3::new(-2.0, 2.0, 2.0), Vec3::ONE].into();
        assert_eq!(place(&scene, 0.0, 0), DVec3::new(-2.0, 1.0, 2.0));
        animate(
            &mut scene,
            2,
            channel::SCALE,
            channel::STEP,
            &[0.0, 1.0],
            &[1.0, 1.0, 1.0, 1.0, 1.0, 2.0],
        );
        animate(&mut scene, 1, channel::SCALE, channel::LINEAR, &[0.0, 1.0], &[2.0; 6]);
        assert_eq!(moving(&scene).unwrap(), [true, false, true]);
        scene.node_parent = vec![2, 0, 1].into();
        assert!(Pose::at(&scene, 0.0).unwrap_err().to_string().contains("its own ancestor"));
        scene.node_parent = vec![2, 9, 1].into();
        assert!(moving(&scene).unwrap_err().to_string().contains("parent 9"));
    }
}
