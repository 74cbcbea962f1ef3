//! Meshes: the triangles and vertices of their primitives.

use super::accessors::{Accessor, Accessors};
use super::container::Document;
use super::materials::Materials;
use super::notes::Notes;
use super::{morphs, skinning, topology};
use crate::node::Error;
use glam::{Vec2, Vec3};
use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

/// The vertex, triangle and primitive columns of a scene.
#[derive(Default)]
pub(super) struct Meshes {
    pub(super) position: Vec<Vec3>,
    pub(super) normal: Vec<Vec3>,
    pub(super) uv: Vec<Vec2>,
    pub(super) colour: Vec<[f32; 4]>,
    pub(super) joint: Vec<[u16; 4]>,
    pub(super) weight: Vec<[f32; 4]>,
    pub(super) triangle: Vec<[u32; 3]>,
    pub(super) primitive: Vec<[u32; 6]>,
    pub(super) morph_target: Vec<[u32; 3]>,
    pub(super) morph_position: Vec<Vec3>,
    pub(super) morph_normal: Vec<Vec3>,
    /// Some primitive has glTF's default material, which is the row after the file's own.
    pub(super) default_material: bool,
}

/// What instances and animations must know of one mesh.
pub(super) struct Summary {
    /// Whether it has triangles.
    pub(super) drawn: bool,
    /// Number of morph targets.
    pub(super) targets: usize,
    /// One more than the largest joint number with a weight; none when no primitive is skinned.
    pub(super) joints: Option<u32>,
}

/// One primitive while it is read.
pub(super) struct Part<'a> {
    pub(super) accessors: &'a Accessors<'a>,
    pub(super) primitive: &'a json::mesh::Primitive,
    pub(super) notes: &'a Notes,
    /// `meshes[1].primitives[0]`
    pub(super) place: String,
    /// Vertices of the accessors that triangles use, in their order.
    pub(super) rows: Vec<u32>,
    /// Elements of every vertex accessor.
    pub(super) count: usize,
}

impl<'a> Part<'a> {
    pub(super) fn wrong(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(format!("{}: {what}", self.place))
    }

    /// The accessor of an attribute, if there is one; as long as that of the positions.
    pub(super) fn attribute(&self, semantic: Semantic) -> Result<Option<Accessor<'a>>, Error> {
        let name = Checked::Valid(semantic);
        match self.primitive.attributes.get(&name) {
            None => Ok(None),
            Some(index) => self.vertices(index.value(), &name.to_string()).map(Some),
        }
    }

    /// A vertex accessor, as long as that of the positions.
    pub(super) fn vertices(&self, index: usize, name: &str) -> Result<Accessor<'a>, Error> {
        let accessor =
            self.accessors.open(index).map_err(|e| self.wrong(format_args!("{name}: {e}")))?;
        if accessor.count == self.count {
            return Ok(accessor);
        }
        let both = format!("{} elements, but POSITION has {}", accessor.count, self.count);
        Err(self.wrong(format_args!("{name}: accessors[{index}] has {both}")))
    }

    /// Vectors of `N` numbers for the used vertices.
    pub(super) fn vectors<const N: usize>(
        &self,
        accessor: &Accessor<'_>,
        normalised: bool,
        name: &str,
    ) -> Result<Vec<[f32; N]>, Error> {
        accessor
            .vectors(normalised, Some(&self.rows))
            .map_err(|e| self.wrong(format_args!("{name}: {e}")))
    }
}

/// A row number or row count; `what` names the table.
pub(super) fn row(rows: usize, what: &str) -> Result<u32, Error> {
    u32::try_from(rows)
        .map_err(|_| Error::invalid(format!("the scene has more than {} {what}", u32::MAX)))
}

impl Meshes {
    /// Appends mesh `mesh` of the file as number `number` of the scene.
    pub(super) fn append(
        &mut self,
        document: &Document,
        accessors: &Accessors<'_>,
        materials: &Materials,
        notes: &Notes,
        (mesh, number): (usize, u32),
    ) -> Result<Summary, Error> {
        let found = document
            .meshes
            .get(mesh)
            .ok_or_else(|| Error::invalid(format!("meshes[{mesh}] does not exist")))?;
        let mut summary = Summary { drawn: false, targets: 0, joints: None };
        for (i, primitive) in found.primitives.iter().enumerate() {
            summary.targets = summary.targets.max(primitive.targets.as_ref().map_or(0, Vec::len));
            let place = format!("meshes[{mesh}].primitives[{i}]");
            let mut part = Part { accessors, primitive, notes, place, rows: Vec::new(), count: 0 };
            let material = match primitive.material {
                None => materials.uv_set.len(),
                Some(index) if index.value() < materials.uv_set.len() => index.value(),
                Some(index) => {
                    return Err(part.wrong(format_args!("materials[{index}] does not exist")));
                }
            };
            let first = (self.triangle.len(), self.position.len());
            if !self.append_triangles(&mut part)? {
                continue;
            }
            self.append_vertices(&part, materials.uv_set.get(material).copied().flatten())?;
            let joints = skinning::append(self, &part)?;
            summary.joints = summary.joints.max(joints);
            morphs::append(self, &part)?;
            summary.drawn = true;
            self.default_material |= primitive.material.is_none();
            self.primitive.push([
                number,
                row(material, "materials")?,
                row(first.0, "triangles")?,
                row(self.triangle.len() - first.0, "triangles")?,
                row(first.1, "vertices")?,
                row(self.position.len() - first.1, "vertices")?,
            ]);
            row(self.position.len(), "vertices")?;
        }
        Ok(summary)
    }

    /// Appends the triangles and positions; false when the primitive has no triangles to show.
    fn append_triangles(&mut self, part: &mut Part<'_>) -> Result<bool, Error> {
        let primitive = part.primitive;
        let Checked::Valid(mode) = primitive.mode else {
            return Err(part.wrong("the mode is unknown"));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            part.notes.count("primitives of points or lines left out", &part.place);
            return Ok(false);
        }
        let Some(index) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
            part.notes.count("primitives without positions left out", &part.place);
            return Ok(false);
        };
        let others = primitive.extensions.as_ref().map(|e| &e.others);
        if others.is_some_and(|o| o.contains_key("KHR_draco_mesh_compression"))
            && !part.accessors.has_data(index.value())
        {
            return Err(
                part.wrong("compressed with KHR_draco_mesh_compression, which is not supported")
            );
        }
        let position = part
            .accessors
            .open(index.value())
            .map_err(|e| part.wrong(format_args!("POSITION: {e}")))?;
        part.count = position.count;
        let vertices = row(position.count, "vertices")?;
        let indices = match primitive.indices {
            None => (0..vertices).collect(),
            Some(index) => {
                let named = |e: Error| part.wrong(format_args!("indices: {e}"));
                let indices =
                    part.accessors.open(index.value()).and_then(|a| a.indices()).map_err(named)?;
                if let Some(past) = indices.iter().find(|i| **i >= vertices) {
                    let what =
                        format!("accessors[{index}] has vertex {past}, but there are {vertices}");
                    return Err(part.wrong(format_args!("indices: {what}")));
                }
                indices
            }
        };
        let (triangles, left) = topology::triangles(mode, &indices).unwrap_or_default();
        part.notes.add("indices that make no whole triangle left out", left, &part.place);
        if triangles.is_empty() {
            return Ok(false);
        }
        let base = row(self.position.len(), "vertices")?;
        let renumbered = used_rows(&triangles, position.count);
        part.rows = renumbered.0;
        self.triangle.extend(
            triangles.iter().map(|t| t.map(|v| base.saturating_add(renumbered.1[v as usize]))),
        );
        let positions: Vec<[f32; 3]> = part.vectors(&position, false, "POSITION")?;
        self.position.extend(positions.into_iter().map(Vec3::from));
        Ok(true)
    }

    fn append_vertices(&mut self, part: &Part<'_>, uv_set: Option<u32>) -> Result<(), Error> {
        let end = self.position.len();
        if let Some(accessor) = part.attribute(Semantic::Normals)? {
            let normals: Vec<[f32; 3]> = part.vectors(&accessor, false, "NORMAL")?;
            self.normal.extend(normals.into_iter().map(|n| unit(Vec3::from(n))));
        }
        self.normal.resize(end, Vec3::ZERO);

        if let Some(accessor) = part.attribute(Semantic::TexCoords(uv_set.unwrap_or(0)))? {
            let uvs: Vec<[f32; 2]> = part.vectors(&accessor, true, "TEXCOORD")?;
            self.uv.extend(uvs.into_iter().map(Vec2::from));
        } else if uv_set.is_some() {
            part.notes.count("textured primitives without texture coordinates", &part.place);
        }
        self.uv.resize(end, Vec2::ZERO);

        if let Some(accessor) = part.attribute(Semantic::Colors(0))? {
            self.colour.resize(end - part.rows.len(), [1.0; 4]);
            if accessor.is_wide(3) {
                let colours: Vec<[f32; 3]> = part.vectors(&accessor, true, "COLOR_0")?;
                self.colour.extend(colours.into_iter().map(|[r, g, b]| [r, g, b, 1.0]));
            } else {
                self.colour.extend(part.vectors::<4>(&accessor, true, "COLOR_0")?);
            }
        } else if !self.colour.is_empty() {
            self.colour.resize(end, [1.0; 4]);
        }
        Ok(())
    }
}

fn unit(normal: Vec3) -> Vec3 {
    let wide = normal.as_dvec3();
    let length = wide.length();
    if length > 0.0 { (wide / length).as_vec3() } else { Vec3::ZERO }
}

/// The vertices that triangles use, in increasing order, and the place of each among them. Files
/// share one large vertex buffer among many primitives, of which each uses a part.
fn used_rows(triangles: &[[u32; 3]], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut place = vec![0_u32; count];
    for vertex in triangles.as_flattened() {
        place[*vertex as usize] = 1;
    }
    let mut rows = Vec::new();
    for (vertex, place) in place.iter_mut().enumerate() {
        if *place == 1 {
            *place = rows.len() as u32;
            rows.push(vertex as u32);
        }
    }
    (rows, place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unused_vertices_are_dropped_in_order() {
        let (rows, place) = used_rows(&[[4, 1, 4], [1, 3, 3]], 6);
        assert_eq!(rows, [1, 3, 4]);
        assert_eq!((place[1], place[3], place[4]), (0, 1, 2));
    }

    #[test]
    fn tiny_normals_are_normalised() {
        assert_eq!(unit(Vec3::new(0.0, 1e-30, 0.0)), Vec3::Y);
        assert_eq!(unit(Vec3::ZERO), Vec3::ZERO);
    }
}
