//! Vectors side by side.

use super::{Lanes, Real, WIDTH};
use glam::Vec3;

/// One vector, or one a lane.
#[derive(Clone, Copy, Debug, Default)]
pub struct Triple<R> {
    /// First components.
    pub x: R,
    /// Second components.
    pub y: R,
    /// Third components.
    pub z: R,
}

impl<R: Real> Triple<R> {
    /// The same in every lane.
    #[inline(always)]
    pub fn splat(v: Vec3) -> Self {
        Triple { x: R::splat(v.x), y: R::splat(v.y), z: R::splat(v.z) }
    }

    /// Products by lane, summed as glam does.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Sums by lane.
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        Triple { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }

    /// Differences by lane.
    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        Triple { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    /// Products by component.
    #[inline(always)]
    pub fn by(self, other: Self) -> Self {
        Triple { x: self.x * other.x, y: self.y * other.y, z: self.z * other.z }
    }

    /// Products by lane.
    #[inline(always)]
    pub fn times(self, factor: R) -> Self {
        Triple { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }

    /// Quotients by lane.
    #[inline(always)]
    pub fn over(self, divisor: R) -> Self {
        Triple { x: self.x / divisor, y: self.y / divisor, z: self.z / divisor }
    }

    /// Each component, but at least `bound`.
    #[inline(always)]
    pub fn at_least(self, bound: R) -> Self {
        Triple { x: self.x.max(bound), y: self.y.max(bound), z: self.z.max(bound) }
    }

    /// Each component, but at most `bound`.
    #[inline(always)]
    pub fn at_most(self, bound: R) -> Self {
        Triple { x: self.x.min(bound), y: self.y.min(bound), z: self.z.min(bound) }
    }

    /// The opposite vectors.
    #[inline(always)]
    pub fn negated(self) -> Self {
        Triple { x: self.x.negated(), y: self.y.negated(), z: self.z.negated() }
    }

    /// The vectors of `self` where the mask is set, those of `other` elsewhere.
    #[inline(always)]
    pub fn or(self, mask: u32, other: Self) -> Self {
        Triple {
            x: self.x.or(mask, other.x),
            y: self.y.or(mask, other.y),
            z: self.z.or(mask, other.z),
        }
    }

    /// Vectors of length one, `other` where there is no direction; rounded as glam's `normalize_or`.
    #[inline(always)]
    pub fn normalized_or(self, other: Self) -> Self {
        let inverse = R::splat(1.0) / self.dot(self).sqrt();
        let sound = inverse.gt(R::splat(0.0)) & R::splat(f32::MAX).ge(inverse);
        self.times(inverse).or(sound, other)
    }
}

impl<L: Lanes> Triple<L> {
    /// One vector a lane from memory.
    #[inline(always)]
    pub fn load(vectors: &[Vec3; WIDTH]) -> Self {
        Triple::of(|lane| vectors[lane]).lanes()
    }

    /// One vector a lane to memory.
    #[inline(always)]
    pub fn store(self) -> [Vec3; WIDTH] {
        let (x, y, z) = (self.x.store(), self.y.store(), self.z.store());
        std::array::from_fn(|i| Vec3::new(x[i], y[i], z[i]))
    }
}

impl Triple<[f32; WIDTH]> {
    /// The vectors that `of` gives for the lanes, in memory.
    #[inline(always)]
    pub fn of(of: impl Fn(usize) -> Vec3) -> Self {
        Triple {
            x: std::array::from_fn(|lane| of(lane).x),
            y: std::array::from_fn(|lane| of(lane).y),
            z: std::array::from_fn(|lane| of(lane).z),
        }
    }

    /// The same in registers.
    #[inline(always)]
    pub fn lanes<L: Lanes>(&self) -> Triple<L> {
        Triple { x: L::load(&self.x), y: L::load(&self.y), z: L::load(&self.z) }
    }
}

impl From<Triple<f32>> for Vec3 {
    #[inline(always)]
    fn from(Triple { x, y, z }: Triple<f32>) -> Vec3 {
        Vec3::new(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_normalized_as_glam_does() {
        let other = Vec3::new(0.0, 0.6, 0.8);
        let kinds = [0.0, -3.0, 1e-30, 1e-22, 0.3, 7e18, 3e38, f32::INFINITY, f32::NAN];
        for v in kinds.iter().flat_map(|&x| kinds.map(|y| Vec3::new(x, y, 0.1 * x))) {
            let found = Vec3::from(Triple::<f32>::splat(v).normalized_or(Triple::splat(other)));
            assert_eq!(found, v.normalize_or(other), "{v}");
        }
    }
}
