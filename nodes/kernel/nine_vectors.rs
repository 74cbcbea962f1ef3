//! The 9-vectors of a deep framebuffer: position, normal and diffuse reflectance
//! (Hašan et al. 2008, section 5, "Pixel mapping computation").

use super::neighbours::{Features, Frame, Weights};
use crate::data::{DeepFramebuffer, Geometry, NONE};
use super::stage::Surface;
use crate::node::Error;

/// The weighted 9-vectors of every pixel, positions relative to the scene's centre and diagonal.
/// `weights` are those of position, normal and albedo.
///
/// # Errors
/// When the framebuffer is larger than a pixel map can be.
pub fn nine_vectors(framebuffer: &DeepFramebuffer, geometry: &Geometry, weights: [f32; 3]) -> Result<Features, Error> {
    let (width, height) = framebuffer.size();
    let valid: Vec<u8> = framebuffer.triangle.iter().map(|t| u8::from(*t != NONE)).collect();
    let frame = Frame {
        width: width as u32,
        height: height as u32,
        position: bytemuck::cast_slice(&framebuffer.position),
        normal: bytemuck::cast_slice(&framebuffer.normal),
        albedo: bytemuck::cast_slice(&framebuffer.albedo),
        valid: &valid,
    };
    let centre = geometry.centre.as_dvec3().to_array();
    let [position, normal, albedo] = weights;
    Features::new(&frame, centre, f64::from(geometry.diagonal), Weights { position, normal, albedo })
        .map_err(|e| Error::invalid(e.to_string()))
}

/// The weighted 9-vector of one surface point, comparable with those of [`nine_vectors`].
pub fn nine_vector(surface: &Surface, geometry: &Geometry, weights: [f32; 3]) -> [f32; 9] {
    let [position, normal, albedo] = weights;
    let relative = (surface.position.as_dvec3() - geometry.centre.as_dvec3()) / f64::from(geometry.diagonal);
    let p = relative.as_vec3() * position;
    let (n, a) = (surface.normal * normal, surface.reflectance.albedo * albedo);
    [p.x, p.y, p.z, n.x, n.y, n.z, a.x, a.y, a.z]
}
