//! The value of an animation channel between its keys, and the arc along which rotations go (glTF 2.0,
//! section 3.11, appendix C).

use super::rows;
use crate::data::{Channel, Scene, channel};
use crate::node::Error;

/// A channel with its keys.
pub(super) struct Track<'a> {
    pub(super) node: usize,
    pub(super) path: u32,
    interpolation: u32,
    /// Numbers in a value.
    width: usize,
    time: &'a [f32],
    value: &'a [f32],
}

impl<'a> Track<'a> {
    pub(super) fn new(scene: &'a Scene, number: usize) -> Result<Self, Error> {
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

    pub(super) fn at(&self, seconds: f64) -> Vec<f64> {
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
    pub(super) fn varies(&self) -> bool {
        let keys = self.time.len();
        let slope = |k| self.part(k, 0).chain(self.part(k, 2)).any(|m| m != 0.0);
        (1..keys).any(|k| !self.key(k).eq(self.key(0)))
            || (keys > 1 && self.interpolation == channel::CUBIC && (0..keys).any(slope))
    }
}

/// The unit quaternion along `q`; no rotation where that has no direction.
pub(super) fn quaternion(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { q.map(|x| x / length) } else { [0.0, 0.0, 0.0, 1.0] }
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

#[cfg(test)]
mod tests {
    use super::super::fixture::{animate, nodes, place};
    use super::super::{Pose, moving};
    use super::*;
    use glam::{DVec3, Vec3};

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

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
