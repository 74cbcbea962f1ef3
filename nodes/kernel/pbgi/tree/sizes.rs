//! Positive numbers in one byte: steps of equal ratio between the least and the greatest, as a table.

/// A table for these numbers: 0, then 255 steps of equal ratio. Equal numbers return exactly; others within half a step, which is
/// 0.5 percent for numbers that differ by up to a factor of ten, 1.8 percent for ten thousand.
pub fn table(values: impl Iterator<Item = f32>) -> [f32; 256] {
    let valid = values.filter(|v| *v > 0.0 && v.is_finite());
    let (least, greatest) = valid.fold((f32::INFINITY, 0.0f32), |(a, b), v| (a.min(v), b.max(v)));
    if greatest == 0.0 {
        return [0.0; 256];
    }
    let ratio = f64::from(greatest) / f64::from(least);
    std::array::from_fn(|k| match k {
        0 => 0.0,
        255 => greatest,
        _ => (f64::from(least) * libm::pow(ratio, (k - 1) as f64 / 254.0)) as f32,
    })
}

/// The code of the nearest entry of a [`table`]; 0 for what is not positive.
pub fn encode(value: f32, table: &[f32; 256]) -> u8 {
    if value.is_nan() || value <= 0.0 {
        return 0;
    }
    let above = table[1..].partition_point(|&t| t < value) + 1;
    let (low, high) = (above.max(2) - 1, above.min(255));
    if value - table[low] <= table[high] - value { low as u8 } else { high as u8 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_return_within_half_a_step() {
        for (ratio, error) in [(10.0f32, 0.0047), (1e4, 0.0185), (1e8, 0.037)] {
            let values: Vec<f32> =
                (0..5000).map(|i| 0.03 * ratio.powf(i as f32 / 4999.0)).collect();
            let table = table(values.iter().copied());
            let worst = values
                .iter()
                .map(|&v| (table[usize::from(encode(v, &table))] / v - 1.0).abs())
                .fold(0.0, f32::max);
            assert!(worst < error && worst > 0.7 * error, "{ratio} {worst}");
        }
    }

    #[test]
    fn equal_numbers_and_none_at_all() {
        let equal = table([0.37; 5].into_iter());
        assert_eq!(equal[usize::from(encode(0.37, &equal))], 0.37);
        for bad in [0.0, -1.0, f32::NAN] {
            assert_eq!(equal[usize::from(encode(bad, &equal))], 0.0);
        }
        assert_eq!(table([0.0, f32::NAN].into_iter()), [0.0; 256]);
        let (zero, any) = (table([].into_iter()), encode(3.0, &equal));
        assert_eq!((zero[usize::from(encode(3.0, &zero))], equal[usize::from(any)]), (0.0, 0.37));
    }
}
