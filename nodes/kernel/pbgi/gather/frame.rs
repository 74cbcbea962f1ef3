//! The frame in which a receiver's micro-buffer stands: its third axis is the shading normal.

use glam::Vec3;

/// An orthonormal right-handed frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) x: Vec3,
    pub(super) y: Vec3,
    pub(super) z: Vec3,
}

/// The normal whose frame is [`TANGENT`] and [`BITANGENT`]. Its opposite is the one normal around which frames turn, so
/// it lies off the directions in which walls, floors and ceilings look.
const POLE: Vec3 = Vec3::new(0.48, 0.6, 0.64);
const TANGENT: Vec3 = Vec3::new(0.8, 0.0, -0.6);

impl Frame {
    /// The frame of a unit normal: [`POLE`]'s frame turned along the shortest way. Continuous in the normal except
    /// opposite of the pole, so that neighbouring receivers of a curved surface see through alike cells.
    pub(super) fn of(normal: Vec3) -> Self {
        let away = 1.0 + POLE.dot(normal);
        let turned = match away > 1e-5 {
            true => TANGENT - (POLE + normal) * (TANGENT.dot(normal) / away),
            false => TANGENT,
        };
        let x = (turned - normal * normal.dot(turned)).normalize_or(TANGENT);
        Frame { x, y: normal.cross(x), z: normal }
    }

    /// A world vector in this frame.
    #[inline]
    pub(super) fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// A vector of this frame in the world.
    #[inline]
    pub(super) fn world(&self, v: Vec3) -> Vec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_everywhere() {
        let spread = (0..500).map(|i| {
            let (z, turn) = (1.0 - (i as f32 + 0.5) / 250.0, i as f32 * 2.399_963);
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * turn.cos(), r * turn.sin(), z)
        });
        let near_the_pole = [1e-2_f32, 1e-3, 1e-4, 1e-6, 0.0]
            .map(|e| (-POLE + Vec3::new(e, -e, e / 3.0)).normalize());
        for normal in spread.chain(Vec3::AXES).chain(Vec3::AXES.map(|a| -a)).chain(near_the_pole) {
            let f = Frame::of(normal);
            for (a, b, dot) in [
                (f.x, f.x, 1.0),
                (f.y, f.y, 1.0),
                (f.x, f.y, 0.0),
                (f.x, f.z, 0.0),
                (f.y, f.z, 0.0),
            ] {
                assert!((a.dot(b) - dot).abs() < 1e-5, "{normal}: {f:?}");
            }
            assert!(f.x.cross(f.y).dot(f.z) > 0.0);
            let v = Vec3::new(0.3, -2.0, 0.7);
            assert!(f.world(f.local(v)).abs_diff_eq(v, 1e-5));
        }
    }

    #[test]
    fn near_normals_have_near_frames() {
        let (a, b) = (Frame::of(Vec3::Y), Frame::of(Vec3::new(1e-3, 1.0, -1e-3).normalize()));
        assert!(a.x.abs_diff_eq(b.x, 3e-3) && a.y.abs_diff_eq(b.y, 3e-3));
    }
}
