//! Lights of every kind as one list, gather samples, and photons.

use super::Array;
use crate::artifact;
use glam::{Vec2, Vec3};

/// How a light emits; the value stored in [`Lights::kind`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LightKind {
    /// The same intensity in all directions; emission in W/sr.
    Omni = 0,
    /// Intensity falling off between two cones; emission is the axial intensity, W/sr.
    Spot = 1,
    /// Parallel rays; emission is the perpendicular irradiance, W/m^2.
    Directional = 2,
    /// Intensity times the cosine to the normal: a piece of a diffuse surface or emitter; emission
    /// is the intensity along the normal, W/sr.
    Cosine = 3,
}

impl LightKind {
    /// The kind of a stored value; values that no kind has are read as [`LightKind::Omni`].
    pub fn of(value: u8) -> Self {
        match value {
            1 => LightKind::Spot,
            2 => LightKind::Directional,
            3 => LightKind::Cosine,
            _ => LightKind::Omni,
        }
    }
}

artifact! {
    /// The lights of one frame. Light j is the same light in every frame of a shot; switched off
    /// means an emission of zero.
    pub struct Lights {
        /// `[light]`: see [`LightKind`].
        kind: Array<u8>,
        /// `[light, 3]` world space, metres; unused for directional lights.
        position: Array<Vec3>,
        /// `[light, 3]` unit vector along which it shines: the axis of a spot, the normal of a
        /// cosine light, the direction in which parallel rays travel.
        direction: Array<Vec3>,
        /// `[light, 3]` linear RGB, in the unit of its kind.
        emission: Array<Vec3>,
        /// `[light, 2]` cosines of the inner and outer cone of a spot.
        cone: Array<Vec2>,
        /// `[light]` distance below which 1/r^2 is held constant, metres; 0 for real lights.
        clamp: Array<f32>,
        /// 1 when light j means the same light in every frame; 0 for lights deposited by photons.
        identity: u8,
    }
}

artifact! {
    /// Points spread uniformly over all surfaces and tied to their triangles, so that they move and
    /// deform with them (Hašan et al. 2008, section 5).
    pub struct GatherSamples {
        /// `[sample]` world-level triangle.
        triangle: Array<u32>,
        /// `[sample, 2]` barycentric weights of the triangle's second and third vertex.
        barycentric: Array<Vec2>,
        /// `[sample]` 1 on the front face, 0 on the back.
        front: Array<u8>,
        /// `[sample]` number of samples its triangle's face has: the area at any time is the
        /// triangle's area times `share`.
        share: Array<f32>,
    }
}

artifact! {
    /// Photons where they hit surfaces (Hašan et al. 2008, section 5).
    pub struct Photons {
        /// `[photon, 3]` world space.
        position: Array<Vec3>,
        /// `[photon, 3]` direction of travel.
        direction: Array<Vec3>,
        /// `[photon, 3]` flux, W.
        power: Array<Vec3>,
        /// `[photon, 3]` unit normal of the surface, on the side that was hit.
        normal: Array<Vec3>,
    }
}
