//! Instances of meshes, a hierarchy over them, and what may be asked of both.

use super::blocking::Blocker;
use super::hierarchy::{Blas, Bounds, Build, LEAF, Node};
use super::nearest::NearestFrom;
use super::query::{Blocked, Bundle, Closest, dispatch};
use super::single::Ray;
use super::triangle::{Three, dot, splat};
use super::{Ends, Filter, Hit, Hits, build};
use crate::kernel::lanes::Lanes;
use glam::{Affine3A, DMat3, Vec3};
use std::sync::Arc;

/// A mesh at a place.
#[derive(Clone, Debug)]
pub struct Instance {
    /// The mesh.
    pub blas: Arc<Blas>,
    /// From the mesh's frame to the world's.
    pub to_world: Affine3A,
    /// The number in the world of the mesh's triangle 0; the others follow.
    pub first_triangle: u32,
}

/// Instances under a hierarchy of their own. Queries take `&self` and may run on any number of threads.
#[derive(Clone, Debug)]
pub struct World {
    pub(super) nodes: Vec<Node>,
    /// Where walks begin: node 0, or an only instance at once.
    pub(super) root: u32,
    pub(super) bounds: Bounds,
    /// In the order in which `nodes` refers to them.
    pub(super) instances: Vec<Placed>,
    skipped: usize,
}

/// An instance with its inverse.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub(super) blas: Arc<Blas>,
    pub(super) first_triangle: u32,
    /// Absent for the identity.
    pub(super) to_object: Option<ToObject>,
}

/// From the world to a mesh: `rows (x - translation)`. Subtracting first keeps the precision of points near an
/// instance that is far from the world's origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct ToObject {
    rows: [[f32; 3]; 3],
    translation: [f32; 3],
}

impl ToObject {
    /// `None` if the matrix is singular or not finite.
    fn new(to_world: &Affine3A) -> Option<Self> {
        let columns = to_world.matrix3;
        let linear = DMat3::from_cols(
            columns.x_axis.as_dvec3(),
            columns.y_axis.as_dvec3(),
            columns.z_axis.as_dvec3(),
        );
        // Relative to the columns' lengths, so that a small instance is not mistaken for a flat one.
        let volume = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
        let regular = linear.determinant().abs() > 1e-12 * volume;
        let rows = linear.inverse().transpose();
        let rows = [rows.x_axis, rows.y_axis, rows.z_axis].map(|r| r.as_vec3().to_array());
        let finite = to_world.is_finite() && rows.iter().flatten().all(|x| x.is_finite());
        (regular && finite).then(|| Self { rows, translation: to_world.translation.to_array() })
    }

    #[inline(always)]
    pub(super) fn vector(&self, v: [f32; 3]) -> [f32; 3] {
        self.rows.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2])
    }

    /// Eight vectors, each to the bit as [`ToObject::vector`] gives it.
    #[inline(always)]
    pub(super) fn vectors<L: Lanes>(&self, v: Three<L>) -> Three<L> {
        let [x, y, z] = self.rows;
        [dot(splat(x), v), dot(splat(y), v), dot(splat(z), v)]
    }

    #[inline(always)]
    pub(super) fn point(&self, p: [f32; 3]) -> [f32; 3] {
        self.vector(std::array::from_fn(|k| p[k] - self.translation[k]))
    }
}

impl World {
    /// Places `instances`. Those whose matrix is singular, not finite or takes the mesh beyond what
    /// is finite are left out and counted ([`World::skipped`]), those without triangles are left out. No instances at all are legal: nothing is hit.
    #[must_use]
    pub fn new(instances: Vec<Instance>) -> Self {
        let mut placed = Vec::with_capacity(instances.len());
        let mut boxes = Vec::with_capacity(instances.len());
        let mut skipped = 0;
        for Instance { blas, to_world, first_triangle } in instances {
            let Some(to_object) = ToObject::new(&to_world) else {
                skipped += 1;
                continue;
            };
            if blas.nodes.is_empty() {
                continue;
            }
            let identity = to_world == Affine3A::IDENTITY;
            let bounds = if identity { blas.bounds } else { outer_bounds(&blas.bounds, &to_world) };
            if !(bounds.low.is_finite() && bounds.high.is_finite()) {
                skipped += 1;
                continue;
            }
            boxes.push(bounds);
            let to_object = (!identity).then_some(to_object);
            placed.push(Placed { blas, first_triangle, to_object });
        }
        let tree = build::tree(&boxes, 1, Build::Medium);
        let order: Vec<Placed> =
            tree.leaves().flatten().map(|&i| placed[i as usize].clone()).collect();
        let root = if order.len() == 1 { LEAF } else { 0 };
        let bounds = boxes.iter().fold(Bounds::EMPTY, |a, b| a.union(*b));
        Self { nodes: tree.nodes, root, bounds, instances: order, skipped }
    }

    /// How many instances were left out because their matrix is unusable.
    #[must_use]
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// Memory in bytes, that of the meshes included; a mesh placed several times counts once.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let mut meshes: Vec<&Arc<Blas>> = self.instances.iter().map(|i| &i.blas).collect();
        meshes.sort_unstable_by_key(|mesh| Arc::as_ptr(mesh));
        meshes.dedup_by_key(|mesh| Arc::as_ptr(mesh));
        size_of::<Self>()
            + self.nodes.capacity() * size_of::<Node>()
            + self.instances.capacity() * size_of::<Placed>()
            + meshes.iter().map(|mesh| mesh.bytes()).sum::<usize>()
    }

    /// The nearest hit of the ray `origin + t direction` with `t_min < t < t_max` (a `t_min` below 0 counts as 0). The
    /// direction need not have unit length. Of hits at equal t the one with the smaller triangle number is given.
    #[must_use]
    pub fn closest(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_min: f32,
        t_max: f32,
        filter: &Filter,
    ) -> Option<Hit> {
        let ray = Ray {
            origin: origin.to_array(),
            direction: direction.to_array(),
            t_min: t_min.max(0.0),
            t_max,
        };
        dispatch(Closest { world: self, ray, filter })
    }

    /// For each i in `active` the nearest hit of the ray `origin + t direction i` with t strictly between `limits[0][i]`
    /// and `limits[1][i]` (a lower limit below 0 counts as 0), as [`World::closest`] gives it.
    ///
    /// Directions that are near to each other, as those of a tile of pixels, are fastest.
    #[must_use]
    pub fn closest_from(
        &self,
        origin: Vec3,
        directions: &Ends,
        active: u64,
        limits: &[[f32; Ends::CAPACITY]; 2],
        filter: &Filter,
    ) -> Hits {
        dispatch(NearestFrom { world: self, origin, directions, active, limits, filter })
    }

    /// Whether anything lies strictly between two points.
    #[must_use]
    pub fn occluded(&self, from: Vec3, to: Vec3, filter: &Filter) -> bool {
        self.blocked(from, to - from, 1.0, filter)
    }

    /// Whether anything lies ahead of a point, however far.
    #[must_use]
    pub fn occluded_along(&self, from: Vec3, direction: Vec3, filter: &Filter) -> bool {
        self.blocked(from, direction, f32::INFINITY, filter)
    }

    fn blocked(&self, from: Vec3, direction: Vec3, t_max: f32, filter: &Filter) -> bool {
        let ray =
            Ray { origin: from.to_array(), direction: direction.to_array(), t_min: 0.0, t_max };
        dispatch(Blocked { world: self, ray, filter })
    }

    /// For each i in `active`, whether anything lies strictly between `origin` and end i: bit i of the answer. For a
    /// directional light the end is the origin plus a long multiple of the direction.
    ///
    /// Ends that are near to each other, as those of an 8 x 8 tile of pixels or of lights in space order, are fastest.
    /// `blocker` is what blocked rays nearby (the default where nothing is known), and becomes what blocks these.
    #[must_use]
    pub fn occluded_from(
        &self,
        origin: Vec3,
        ends: &Ends,
        active: u64,
        blocker: &mut Blocker,
        filter: &Filter,
    ) -> u64 {
        dispatch(Bundle::<false> { world: self, shared: origin, ends, active, blocker, filter })
    }

    /// For each i in `active`, whether anything lies ahead of start i along the shared `direction`, however far: bit
    /// i of the answer. `blocker` as in [`World::occluded_from`].
    #[must_use]
    pub fn occluded_parallel(
        &self,
        direction: Vec3,
        starts: &Ends,
        active: u64,
        blocker: &mut Blocker,
        filter: &Filter,
    ) -> u64 {
        let (shared, ends) = (direction, starts);
        dispatch(Bundle::<true> { world: self, shared, ends, active, blocker, filter })
    }
}

/// The box around a box that is moved, a little larger than rounding can make it wrong.
fn outer_bounds(inner: &Bounds, to_world: &Affine3A) -> Bounds {
    let matrix = to_world.matrix3;
    let corner = |i: usize| {
        let pick = |bit: usize, axis: usize| {
            let side = if i >> bit & 1 == 0 { inner.low } else { inner.high };
            f64::from(side[axis])
        };
        (matrix.x_axis.as_dvec3() * pick(0, 0)
            + matrix.y_axis.as_dvec3() * pick(1, 1)
            + matrix.z_axis.as_dvec3() * pick(2, 2)
            + to_world.translation.as_dvec3())
        .as_vec3()
    };
    let corners: [Vec3; 8] = std::array::from_fn(corner);
    let bounds = Bounds::around(&corners);
    let margin = bounds.low.abs().max(bounds.high.abs()) * (4.0 * f32::EPSILON);
    Bounds { low: bounds.low - margin, high: bounds.high + margin }
}

impl Placed {
    /// A world ray in the mesh's frame; t stays what it was.
    #[inline(always)]
    pub(super) fn localise(&self, ray: &Ray) -> Ray {
        match &self.to_object {
            None => *ray,
            Some(to) => {
                Ray { origin: to.point(ray.origin), direction: to.vector(ray.direction), ..*ray }
            }
        }
    }
}
