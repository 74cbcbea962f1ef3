//! Cameras, deep framebuffers, and the maps between those of neighbouring frames.

use super::Array;
use crate::artifact;
use glam::Vec3;

/// No triangle, no pixel.
pub const NONE: u32 = u32::MAX;

artifact! {
    /// A camera at one time. The picture's height spans the field of view; its width follows from
    /// the shape of the picture.
    pub struct Camera {
        /// World space, metres.
        eye: Vec3,
        /// Unit vector to the right of the picture.
        right: Vec3,
        /// Unit vector to the top of the picture.
        up: Vec3,
        /// Unit vector along which it looks.
        forward: Vec3,
        /// Tangent of half the vertical field of view; 0 for an orthographic camera.
        half_height_tangent: f32,
        /// Half the height of the view of an orthographic camera, metres; 0 otherwise.
        half_height: f32,
        /// Distances along `forward` between which surfaces are seen, metres.
        clip: [f32; 2],
    }
}

artifact! {
    /// What the camera sees at the centre of each pixel (Hašan et al. 2008, section 5). Arrays are
    /// `[height, width]`, the first row at the top.
    pub struct DeepFramebuffer {
        /// World space, metres.
        position: Array<Vec3>,
        /// Unit shading normal, towards the eye.
        normal: Array<Vec3>,
        /// Unit normal of the triangle, towards the eye.
        facet: Array<Vec3>,
        /// Diffuse reflectance, linear RGB.
        albedo: Array<Vec3>,
        /// Specular reflectance at normal incidence, linear RGB.
        specular: Array<Vec3>,
        /// Perceptual roughness.
        roughness: Array<f32>,
        /// Radiance emitted towards the eye; on pixels that see no surface, that of the background.
        emitted: Array<Vec3>,
        /// World-level triangle; [`NONE`] where no surface is seen.
        triangle: Array<u32>,
        /// Where the picture was taken from.
        eye: Vec3,
        /// 0 for an orthographic camera, whose view direction is `forward` everywhere.
        perspective: u8,
        /// Viewing direction of an orthographic camera.
        forward: Vec3,
    }
}

impl DeepFramebuffer {
    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        let shape = self.triangle.shape();
        (shape.get(1).copied().unwrap_or(0), shape.first().copied().unwrap_or(0))
    }
}

artifact! {
    /// Nearest neighbours between the pixels of frames k and k+1 (Hašan et al. 2008, section 4.4).
    pub struct PixelMaps {
        /// `[height, width]` on frame k+1: pixel of frame k, or [`NONE`]: M(k -> k+1).
        forward: Array<u32>,
        /// `[height, width]` on frame k: pixel of frame k+1, or [`NONE`]: M(k+1 -> k).
        backward: Array<u32>,
        /// Share of surface pixels of the two frames whose nearest neighbour is farther than the
        /// cut distance, 0 to 1.
        far: f32,
        /// Weights of position, normal and albedo in the 9-vectors.
        weights: [f32; 3],
    }
}
