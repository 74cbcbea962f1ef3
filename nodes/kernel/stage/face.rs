//! Surfaces of the posed scene: what a triangle is like at a point.

use super::Stage;
use crate::kernel::brdf::Reflectance;
use crate::kernel::texture::{self, Texture};
use glam::{Vec2, Vec3};

/// A surface point with everything shading needs. Normals are on the front of the triangle.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// World space, metres.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Unit normal of the triangle.
    pub facet: Vec3,
    /// How it reflects, on either side.
    pub reflectance: Reflectance,
    /// Radiance emitted from the front, W/(m^2 sr).
    pub emitted: Vec3,
    /// Whether the back emits too.
    pub double_sided: bool,
}

impl Surface {
    /// Reflectance of a point that stands for its surface in all directions: what metals and glosses
    /// reflect is spread over them, so that its energy is kept.
    pub fn spread_albedo(&self) -> Vec3 {
        (self.reflectance.albedo + self.reflectance.specular).min(Vec3::ONE)
    }

    /// The same point with its normals on the side of `direction` (pointing away from the surface),
    /// and the emission of that side.
    pub fn facing(mut self, direction: Vec3) -> Self {
        if self.facet.dot(direction) < 0.0 {
            self.facet = -self.facet;
            self.normal = -self.normal;
            if !self.double_sided {
                self.emitted = Vec3::ZERO;
            }
        }
        self
    }
}

/// A triangle of the posed scene, with all that does not differ from point to point of it: points of one face after the
/// other take less work than points of many.
pub struct Face<'a> {
    stage: &'a Stage,
    /// Its number in the world.
    pub triangle: u32,
    instance: usize,
    material: usize,
    /// Its vertices in the geometry.
    vertices: [u32; 3],
    /// Their positions, world space, metres.
    corners: [Vec3; 3],
    /// Unit normal, on its front.
    pub facet: Vec3,
    /// Its shading where that is the same everywhere.
    plain: Option<Shading>,
}

/// How a point reflects and emits.
#[derive(Clone, Copy)]
struct Shading {
    reflectance: Reflectance,
    emitted: Vec3,
    double_sided: bool,
}

impl Stage {
    /// A world-level triangle.
    pub fn face(&self, triangle: u32) -> Face<'_> {
        let (i, local) = self.locate(triangle);
        let mesh = self.geometry.mesh[self.geometry.instance[i][0] as usize];
        let t = (mesh[0] + local) as usize;
        let corners = self.corners(i, local);
        let [a, b, c] = corners;
        let facet = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let (_, mirrored) = self.normal_matrix[i];
        let vertices = self.geometry.triangle[t];
        let material = self.geometry.triangle_material[t] as usize;
        let untextured = self.materials.material_texture[material].iter().all(|index| *index < 0.0);
        let tint = self.one_colour(vertices).filter(|_| untextured);
        Face {
            stage: self,
            triangle,
            instance: i,
            material,
            vertices,
            corners,
            facet: if mirrored { -facet } else { facet },
            plain: tint.map(|tint| self.shade(material, Vec2::ZERO, tint)),
        }
    }

    /// The surface at barycentric weights `u`, `v` of a triangle's second and third corner.
    pub fn surface(&self, triangle: u32, u: f32, v: f32) -> Surface {
        self.face(triangle).surface(u, v)
    }

    /// The colour of three vertices that have the same.
    fn one_colour(&self, corner: [u32; 3]) -> Option<[f32; 4]> {
        if self.geometry.colour.is_empty() {
            return Some([1.0; 4]);
        }
        let [a, b, c] = corner.map(|v| self.geometry.colour[v as usize]);
        (a == b && b == c).then_some(a)
    }

    pub(super) fn vertex_colour(&self, corner: [u32; 3], weights: [f32; 3]) -> [f32; 4] {
        if self.geometry.colour.is_empty() {
            return [1.0; 4];
        }
        let mut blend = [0.0; 4];
        for (vertex, weight) in corner.into_iter().zip(weights) {
            let colour = self.geometry.colour[vertex as usize];
            (0..4).for_each(|c| blend[c] += colour[c] * weight);
        }
        blend
    }

    fn shade(&self, m: usize, uv: Vec2, tint: [f32; 4]) -> Shading {
        let materials = &*self.materials;
        let base = texture::sample(materials, m, Texture::BaseColour, uv);
        let factor = materials.base_colour[m];
        let base =
            Vec3::from_array([0, 1, 2].map(|c| (factor[c] * tint[c] * base[c]).clamp(0.0, 1.0)));
        let rough = texture::sample(materials, m, Texture::MetallicRoughness, uv);
        let [metallic, roughness] = materials.metallic_roughness[m];
        let (metallic, roughness) =
            ((metallic * rough[2]).clamp(0.0, 1.0), (roughness * rough[1]).clamp(0.0, 1.0));
        let dielectric = 0.04 * materials.specular_factor[m];
        let reflectance = Reflectance {
            albedo: base * (1.0 - metallic),
            specular: Vec3::splat(dielectric).lerp(base, metallic),
            roughness,
        };
        let glow = texture::sample(materials, m, Texture::Emission, uv);
        let emitted = materials.emissive[m] * Vec3::from_array([glow[0], glow[1], glow[2]]);
        Shading { reflectance, emitted, double_sided: materials.double_sided[m] != 0 }
    }
}

impl Face<'_> {
    /// The position at barycentric weights `u`, `v` of the second and third corner, world space, metres.
    pub fn position(&self, u: f32, v: f32) -> Vec3 {
        let [a, b, c] = self.corners;
        a + (b - a) * u + (c - a) * v
    }

    /// The surface at barycentric weights `u`, `v` of the second and third corner.
    pub fn surface(&self, u: f32, v: f32) -> Surface {
        let Face { stage, instance, material, vertices, facet, .. } = *self;
        let weights = [1.0 - u - v, u, v];
        let blend = |at: [Vec3; 3]| at[0] * weights[0] + at[1] * weights[1] + at[2] * weights[2];
        let geometry = &stage.geometry;
        let normal = match &stage.deformed[instance] {
            Some((_, normals)) => {
                let first = geometry.mesh[geometry.instance[instance][0] as usize][2];
                blend(vertices.map(|v| normals[(v - first) as usize]))
            }
            None => {
                stage.normal_matrix[instance].0
                    * blend(vertices.map(|v| geometry.normal[v as usize]))
            }
        };
        let normal = if normal.is_finite() { normal.normalize_or(facet) } else { facet };
        let normal = if normal.dot(facet) < 0.0 { -normal } else { normal };
        let Shading { reflectance, emitted, double_sided } = self.plain.unwrap_or_else(|| {
            let uv = vertices.map(|v| geometry.uv[v as usize]);
            let uv = uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2];
            stage.shade(material, uv, stage.vertex_colour(vertices, weights))
        });
        Surface { position: self.position(u, v), normal, facet, reflectance, emitted, double_sided }
    }
}
