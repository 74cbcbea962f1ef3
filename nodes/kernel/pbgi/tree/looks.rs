//! What leaves hold besides their place (Buchholz and Boubekeur 2012, Table 2), and what that cannot hold.
//!
//! Surfels are rounded before a tree is built over them, so that a leaf decodes to the surfel that its ancestors were made of, and
//! spheres hold the discs as they are decoded.

use super::super::half::{self, Losses};
use super::super::hierarchy::{Surfel, SurfelSet};
use super::{colours, octahedral, sizes};
use glam::Vec3;
use std::f32::consts::PI;

crate::choice! {
    /// How leaves are stored.
    pub enum Format {
        /// 26 bytes: place in full precision, colour, normal and area in half floats. Radii of discs
        /// follow from the areas.
        A = "a",
        /// 16 bytes: the same with a place relative to the sphere of the parent in 2 bytes.
        B = "b",
        /// 10 bytes: a place as in B, a colour with a shared exponent, a normal in 2 bytes, area and
        /// radius in 1 byte each. Inner nodes take 6 bytes instead of 12.
        C = "c",
    }
}

impl Format {
    /// Bytes of a leaf.
    pub const fn leaf_bytes(self) -> u64 {
        match self {
            Format::A => 26,
            Format::B => 16,
            Format::C => 10,
        }
    }

    /// Bytes of an inner node besides its vector or index.
    pub const fn inner_bytes(self) -> u64 {
        match self {
            Format::A | Format::B => 12,
            Format::C => 6,
        }
    }
}

/// What all leaves of a tree share.
#[derive(Clone, Debug, PartialEq)]
pub enum Scales {
    /// For formats A and B: powers of two by which radiance and area were multiplied, and the radius of a disc relative to that
    /// of its area.
    Half {
        /// Of radiance.
        radiance: f32,
        /// Of area.
        area: f32,
        /// Radius over sqrt(area / pi), such that all discs together keep their area.
        spread: f32,
    },
    /// For format C: the power of two of radiance, and the tables of areas and radii.
    Lean {
        /// Of radiance.
        radiance: f32,
        /// Areas by code.
        areas: Box<[f32; 256]>,
        /// Radii by code.
        radii: Box<[f32; 256]>,
    },
}

/// Codes of one leaf without its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Colour, normal, area.
    Half([u16; 7]),
    /// Colour (low byte first), normal, area, radius.
    Lean([u8; 8]),
}

impl Scales {
    /// Scales that suit these surfels.
    pub fn fit(format: Format, surfels: &impl SurfelSet) -> Self {
        let all = || (0..surfels.count()).map(|i| surfels.surfel(i));
        let greatest = |value: fn(Surfel) -> f32| {
            all().map(value).filter(|v| v.is_finite()).fold(0.0, f32::max)
        };
        let radiance = half::scale(greatest(|s| s.radiance.max_element()));
        if format == Format::C {
            let table = |value: fn(Surfel) -> f32| Box::new(sizes::table(all().map(value)));
            return Scales::Lean { radiance, areas: table(|s| s.area), radii: table(|s| s.radius) };
        }
        let sum =
            |value: fn(Surfel) -> f64| all().map(value).filter(|v| v.is_finite()).sum::<f64>();
        let (discs, areas) =
            (sum(|s| f64::from(s.radius) * f64::from(s.radius)), sum(|s| f64::from(s.area)));
        let spread =
            if areas > 0.0 { (std::f64::consts::PI * discs / areas).sqrt() as f32 } else { 1.0 };
        Scales::Half { radiance, area: half::scale(greatest(|s| s.area)), spread }
    }

    /// Codes a surfel.
    pub fn encode(&self, surfel: &Surfel, losses: &mut Losses) -> Look {
        match self {
            Scales::Half { radiance, area, .. } => {
                let positive = |x: f32, losses: &mut Losses| {
                    losses.invalid += u64::from(x < 0.0);
                    half::encode(if x < 0.0 { 0.0 } else { x }, losses)
                };
                let [r, g, b] =
                    (surfel.radiance * radiance).to_array().map(|c| positive(c, losses));
                // Zeros in a normal lose nothing.
                let [x, y, z] =
                    surfel.normal.to_array().map(|c| half::encode(c, &mut Losses::default()));
                Look::Half([r, g, b, x, y, z, positive(surfel.area * area, losses)])
            }
            Scales::Lean { radiance, areas, radii } => {
                let [r, g, b, e] =
                    colours::encode(surfel.radiance * radiance, losses).to_le_bytes();
                let [u, v] = octahedral::encode(surfel.normal);
                losses.invalid += u64::from(surfel.area.is_nan() || surfel.area < 0.0);
                Look::Lean([
                    r,
                    g,
                    b,
                    e,
                    u,
                    v,
                    sizes::encode(surfel.area, areas),
                    sizes::encode(surfel.radius, radii),
                ])
            }
        }
    }

    /// A surfel at `position`, black where the code is not of the kind of these scales.
    #[inline(always)]
    pub fn decode(&self, look: Look, position: Vec3) -> Surfel {
        match (self, look) {
            (&Scales::Half { radiance, area, spread }, Look::Half(codes)) => {
                let [r, g, b, x, y, z, size] = codes.map(half::decode);
                let area = size / area;
                Surfel {
                    position,
                    normal: Vec3::new(x, y, z).normalize_or(Vec3::Y),
                    radiance: Vec3::new(r, g, b) / radiance,
                    area,
                    radius: (area / PI).sqrt() * spread,
                }
            }
            (
                Scales::Lean { radiance, areas, radii },
                Look::Lean([r, g, b, e, u, v, area, radius]),
            ) => Surfel {
                position,
                normal: octahedral::decode([u, v]),
                radiance: colours::decode(u32::from_le_bytes([r, g, b, e])) / *radiance,
                area: areas[usize::from(area)],
                radius: radii[usize::from(radius)],
            },
            _ => Surfel { position, normal: Vec3::Y, radiance: Vec3::ZERO, area: 0.0, radius: 0.0 },
        }
    }

    /// A surfel as a leaf holds it, its place excepted; what that loses is counted.
    pub fn rounded(&self, surfel: &Surfel, losses: &mut Losses) -> Surfel {
        self.decode(self.encode(surfel, losses), surfel.position)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixtures::cloud;
    use super::*;

    fn rounded(format: Format, surfels: &Vec<Surfel>) -> (Vec<Surfel>, Losses) {
        let mut losses = Losses::default();
        let scales = Scales::fit(format, surfels);
        (surfels.iter().map(|s| scales.rounded(s, &mut losses)).collect(), losses)
    }

    #[test]
    fn surfels_return_within_the_stated_errors() {
        let surfels = cloud(5000, 3.0, 2);
        for (format, colour, normal, size) in
            [(Format::A, 4.9e-4, 7e-4, 4.9e-4), (Format::C, 2e-3, 0.017, 4e-3)]
        {
            let (back, losses) = rounded(format, &surfels);
            assert_eq!(losses.saturated + losses.invalid, 0);
            for (s, b) in surfels.iter().zip(&back) {
                assert_eq!(s.position, b.position);
                assert!(
                    (s.radiance - b.radiance).abs().max_element()
                        <= colour * s.radiance.max_element()
                );
                assert!(s.normal.distance(b.normal) <= normal);
                assert!((s.area / b.area - 1.0).abs() <= size, "{} {}", s.area, b.area);
            }
            let discs = |all: &[Surfel]| all.iter().map(|s| s.radius * s.radius).sum::<f32>();
            assert!((discs(&surfels) / discs(&back) - 1.0).abs() < 2e-3);
        }
    }

    #[test]
    fn powers_of_two_change_nothing() {
        let surfels = cloud(200, 3.0, 2);
        for exponent in [-40, 40] {
            let factor = 2.0f32.powi(exponent);
            let scaled: Vec<_> =
                surfels.iter().map(|s| Surfel { radiance: s.radiance * factor, ..*s }).collect();
            for format in [Format::A, Format::C] {
                let (back, losses) = rounded(format, &scaled);
                let (plain, plain_losses) = rounded(format, &surfels);
                assert_eq!(losses, plain_losses);
                assert!(back.iter().zip(&plain).all(|(b, p)| b.radiance == p.radiance * factor));
            }
        }
    }

    #[test]
    fn what_cannot_be_held_is_counted() {
        let mut surfels = cloud(4, 3.0, 2);
        surfels[0].radiance = Vec3::new(f32::INFINITY, f32::NAN, -1.0);
        surfels[1].radiance = Vec3::splat(1e9);
        surfels[2].radiance = Vec3::splat(1e-6);
        for format in [Format::B, Format::C] {
            let (back, losses) = rounded(format, &surfels);
            assert_eq!(
                (losses.saturated, losses.invalid, losses.vanished),
                (1, 2, 3),
                "{format:?}"
            );
            assert!(back.iter().all(|s| s.radiance.is_finite()));
            assert!(back[0].radiance.x >= 1e9 && (back[1].radiance.x / 1e9 - 1.0).abs() < 2e-3);
        }
    }
}
