//! The nodes of a scene at one time: animation channels, node hierarchy, morph weights (glTF 2.0,
//! sections 3.5 and 3.11, appendix C).
//!
//! In f64, with square roots as the only function that is not plain arithmetic: sines differ between
//! mathematical libraries, square roots do not.

use crate::data::{Channel, Scene, channel};
use crate::node::Error;
use glam::{DMat4, DQuat, DVec3};

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

/// The point at share `u`, 0 to 1, of the shorter arc from `a` to `b`, which are unit vectors and not
/// opposite. Bisects the arc until chord and arc agree to f64.
pub fn along_arc<const N: usize>(mut a: [f64; N], mut b: [f64; N], mut u: f64) -> [f64; N] {
    // A channel that rests must give the same bits at every time.
    if a == b {
        return a;
    }
    let between = |a: [f64; N], b: [f64; N], u: f64| {
        let point: [f64; N] = std::array::from_fn(|i| a[i] + u * (b[i] - a[i]));
        let length = point.iter().map(|x| x * x).sum::<f64>().sqrt();
        point.map(|x| x / length)
    };
    for _ in 0..16 {
        let middle = between(a, b, 0.5);
        u *= 2.0;
        if u < 1.0 {
            b = middle;
        } else {
            a = middle;
            u -= 1.0;
        }
    }
    between(a, b, u)
}

/// Cosine and sine of an angle in degrees, with the same bits on every machine.
pub fn cos_sin(degrees: f64) -> [f64; 2] {
    let quarters = degrees.rem_euclid(360.0) / 90.0;
    let [c, s] = along_arc([1.0, 0.0], [0.0, 1.0], quarters.fract());
    match quarters as u32 % 4 {
        0 => [c, s],
        1 => [-s, c],
        2 => [-c, -s],
        _ => [s, -c],
    }
}

/// The unit quaternion along `q`; no rotation where that has no direction.
fn quaternion(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { q.map(|x| x / length) } else { [0.0, 0.0, 0.0, 1.0] }
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

/// A channel with its keys.
struct Track<'a> {
    node: usize,
    path: u32,
    interpolation: u32,
    /// Numbers in a value.
    width: usize,
    time: &'a [f32],
    value: &'a [f32],
}

impl<'a> Track<'a> {
    fn new(scene: &'a Scene, number: usize) -> Result<Self, Error> {
        let Channel { node, path, interpolation, first_key, keys, first_value } =
            scene.channel[number].into();
        let wrong = |what: &str| Error::invalid(format!("animation channel {number} {what}"));
        let &[first_weight, weights] = scene
            .node_weight
            .get(node as usize)
            .ok_or_else(|| wrong("moves a node that does not exist"))?;
        let width = match path {
            channel::TRANSLATION | channel::SCALE => 3,
            channel::ROTATION => 4,
            channel::WEIGHTS => weights as usize,
            _ => return Err(wrong(&format!("moves property {path}, which no node has"))),
        };
        let parts = if interpolation == channel::CUBIC { 3 } else { 1 };
        let time = rows(&scene.key_time, first_key, keys as usize);
        let value = rows(&scene.key_value, first_value, keys as usize * parts * width);
        let weight = rows(&scene.rest_weight, first_weight, weights as usize);
        match (time, value, weight) {
            (Some([]), ..) => Err(wrong("has no keys")),
            (Some(time), Some(value), Some(_)) => {
                Ok(Track { node: node as usize, path, interpolation, width, time, value })
            }
            _ => Err(wrong("has keys, values or weights that do not exist")),
        }
    }

    /// One part of a key: 0 is its only one; of cubic ones 0 the in-tangent, 1 the value, 2 the out-tangent.
    fn part(&self, key: usize, part: usize) -> impl Iterator<Item = f64> + 'a {
        let parts = if self.interpolation == channel::CUBIC { 3 } else { 1 };
        let start = (key * parts + part) * self.width;
        self.value[start..start + self.width].iter().map(|&x| f64::from(x))
    }

    fn key(&self, key: usize) -> impl Iterator<Item = f64> + 'a {
        self.part(key, usize::from(self.interpolation == channel::CUBIC))
    }

    fn at(&self, seconds: f64) -> Vec<f64> {
        let after = self.time.partition_point(|&t| f64::from(t) <= seconds);
        if after == 0 || after == self.time.len() {
            return self.key(after.saturating_sub(1)).collect();
        }
        let before = after - 1;
        let (t0, t1) = (f64::from(self.time[before]), f64::from(self.time[after]));
        let (dt, u) = (t1 - t0, (seconds - t0) / (t1 - t0));
        let ends = self.key(before).zip(self.key(after));
        match (self.interpolation, self.path) {
            (channel::STEP, _) => self.key(before).collect(),
            (channel::CUBIC, _) => {
                let (u2, u3) = (u * u, u * u * u);
                let slopes = self.part(before, 2).zip(self.part(after, 0));
                ends.zip(slopes)
                    .map(|((p0, p1), (m0, m1))| {
                        (2.0 * u3 - 3.0 * u2 + 1.0) * p0
                            + (u3 - 2.0 * u2 + u) * dt * m0
                            + (3.0 * u2 - 2.0 * u3) * p1
                            + (u3 - u2) * dt * m1
                    })
                    .collect()
            }
            (_, channel::ROTATION) => {
                let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
                for (i, (from, to)) in ends.enumerate() {
                    (a[i], b[i]) = (from, to);
                }
                let (a, mut b) = (quaternion(a), quaternion(b));
                // A quaternion and its negative are one rotation; the nearer one is meant.
                if a.iter().zip(&b).map(|(x, y)| x * y).sum::<f64>() < 0.0 {
                    b = b.map(|x| -x);
                }
                along_arc(a, b, u).to_vec()
            }
            _ => ends.map(|(from, to)| from + u * (to - from)).collect(),
        }
    }

    /// Whether its value is not the same at all times; cubic keys with slopes count as changing.
    fn varies(&self) -> bool {
        let keys = self.time.len();
        let slope = |k| self.part(k, 0).chain(self.part(k, 2)).any(|m| m != 0.0);
        (1..keys).any(|k| !self.key(k).eq(self.key(0)))
            || (keys > 1 && self.interpolation == channel::CUBIC && (0..keys).any(slope))
    }
}

/// `count` elements from `first` on, if there are as many.
pub(crate) fn rows<T>(of: &[T], first: u32, count: usize) -> Option<&[T]> {
    of.get(first as usize..)?.get(..count)
}

#[cfg(test)]
pub(crate) mod fixture {
    //! Tiny scenes for tests.
    use super::*;
    use crate::data::Array;
    use glam::{Vec2, Vec3};

    /// Nothing.
    pub fn empty() -> Scene {
        Scene {
            position: Array::default(),
            normal: Array::default(),
            uv: Array::default(),
            colour: Array::default(),
            joint: Array::default(),
            weight: Array::default(),
            triangle: Array::default(),
            primitive: Array::default(),
            morph_target: Array::default(),
            morph_position: Array::default(),
            morph_normal: Array::default(),
            node_parent: Array::default(),
            node_translation: Array::default(),
            node_rotation: Array::default(),
            node_scale: Array::default(),
            node_weight: Array::default(),
            rest_weight: Array::default(),
            instance: Array::default(),
            instance_offset: Array::default(),
            skin: Array::default(),
            skin_joint: Array::default(),
            skin_inverse_bind: Array::default(),
            channel: Array::default(),
            key_time: Array::default(),
            key_value: Array::default(),
            base_colour: Array::default(),
            metallic_roughness: Array::default(),
            specular_factor: Array::default(),
            emissive: Array::default(),
            alpha_mode: Array::default(),
            double_sided: Array::default(),
            material_texture: Array::default(),
            texture_transform: Array::default(),
            texture: Array::default(),
            texel: Array::default(),
            camera: Array::default(),
            light: Array::default(),
        }
    }

    /// Nodes at the given places under the given parents, without rotation, scale or weights.
    pub fn nodes(of: &[(i32, Vec3)]) -> Scene {
        Scene {
            node_parent: of.iter().map(|n| n.0).collect(),
            node_translation: of.iter().map(|n| n.1).collect(),
            node_rotation: vec![[0.0, 0.0, 0.0, 1.0]; of.len()].into(),
            node_scale: vec![Vec3::ONE; of.len()].into(),
            node_weight: vec![[0, 0]; of.len()].into(),
            ..empty()
        }
    }

    /// `nodes`, with the triangle (0,0,0) (1,0,0) (0,1,0) facing +Z as mesh 0, used by the last node.
    pub fn triangle(of: &[(i32, Vec3)]) -> Scene {
        Scene {
            position: vec![Vec3::ZERO, Vec3::X, Vec3::Y].into(),
            normal: vec![Vec3::Z; 3].into(),
            uv: vec![Vec2::ZERO; 3].into(),
            triangle: vec![[0, 1, 2]].into(),
            primitive: vec![[0, 0, 0, 1, 0, 3]].into(),
            instance: vec![[of.len() as u32 - 1, 0, u32::MAX]].into(),
            instance_offset: vec![DMat4::IDENTITY.as_mat4().to_cols_array()].into(),
            base_colour: vec![[0.5, 0.5, 0.5, 1.0]].into(),
            metallic_roughness: vec![[0.0, 1.0]].into(),
            specular_factor: vec![0.0].into(),
            emissive: vec![Vec3::ZERO].into(),
            alpha_mode: vec![[0.0, 0.5]].into(),
            double_sided: vec![0].into(),
            material_texture: vec![[-1.0; 3]].into(),
            texture_transform: vec![[0.0; 18]].into(),
            ..nodes(of)
        }
    }

    /// Adds a channel.
    pub fn animate(scene: &mut Scene, node: u32, path: u32, how: u32, time: &[f32], value: &[f32]) {
        let row = [
            node,
            path,
            how,
            scene.key_time.len() as u32,
            time.len() as u32,
            scene.key_value.len() as u32,
        ];
        scene.channel = scene.channel.iter().copied().chain([row]).collect();
        scene.key_time = scene.key_time.iter().chain(time).copied().collect();
        scene.key_value = scene.key_value.iter().chain(value).copied().collect();
    }
}

#[cfg(test)]
mod tests {
    use super::fixture::{animate, nodes};
    use super::*;
    use glam::Vec3;

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

    fn place(scene: &Scene, seconds: f64, node: usize) -> DVec3 {
        Pose::at(scene, seconds).unwrap().position(node).unwrap()
    }

    fn near(a: DVec3, b: DVec3) -> bool {
        a.distance(b) < 1e-6
    }

    #[test]
    fn an_arc_is_walked_at_constant_speed() {
        for i in -800..800 {
            let degrees = f64::from(i) * 1.37;
            let [c, s] = cos_sin(degrees);
            let (sine, cosine) = degrees.to_radians().sin_cos();
            assert!((c - cosine).abs() < 4e-15 && (s - sine).abs() < 4e-15, "{degrees}");
        }
        assert_eq!(
            (cos_sin(90.0), cos_sin(-360.0), cos_sin(-1e-300)),
            ([-0.0, 1.0], [1.0, 0.0], [1.0, 0.0])
        );
    }

    #[test]
    fn rotations_are_on_the_great_arc_and_clamped() {
        // 0 to 180 degrees about Y, the second key given as its negative: 90 degrees at mid key.
        let mut scene = nodes(&[(-1, Vec3::ZERO), (0, Vec3::X)]);
        let keys = [0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0];
        animate(&mut scene, 0, channel::ROTATION, channel::LINEAR, &[1.0, 3.0], &keys);
        assert!(near(place(&scene, 2.0, 1).abs(), DVec3::Z));
        let keys = [0.0, 0.0, 0.0, 1.0, 0.0, -HALF, 0.0, -HALF];
        animate(&mut scene, 0, channel::ROTATION, channel::LINEAR, &[1.0, 4.0], &keys);
        let (sine, cosine) = 30_f64.to_radians().sin_cos();
        assert!(near(place(&scene, 2.0, 1), DVec3::new(cosine, 0.0, -sine)));
        assert!(near(place(&scene, 0.0, 1), DVec3::X));
        assert!(near(place(&scene, 9.0, 1), DVec3::NEG_Z));
    }

    #[test]
    fn steps_lines_and_cubics() {
        let mut scene = nodes(&[(-1, Vec3::ZERO); 3]);
        let line = [0.0, 0.0, 0.0, 4.0, 8.0, 0.0];
        animate(&mut scene, 0, channel::TRANSLATION, channel::STEP, &[0.0, 2.0], &line);
        animate(&mut scene, 1, channel::TRANSLATION, channel::LINEAR, &[0.0, 2.0], &line);
        // In-tangent, value, out-tangent of two keys; x has slopes only, y values only.
        #[rustfmt::skip]
        let cubic = [9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0,  -1.0, 0.0, 0.0, 0.0, 8.0, 0.0, 9.0, 9.0, 9.0];
        animate(&mut scene, 2, channel::TRANSLATION, channel::CUBIC, &[0.0, 2.0], &cubic);
        let at = |t, n| place(&scene, t, n);
        assert_eq!((at(1.999, 0), at(2.0, 0)), (DVec3::ZERO, DVec3::new(4.0, 8.0, 0.0)));
        assert_eq!(at(0.5, 1), DVec3::new(1.0, 2.0, 0.0));
        // Hermite at u = 1/4, dt = 2: h10 = 9/64, h11 = -3/64, h01 = 5/32.
        assert_eq!(at(0.5, 2), DVec3::new(2.0 * (3.0 * 9.0 + 3.0) / 64.0, 8.0 * 5.0 / 32.0, 0.0));
        assert_eq!((at(-1.0, 2), at(7.0, 2)), (DVec3::ZERO, DVec3::new(0.0, 8.0, 0.0)));
    }

    #[test]
    fn weights_are_interpolated_side_by_side() {
        let mut scene = nodes(&[(-1, Vec3::ZERO), (-1, Vec3::ZERO)]);
        scene.node_weight = vec![[0, 1], [1, 2]].into();
        scene.rest_weight = vec![0.25, 0.0, 0.0].into();
        animate(
            &mut scene,
            1,
            channel::WEIGHTS,
            channel::LINEAR,
            &[0.0, 1.0],
            &[0.0, 1.0, 1.0, 0.5],
        );
        assert_eq!(Pose::at(&scene, 0.5).unwrap().weight, [0.25, 0.5, 0.75]);
        assert_eq!(moving(&scene).unwrap(), [false, false]);
    }

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

    #[test]
    fn broken_channels_are_named() {
        let broken = |row: [u32; 6]| {
            let mut scene = nodes(&[(-1, Vec3::ZERO)]);
            animate(&mut scene, 0, channel::SCALE, channel::LINEAR, &[0.0], &[1.0; 3]);
            scene.channel = vec![row].into();
            Pose::at(&scene, 0.0).map(|_| ()).map_err(|e| e.to_string())
        };
        assert_eq!(broken([0, 2, 1, 0, 1, 0]), Ok(()));
        for row in [
            [1, 2, 1, 0, 1, 0],
            [0, 9, 1, 0, 1, 0],
            [0, 2, 2, 0, 1, 0],
            [0, 2, 1, 0, 0, 0],
            [0, 2, 1, 7, 1, 0],
        ] {
            assert!(broken(row).unwrap_err().contains("animation channel 0"), "{row:?}");
        }
    }
}
