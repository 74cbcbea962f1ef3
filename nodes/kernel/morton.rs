//! Morton codes: points in order of their codes are mostly near to their neighbours in that order.

/// Bits of a code for each axis.
pub const BITS: u32 = 21;

/// The bits of three coordinates interleaved, the first lowest; what exceeds [`BITS`] counts as the largest that does not.
pub fn code(cell: [u32; 3]) -> u64 {
    let [x, y, z] = cell.map(spread);
    x | y << 1 | z << 2
}

/// Bit i moved to bit 3 i.
fn spread(x: u32) -> u64 {
    let x = u64::from(x.min((1 << BITS) - 1));
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_interleaved() {
        for i in 0..BITS {
            assert_eq!(code([1 << i, 0, 0]), 1 << (3 * i));
            assert_eq!(code([0, 1 << i, 0]), 2 << (3 * i));
            assert_eq!(code([0, 0, 1 << i]), 4 << (3 * i));
        }
        assert_eq!(code([u32::MAX; 3]), (1 << (3 * BITS)) - 1);
    }
}
