//! The posed scene of one frame: hierarchies to trace (`rays` asks them) and surfaces to shade (`face`). Derived, never stored.

mod face;
mod rays;

pub use face::{Face, Surface};

use super::posing::posed_vertices;
use super::visibility::{Blas, Build, Instance, World};
use crate::data::{Geometry, Materials, Poses, alpha, instance};
use crate::node::{Ctx, Digest, Error, Item};
use glam::{Affine3A, Mat3, Mat4, Vec3};
use std::sync::Arc;

/// Triangles of repeated meshes that are copied rather than instanced; a copy takes some 100 bytes a triangle.
const COPIES: u64 = 1 << 19;

/// Vertices of a deforming instance in world space, the mesh's range only.
type Deformed = Option<(Vec<Vec3>, Vec<Vec3>)>;

/// The posed scene of one frame. Triangles are numbered as [`Geometry`] says.
pub struct Stage {
    geometry: Item<Geometry>,
    materials: Item<Materials>,
    world: Arc<World>,
    matrix: Vec<Mat4>,
    /// For each instance: the matrix of its normals, and whether its matrix mirrors.
    normal_matrix: Vec<(Mat3, bool)>,
    deformed: Vec<Deformed>,
    /// First world-level triangle of each instance, and the total at the end.
    first: Vec<u32>,
    /// Runs of the hierarchy's own numbering: (first number there, first triangle here), sorted.
    runs: Vec<(u32, u32)>,
}

impl Stage {
    /// The stage of one frame, built once for all who ask for the same frame.
    ///
    /// # Errors
    /// When the parts do not belong together.
    pub fn of(
        ctx: &Ctx,
        geometry: &Item<Geometry>,
        materials: &Item<Materials>,
        poses: &Item<Poses>,
    ) -> Result<Arc<Stage>, Error> {
        let key = [geometry.digest(), materials.digest(), poses.digest()];
        ctx.derive(&key, || {
            let stage = Stage::build(ctx, geometry, materials, poses)?;
            let bytes = stage.bytes();
            Ok((stage, bytes))
        })
    }

    fn build(
        ctx: &Ctx,
        geometry: &Item<Geometry>,
        materials: &Item<Materials>,
        poses: &Item<Poses>,
    ) -> Result<Stage, Error> {
        let instances = &geometry.instance;
        if instances.len() != poses.matrix.len() {
            let what = format!(
                "{} instances but {} poses: they are of different scenes",
                instances.len(),
                poses.matrix.len()
            );
            return Err(Error::invalid(what));
        }
        let matrix: Vec<Mat4> = poses.matrix.iter().map(Mat4::from_cols_array).collect();
        let mut first = vec![0_u32];
        for &[mesh, ..] in instances.iter() {
            first.push(first[first.len() - 1] + geometry.mesh[mesh as usize][1]);
        }
        let deformed: Vec<Deformed> = (0..instances.len())
            .map(|i| {
                (instances[i][2] == instance::DEFORMING)
                    .then(|| posed_vertices(geometry, poses, i))
                    .transpose()
            })
            .collect::<Result<_, Error>>()?;
        let mut stage = Stage {
            geometry: geometry.clone(),
            materials: materials.clone(),
            world: Arc::new(World::new(Vec::new())),
            normal_matrix: matrix.iter().map(normal_matrix).collect(),
            matrix,
            deformed,
            first,
            runs: Vec::new(),
        };
        let parts = stage.place(ctx)?;
        stage.world = Arc::new(World::new(parts));
        Ok(stage)
    }

    /// The instances of the hierarchy: what stands still becomes one hierarchy in world space, which is faster to
    /// trace than hundreds that overlap; every other mesh has its own in mesh space, built once a shot; what deforms
    /// is built anew for each pose.
    fn place(&mut self, ctx: &Ctx) -> Result<Vec<Instance>, Error> {
        let geometry = self.geometry.clone();
        let triangles: Vec<u32> = geometry.mesh.iter().map(|mesh| mesh[1]).collect();
        let merged = merged_meshes(&triangles, &geometry.instance);
        let fixed = |i: &usize| {
            let [mesh, _, motion] = geometry.instance[*i];
            motion == instance::STATIC && merged[mesh as usize]
        };
        let (fixed, free): (Vec<usize>, Vec<usize>) = (0..geometry.instance.len()).partition(fixed);
        let mut parts = Vec::new();
        let mut number = 0;
        if !fixed.is_empty() {
            for &i in &fixed {
                self.runs.push((number, self.first[i]));
                number += self.first[i + 1] - self.first[i];
            }
            let blas = self.fixed_hierarchy(ctx, &fixed)?;
            parts.push(Instance { blas, to_world: Affine3A::IDENTITY, first_triangle: 0 });
        }
        for i in free {
            let (blas, to_world) = match self.deformed[i] {
                Some(_) => (self.build_hierarchy(&[i], Build::Fast, ctx), Affine3A::IDENTITY),
                None => (self.mesh_hierarchy(ctx, i)?, Affine3A::from_mat4(self.matrix[i])),
            };
            self.runs.push((number, self.first[i]));
            parts.push(Instance { blas, to_world, first_triangle: number });
            number += self.first[i + 1] - self.first[i];
        }
        Ok(parts)
    }

    fn fixed_hierarchy(&self, ctx: &Ctx, fixed: &[usize]) -> Result<Arc<Blas>, Error> {
        let places: Vec<[f32; 16]> =
            fixed.iter().map(|&i| self.matrix[i].to_cols_array()).collect();
        let places = Digest::of(bytemuck::cast_slice(&places));
        let key = [self.geometry.digest(), self.materials.digest(), places];
        let shared = ctx.derive(&key, || {
            let blas = self.build_hierarchy(fixed, Build::Medium, ctx);
            let bytes = blas.bytes();
            Ok((Shared(blas), bytes))
        })?;
        Ok(Arc::clone(&shared.0))
    }

    fn mesh_hierarchy(&self, ctx: &Ctx, i: usize) -> Result<Arc<Blas>, Error> {
        let mesh = Digest::of(&self.geometry.instance[i][0].to_le_bytes());
        let key = [self.geometry.digest(), self.materials.digest(), mesh];
        let shared = ctx.derive(&key, || {
            let range = self.geometry.mesh[self.geometry.instance[i][0] as usize];
            let blas = self.hierarchy_of(
                (range[0]..range[0] + range[1]).map(|t| {
                    (
                        t,
                        self.geometry.triangle[t as usize]
                            .map(|v| self.geometry.position[v as usize]),
                    )
                }),
                Build::Medium,
                ctx,
            );
            let bytes = blas.bytes();
            Ok((Shared(blas), bytes))
        })?;
        Ok(Arc::clone(&shared.0))
    }

    fn build_hierarchy(&self, instances: &[usize], build: Build, ctx: &Ctx) -> Arc<Blas> {
        let triangles = instances.iter().flat_map(|&i| {
            let range = self.geometry.mesh[self.geometry.instance[i][0] as usize];
            (0..range[1]).map(move |t| (range[0] + t, self.corners(i, t)))
        });
        self.hierarchy_of(triangles, build, ctx)
    }

    fn hierarchy_of(
        &self,
        triangles: impl Iterator<Item = (u32, [Vec3; 3])>,
        build: Build,
        ctx: &Ctx,
    ) -> Arc<Blas> {
        let mut absent = 0;
        let (corners, masked): (Vec<_>, Vec<_>) = triangles
            .map(|(t, corners)| {
                let mode = self.materials.alpha_mode
                    [self.geometry.triangle_material[t as usize] as usize][0];
                // Light passes through what is absent: a triangle of no extent keeps its number and
                // is never hit.
                let gone = mode == alpha::ABSENT;
                absent += usize::from(gone);
                (if gone { [Vec3::NAN; 3] } else { corners }, mode == alpha::MASK)
            })
            .unzip();
        let blas = Blas::new(&corners, &masked, build);
        let skipped = blas.skipped().saturating_sub(absent);
        if skipped > 0 {
            ctx.note(format!("{skipped} triangles without area are never hit"));
        }
        Arc::new(blas)
    }

    fn bytes(&self) -> usize {
        let vertices = |d: &Deformed| d.as_ref().map_or(0, |(p, n)| 12 * (p.len() + n.len()));
        self.world.bytes()
            + self.deformed.iter().map(vertices).sum::<usize>()
            + 64 * self.matrix.len()
    }

    /// Length by which shadow rays are lifted off surfaces, metres.
    pub fn bias(&self) -> f32 {
        self.geometry.bias
    }

    /// The shapes this stage poses.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Number of world-level triangles.
    pub fn triangles(&self) -> u32 {
        self.first[self.first.len() - 1]
    }

    /// Material of a world-level triangle.
    pub fn material(&self, triangle: u32) -> usize {
        let (i, local) = self.locate(triangle);
        let mesh = self.geometry.mesh[self.geometry.instance[i][0] as usize];
        self.geometry.triangle_material[(mesh[0] + local) as usize] as usize
    }

    /// The three corners of a world-level triangle, world space.
    pub fn triangle(&self, triangle: u32) -> [Vec3; 3] {
        let (i, local) = self.locate(triangle);
        self.corners(i, local)
    }

    /// Area of a world-level triangle, square metres; zero for what is absent or not finite.
    pub fn area(&self, triangle: u32) -> f32 {
        if self.materials.alpha_mode[self.material(triangle)][0] == alpha::ABSENT {
            return 0.0;
        }
        let [a, b, c] = self.triangle(triangle);
        let area = 0.5 * (b - a).cross(c - a).length();
        if area.is_finite() { area } else { 0.0 }
    }

    fn locate(&self, triangle: u32) -> (usize, u32) {
        let i = self.first.partition_point(|&f| f <= triangle) - 1;
        (i, triangle - self.first[i])
    }

    fn corners(&self, i: usize, local: u32) -> [Vec3; 3] {
        let mesh = self.geometry.mesh[self.geometry.instance[i][0] as usize];
        let corner = self.geometry.triangle[(mesh[0] + local) as usize];
        match &self.deformed[i] {
            Some((positions, _)) => corner.map(|v| positions[(v - mesh[2]) as usize]),
            None => {
                corner.map(|v| self.matrix[i].transform_point3(self.geometry.position[v as usize]))
            }
        }
    }
}

/// Which meshes' static instances share one hierarchy: those used once, and of the others, smallest first, as many as
/// take no more than [`COPIES`] triangles together when each instance has its own copy.
fn merged_meshes(triangles: &[u32], instances: &[[u32; 3]]) -> Vec<bool> {
    let mut uses = vec![0_u64; triangles.len()];
    instances.iter().for_each(|i| uses[i[0] as usize] += 1);
    let copies = |mesh: usize| uses[mesh] * u64::from(triangles[mesh]);
    let mut repeated: Vec<usize> = (0..uses.len()).filter(|&mesh| uses[mesh] > 1).collect();
    repeated.sort_by_key(|&mesh| (copies(mesh), mesh));
    let mut merged = vec![true; uses.len()];
    let mut total = 0;
    for mesh in repeated {
        total += copies(mesh);
        merged[mesh] = total <= COPIES;
    }
    merged
}

/// The cofactor matrix: the inverse transpose up to a positive factor, and finite for any matrix.
fn normal_matrix(matrix: &Mat4) -> (Mat3, bool) {
    let m = Mat3::from_mat4(*matrix);
    let cofactor = Mat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    let mirrored = m.determinant() < 0.0;
    (if mirrored { -cofactor } else { cofactor }, mirrored)
}

/// A hierarchy under a key of its own; the stage's own key is of another type.
struct Shared(Arc<Blas>);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_meshes_are_copied_and_large_ones_instanced() {
        let columns = [[0, 0, 0]; 12];
        let trees = [[1, 0, 0]; 80];
        let instances = [&columns[..], &trees, &[[2, 0, 0]]].concat();
        assert_eq!(merged_meshes(&[1200, 100_000, 9_000_000], &instances), [true, false, true]);
        // 12 x 43,691 triangles are 4 more than there is room for.
        assert_eq!(merged_meshes(&[43_691, 1, 1], &columns), [false, true, true]);
        assert_eq!(merged_meshes(&[43_690, 1, 1], &columns), [true, true, true]);
    }
}
