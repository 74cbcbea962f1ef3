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
    /// How far images I are from their references R, in linear radiance unless said otherwise, over
    /// all pixels and channels.
    pub struct Comparison: Figures {
        /// `[frame]` relative L2 error: |I - R| / |R|.
        relative_l2: Array<f64>,
        /// `[frame]` ratio of the sums: energy of the images over that of the references.
        energy: Array<f64>,
        /// `[frame]` root of the mean of (I - R)^2, in units of radiance.
        rmse: Array<f64>,
        /// `[frame]` mean of (I - R)^2 / (R^2 + epsilon).
        rel_mse: Array<f64>,
        /// `[frame]` peak signal-to-noise ratio of display values in dB: radiance over the 99th
        /// percentile of |R|, cut to [0, 1], in sRGB without rounding, peak 1; at most 200, which is
        /// also the value of equal images.
        psnr: Array<f64>,
        /// `[frame]` the same of linear radiance, uncut; the peak is the 99th percentile of |R|.
        psnr_linear: Array<f64>,
        /// `[frame]` 99th percentile of |I - R|, in units of radiance.
        error99: Array<f64>,
        /// Mean over neighbouring frames of |(I' - R') - (I - R)| / |R|: zero for any constant bias;
        /// 0 for a single frame.
        flicker: f64,
        /// Standard deviation in time of I - R at pixels whose reference stands still, over the mean
        /// of |R|; 0 where none does.
        static_deviation: f64,
    }
}

artifact! {
    /// How alike images are to their references in structure.
    pub struct Ssim: Figures {
        /// `[frame]` mean structural similarity: 1 for equal images, at least -1.
        ssim: Array<f64>,
    }
}

artifact! {
    /// How much of images looks different from their references.
    pub struct PerceptualDifferences: Figures {
        /// `[frame]` share of the pixels that differ visibly, from 0 to 1.
        different: Array<f64>,
    }
}
