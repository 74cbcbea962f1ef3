//! Eight `f32` at once: the children of a node, the triangles of a leaf, rays or receivers side by side. Every operation is the
//! same IEEE operation in each implementation and none is fused, so an answer has the same bits on every instruction set.

use std::ops::{Add, Div, Mul, Sub};

/// Numbers side by side.
pub const WIDTH: usize = 8;

/// One `f32` or several side by side: what is written for it holds for one sample as for eight, with the same bits. Masks have bit
/// i set where lane i is meant; one number is lane 0.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same in every lane.
    fn splat(value: f32) -> Self;
    /// Square root by lane.
    fn sqrt(self) -> Self;
    /// The larger by lane, that of `other` if one is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller by lane, that of `other` if one is not a number.
    fn min(self, other: Self) -> Self;
    /// The other sign by lane.
    fn negated(self) -> Self;
    /// Where `self` is greater than `other`.
    fn gt(self, other: Self) -> u32;
    /// Where `self` is greater than or equal to `other`.
    fn ge(self, other: Self) -> u32;
    /// The lanes of `self` where the mask is set, those of `other` elsewhere.
    fn or(self, mask: u32, other: Self) -> Self;
}

/// Eight `f32`.
pub trait Lanes: Real {
    /// Eight from memory.
    fn load(values: &[f32; WIDTH]) -> Self;
    /// Eight to memory.
    fn store(self) -> [f32; WIDTH];
    /// Magnitude by lane.
    fn abs(self) -> Self;
    /// The other sign in the lanes in which `sign` has its sign bit set.
    fn flip(self, sign: Self) -> Self;
    /// The least lane; anything if one is not a number.
    fn least(self) -> f32;
    /// The greatest lane; anything if one is not a number.
    fn greatest(self) -> f32;
    /// The lanes where the mask is set side by side, in their order, and then lane 0 again and again.
    fn press(self, mask: u32) -> Self;
    /// Writes lane i of row k to `columns[i][k]`.
    fn transpose(rows: [Self; WIDTH]) -> [[f32; WIDTH]; WIDTH];
}

/// The lanes where the mask is set, in their order, and then zeros.
#[inline(always)]
pub fn pressed(mask: u32) -> [u8; WIDTH] {
    static ALL: [[u8; WIDTH]; 1 << WIDTH] = {
        let mut all = [[0; WIDTH]; 1 << WIDTH];
        let mut mask = 0;
        while mask < all.len() {
            let (mut lane, mut count) = (0, 0);
            while lane < WIDTH {
                if mask >> lane & 1 == 1 {
                    all[mask][count] = lane as u8;
                    count += 1;
                }
                lane += 1;
            }
            mask += 1;
        }
        all
    };
    ALL[mask as usize % ALL.len()]
}

impl Real for f32 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn negated(self) -> Self {
        -self
    }
    #[inline(always)]
    fn gt(self, other: Self) -> u32 {
        u32::from(self > other)
    }
    #[inline(always)]
    fn ge(self, other: Self) -> u32 {
        u32::from(self >= other)
    }
    #[inline(always)]
    fn or(self, mask: u32, other: Self) -> Self {
        if mask & 1 == 1 { self } else { other }
    }
}

/// Plain arrays, for every instruction set.
#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mask(self, other: Self, f: impl Fn(f32, f32) -> bool) -> u32 {
        (0..WIDTH).fold(0, |mask, i| mask | (u32::from(f(self.0[i], other.0[i])) << i))
    }
}

/// The four operators of a type of lanes.
macro_rules! operators {
    ($type:ident($a:ident, $b:ident): $($trait:ident $name:ident $body:expr),*) => {
        $(impl $trait for $type {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let ($a, $b) = (self.0, other.0);
                Self($body)
            }
        })*
    };
}

operators! { Portable(a, b):
    Add add std::array::from_fn(|i| a[i] + b[i]),
    Sub sub std::array::from_fn(|i| a[i] - b[i]),
    Mul mul std::array::from_fn(|i| a[i] * b[i]),
    Div div std::array::from_fn(|i| a[i] / b[i])
}

impl Real for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.zip(self, |a, _| a.sqrt())
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn negated(self) -> Self {
        self.zip(self, |a, _| -a)
    }
    #[inline(always)]
    fn gt(self, other: Self) -> u32 {
        self.mask(other, |a, b| a > b)
    }
    #[inline(always)]
    fn ge(self, other: Self) -> u32 {
        self.mask(other, |a, b| a >= b)
    }
    #[inline(always)]
    fn or(self, mask: u32, other: Self) -> Self {
        Self(std::array::from_fn(|i| if mask >> i & 1 == 1 { self.0[i] } else { other.0[i] }))
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn load(values: &[f32; WIDTH]) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn store(self) -> [f32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.zip(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn flip(self, sign: Self) -> Self {
        self.zip(sign, |a, s| f32::from_bits(a.to_bits() ^ (s.to_bits() & 0x8000_0000)))
    }
    #[inline(always)]
    fn least(self) -> f32 {
        self.0.into_iter().fold(f32::INFINITY, f32::min)
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
    #[inline(always)]
    fn press(self, mask: u32) -> Self {
        Self(pressed(mask).map(|lane| self.0[lane as usize % WIDTH]))
    }
    #[inline(always)]
    fn transpose(rows: [Self; WIDTH]) -> [[f32; WIDTH]; WIDTH] {
        std::array::from_fn(|i| std::array::from_fn(|k| rows[k].0[i]))
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2;
mod triple;

pub use triple::Triple;

/// Hints that all of `value` will be read soon.
#[inline(always)]
pub fn prefetch<T: ?Sized>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let start = std::ptr::from_ref(value).cast::<i8>();
        let mut offset = 0;
        while offset < size_of_val(value) {
            // SAFETY: the address lies inside `value`; a prefetch reads nothing the program can see.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.add(offset)) };
            offset += 64;
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bits of all operations on numbers of every kind.
    #[inline(always)]
    fn all<L: Lanes>(a: &[f32; WIDTH], b: &[f32; WIDTH]) -> Vec<u32> {
        let (x, y) = (L::load(a), L::load(b));
        let numbers = [
            x + y,
            x - y,
            x * y,
            x / y,
            x.sqrt(),
            x.max(y),
            x.min(y),
            x.abs(),
            x.negated(),
            x.flip(y),
            x.or(0b1010_0110, y),
            x.press(0b1010_0110),
            L::splat(a[3]),
        ];
        let columns = L::transpose([x, y, x + y, x, y, x - y, y, x]);
        let stored = numbers.map(L::store);
        let stored = stored.iter().chain(&columns).flatten();
        // Which bits one gets for what is no number is left open.
        let bits = |n: &f32| if n.is_nan() { u32::MAX } else { n.to_bits() };
        // Lanes without those that are no number, of which there is no least.
        let whole = x.or(x.ge(x), L::splat(1.0));
        let ends = [whole.least(), whole.greatest()].map(f32::to_bits);
        stored.map(bits).chain([x.gt(y), x.ge(y)]).chain(ends).collect()
    }

    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let kinds = [0.0, -0.0, 1.0, -2.5, f32::NAN, f32::INFINITY, 1e-40, 3e38];
        for turn in 0..WIDTH {
            let b: [f32; WIDTH] = std::array::from_fn(|i| kinds[(i + turn) % WIDTH] * 0.7);
            let plain = all::<Portable>(&kinds, &b);
            assert!(b[2].is_nan() || plain[2 * WIDTH + 2] == b[2].to_bits(), "1 times a number");
            #[cfg(target_arch = "x86_64")]
            if std::is_x86_feature_detected!("avx2") {
                #[target_feature(enable = "avx2")]
                fn avx2(a: &[f32; WIDTH], b: &[f32; WIDTH]) -> Vec<u32> {
                    all::<Avx2>(a, b)
                }
                // SAFETY: the processor has AVX2.
                assert_eq!(unsafe { avx2(&kinds, &b) }, plain);
            }
        }
    }

    #[test]
    fn pressed_lanes_keep_their_order() {
        assert_eq!(pressed(0b1010_0110), [1, 2, 5, 7, 0, 0, 0, 0]);
        assert_eq!(pressed(0xff), [0, 1, 2, 3, 4, 5, 6, 7]);
        let x = Portable(std::array::from_fn(|i| (i as f32 - 2.0) * 1.5));
        assert_eq!(x.press(0b1000_0010).store()[..3], [-1.5, 7.5, -3.0]);
        assert_eq!([x.least(), x.greatest()], [-3.0, 7.5]);
    }

    #[test]
    fn columns_are_rows() {
        let rows: [[f32; WIDTH]; WIDTH] =
            std::array::from_fn(|k| std::array::from_fn(|i| (k * 10 + i) as f32));
        let columns = Portable::transpose(rows.map(Portable));
        assert_eq!((columns[3][5], columns[0][7], columns[7][0]), (53.0, 70.0, 7.0));
    }
}
