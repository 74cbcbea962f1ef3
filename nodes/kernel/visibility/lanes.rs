//! Eight numbers at once: the only place that knows an instruction set.
//!
//! Every operation is the same IEEE operation in each implementation and none is fused, so a query gives the same
//! bits whichever implementation answers it.

/// How many numbers one [`Lanes`] holds: the children of a node, the triangles of a leaf, the rays of a group.
pub(super) const WIDTH: usize = 8;

/// Eight `f32` with the operations the traversal needs.
///
/// `min` and `max` return the second operand when either is NaN, as the x86 instructions do.
pub(super) trait Lanes: Copy {
    fn splat(value: f32) -> Self;
    fn load(values: &[f32; WIDTH]) -> Self;
    fn store(self) -> [f32; WIDTH];
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Negates the lanes in which `sign` has its sign bit set.
    fn flip(self, sign: Self) -> Self;
    /// Bit i is set where lane i of `self` is greater than or equal to that of `other`.
    fn ge(self, other: Self) -> u32;
    /// Bit i is set where lane i of `self` is greater than that of `other`.
    fn gt(self, other: Self) -> u32;
    /// Hints that `value` will be read soon.
    fn prefetch<T>(value: &T);
}

/// Plain arrays, for every instruction set.
#[derive(Clone, Copy)]
pub(super) struct Portable([f32; WIDTH]);

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
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
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
    fn ge(self, other: Self) -> u32 {
        self.mask(other, |a, b| a >= b)
    }
    #[inline(always)]
    fn gt(self, other: Self) -> u32 {
        self.mask(other, |a, b| a > b)
    }
    #[inline(always)]
    fn prefetch<T>(_: &T) {}
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Lanes, WIDTH};
    use std::arch::x86_64::*;

    /// One 256-bit register. Values are made only inside functions compiled for AVX2, which are entered only after
    /// the processor was asked for it: this is what every `SAFETY` note below relies on.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256);

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
        fn add(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_div_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn flip(self, sign: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_xor_ps(self.0, _mm256_and_ps(sign.0, _mm256_set1_ps(-0.0))) })
        }
        #[inline(always)]
        fn ge(self, other: Self) -> u32 {
            // SAFETY: the processor has AVX2, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn gt(self, other: Self) -> u32 {
            // SAFETY: the processor has AVX2, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn prefetch<T>(value: &T) {
            let start = std::ptr::from_ref(value).cast::<i8>();
            let mut offset = 0;
            while offset < size_of::<T>() {
                // SAFETY: the address lies inside `value`; a prefetch reads nothing the program can see.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(start.add(offset)) };
                offset += 64;
            }
        }
    }
}
