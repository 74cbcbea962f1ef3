//! Clear and hazy daylight: "A Practical Analytic Model for Daylight" (Preetham et al. 1999).
//!
//! The sky is the paper's fit: Perez' distribution for luminance and for the two chromaticities. The
//! sun is its appendix, integrated over wavelength: a black body of 5778 K dimmed by Rayleigh
//! scattering, aerosols and ozone (mixed gases and water vapour, which matter beyond 690 nm only, are
//! left out). Units: kcd/m^2 for radiance, klx for irradiance; colours are linear Rec. 709.

use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::PI;

/// Diameter of the sun's disc, radians.
pub const SUN_DIAMETER: f64 = 0.53 * PI / 180.0;

/// Slope and offset over turbidity of A to E (appendix A.2) for luminance Y, x and y.
const PEREZ: [[[f64; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [
        [-0.0193, -0.2592],
        [-0.0665, 0.0008],
        [-0.0004, 0.2125],
        [-0.0641, -0.8989],
        [-0.0033, 0.0452],
    ],
    [
        [-0.0167, -0.2608],
        [-0.0950, 0.0092],
        [-0.0079, 0.2102],
        [-0.0441, -1.6537],
        [-0.0109, 0.0529],
    ],
];

/// Zenith chromaticities x and y: rows for T^2, T, 1; columns for the powers 3 to 0 of the sun's angle.
const ZENITH: [[[f64; 4]; 3]; 2] = [
    [
        [0.00166, -0.00375, 0.00209, 0.0],
        [-0.02903, 0.06377, -0.03202, 0.00394],
        [0.11693, -0.21196, 0.06052, 0.25886],
    ],
    [
        [0.00275, -0.00610, 0.00317, 0.0],
        [-0.04214, 0.08970, -0.04153, 0.00516],
        [0.15346, -0.26756, 0.06670, 0.26688],
    ],
];

/// Absorption of ozone per cm at 380 nm, 400 nm, ... 780 nm (the Chappuis band).
const OZONE: [f64; 21] = [
    0.0, 0.0, 0.001, 0.002, 0.006, 0.014, 0.030, 0.048, 0.075, 0.103, 0.120, 0.115, 0.120, 0.090,
    0.067, 0.048, 0.028, 0.018, 0.011, 0.009, 0.005,
];

/// XYZ to linear Rec. 709 with its D65 white, rows for R, G, B.
const REC709: [[f64; 3]; 3] = [
    [3.2404542, -1.5371385, -0.4985314],
    [-0.969266, 1.8760108, 0.041556],
    [0.0556434, -0.2040259, 1.0572252],
];

/// Daylight for one place of the sun and one turbidity.
pub struct Daylight {
    sun: DVec3,
    sun_zenith_angle: f64,
    turbidity: f64,
    /// A to E for Y, x, y.
    perez: [[f64; 5]; 3],
    /// Zenith value over the distribution there, for Y, x, y.
    scale: [f64; 3],
}

impl Daylight {
    /// `sun` is its elevation over the horizon (0 to 90) and its azimuth from +X towards +Z (any), in
    /// degrees; `turbidity` is 2 (clear) to 10 (haze), the range for which the model was fitted.
    ///
    /// # Errors
    /// When the elevation or the turbidity is out of its range, or the azimuth is not finite.
    pub fn new(sun: [f32; 2], turbidity: f32) -> Result<Self, String> {
        let [elevation, azimuth] = sun.map(f64::from);
        let turbidity = f64::from(turbidity);
        if !(0.0..=90.0).contains(&elevation) || !azimuth.is_finite() {
            return Err(format!(
                "expected a sun 0 to 90 degrees over the horizon, found {elevation}"
            ));
        }
        if !(2.0..=10.0).contains(&turbidity) {
            return Err(format!("expected a turbidity from 2 to 10, found {turbidity}"));
        }
        let (sin, cos) = libm::sincos(elevation.to_radians());
        let (azimuth_sin, azimuth_cos) = libm::sincos((azimuth % 360.0).to_radians());
        let angle = (90.0 - elevation).to_radians();
        let chi = (4.0 / 9.0 - turbidity / 120.0) * (PI - 2.0 * angle);
        let luminance =
            (4.0453 * turbidity - 4.9710) * libm::tan(chi) - 0.2155 * turbidity + 2.4192;
        let chromaticity = |rows: &[[f64; 4]; 3]| {
            let row = |r: &[f64; 4]| r.iter().fold(0.0, |sum, c| sum * angle + c);
            (row(&rows[0]) * turbidity + row(&rows[1])) * turbidity + row(&rows[2])
        };
        let zenith = [luminance, chromaticity(&ZENITH[0]), chromaticity(&ZENITH[1])];
        let perez = PEREZ.map(|table| table.map(|[slope, offset]| slope * turbidity + offset));
        let scale = [0, 1, 2].map(|k| zenith[k] / distribution(&perez[k], 1.0, angle));
        Ok(Daylight {
            sun: DVec3::new(cos * azimuth_cos, sin, cos * azimuth_sin),
            sun_zenith_angle: angle,
            turbidity,
            perez,
            scale,
        })
    }

    /// The unit vector towards the centre of the sun.
    pub fn sun(&self) -> DVec3 {
        self.sun
    }

    /// Radiance of the sky, without the sun's disc, towards a unit vector, kcd/m^2 and not negative.
    /// Below the horizon it is that of the horizon.
    pub fn radiance(&self, towards: DVec3) -> Vec3 {
        let gamma = libm::acos(towards.dot(self.sun).clamp(-1.0, 1.0));
        // The fit has 1/cos(theta); a quarter of a degree over the horizon stands for the horizon.
        let height = towards.y.max(0.004);
        let [luminance, x, y] =
            [0, 1, 2].map(|k| self.scale[k] * distribution(&self.perez[k], height, gamma));
        let y = y.max(0.01);
        rec709(DVec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance)
    }

    /// Irradiance that the whole disc of the sun causes on a surface facing it, klx and not negative.
    pub fn sun_irradiance(&self) -> Vec3 {
        let degrees = self.sun_zenith_angle.to_degrees();
        let mass = 1.0 / (self.sun.y + 0.15 * libm::pow(93.885 - degrees, -1.253));
        let aerosols = 0.04608 * self.turbidity - 0.04586;
        let sum: DVec3 = (0..=80)
            .map(|i| {
                let nanometres = 380.0 + 5.0 * f64::from(i);
                let micrometres = nanometres / 1000.0;
                let at = f64::from(i) / 4.0;
                let (below, part) = (at as usize, at.fract());
                let ozone = OZONE[below] * (1.0 - part) + OZONE[(below + 1).min(20)] * part;
                let depth = 0.008735 * libm::pow(micrometres, -4.08)
                    + aerosols * libm::pow(micrometres, -1.3)
                    + 0.35 * ozone;
                observer(nanometres) * black_body(nanometres) * libm::exp(-depth * mass) * 5.0
            })
            .sum();
        let solid_angle = 2.0 * PI * (1.0 - libm::cos(SUN_DIAMETER / 2.0));
        rec709(sum * (0.683 * solid_angle))
    }
}

/// Perez' distribution: `height` is the cosine to the zenith, `gamma` the angle to the sun.
fn distribution(&[a, b, c, d, e]: &[f64; 5], height: f64, gamma: f64) -> f64 {
    (1.0 + a * libm::exp(b / height))
        * (1.0 + c * libm::exp(d * gamma) + e * libm::cos(gamma) * libm::cos(gamma))
}

/// Spectral radiance of the sun's surface outside the atmosphere, W/(m^2 sr nm).
fn black_body(nanometres: f64) -> f64 {
    let (first, second) = (1.191_043e20, 1.438_777e7);
    first / (nanometres.powi(5) * (libm::exp(second / (nanometres * 5778.0)) - 1.0))
}

/// The CIE 1931 observer: the sums of skewed Gaussians of Wyman, Sloan and Shirley 2013.
fn observer(nanometres: f64) -> DVec3 {
    let lobe = |peak: f64, below: f64, above: f64| {
        let t = (nanometres - peak) / if nanometres < peak { below } else { above };
        libm::exp(-0.5 * t * t)
    };
    DVec3::new(
        1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7)
            - 0.065 * lobe(501.1, 20.4, 26.2),
        0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1),
        1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8),
    )
}

/// A colour outside of Rec. 709 loses its negative components.
fn rec709(xyz: DVec3) -> Vec3 {
    (DMat3::from_cols_array_2d(&REC709).transpose() * xyz).max(DVec3::ZERO).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(rgb: Vec3) -> f32 {
        rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
    }

    #[test]
    fn the_zenith_has_the_luminance_and_chromaticity_of_the_paper() {
        // T = 3, sun 45 degrees high: chi = (4/9 - 3/120) pi/2, Yz = 7.1649 tan(chi) + 1.7727.
        let sky = Daylight::new([45.0, 0.0], 3.0).unwrap();
        let chi: f64 = (4.0 / 9.0 - 3.0 / 120.0) * PI / 2.0;
        let zenith = luminance(sky.radiance(DVec3::Y));
        assert!((f64::from(zenith) - (7.1649 * libm::tan(chi) + 1.7727)).abs() < 2e-3, "{zenith}");
    }

    #[test]
    fn the_sun_outside_the_atmosphere_is_as_bright_as_measured() {
        // Measured: 128 to 134 klx; a black body is known to be a few per cent darker.
        let sum: f64 = (0..=80)
            .map(|i| 380.0 + 5.0 * f64::from(i))
            .map(|w| observer(w).y * black_body(w) * 5.0)
            .sum();
        let klx = 0.683 * sum * 2.0 * PI * (1.0 - (SUN_DIAMETER / 2.0).cos());
        assert!((120.0..134.0).contains(&klx), "{klx}");
    }

    #[test]
    fn the_sun_reddens_and_dims_towards_the_horizon_and_in_haze() {
        let at = |elevation, turbidity| {
            Daylight::new([elevation, 30.0], turbidity).unwrap().sun_irradiance()
        };
        let (noon, evening, haze) = (at(80.0, 2.5), at(8.0, 2.5), at(80.0, 8.0));
        assert!((80.0..115.0).contains(&luminance(noon)), "{noon}");
        assert!(luminance(evening) < 0.6 * luminance(noon) && luminance(haze) < luminance(noon));
        assert!(evening.x / evening.z > 2.0 * noon.x / noon.z, "{evening} {noon}");
    }

    #[test]
    fn the_sky_is_blue_above_and_finite_everywhere() {
        for elevation in [0.0, 1.0, 10.0, 35.0, 60.0, 90.0] {
            for turbidity in [2.0, 3.0, 6.0, 10.0] {
                let sky = Daylight::new([elevation, 60.0], turbidity).unwrap();
                assert!(
                    sky.sun_irradiance().is_finite() && sky.sun_irradiance().min_element() >= 0.0
                );
                for i in 0..400 {
                    let (u, v) = (f64::from(i % 20) / 20.0, f64::from(i / 20) / 19.0);
                    let l = sky.radiance(crate::kernel::latlong::direction(u, v));
                    assert!(
                        l.is_finite() && l.min_element() >= 0.0,
                        "{elevation} {turbidity} {u} {v}: {l}"
                    );
                }
            }
        }
        let sky = Daylight::new([35.0, 0.0], 2.5).unwrap();
        let (zenith, horizon) = (sky.radiance(DVec3::Y), sky.radiance(DVec3::NEG_X));
        assert!(
            zenith.z > 1.5 * zenith.x && zenith.z / zenith.x > horizon.z / horizon.x,
            "{zenith} {horizon}"
        );
    }

    #[test]
    fn what_the_model_does_not_cover_is_refused() {
        for (sun, turbidity) in [
            ([-1.0, 0.0], 3.0),
            ([91.0, 0.0], 3.0),
            ([f32::NAN, 0.0], 3.0),
            ([30.0, f32::INFINITY], 3.0),
            ([30.0, 0.0], 1.0),
        ] {
            assert!(Daylight::new(sun, turbidity).is_err());
        }
    }
}
