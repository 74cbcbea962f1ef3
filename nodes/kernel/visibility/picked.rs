//! The rays of a packet before it is one: picked from 64, side by side.

use super::triangle::{Three, load};
use crate::kernel::lanes::{Lanes, WIDTH, pressed};

/// Rays in a packet.
pub(super) const RAYS: usize = 64;
pub(super) const GROUPS: usize = RAYS / WIDTH;

/// One number per ray, in groups of eight.
pub(super) type PerRay = [[f32; WIDTH]; GROUPS];

/// Where rays are picked from. A trait and not a closure, because its method must be inlined.
pub(super) trait Source {
    /// The vectors of rays 8 `group` to 8 `group` + 7. Must be inlined.
    fn vectors<L: Lanes>(&self, group: usize) -> Three<L>;
}

/// Rays picked from 64, side by side.
pub(super) struct Picked {
    /// Empty lanes of a group with rays repeat one of them, so that they widen nothing.
    pub(super) vector: [PerRay; 3],
    /// Where each ray comes from, and where all do, a bit each.
    place: [u8; RAYS],
    places: u64,
}

impl Picked {
    /// No rays yet.
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { vector: [[[0.0; WIDTH]; GROUPS]; 3], place: [0; RAYS], places: 0 }
    }

    /// Picks those of the source's rays whose bits are set; for one that has no rays yet.
    #[inline(always)]
    pub(super) fn pick<L: Lanes>(&mut self, rays: u64, source: &impl Source) {
        self.places = rays;
        let mut count = 0;
        let mut left = groups(rays);
        while left != 0 {
            let group = left.trailing_zeros() as usize;
            left &= left - 1;
            let mask = (rays >> (group * WIDTH)) as u32 & 0xff;
            for (axis, v) in self.vector.iter_mut().zip(source.vectors::<L>(group)) {
                write(axis.as_flattened_mut(), count, v.press(mask).store());
            }
            // In each byte a lane's number; added to all of them, what comes before the group.
            let lanes = u64::from_le_bytes(pressed(mask)) + 0x0808_0808_0808_0808 * group as u64;
            write(&mut self.place, count, lanes.to_le_bytes());
            count += mask.count_ones() as usize;
        }
        for axis in &mut self.vector {
            let first = axis[0][0];
            write(axis.as_flattened_mut(), count, [first; WIDTH]);
        }
    }

    /// How many they are.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.places.count_ones() as usize
    }

    /// Where each ray was picked.
    #[inline(always)]
    pub(super) fn places(&self) -> impl Iterator<Item = usize> {
        self.place.iter().take(self.count()).map(|place| usize::from(*place) % RAYS)
    }

    /// The bits of some of the rays where they were picked.
    #[inline(always)]
    pub(super) fn back(&self, mut rays: u64) -> u64 {
        if rays == low_bits(self.count()) {
            return self.places;
        }
        let mut places = 0;
        while rays != 0 {
            places |= 1 << self.place[rays.trailing_zeros() as usize];
            rays &= rays - 1;
        }
        places
    }
}

impl Source for Picked {
    #[inline(always)]
    fn vectors<L: Lanes>(&self, group: usize) -> Three<L> {
        let [x, y, z] = &self.vector;
        let group = group % GROUPS;
        load([&x[group], &y[group], &z[group]])
    }
}

/// Writes what of `eight` has room from `at` on.
#[inline(always)]
fn write<T: Copy>(all: &mut [T], at: usize, eight: [T; WIDTH]) {
    let room = &mut all[at..];
    if let Some(room) = room.first_chunk_mut() {
        *room = eight;
    } else {
        room.copy_from_slice(&eight[..room.len()]);
    }
}

/// The lowest `count` bits, all 64 if there are that many.
pub(super) fn low_bits(count: usize) -> u64 {
    if count >= RAYS { u64::MAX } else { (1 << count) - 1 }
}

/// Bit g is set where any of rays 8g to 8g + 7 is.
#[inline(always)]
pub(super) fn groups(rays: u64) -> u32 {
    // Gathers each byte's bits in its lowest, then those in the highest byte.
    let mut any = rays | rays >> 4;
    any |= any >> 2;
    any |= any >> 1;
    ((any & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::lanes::Portable;

    /// Each ray's place, and twice and three times that.
    struct Places;

    impl Source for Places {
        fn vectors<L: Lanes>(&self, group: usize) -> Three<L> {
            let place: [f32; WIDTH] = std::array::from_fn(|i| (group * WIDTH + i) as f32);
            let place = L::load(&place);
            [place, place + place, place + place + place]
        }
    }

    #[test]
    fn rays_stand_side_by_side_and_return_to_where_they_were() {
        for rays in [0, 1, u64::MAX, u64::MAX - 1, u64::MAX >> 7, 0x8040_2000_0011_8008, 0xff00] {
            let mut picked = Picked::none();
            picked.pick::<Portable>(rays, &Places);
            let places: Vec<usize> = (0..RAYS).filter(|i| rays >> i & 1 == 1).collect();
            assert_eq!(picked.places().collect::<Vec<_>>(), places);
            for (k, axis) in picked.vector.iter().enumerate() {
                for (number, place) in axis.as_flattened().iter().zip(&places) {
                    assert_eq!(*number, ((k + 1) * place) as f32);
                }
                let filled = places.len().next_multiple_of(WIDTH);
                for number in &axis.as_flattened()[places.len()..filled] {
                    assert_eq!(*number, ((k + 1) * places[0]) as f32);
                }
            }
            let odd = picked.back(0xaaaa_aaaa_aaaa_aaaa & low_bits(places.len()));
            let expected = places.iter().skip(1).step_by(2).fold(0, |all, place| all | 1 << place);
            assert_eq!(odd, expected);
            assert_eq!(picked.back(low_bits(places.len())), rays);
        }
    }

    #[test]
    fn all_bits_are_low() {
        assert_eq!([low_bits(0), low_bits(4), low_bits(64)], [0, 15, u64::MAX]);
    }

    #[test]
    fn groups_are_the_bytes_with_any_bit() {
        for rays in [0, 1, u64::MAX, 0x8000_0000_0000_0000, 0x0040_0000_0200_8000, 1 << 17] {
            let expected =
                (0..GROUPS).filter(|g| rays >> (8 * g) & 0xff != 0).fold(0, |m, g| m | 1 << g);
            assert_eq!(groups(rays), expected, "{rays:x}");
        }
    }
}
