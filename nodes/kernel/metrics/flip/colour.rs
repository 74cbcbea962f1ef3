//! Colours as the eye tells them apart: an opponent space to filter in, and the distance in CIELAB
//! with Hunt's adjustment (Andersson et al. 2020, section 4.1).

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};
use libm::{cbrtf, exp2f, log2f};

/// Exponent, share of the largest distance, and the error there, of the map from distance to error
/// (the paper's q_c, p_c and p_t).
const EXPONENT: f32 = 0.7;
const SHARE: f32 = 0.4;
const ERROR: f32 = 0.95;

/// Linear Rec. 709 RGB to and from tristimulus values relative to white (D65).
pub struct Space {
    to_relative: Mat3,
    to_rgb: Mat3,
    /// The largest distance, that of green from blue, after the exponent.
    largest: f32,
}

impl Space {
    /// The conversions and the largest distance.
    pub fn new() -> Self {
        // The matrix of the published tool as fractions; each row sums to the white it is relative to.
        let rows = [
            DVec3::new(10_135_552.0, 8_788_810.0, 4_435_075.0),
            DVec3::new(2_613_072.0, 8_788_810.0, 887_015.0),
            DVec3::new(1_425_312.0, 8_788_810.0, 70_074_185.0),
        ];
        let [x, y, z] = rows.map(|row| row / row.element_sum());
        let to_relative = DMat3::from_cols(x, y, z).transpose();
        let mut space = Space {
            to_relative: to_relative.as_mat3(),
            to_rgb: to_relative.inverse().as_mat3(),
            largest: 0.0,
        };
        let [green, blue] = [Vec3::Y, Vec3::Z].map(|rgb| space.adjusted_lab(rgb));
        space.largest = power(hyab(green, blue), EXPONENT);
        space
    }

    /// Luminance, red-green and blue-yellow of linear RGB: the paper's Y Cx Cz without its factors
    /// and offset, which a filter does not see.
    pub fn opponent(&self, rgb: Vec3) -> Vec3 {
        let xyz = self.to_relative * rgb;
        Vec3::new(xyz.y, xyz.x - xyz.y, xyz.y - xyz.z)
    }

    /// Linear RGB from 0 to 1 that is closest, channel by channel, to the opponent colour.
    fn displayed(&self, opponent: Vec3) -> Vec3 {
        let Vec3 { x: y, y: red_green, z: blue_yellow } = opponent;
        let rgb = self.to_rgb * Vec3::new(y + red_green, y, y - blue_yellow);
        rgb.clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// CIELAB of linear RGB, with a and b growing with lightness (Hunt).
    fn adjusted_lab(&self, rgb: Vec3) -> Vec3 {
        let Vec3 { x, y, z } = self.to_relative * rgb;
        let [x, y, z] = [x, y, z].map(|t| {
            const LINEAR: f32 = 6.0 / 29.0;
            if t > LINEAR * LINEAR * LINEAR {
                cbrtf(t)
            } else {
                t / (3.0 * LINEAR * LINEAR) + 4.0 / 29.0
            }
        });
        let lightness = 116.0 * y - 16.0;
        let hunt = 0.01 * lightness;
        Vec3::new(lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z))
    }

    /// The error in colour of two filtered opponent colours, 0 to 1.
    pub fn error(&self, one: Vec3, other: Vec3) -> f32 {
        let [one, other] = [one, other].map(|c| self.adjusted_lab(self.displayed(c)));
        let distance = power(hyab(one, other), EXPONENT);
        let knee = SHARE * self.largest;
        if distance < knee {
            distance * ERROR / knee
        } else {
            ERROR + (distance - knee) / (self.largest - knee) * (1.0 - ERROR)
        }
    }
}

/// The distance of large colour differences: lightness apart, plus chroma apart (Abasi et al. 2020).
fn hyab(one: Vec3, other: Vec3) -> f32 {
    let apart = one - other;
    apart.x.abs() + Vec2::new(apart.y, apart.z).length()
}

/// A number from 0 on to a positive power, to about six digits. An exact one makes a map take a
/// quarter longer.
pub fn power(base: f32, exponent: f32) -> f32 {
    if base > 0.0 { exp2f(exponent * log2f(base)) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_and_black_are_neutral() {
        let space = Space::new();
        let white = space.adjusted_lab(Vec3::ONE);
        assert!((white - Vec3::new(100.0, 0.0, 0.0)).length() < 1e-3, "{white}");
        assert!(space.adjusted_lab(Vec3::ZERO).length() < 1e-5);
        assert!((space.opponent(Vec3::ONE) - Vec3::X).length() < 1e-6);
        let rgb = Vec3::new(0.2, 0.7, 0.1);
        assert!((space.displayed(space.opponent(rgb)) - rgb).length() < 1e-6);
        assert_eq!(space.displayed(Vec3::splat(9.0)).max_element(), 1.0);
    }

    #[test]
    fn powers_are_near_the_exact_ones() {
        for (base, exponent) in [(1e-30_f32, 0.7_f32), (0.013, 0.16), (1.0, 0.9), (308.0, 0.7)] {
            let exact = libm::powf(base, exponent);
            assert!((power(base, exponent) - exact).abs() < 1e-5 * exact);
        }
        assert_eq!((power(0.0, 0.7), power(1.0, 1.0)), (0.0, 1.0));
    }

    #[test]
    fn errors_go_from_none_to_one() {
        let space = Space::new();
        let opponent = [Vec3::Y, Vec3::Z, Vec3::ONE, Vec3::ZERO].map(|c| space.opponent(c));
        let error = |a: usize, b: usize| space.error(opponent[a], opponent[b]);
        assert_eq!((error(0, 0), error(3, 3)), (0.0, 0.0));
        assert!((error(0, 1) - 1.0).abs() < 1e-5, "{}", error(0, 1));
        assert_eq!(error(2, 3), error(3, 2));
        assert!(error(2, 3) > 0.9 && error(2, 3) < 1.0);
        // Lab of the sRGB primaries is published: green is (87.73, -86.18, 83.18).
        let green = space.adjusted_lab(Vec3::Y);
        assert!((green.x - 87.73).abs() < 0.02 && (green.y + 0.8773 * 86.18).abs() < 0.05);
    }
}
