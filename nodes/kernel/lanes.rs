//! Eight `f32` at once: the children of a node, the triangles of a leaf, rays or receivers side by side. Every operation is the
//! same IEEE operation in each implementation and none is fused, so an answer has the same bits on every instruction set.

use glam::Vec3;
use std::ops::{Add, Div, Mul, Sub};

/// Numbers side by side.
pub const WIDTH: usize = 8;

/// Eight `f32`. Masks have bit i set where lane i is meant.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Eight times the same.
    fn splat(value: f32) -> Self;
    /// Eight from memory.
    fn load(values: &[f32; WIDTH]) -> Self;
    /// Eight to memory.
    fn store(self) -> [f32; WIDTH];
    /// Square root by lane.
    fn sqrt(self) -> Self;
    /// The larger by lane, that of `other` if one is not a number.
    fn max(self, other: Self) -> Self;
    /// The smaller by lane, that of `other` if one is not a number.
    fn min(self, other: Self) -> Self;
    /// Magnitude by lane.
    fn abs(self) -> Self;
    /// The other sign by lane.
    fn negated(self) -> Self;
    /// The other sign in the lanes in which `sign` has its sign bit set.
    fn flip(self, sign: Self) -> Self;
    /// Where `self` is greater than `other`.
    fn gt(self, other: Self) -> u32;
    /// Where `self` is greater than or equal to `other`.
    fn ge(self, other: Self) -> u32;
    /// The lanes of `self` where the mask is set, those of `other` elsewhere.
    fn or(self, mask: u32, other: Self) -> Self;
    /// Writes lane i of row k to `columns[i][k]`.
    fn transpose(rows: [Self; WIDTH]) -> [[f32; WIDTH]; WIDTH];
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

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn load(values: &[f32; WIDTH]) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn store(self) -> [f32; WIDTH] {
        self.0
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
    fn abs(self) -> Self {
        self.zip(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn negated(self) -> Self {
        self.zip(self, |a, _| -a)
    }
    #[inline(always)]
    fn flip(self, sign: Self) -> Self {
        self.zip(sign, |a, s| f32::from_bits(a.to_bits() ^ (s.to_bits() & 0x8000_0000)))
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
    #[inline(always)]
    fn transpose(rows: [Self; WIDTH]) -> [[f32; WIDTH]; WIDTH] {
        std::array::from_fn(|i| std::array::from_fn(|k| rows[k].0[i]))
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Add, Div, Lanes, Mul, Sub, WIDTH};
    use std::arch::x86_64::*;

    /// One 256-bit register. Values are made only inside functions compiled for AVX2, which are entered only after
    /// the processor was asked for it: this is what every `SAFETY` note below relies on.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256);

    // SAFETY, of all four: the processor has AVX2, see the type.
    operators! { Avx2(a, b):
        // SAFETY: the processor has AVX2, see the type.
        Add add unsafe { _mm256_add_ps(a, b) },
        // SAFETY: the same.
        Sub sub unsafe { _mm256_sub_ps(a, b) },
        // SAFETY: the same.
        Mul mul unsafe { _mm256_mul_ps(a, b) },
        // SAFETY: the same.
        Div div unsafe { _mm256_div_ps(a, b) }
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn load(values: &[f32; WIDTH]) -> Self {
            // SAFETY: the processor has AVX2, see the type; the reference covers the 32 bytes of an unaligned load.
            Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
        }
        #[inline(always)]
        fn store(self) -> [f32; WIDTH] {
            let mut values = [0.0; WIDTH];
            // SAFETY: the processor has AVX2, see the type; `values` covers the 32 bytes of an unaligned store.
            unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) };
            values
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn negated(self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn flip(self, sign: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_xor_ps(self.0, _mm256_and_ps(sign.0, _mm256_set1_ps(-0.0))) })
        }
        #[inline(always)]
        fn gt(self, other: Self) -> u32 {
            // SAFETY: the processor has AVX2, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn ge(self, other: Self) -> u32 {
            // SAFETY: the processor has AVX2, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn or(self, mask: u32, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe {
                let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
                let set = _mm256_and_si256(_mm256_set1_epi32(mask as i32), bits);
                let set = _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, bits));
                _mm256_blendv_ps(other.0, self.0, set)
            })
        }
        #[inline(always)]
        fn transpose([a, b, c, d, e, f, g, h]: [Self; WIDTH]) -> [[f32; WIDTH]; WIDTH] {
            // SAFETY: the processor has AVX2, see the type.
            unsafe {
                let ab = [_mm256_unpacklo_ps(a.0, b.0), _mm256_unpackhi_ps(a.0, b.0)];
                let cd = [_mm256_unpacklo_ps(c.0, d.0), _mm256_unpackhi_ps(c.0, d.0)];
                let ef = [_mm256_unpacklo_ps(e.0, f.0), _mm256_unpackhi_ps(e.0, f.0)];
                let gh = [_mm256_unpacklo_ps(g.0, h.0), _mm256_unpackhi_ps(g.0, h.0)];
                // Of each pair of columns i and i + 4 the upper four rows and the lower four.
                let upper = [
                    _mm256_shuffle_ps::<0x44>(ab[0], cd[0]),
                    _mm256_shuffle_ps::<0xee>(ab[0], cd[0]),
                    _mm256_shuffle_ps::<0x44>(ab[1], cd[1]),
                    _mm256_shuffle_ps::<0xee>(ab[1], cd[1]),
                ];
                let lower = [
                    _mm256_shuffle_ps::<0x44>(ef[0], gh[0]),
                    _mm256_shuffle_ps::<0xee>(ef[0], gh[0]),
                    _mm256_shuffle_ps::<0x44>(ef[1], gh[1]),
                    _mm256_shuffle_ps::<0xee>(ef[1], gh[1]),
                ];
                [
                    Self(_mm256_permute2f128_ps::<0x20>(upper[0], lower[0])).store(),
                    Self(_mm256_permute2f128_ps::<0x20>(upper[1], lower[1])).store(),
                    Self(_mm256_permute2f128_ps::<0x20>(upper[2], lower[2])).store(),
                    Self(_mm256_permute2f128_ps::<0x20>(upper[3], lower[3])).store(),
                    Self(_mm256_permute2f128_ps::<0x31>(upper[0], lower[0])).store(),
                    Self(_mm256_permute2f128_ps::<0x31>(upper[1], lower[1])).store(),
                    Self(_mm256_permute2f128_ps::<0x31>(upper[2], lower[2])).store(),
                    Self(_mm256_permute2f128_ps::<0x31>(upper[3], lower[3])).store(),
                ]
            }
        }
    }
}

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

/// Vectors side by side.
#[derive(Clone, Copy)]
pub struct Triple<L> {
    /// First components.
    pub x: L,
    /// Second components.
    pub y: L,
    /// Third components.
    pub z: L,
}

impl<L: Lanes> Triple<L> {
    /// Eight times the same.
    #[inline(always)]
    pub fn splat(v: Vec3) -> Self {
        Triple { x: L::splat(v.x), y: L::splat(v.y), z: L::splat(v.z) }
    }

    /// Products by lane, summed as glam does.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Differences by lane.
    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        Triple { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    /// Quotients by lane.
    #[inline(always)]
    pub fn over(self, divisor: L) -> Self {
        Triple { x: self.x / divisor, y: self.y / divisor, z: self.z / divisor }
    }

    /// One vector a lane from memory.
    #[inline(always)]
    pub fn load(vectors: &[Vec3; WIDTH]) -> Self {
        Triple {
            x: L::load(&vectors.map(|v| v.x)),
            y: L::load(&vectors.map(|v| v.y)),
            z: L::load(&vectors.map(|v| v.z)),
        }
    }

    /// One vector a lane to memory.
    #[inline(always)]
    pub fn store(self) -> [Vec3; WIDTH] {
        let (x, y, z) = (self.x.store(), self.y.store(), self.z.store());
        std::array::from_fn(|i| Vec3::new(x[i], y[i], z[i]))
    }
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
            L::splat(a[3]),
        ];
        let columns = L::transpose([x, y, x + y, x, y, x - y, y, x]);
        let stored = numbers.map(L::store);
        let stored = stored.iter().chain(&columns).flatten();
        // Which bits one gets for what is no number is left open.
        let bits = |n: &f32| if n.is_nan() { u32::MAX } else { n.to_bits() };
        stored.map(bits).chain([x.gt(y), x.ge(y)]).collect()
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
    fn columns_are_rows() {
        let rows: [[f32; WIDTH]; WIDTH] =
            std::array::from_fn(|k| std::array::from_fn(|i| (k * 10 + i) as f32));
        let columns = Portable::transpose(rows.map(Portable));
        assert_eq!((columns[3][5], columns[0][7], columns[7][0]), (53.0, 70.0, 7.0));
    }
}
