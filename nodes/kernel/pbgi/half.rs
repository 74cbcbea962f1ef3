//! Half floats (IEEE 754 binary16), with the counts of what they cannot hold.

/// Greatest finite half float.
pub const MAX: f32 = 65504.0;

/// What happened to numbers on their way into half floats or shared exponents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Numbers beyond the greatest that fits, infinities included, held at the greatest.
    pub saturated: u64,
    /// Numbers other than zero that became zero.
    pub vanished: u64,
    /// Numbers that were not a number, or negative where that means nothing: now zero.
    pub invalid: u64,
}

impl std::ops::AddAssign for Losses {
    fn add_assign(&mut self, other: Self) {
        self.saturated += other.saturated;
        self.vanished += other.vanished;
        self.invalid += other.invalid;
    }
}

/// The nearest half float, of two as near the even one; beyond [`MAX`] that maximum, with the sign; not a number is 0.
pub fn encode(x: f32, losses: &mut Losses) -> u16 {
    if x.is_nan() {
        losses.invalid += 1;
        return 0;
    }
    let sign = ((x.to_bits() >> 16) & 0x8000) as u16;
    let magnitude = x.abs();
    if magnitude > MAX {
        losses.saturated += 1;
        return sign | 0x7bff;
    }
    // A number added so that the unit in the last place of the sum is the one of the half float: the addition rounds.
    let exponent = ((magnitude.to_bits() >> 23) as i32 - 127).max(-14);
    let magic = f32::from_bits(((exponent + 13 + 127) as u32) << 23);
    let rounded = (magnitude + magic) - magic;
    if rounded == 0.0 {
        losses.vanished += u64::from(magnitude > 0.0);
        return sign;
    }
    if rounded > MAX {
        losses.saturated += 1;
        return sign | 0x7bff;
    }
    if rounded < 6.103_515_6e-5 {
        // Below 2^-14: a count of units of 2^-24.
        return sign | (rounded * 16_777_216.0) as u16;
    }
    sign | ((rounded.to_bits() >> 13) - (112 << 10)) as u16
}

/// The number that a half float holds.
#[inline(always)]
pub fn decode(half: u16) -> f32 {
    // Exponent and mantissa in place, then the bias by an exact product, which also serves numbers below 2^-14.
    let magnitude = f32::from_bits(u32::from(half & 0x7fff) << 13) * f32::from_bits(0x7780_0000);
    f32::from_bits(magnitude.to_bits() | u32::from(half & 0x8000) << 16)
}

/// The power of two by which numbers up to `greatest` are multiplied so that they use the upper end of the range of half floats
/// without leaving it; 1 when there is nothing to scale.
pub fn scale(greatest: f32) -> f32 {
    if !(greatest > 0.0 && greatest.is_finite()) {
        return 1.0;
    }
    // greatest is below 2^(exponent + 1): it lands below 2^15.
    let exponent = ((greatest.to_bits() >> 23) as i32 - 127).max(-127);
    f32::from_bits(((14 - exponent).clamp(-126, 126) + 127) as u32 * (1 << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn once(x: f32) -> (f32, Losses) {
        let mut losses = Losses::default();
        (decode(encode(x, &mut losses)), losses)
    }

    #[test]
    fn every_half_float_returns() {
        let mut losses = Losses::default();
        for half in (0..=u16::MAX).filter(|half| half & 0x7c00 != 0x7c00) {
            assert_eq!(encode(decode(half), &mut losses), half);
        }
        assert_eq!(losses, Losses::default());
        assert_eq!((decode(0x3c00), decode(0x7bff), decode(1)), (1.0, MAX, 2.0f32.powi(-24)));
    }

    #[test]
    fn numbers_round_to_the_nearest() {
        let values: Vec<f32> = (0..0x7c00).map(decode).collect();
        let mut x = 1.3e-8f32;
        while x < MAX {
            let at = values.partition_point(|&v| v < x);
            let (low, high) = (values[at.max(1) - 1], values[at]);
            let (got, _) = once(x);
            let error = (f64::from(got) - f64::from(x)).abs();
            assert!(error <= f64::from(x - low).abs().min(f64::from(high - x).abs()), "{x} {got}");
            assert_eq!(once(-x).0, -got);
            x *= 1.000_37;
        }
    }

    #[test]
    fn what_does_not_fit_is_held_and_counted() {
        // Two times 40,000 overflows if it is summed in half floats; the mean is taken in f32.
        assert_eq!(once(65504.0), (MAX, Losses::default()));
        assert_eq!(once(65519.0), (MAX, Losses { saturated: 1, ..Losses::default() }));
        assert_eq!(once(65520.0), (MAX, Losses { saturated: 1, ..Losses::default() }));
        assert_eq!(once(f32::NEG_INFINITY), (-MAX, Losses { saturated: 1, ..Losses::default() }));
        assert_eq!(once(2e-8), (0.0, Losses { vanished: 1, ..Losses::default() }));
        assert_eq!(once(f32::NAN), (0.0, Losses { invalid: 1, ..Losses::default() }));
    }

    #[test]
    fn scaled_numbers_fit() {
        for greatest in [1e-45f32, 1e-38, 3e-9, 0.7, 1.0, 40_000.0, 65520.0, 1e9, 3e38] {
            let scaled = greatest * scale(greatest);
            assert!(scaled <= MAX, "{greatest} {scaled}");
            assert!(scaled >= 16384.0 || greatest < 1e-33, "{greatest} {scaled}");
            assert_eq!(scaled / scale(greatest), greatest);
        }
        assert_eq!((scale(0.0), scale(f32::INFINITY), scale(f32::NAN)), (1.0, 1.0, 1.0));
    }
}
