//! Shapes made of triangles, for generated scenes: closed solids, a sheet, and their shading normals.
//!
//! Every solid is closed and its triangles are counter-clockwise seen from outside; metres, +Y up.

mod arrange;
mod extrude;
mod plait;
mod sheet;
mod solids;

pub use arrange::{Arrangement, Material};
pub use extrude::extruded;
pub use plait::plaited_trefoil;
pub use sheet::{Displacement, sheet};
pub use solids::{ball, bevelled_box, lathe, ring};

use glam::{Affine3A, Vec3};

/// Points and the triangles between them; neighbouring triangles share their points.
#[derive(Clone, Debug, Default)]
pub struct Solid {
    /// Corners.
    pub position: Vec<Vec3>,
    /// Rows of `position`, counter-clockwise seen from outside.
    pub triangle: Vec<[u32; 3]>,
}

impl Solid {
    /// The solid moved by a rigid or scaling transform that does not mirror.
    pub fn moved(mut self, by: Affine3A) -> Self {
        self.position.iter_mut().for_each(|p| *p = by.transform_point3(*p));
        self
    }

    /// The solid moved along a vector.
    pub fn at(self, place: Vec3) -> Self {
        self.moved(Affine3A::from_translation(place))
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangle.extend([[a, b, c], [a, c, d]]);
    }
}

/// Triangles with what shading needs of them.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// `[vertex]` corners.
    pub position: Vec<Vec3>,
    /// `[vertex]` unit normals.
    pub normal: Vec<Vec3>,
    /// `[vertex]` linear colours, to be multiplied with the material's.
    pub colour: Vec<Vec3>,
    /// Rows of the vertices.
    pub triangle: Vec<[u32; 3]>,
}

impl Mesh {
    /// Adds a solid of one colour. Edges at which the surface turns by less than `crease` degrees are
    /// shaded smoothly, others stay sharp.
    pub fn add(&mut self, solid: &Solid, crease: f32, colour: Vec3) {
        let faces: Vec<Vec3> = solid.triangle.iter().map(|t| area_vector(solid, t)).collect();
        let mut around = vec![Vec::new(); solid.position.len()];
        for (face, triangle) in solid.triangle.iter().enumerate() {
            triangle.iter().for_each(|&v| around[v as usize].push(face));
        }
        let least = libm::cosf(crease.to_radians());
        let mut made: Vec<Vec<(Vec3, u32)>> = vec![Vec::new(); solid.position.len()];
        for (face, triangle) in solid.triangle.iter().enumerate() {
            let corners = triangle.map(|v| {
                let own = faces[face].normalize_or_zero();
                let smooth = around[v as usize].iter().map(|&f| faces[f]);
                let sum: Vec3 = smooth.filter(|f| f.normalize_or_zero().dot(own) >= least).sum();
                let normal = sum.normalize_or(own);
                let known =
                    made[v as usize].iter().find(|(n, _)| *n == normal).map(|(_, vertex)| *vertex);
                known.unwrap_or_else(|| {
                    let vertex = self.position.len() as u32;
                    self.position.push(solid.position[v as usize]);
                    self.normal.push(normal);
                    self.colour.push(colour);
                    made[v as usize].push((normal, vertex));
                    vertex
                })
            });
            self.triangle.push(corners);
        }
    }
}

/// Along the triangle's normal, twice its area long.
fn area_vector(solid: &Solid, triangle: &[u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|v| solid.position[v as usize]);
    (b - a).cross(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fails unless every edge has one triangle on either side, no triangle is without area, and the
    /// normals point outward; returns the volume.
    pub(super) fn assert_closed(name: &str, solid: &Solid) -> f32 {
        let mut edges: Vec<[u32; 2]> =
            solid.triangle.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        edges.sort_unstable();
        assert!(edges.windows(2).all(|w| w[0] != w[1]), "{name}: an edge is used twice");
        for [a, b] in &edges {
            assert!(edges.binary_search(&[*b, *a]).is_ok(), "{name}: edge {a} {b} is open");
        }
        assert!(solid.position.iter().all(|p| p.is_finite()), "{name}");
        let mut volume = 0.0;
        for t in &solid.triangle {
            let [a, b, c] = t.map(|v| solid.position[v as usize].as_dvec3());
            assert!((b - a).cross(c - a).length() > 1e-9, "{name}: {t:?} has no area");
            volume += a.dot(b.cross(c)) / 6.0;
        }
        assert!(volume > 0.0, "{name} is inside out: {volume}");
        volume as f32
    }

    #[test]
    fn creases_decide_between_flat_and_smooth() {
        let cube = bevelled_box(Vec3::ZERO, Vec3::ONE, 0.1);
        let vertices = |crease| {
            let mut mesh = Mesh::default();
            mesh.add(&cube, crease, Vec3::ONE);
            assert!(mesh.normal.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
            mesh.position.len()
        };
        assert_eq!(vertices(80.0), 24);
        assert_eq!(vertices(10.0), 6 * 4 + 12 * 4 + 8 * 3);
    }
}
