//! Which vectors are equal.

/// For each vector of `dims` numbers the first that equals it (0 and -0 are equal).
pub fn first_equals(vectors: &[f32], dims: usize) -> Vec<u32> {
    let mut order: Vec<(u64, u32)> = vectors.chunks_exact(dims).map(hash).zip(0..).collect();
    order.sort_unstable();
    let vector = |i: u32| &vectors[i as usize * dims..(i as usize + 1) * dims];
    let mut first = vec![0; order.len()];
    for equal_hash in order.chunk_by(|a, b| a.0 == b.0) {
        let mut firsts: Vec<u32> = Vec::new();
        for &(_, i) in equal_hash {
            let known = firsts.iter().find(|&&f| vector(f) == vector(i)).copied();
            first[i as usize] = known.unwrap_or(i);
            if known.is_none() {
                firsts.push(i);
            }
        }
    }
    first
}

/// The same for equal vectors.
fn hash(vector: &[f32]) -> u64 {
    vector.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, &x| {
        // Adding zero turns -0 to 0.
        let mixed = (hash ^ u64::from((x + 0.0).to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 29)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equals_is_found() {
        let vectors = [1.0, 0.0, 2.0, 1.0, 1.0, -0.0, 1.0, 0.0, 2.0, 1.0];
        assert_eq!(first_equals(&vectors, 2), [0, 1, 0, 0, 1]);
        assert!(first_equals(&[], 3).is_empty());
    }

    #[test]
    fn vectors_that_differ_are_told_apart() {
        let vectors: Vec<f32> = (0..30_000).map(|i| (i % 1000) as f32).collect();
        let first = first_equals(&vectors, 1);
        assert!(first.iter().zip(0..).all(|(&first, i)| first == i % 1000));
    }
}
