//! Images, environments, encoded pictures, and comparisons.

use super::Array;
use crate::artifact;
use glam::Vec3;

artifact! {
    /// Radiance, linear Rec. 709 RGB.
    pub struct Image {
        /// `[height, width, 3]`, first row at the top.
        radiance: Array<Vec3>,
    }
}

impl Image {
    /// An image from its pixels, row after row.
    pub fn new(width: usize, height: usize, radiance: Vec<Vec3>) -> Self {
        Image { radiance: Array::shaped(radiance, &[height, width]) }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        let shape = self.radiance.shape();
        (shape.get(1).copied().unwrap_or(0), shape.first().copied().unwrap_or(0))
    }
}

artifact! {
    /// Radiance from infinitely far away over all directions, latitude-longitude: u = 0.5 is +X,
    /// u = 0.25 is -Z, u = 0.75 is +Z, v = 0 is +Y.
    pub struct Environment {
        /// `[height, width, 3]`, finite and not negative.
        radiance: Array<Vec3>,
    }
}

artifact! {
    /// A file to publish: its bytes and its name's extension.
    pub struct Picture {
        /// The file's content.
        bytes: Array<u8>,
        /// Extension without the dot, ASCII.
        extension: Array<u8>,
    }
}

impl Picture {
    /// A file of the given content.
    pub fn new(bytes: Vec<u8>, extension: &str) -> Self {
        Picture { bytes: bytes.into(), extension: extension.as_bytes().to_vec().into() }
    }
}

artifact! {
    /// How far images are from their references.
    pub struct Comparison {
        /// `[frame]` relative L2 error: |I - R| / |R|.
        relative_l2: Array<f64>,
        /// `[frame]` ratio of the sums: energy of the images over that of the references.
        energy: Array<f64>,
        /// Mean over neighbouring frames of |(I' - R') - (I - R)| / |R|: zero for any constant bias;
        /// 0 for a single frame.
        flicker: f64,
    }
}
