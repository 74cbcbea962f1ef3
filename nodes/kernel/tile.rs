//! Up to 64 receivers side by side: a tile of a picture, as columns of the lighting tensor are asked for.

use super::element::{Light, Receiver};
use super::visibility::Ends;
use crate::data::LightKind;
use glam::Vec3;

/// Receivers that are lit together.
pub struct Tile<'a> {
    /// The receivers themselves; at most 64.
    pub receivers: &'a [Receiver],
    /// Where their shadow rays start, world space, metres.
    pub lifted: Ends,
    position: Ends,
    normal: Ends,
    facet: Ends,
}

impl<'a> Tile<'a> {
    /// The first 64 of `receivers`, whose shadow rays start `bias` metres off their surface.
    pub fn new(receivers: &'a [Receiver], bias: f32) -> Self {
        let receivers = &receivers[..receivers.len().min(Ends::CAPACITY)];
        // The points beyond the last receiver have no normal and so face nothing.
        let each = |of: &dyn Fn(&Receiver) -> Vec3| {
            let mut ends = Ends::new();
            receivers.iter().enumerate().for_each(|(i, receiver)| ends.set(i, of(receiver)));
            ends
        };
        Tile {
            receivers,
            lifted: each(&|receiver| receiver.lifted(bias)),
            position: each(&|receiver| receiver.position),
            normal: each(&|receiver| receiver.normal),
            facet: each(&|receiver| receiver.facet),
        }
    }

    /// Which receivers `light` can add anything to before visibility is asked: bit i is what [`faces`] says of
    /// receiver i.
    ///
    /// [`faces`]: super::element::faces
    pub fn facing(&self, light: &Light) -> u64 {
        if light.emission == Vec3::ZERO {
            return 0;
        }
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.facing_with_avx2(light) };
        }
        self.facing_lanes(light)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn facing_with_avx2(&self, light: &Light) -> u64 {
        self.facing_lanes(light)
    }

    /// The sums and quotients of [`arrive`](super::element) in their order, so that no receiver is judged otherwise.
    #[inline(always)]
    fn facing_lanes(&self, light: &Light) -> u64 {
        let (p, n, f) = (&self.position, &self.normal, &self.facet);
        let mut facing = [false; Ends::CAPACITY];
        if light.kind == LightKind::Directional {
            let [x, y, z] = (-light.direction).to_array();
            for (i, facing) in facing.iter_mut().enumerate() {
                let normal = n.xs[i] * x + n.ys[i] * y + n.zs[i] * z;
                let facet = f.xs[i] * x + f.ys[i] * y + f.zs[i] * z;
                *facing = (normal > 0.0) & (facet > 0.0);
            }
            return mask(&facing);
        }
        let all_round = light.kind == LightKind::Omni;
        let least = if light.kind == LightKind::Spot { light.cone.y } else { 0.0 };
        let (from, d) = (light.position, light.direction);
        for (i, facing) in facing.iter_mut().enumerate() {
            let (x, y, z) = (from.x - p.xs[i], from.y - p.ys[i], from.z - p.zs[i]);
            let squared = x * x + y * y + z * z;
            let length = squared.sqrt();
            let (x, y, z) = (x / length, y / length, z / length);
            let cosine = -(d.x * x + d.y * y + d.z * z);
            let normal = n.xs[i] * x + n.ys[i] * y + n.zs[i] * z;
            let facet = f.xs[i] * x + f.ys[i] * y + f.zs[i] * z;
            *facing = (squared >= f32::MIN_POSITIVE)
                & ((cosine > least) | all_round)
                & (normal > 0.0)
                & (facet > 0.0);
        }
        mask(&facing)
    }
}

/// Bit i is set where `bits[i]` is.
#[inline(always)]
fn mask(bits: &[bool; Ends::CAPACITY]) -> u64 {
    let mut mask = 0;
    for (byte, bits) in bits.as_chunks::<8>().0.iter().enumerate() {
        // Gathers the lowest bits of eight bytes in the highest byte.
        let bytes = u64::from_le_bytes(bits.map(u8::from));
        mask |= (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * byte);
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::element::faces;
    use crate::kernel::fixtures::{cosine_lights, room_receivers, room_stage};

    #[test]
    fn a_tile_judges_as_each_receiver_does() {
        let stage = room_stage();
        let list = cosine_lights(200, 3);
        let receivers = room_receivers(&stage, 61, 4);
        let tile = Tile::new(&receivers, stage.bias());
        let (mut facing, mut averted) = (0, 0);
        for j in 0..200 {
            let cosine = Light::at(&list, j);
            let omni = Light { kind: LightKind::Omni, ..cosine };
            let directional = Light { kind: LightKind::Directional, ..cosine };
            let spot = Light { kind: LightKind::Spot, cone: glam::Vec2::new(0.9, 0.4), ..cosine };
            let upon = Light { position: receivers[j % 61].position, ..cosine };
            let lost = Light { position: Vec3::NAN, ..omni };
            let dark = Light { emission: Vec3::ZERO, ..cosine };
            for light in [cosine, omni, directional, spot, upon, lost, dark] {
                let expected: u64 =
                    (0..61).map(|i| u64::from(faces(&receivers[i], &light)) << i).sum();
                assert_eq!(tile.facing(&light), expected, "{light:?}");
                facing += expected.count_ones();
                averted += 61 - expected.count_ones();
            }
        }
        assert!(facing > 1000 && averted > 1000, "{facing} {averted}");
    }

    #[test]
    fn masks_have_the_bits_of_their_flags() {
        for bits in [0_u64, 1, u64::MAX, 0x8000_0000_0000_0001, 0x0123_4567_89ab_cdef] {
            assert_eq!(mask(&std::array::from_fn(|i| bits >> i & 1 == 1)), bits);
        }
    }
}
