//! Eight `f32` in a register of AVX2.

use super::{Add, Div, Lanes, Mul, Real, Sub, WIDTH, pressed};
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

impl Real for Avx2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: the processor has AVX2, see the type.
        Self(unsafe { _mm256_set1_ps(value) })
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
    fn negated(self) -> Self {
        // SAFETY: the processor has AVX2, see the type.
        Self(unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), self.0) })
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
}

impl Lanes for Avx2 {
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
    fn least(self) -> f32 {
        // SAFETY: the processor has AVX2, see the type.
        unsafe {
            let half = _mm256_min_ps(self.0, _mm256_permute2f128_ps::<0x01>(self.0, self.0));
            let pair = _mm256_min_ps(half, _mm256_permute_ps::<0x4e>(half));
            _mm256_cvtss_f32(_mm256_min_ps(pair, _mm256_permute_ps::<0xb1>(pair)))
        }
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        // SAFETY: the processor has AVX2, see the type.
        unsafe {
            let half = _mm256_max_ps(self.0, _mm256_permute2f128_ps::<0x01>(self.0, self.0));
            let pair = _mm256_max_ps(half, _mm256_permute_ps::<0x4e>(half));
            _mm256_cvtss_f32(_mm256_max_ps(pair, _mm256_permute_ps::<0xb1>(pair)))
        }
    }
    #[inline(always)]
    fn press(self, mask: u32) -> Self {
        let lanes = u64::from_le_bytes(pressed(mask)) as i64;
        // SAFETY: the processor has AVX2, see the type.
        Self(unsafe {
            let lanes = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(lanes));
            _mm256_permutevar8x32_ps(self.0, lanes)
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
