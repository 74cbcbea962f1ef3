//! The 9-vectors of a deep framebuffer: position, normal and diffuse reflectance
//! (Hašan et al. 2008, section 5, "Pixel mapping computation").

use super::neighbours::{Features, Frame, Weights};
use super::stage::Surface;
use crate::data::{DeepFramebuffer, Geometry, NONE};
use crate::node::{Ctx, Digest, Error, Item};
use std::sync::Arc;

/// The weighted 9-vectors of every pixel, positions relative to the scene's centre and diagonal, made
/// once for all who ask for the same. `weights` are those of position, normal and albedo.
///
/// # Errors
/// When the framebuffer is larger than a pixel map can be.
pub fn nine_vectors(
    ctx: &Ctx,
    framebuffer: &Item<DeepFramebuffer>,
    geometry: &Item<Geometry>,
    weights: [f32; 3],
) -> Result<Arc<Features>, Error> {
    let weighted = Digest::of(bytemuck::cast_slice(&weights));
    ctx.derive(&[framebuffer.digest(), geometry.digest(), weighted], || {
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
        let weights = Weights { position, normal, albedo };
        let features = Features::new(&frame, centre, f64::from(geometry.diagonal), weights);
        let features = features.map_err(|e| Error::invalid(e.to_string()))?;
        Ok((features, 40 * width * height))
    })
}

/// The weighted 9-vector of one surface point, comparable with those of [`nine_vectors`].
pub fn nine_vector(surface: &Surface, geometry: &Geometry, weights: [f32; 3]) -> [f32; 9] {
    let [position, normal, albedo] = weights;
    let relative =
        (surface.position.as_dvec3() - geometry.centre.as_dvec3()) / f64::from(geometry.diagonal);
    let p = relative.as_vec3() * position;
    let (n, a) = (surface.normal * normal, surface.reflectance.albedo * albedo);
    [p.x, p.y, p.z, n.x, n.y, n.z, a.x, a.y, a.z]
}
