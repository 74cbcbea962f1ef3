//! Sums over rows, in f64, in a fixed number of accumulators added up in a fixed order: the same bits on every instruction set,
//! and vector code without reassociation by the compiler.

/// Accumulators of a sum over one column.
const WIDE: usize = 8;
/// Accumulators of each of several columns read at once.
const NARROW: usize = 4;
/// Blocks of `NARROW` entries in a cache line of 64 bytes.
const LINE: usize = 64 / (NARROW * size_of::<f32>());
/// Columns that `gather` reads at once.
pub const GROUP: usize = 4;

/// Splits into vectors of `N`; the rest counts as one shorter vector.
macro_rules! vectors {
    ($slice:expr, $n:expr) => {
        $slice.as_chunks::<{ $n }>()
    };
}

/// Defines a function that runs `$body`, which must be `#[inline(always)]`, compiled for AVX2 where the processor has it. The bits
/// are the same: only the width of the vector code differs, nothing is reassociated or fused.
macro_rules! wide {
    ($(#[$doc:meta])* fn $name:ident($($arg:ident: $type:ty),*) $(-> $out:ty)? = $body:expr) => {
        $(#[$doc])*
        fn $name($($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body($($arg),*)
                }
                if std::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has AVX2.
                    return unsafe { avx2($($arg),*) };
                }
            }
            $body($($arg),*)
        }
    };
}
pub(super) use wide;

/// The sum of squares.
#[inline(always)]
pub fn squares(column: &[f32]) -> f64 {
    fold(column, |x| f64::from(x) * f64::from(x))
}

/// The sum.
#[inline(always)]
pub fn sum(terms: &[f64]) -> f64 {
    fold(terms, |x| x)
}

#[inline(always)]
fn fold<T: Copy>(terms: &[T], term: impl Fn(T) -> f64) -> f64 {
    let (vectors, rest) = vectors!(terms, WIDE);
    let mut sums = [0.0; WIDE];
    for vector in vectors {
        for (sum, &x) in sums.iter_mut().zip(vector) {
            *sum += term(x);
        }
    }
    for (sum, &x) in sums.iter_mut().zip(rest) {
        *sum += term(x);
    }
    total(sums)
}

#[inline(always)]
fn total(s: [f64; WIDE]) -> f64 {
    ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
}

/// Adds `row` to `sum` and gives the squared norm of the new sum.
#[inline(always)]
pub fn accumulate<T: Copy + Into<f64>>(sum: &mut [f64], row: &[T]) -> f64 {
    let (sums, sum_rest) = sum.as_chunks_mut::<WIDE>();
    let (rows, row_rest) = vectors!(row, WIDE);
    let mut norm = [0.0; WIDE];
    for (sum, row) in sums.iter_mut().zip(rows) {
        for ((norm, sum), &x) in norm.iter_mut().zip(sum).zip(row) {
            *sum += x.into();
            *norm += *sum * *sum;
        }
    }
    for ((norm, sum), &x) in norm.iter_mut().zip(sum_rest).zip(row_rest) {
        *sum += x.into();
        *norm += *sum * *sum;
    }
    total(norm)
}

/// Adds `row` to `sum`.
#[inline(always)]
pub fn add<T: Copy + Into<f64>>(sum: &mut [f64], row: &[T]) {
    for (sum, &x) in sum.iter_mut().zip(row) {
        *sum += x.into();
    }
}

/// The squared distance of `column * scale` from `centre`.
#[inline(always)]
pub fn distance(column: &[f32], scale: f64, centre: &[f64]) -> f64 {
    let (columns, column_rest) = vectors!(column, WIDE);
    let (centres, centre_rest) = vectors!(centre, WIDE);
    let mut sums = [0.0; WIDE];
    for (column, centre) in columns.iter().zip(centres) {
        for ((sum, &x), c) in sums.iter_mut().zip(column).zip(centre) {
            let d = f64::from(x) * scale - c;
            *sum += d * d;
        }
    }
    for ((sum, &x), c) in sums.iter_mut().zip(column_rest).zip(centre_rest) {
        let d = f64::from(x) * scale - c;
        *sum += d * d;
    }
    total(sums)
}

/// Asks for the cache line at an address, valid or not.
#[inline(always)]
fn fetch(address: *const f32) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

/// Reads the columns of `G` lights in one frame once: adds their sum to `frame`, each to its own sum in `lights` (`G` times as long;
/// left alone when empty), and gives their dot products with `line`. All of one length. The columns from `next` on, which will be
/// read next, are asked for meanwhile: any address will do.
#[inline(always)]
pub fn gather<const G: usize, const LIGHTS: bool>(
    columns: [&[f32]; G],
    line: &[f64],
    frame: &mut [f64],
    lights: &mut [f64],
    next: [*const f32; G],
) -> [f64; G] {
    let rows = line.len();
    let mut sums = [[0.0f64; NARROW]; G];
    let (line, line_rest) = vectors!(line, NARROW);
    let (frame, frame_rest) = frame[..rows].as_chunks_mut::<NARROW>();
    let blocks = line.len();
    let split = columns.map(|column| vectors!(column[..rows], NARROW));
    let columns = split.map(|(vectors, _)| &vectors[..blocks]);
    let rests = split.map(|(_, rest)| rest);
    let mut each = lights.chunks_exact_mut(rows);
    let lights: [(&mut [[f64; NARROW]], &mut [f64]); G] = std::array::from_fn(|_| {
        let (vectors, rest) = each.next().unwrap_or_default().as_chunks_mut();
        (&mut vectors[..if LIGHTS { blocks } else { 0 }], rest)
    });
    for block in 0..blocks {
        if block % LINE == 0 {
            next.iter().for_each(|next| fetch(next.wrapping_add(NARROW * block)));
        }
        let mut frame_sum = frame[block];
        for g in 0..G {
            let x = columns[g][block].map(f64::from);
            add(&mut frame_sum, &x);
            for lane in 0..NARROW {
                sums[g][lane] += x[lane] * line[block][lane];
            }
            if LIGHTS {
                add(&mut lights[g].0[block], &x);
            }
        }
        frame[block] = frame_sum;
    }
    for lane in 0..line_rest.len() {
        for g in 0..G {
            let x = f64::from(rests[g][lane]);
            sums[g][lane] += x * line_rest[lane];
            frame_rest[lane] += x;
            if LIGHTS {
                lights[g].1[lane] += x;
            }
        }
    }
    sums.map(|s| (s[0] + s[2]) + (s[1] + s[3]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(rows: usize, from: usize) -> Vec<f32> {
        (from..from + rows).map(|i| (i * i % 17) as f32).collect()
    }

    #[test]
    fn every_length_agrees_with_the_plain_sum() {
        for rows in 1..40 {
            let columns: [_; GROUP] = std::array::from_fn(|g| column(rows, 3 * g));
            let line: Vec<f64> = column(rows, 50).into_iter().map(f64::from).collect();
            let plain =
                |c: &[f32]| c.iter().zip(&line).map(|(&x, l)| f64::from(x) * l).sum::<f64>();

            let mut frame = vec![1.0; rows];
            let mut lights = vec![2.0; GROUP * rows];
            let slices = std::array::from_fn(|g| columns[g].as_slice());
            let next = std::array::from_fn(|g| columns[g].as_ptr());
            let dots = gather::<GROUP, true>(slices, &line, &mut frame, &mut lights, next);
            for g in 0..GROUP {
                assert_eq!(dots[g], plain(&columns[g]));
                for i in 0..rows {
                    assert_eq!(lights[g * rows + i], 2.0 + f64::from(columns[g][i]));
                }
            }
            for (i, sum) in frame.iter().enumerate() {
                assert_eq!(*sum, 1.0 + columns.iter().map(|c| f64::from(c[i])).sum::<f64>());
            }

            let norm = accumulate(&mut frame, &columns[0]);
            assert_eq!(norm, frame.iter().map(|x| x * x).sum::<f64>());
            assert_eq!(
                squares(&columns[1]),
                columns[1].iter().map(|&x| f64::from(x * x)).sum::<f64>()
            );
            let apart: f64 =
                columns[2].iter().zip(&line).map(|(&x, l)| (2.0 * f64::from(x) - l).powi(2)).sum();
            assert_eq!(distance(&columns[2], 2.0, &line), apart);
        }
    }
}
