//! Up to 64 receivers side by side: a tile of a picture, as columns of the lighting tensor are asked for.

use super::element::{Light, LightLanes, Receiver, ReceiverLanes};
use super::lanes::{Lanes, Portable, Triple, WIDTH};
use super::visibility::Ends;
use glam::Vec3;

/// Receivers that are lit together.
pub struct Tile {
    /// Where their shadow rays start, world space, metres.
    pub lifted: Ends,
    groups: Vec<ReceiverLanes<[f32; WIDTH]>>,
}

impl Tile {
    /// The first 64 of `receivers`, whose shadow rays start `bias` metres off their surface.
    pub fn new(receivers: &[Receiver], bias: f32) -> Self {
        let receivers = &receivers[..receivers.len().min(Ends::CAPACITY)];
        let mut lifted = Ends::new();
        receivers.iter().enumerate().for_each(|(i, receiver)| lifted.set(i, receiver.lifted(bias)));
        Tile { lifted, groups: receivers.chunks(WIDTH).map(ReceiverLanes::of).collect() }
    }

    /// Which receivers `light` can add anything to before visibility is asked: bit i is what [`faces`] says of
    /// receiver i.
    ///
    /// [`faces`]: super::element::faces
    pub fn facing(&self, light: &Light) -> u64 {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.facing_with_avx2(light) };
        }
        self.facing_lanes::<Portable>(light)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn facing_with_avx2(&self, light: &Light) -> u64 {
        self.facing_lanes::<super::lanes::Avx2>(light)
    }

    #[inline(always)]
    fn facing_lanes<L: Lanes>(&self, light: &Light) -> u64 {
        let light = LightLanes::<L>::splat(light);
        let mut facing = 0;
        for (group, receivers) in self.groups.iter().enumerate() {
            facing |= u64::from(receivers.lanes::<L>().faces(&light)) << (group * WIDTH);
        }
        facing
    }

    /// Writes to `column` what `light` adds to each receiver of the mask `lit` and zero for every other: what
    /// [`element`] says of them. At most as many as there is room for.
    ///
    /// [`element`]: super::element::element
    pub fn shade(&self, light: &Light, lit: u64, column: &mut [Vec3]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.shade_with_avx2(light, lit, column) };
        }
        self.shade_lanes::<Portable>(light, lit, column);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn shade_with_avx2(&self, light: &Light, lit: u64, column: &mut [Vec3]) {
        self.shade_lanes::<super::lanes::Avx2>(light, lit, column);
    }

    #[inline(always)]
    fn shade_lanes<L: Lanes>(&self, light: &Light, lit: u64, column: &mut [Vec3]) {
        let light = LightLanes::<L>::splat(light);
        let (whole, rest) = column.as_chunks_mut::<WIDTH>();
        let mut last = [Vec3::ZERO; WIDTH];
        let columns = whole.iter_mut().chain(std::iter::once(&mut last));
        for (group, (column, receivers)) in columns.zip(&self.groups).enumerate() {
            let lit = (lit >> (group * WIDTH)) as u32 & 0xff;
            *column = match lit {
                0 => [Vec3::ZERO; WIDTH],
                lit => {
                    let elements = receivers.lanes::<L>().elements(&light);
                    elements.or(lit, Triple::splat(Vec3::ZERO)).store()
                }
            };
        }
        rest.copy_from_slice(&last[..rest.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::LightKind;
    use crate::kernel::element::{element, faces};
    use crate::kernel::fixtures::{cosine_lights, room_receivers, room_stage};

    #[test]
    fn a_tile_judges_as_each_receiver_does() {
        let stage = room_stage();
        let list = cosine_lights(200, 3);
        let receivers = room_receivers(&stage, 61, 4);
        let tile = Tile::new(&receivers, stage.bias());
        let (mut facing, mut averted) = (0, 0);
        let mut column = [Vec3::NAN; 61];
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
                assert_eq!(tile.facing_lanes::<Portable>(&light), expected, "{light:?}");
                let lit = expected & 0x1fff_ff00_f0f0_3311;
                let elements: [Vec3; 61] = std::array::from_fn(|i| match lit >> i & 1 {
                    1 => element(&receivers[i], &light),
                    _ => Vec3::ZERO,
                });
                tile.shade(&light, lit, &mut column);
                assert_eq!(column, elements, "{light:?}");
                tile.shade_lanes::<Portable>(&light, lit, &mut column);
                assert_eq!(column, elements, "{light:?}");
                facing += expected.count_ones();
                averted += 61 - expected.count_ones();
            }
        }
        assert!(facing > 1000 && averted > 1000, "{facing} {averted}");
    }
}
