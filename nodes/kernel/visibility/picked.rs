//! The rays of a packet before it is one: picked from a query's 64, side by side.

use crate::kernel::lanes::WIDTH;

/// Rays in a packet.
pub(super) const RAYS: usize = 64;
pub(super) const GROUPS: usize = RAYS / WIDTH;

/// One number per ray, in groups of eight.
pub(super) type PerRay = [[f32; WIDTH]; GROUPS];

/// Rays picked from 64, side by side.
pub(super) struct Picked {
    pub(super) vector: [PerRay; 3],
    pub(super) place: [u8; RAYS],
    pub(super) count: usize,
}

impl Picked {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { vector: [[[0.0; WIDTH]; GROUPS]; 3], place: [0; RAYS], count: 0 }
    }

    /// Adds a ray that comes from place `place`; at most 64.
    #[inline(always)]
    pub(super) fn push(&mut self, vector: [f32; 3], place: usize) {
        let (group, lane) = (self.count / WIDTH % GROUPS, self.count % WIDTH);
        self.vector[0][group][lane] = vector[0];
        self.vector[1][group][lane] = vector[1];
        self.vector[2][group][lane] = vector[2];
        self.place[self.count % RAYS] = place as u8;
        self.count += 1;
    }

    /// The rays' bits back where they came from.
    #[inline(always)]
    pub(super) fn places(&self, mut rays: u64) -> u64 {
        let mut places = 0;
        while rays != 0 {
            places |= 1 << self.place[rays.trailing_zeros() as usize];
            rays &= rays - 1;
        }
        places
    }
}

/// The lowest `count` bits, all 64 if there are that many.
pub(super) fn low_bits(count: usize) -> u64 {
    if count >= RAYS { u64::MAX } else { (1 << count) - 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_return_to_where_rays_were_picked() {
        let mut picked = Picked::new();
        for place in [3, 17, 40, 63] {
            picked.push([place as f32; 3], place);
        }
        assert_eq!(picked.places(0b1010), 1 << 17 | 1 << 63);
        assert_eq!(picked.vector[1][0][2], 40.0);
        assert_eq!([low_bits(0), low_bits(4), low_bits(64)], [0, 15, u64::MAX]);
    }
}
