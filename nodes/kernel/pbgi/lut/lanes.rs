//! Squared distances in f32, in eight sums added up in a fixed order: the same bits on every instruction set and for both layouts,
//! a vector at a time or eight at a time.

/// Partial sums of a distance; a vector is padded with zeros to a multiple.
pub const WIDTH: usize = 8;
/// Eight consecutive entries of one vector, or one entry of eight vectors; aligned, so that none straddles two cache lines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Eight(pub [f32; WIDTH]);
/// Vectors whose sums [`Lanes::sums`] finishes together.
pub const GROUP: usize = 4;

/// Eight `f32`. Every operation is the same IEEE operation in each implementation and none is fused.
pub trait Lanes: Copy {
    /// Eight times the same.
    fn splat(value: f32) -> Self;
    /// Eight from memory.
    fn load(values: &Eight) -> Self;
    /// Eight to memory.
    fn store(self) -> [f32; WIDTH];
    /// Sum by lane.
    fn add(self, other: Self) -> Self;
    /// Difference by lane.
    fn sub(self, other: Self) -> Self;
    /// Product by lane.
    fn mul(self, other: Self) -> Self;
    /// The larger by lane, that of `other` if one is not a number.
    fn max(self, other: Self) -> Self;
    /// Bit i is set where lane i of `self` is less than that of `other`.
    fn less(self, other: Self) -> u32;
    /// For each of four: `((0 + 4) + (2 + 6)) + ((1 + 5) + (3 + 7))`.
    fn sums(four: [Self; GROUP]) -> [f32; GROUP];
}

/// Plain arrays, for every instruction set.
#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }
    #[inline(always)]
    fn load(values: &Eight) -> Self {
        Self(values.0)
    }
    #[inline(always)]
    fn store(self) -> [f32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - other.0[i]))
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] * other.0[i]))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] }))
    }
    #[inline(always)]
    fn less(self, other: Self) -> u32 {
        (0..WIDTH).fold(0, |mask, i| mask | (u32::from(self.0[i] < other.0[i]) << i))
    }
    #[inline(always)]
    fn sums(four: [Self; GROUP]) -> [f32; GROUP] {
        four.map(|Self(s)| ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])))
    }
}

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Eight, GROUP, Lanes, WIDTH};
    use std::arch::x86_64::*;

    /// One 256-bit register. Values are made only inside functions compiled for AVX2, which are entered only after
    /// the processor was asked for it: this is what every `SAFETY` note below relies on.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256);

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn load(values: &Eight) -> Self {
            // SAFETY: the processor has AVX2, see the type; the reference covers the 32 bytes of an unaligned load.
            Self(unsafe { _mm256_loadu_ps(values.0.as_ptr()) })
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
        fn max(self, other: Self) -> Self {
            // SAFETY: the processor has AVX2, see the type.
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn less(self, other: Self) -> u32 {
            // SAFETY: the processor has AVX2, see the type.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn sums(four: [Self; GROUP]) -> [f32; GROUP] {
            let mut sums = [0.0; GROUP];
            // SAFETY: the processor has AVX2, see the type; `sums` covers the 16 bytes of an unaligned store.
            unsafe {
                let [a, b, c, d] = four.map(|Self(s)| {
                    _mm_add_ps(_mm256_castps256_ps128(s), _mm256_extractf128_ps::<1>(s))
                });
                let ab = _mm_add_ps(_mm_movelh_ps(a, b), _mm_movehl_ps(b, a));
                let cd = _mm_add_ps(_mm_movelh_ps(c, d), _mm_movehl_ps(d, c));
                let even = _mm_shuffle_ps::<0b10_00_10_00>(ab, cd);
                let odd = _mm_shuffle_ps::<0b11_01_11_01>(ab, cd);
                _mm_storeu_ps(sums.as_mut_ptr(), _mm_add_ps(even, odd));
            }
            sums
        }
    }
}

/// Defines a function that runs `$body`, generic in its [`Lanes`] and `#[inline(always)]`, with AVX2 where the processor has it.
macro_rules! wide {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),*) $(-> $out:ty)? = $body:ident $(<$n:literal>)?) => {
        $(#[$doc])*
        $vis fn $name($($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body::<$crate::kernel::pbgi::lut::lanes::Avx2 $(, $n)?>($($arg),*)
                }
                if std::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body::<$crate::kernel::pbgi::lut::lanes::Portable $(, $n)?>($($arg),*)
        }
    };
}
pub(super) use wide;

/// The squared distances of a padded vector from four: lane j sums `(x_i - c_i)^2` over i = j, j + 8, ... ascending, and the lanes
/// are added as [`Lanes::sums`] does. Relative error below 2e-6 up to 128 entries.
#[inline(always)]
pub fn squared<L: Lanes>(x: &[Eight], centres: [&[Eight]; GROUP]) -> [f32; GROUP] {
    let mut sums = [L::splat(0.0); GROUP];
    for (i, x) in x.iter().enumerate() {
        let x = L::load(x);
        for (sum, centre) in sums.iter_mut().zip(centres) {
            let d = x.sub(L::load(&centre[i]));
            *sum = sum.add(d.mul(d));
        }
    }
    L::sums(sums)
}

/// [`squared`] of eight vectors at once; `block` has entry i of all eight in its i-th lanes, as many as `x` without its padding.
#[inline(always)]
pub fn squared_of_eight<L: Lanes>(x: &[Eight], block: &[Eight]) -> L {
    let mut s = [L::splat(0.0); WIDTH];
    let (block, rest) = block.as_chunks::<WIDTH>();
    for (x, block) in x.iter().zip(block) {
        for ((sum, &x), centres) in s.iter_mut().zip(&x.0).zip(block) {
            *sum = add_square(*sum, x, centres);
        }
    }
    if let Some(x) = x.get(block.len()) {
        // Over all sums, so that their positions are constant and they stay in registers.
        for (i, sum) in s.iter_mut().enumerate() {
            if let Some(centres) = rest.get(i) {
                *sum = add_square(*sum, x.0[i], centres);
            }
        }
    }
    let [a, b, c, d] = [s[0].add(s[4]), s[1].add(s[5]), s[2].add(s[6]), s[3].add(s[7])];
    a.add(c).add(b.add(d))
}

#[inline(always)]
fn add_square<L: Lanes>(sum: L, x: f32, centres: &Eight) -> L {
    let d = L::splat(x).sub(L::load(centres));
    sum.add(d.mul(d))
}

/// Pads `vectors` of `dims` entries, times `scale`, to whole lanes.
pub fn padded(vectors: &[f32], dims: usize, scale: f32) -> Vec<Eight> {
    let lanes = dims.div_ceil(WIDTH);
    let mut out = vec![Eight::default(); vectors.len() / dims * lanes];
    for (vector, out) in vectors.chunks_exact(dims).zip(out.chunks_exact_mut(lanes)) {
        pad(vector, scale, out);
    }
    out
}

/// Writes `vector` times `scale` into zeroed lanes.
#[inline(always)]
pub fn pad(vector: &[f32], scale: f32, out: &mut [Eight]) {
    for (&x, out) in vector.iter().zip(out.iter_mut().flat_map(|out| &mut out.0)) {
        *out = x * scale;
    }
}

/// Vectors of `lanes` lanes by eights as [`squared_of_eight`] reads them, `dims` lanes an eight; the last eight is filled up with
/// vectors that are infinitely far from all.
pub fn blocked(padded: &[Eight], lanes: usize, dims: usize) -> Vec<Eight> {
    let count = padded.len() / lanes;
    let entry = |vector: usize, i: usize| {
        if vector < count { padded[vector * lanes + i / WIDTH].0[i % WIDTH] } else { f32::INFINITY }
    };
    (0..count.div_ceil(WIDTH))
        .flat_map(|block| (0..dims).map(move |i| (block * WIDTH, i)))
        .map(|(first, i)| Eight(std::array::from_fn(|lane| entry(first + lane, i))))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    wide! { fn best(x: &[Eight], c: &[Eight], block: &[Eight]) -> (f32, [f32; WIDTH]) = both }

    #[inline(always)]
    fn both<L: Lanes>(x: &[Eight], c: &[Eight], block: &[Eight]) -> (f32, [f32; WIDTH]) {
        let one = squared::<L>(x, [x, c, x, c]);
        assert_eq!((one[0], one[2], one[3]), (0.0, 0.0, one[1]));
        (one[1], squared_of_eight::<L>(x, block).store())
    }

    #[test]
    fn all_ways_give_the_same_bits_and_nearly_the_true_distance() {
        for dims in 1..=100 {
            let value = |v: usize, i: usize| ((v * 37 + i * 101) % 97) as f32 * 0.37 - 11.0;
            let vectors: Vec<f32> =
                (0..11).flat_map(|v| (0..dims).map(move |i| value(v, i))).collect();
            let padded = padded(&vectors, dims, 0.5);
            let lanes = dims.div_ceil(WIDTH);
            let blocked = blocked(&padded, lanes, dims);
            let x = &padded[3 * lanes..4 * lanes];
            for c in 0..11 {
                let centre = &padded[c * lanes..(c + 1) * lanes];
                let block = &blocked[c / WIDTH * dims..(c / WIDTH + 1) * dims];
                let (one, eight) = best(x, centre, block);
                assert_eq!(one.to_bits(), eight[c % WIDTH].to_bits());
                let (plain, eight) = both::<Portable>(x, centre, block);
                assert_eq!(
                    (one.to_bits(), one.to_bits()),
                    (plain.to_bits(), eight[c % WIDTH].to_bits())
                );
                let exact: f64 = (0..dims)
                    .map(|i| (0.5 * f64::from(value(3, i)) - 0.5 * f64::from(value(c, i))).powi(2))
                    .sum();
                assert!((f64::from(one) - exact).abs() <= 2e-6 * exact);
            }
        }
    }

    #[test]
    fn less_is_by_lane() {
        let (a, b) = ([1.0, 2.0, f32::NAN, 0.0, -1.0, 5.0, 5.0, 5.0], [2.0; WIDTH]);
        assert_eq!(Portable(a).less(Portable(b)), 0b1_1001);
    }
}
