//! Colours in four bytes: three mantissas of nine bits and an exponent that they share.

use super::super::half::Losses;
use glam::Vec3;

/// Greatest channel that fits.
const MAX: f32 = 65408.0;

/// Codes a colour; what is negative or not a number becomes 0, what does not fit is held at the greatest that does.
pub fn encode(colour: Vec3, losses: &mut Losses) -> u32 {
    let channels = colour.to_array().map(|c| {
        losses.invalid += u64::from(c.is_nan() || c < 0.0);
        losses.saturated += u64::from(c > MAX);
        if c > 0.0 { c.min(MAX) } else { 0.0 }
    });
    let greatest = channels.into_iter().fold(0.0, f32::max);
    // Mantissas count units of 2^(exponent - 24); the greatest is below 2^9 of them, unless it rounds up to that.
    let mut exponent = ((greatest.to_bits() >> 23) as i32 - 127 + 16).clamp(0, 31);
    if (greatest / unit(exponent as u32)).round_ties_even() > 511.0 {
        exponent = (exponent + 1).min(31);
    }
    let mantissa = |c: f32| (c / unit(exponent as u32)).round_ties_even().min(511.0) as u32;
    let [r, g, b] = channels.map(|c| {
        let m = mantissa(c);
        losses.vanished += u64::from(c > 0.0 && m == 0);
        m
    });
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

/// The colour of a code. Each channel is within 1/512 of the greatest of the three, where that is at least 2^-15.
#[inline(always)]
pub fn decode(code: u32) -> Vec3 {
    let mantissa = |shift: u32| (code >> shift & 511) as f32;
    Vec3::new(mantissa(0), mantissa(9), mantissa(18)) * unit(code >> 27)
}

#[inline(always)]
fn unit(exponent: u32) -> f32 {
    f32::from_bits((exponent + 127 - 24) << 23)
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::unit_vectors;
    use super::*;

    #[test]
    fn colours_return_within_the_stated_error() {
        let mut scale = 1e-4;
        for v in unit_vectors(20_000, 4) {
            scale = if scale > 3e4 { 1e-4 } else { scale * 1.07 };
            let colour = v.abs() * scale;
            let mut losses = Losses::default();
            let code = encode(colour, &mut losses);
            let back = decode(code);
            assert!(
                (back - colour).abs().max_element() <= colour.max_element() / 512.0,
                "{colour} {back}"
            );
            assert_eq!((encode(back, &mut losses), losses.saturated + losses.invalid), (code, 0));
        }
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        let mut losses = Losses::default();
        assert_eq!(
            decode(encode(Vec3::new(f32::NAN, -1.0, f32::INFINITY), &mut losses)),
            Vec3::new(0.0, 0.0, MAX)
        );
        assert_eq!(decode(encode(Vec3::new(1.0, 1e-4, 0.0), &mut losses)), Vec3::X);
        assert_eq!(losses, Losses { invalid: 2, saturated: 1, vanished: 1 });
    }
}
