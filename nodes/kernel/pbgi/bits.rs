//! Indices of a fixed number of bits, packed without gaps (Buchholz and Boubekeur 2012, section 3.1: log2(l) bits a node).

/// Bits that tell `count` values apart: ceil(log2(count)), and one for a single value.
pub fn width(count: usize) -> u32 {
    (usize::BITS - count.saturating_sub(1).leading_zeros()).clamp(1, 32)
}

/// Words that `count` values of `width` bits fill, one more than the last bit needs so that two words can always be read.
pub fn words(count: usize, width: u32) -> usize {
    (count as u64 * u64::from(width)).div_ceil(64) as usize + 1
}

/// Packs values of `width` bits (1 to 32): value i at bits i * width and up, lowest bit first. Higher bits of a value are dropped.
pub fn pack(values: impl ExactSizeIterator<Item = u32>, width: u32) -> Vec<u64> {
    let mut packed = vec![0u64; words(values.len(), width)];
    for (i, value) in values.enumerate() {
        let at = i as u64 * u64::from(width);
        let (word, bit) = ((at / 64) as usize, at % 64);
        let value = u64::from(value) & mask(width);
        packed[word] |= value << bit;
        if bit + u64::from(width) > 64 {
            packed[word + 1] |= value >> (64 - bit);
        }
    }
    packed
}

/// Value `i` of what [`pack`] gave.
#[inline(always)]
pub fn get(packed: &[u64], width: u32, i: usize) -> u32 {
    let at = i as u64 * u64::from(width);
    let (word, bit) = ((at / 64) as usize, at % 64);
    let both = u128::from(packed[word]) | u128::from(packed[word + 1]) << 64;
    ((both >> bit) as u64 & mask(width)) as u32
}

#[inline(always)]
fn mask(width: u32) -> u64 {
    (1 << width) - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_of_tables() {
        let expected = [
            (0, 1),
            (1, 1),
            (2, 1),
            (3, 2),
            (100, 7),
            (1000, 10),
            (10_000, 14),
            (65_536, 16),
            (65_537, 17),
        ];
        for (count, bits) in expected {
            assert_eq!(width(count), bits, "{count}");
        }
        assert_eq!(width(usize::MAX), 32);
    }

    #[test]
    fn values_return_at_every_width() {
        for width in 1..=32 {
            for count in [0, 1, 2, 63, 64, 65, 1000] {
                let hash = |i: u32| (i.wrapping_add(1)).wrapping_mul(0x9e37_79b9);
                let value = |i: u32| hash(i) & mask(width) as u32;
                let packed = pack((0..count).map(hash), width);
                assert_eq!(packed.len(), words(count as usize, width));
                for i in 0..count {
                    assert_eq!(get(&packed, width, i as usize), value(i), "{width} {i}");
                }
            }
        }
    }
}
