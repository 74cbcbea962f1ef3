//! Display values of radiance as real numbers: sRGB without rounding, for metrics that ask for them.

use glam::DVec3;

/// The sRGB value from 0 to 1 (IEC 61966-2-1) of linear light, in which 1 is the display's white;
/// light below 0 or above 1 is cut.
pub fn srgb(light: f64) -> f64 {
    let light = light.clamp(0.0, 1.0);
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055 }
}

/// The luma from 0 to 1 of linear light: its sRGB values weighted as in Rec. 709.
pub fn luma(light: DVec3) -> f64 {
    0.2126 * srgb(light.x) + 0.7152 * srgb(light.y) + 0.0722 * srgb(light.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_the_known_ones() {
        assert_eq!((srgb(0.0), srgb(-1.0), srgb(1e300)), (0.0, 0.0, srgb(1.0)));
        assert!((srgb(0.001) - 0.01292).abs() < 1e-15);
        assert!((srgb(0.5) - 0.735_356_983).abs() < 1e-9);
        assert!((srgb(1.0) - 1.0).abs() < 1e-15);
        assert!((luma(DVec3::ONE) - 1.0).abs() < 1e-15);
        assert!((luma(DVec3::new(0.0, 1.0, 0.0)) - 0.7152).abs() < 1e-15);
    }
}
