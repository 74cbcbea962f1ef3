//! From surfels to the arrays of a stored tree.

use super::super::half::{self, Losses};
use super::super::hierarchy::{Bound, Surfel};
use super::super::topology::walk::{Fold, fold};
use super::super::topology::{Built, Part, Topology, above};
use super::looks::{Format, Look, Scales};
use super::spheres::{self, COARSE, FINE, Grid, Spheres};
use super::vectors::Vectors;
use super::{Leaves, Looks, Places, Tree, lattice};
use glam::Vec3;

/// The arrays of a tree besides its shape and vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// The sphere of the root.
    pub root: Bound,
    /// Spheres of inner nodes.
    pub spheres: StoredSpheres,
    /// Places of leaves.
    pub places: StoredPlaces,
    /// Codes of leaves.
    pub looks: StoredLooks,
    /// What leaves share.
    pub scales: Scales,
}

/// Owned arrays behind [`Spheres`].
#[derive(Clone, Debug, PartialEq)]
pub enum StoredSpheres {
    /// As [`Spheres::Fine`].
    Fine(Vec<[u16; 4]>, Vec<f32>),
    /// As [`Spheres::Coarse`].
    Coarse(Vec<[u8; 4]>, Vec<u16>, f32),
}

/// Owned arrays behind [`Places`].
#[derive(Clone, Debug, PartialEq)]
pub enum StoredPlaces {
    /// As [`Places::World`].
    World(Vec<Vec3>),
    /// As [`Places::Parent`].
    Parent(Vec<u16>),
}

/// Owned arrays behind [`Looks`].
#[derive(Clone, Debug, PartialEq)]
pub enum StoredLooks {
    /// As [`Looks::Half`].
    Half(Vec<[u16; 7]>),
    /// As [`Looks::Lean`].
    Lean(Vec<[u8; 8]>),
}

/// Encodes a tree that was built over `surfels`, which [`Scales::round`] has rounded. A walk from the root finds each disc, as it is
/// decoded, within all spheres above it.
pub fn encode<T: Topology>(
    built: &Built<T>,
    surfels: &[Surfel],
    scales: Scales,
    format: Format,
) -> Stored {
    let topology = &built.topology;
    let leaf = |k: usize| &surfels[built.order[k] as usize];
    let leaves = 0..topology.leaves();
    // Rounded surfels lose nothing more.
    let mut losses = Losses::default();
    let looks = match format {
        Format::A | Format::B => StoredLooks::Half(
            leaves.clone().map(|k| half_codes(scales.encode(leaf(k), &mut losses))).collect(),
        ),
        Format::C => StoredLooks::Lean(
            leaves.clone().map(|k| lean_codes(scales.encode(leaf(k), &mut losses))).collect(),
        ),
    };
    let mut areas = vec![0.0; topology.inner()];
    let mut sums = Folded {
        leaf: |k: usize| f64::from(leaf(k).area),
        merge: |a, b| a + b,
        close: |i: usize, area| areas[i] = area as f32,
    };
    fold(topology, topology.root(), &mut sums);
    let root = root(built, surfels);
    let fine =
        |codes: Vec<[u32; 4]>| codes.into_iter().map(|code| code.map(|c| c as u16)).collect();
    let (root, spheres, places) = match format {
        Format::A => {
            let codes = spheres::encode(topology, root, |i| built.bounds[i], FINE, |_, _| ());
            let world = leaves.map(|k| leaf(k).position).collect();
            (root, StoredSpheres::Fine(fine(codes), areas), StoredPlaces::World(world))
        }
        Format::B => {
            let (codes, places, root) = relative(built, surfels, root, FINE);
            (root, StoredSpheres::Fine(fine(codes), areas), StoredPlaces::Parent(places))
        }
        Format::C => {
            let (codes, places, root) = relative(built, surfels, root, COARSE);
            let codes = codes.into_iter().map(|code| code.map(|c| c as u8)).collect();
            let scale = half::scale(areas.iter().copied().fold(0.0, f32::max));
            let areas = areas.iter().map(|area| half::encode(area * scale, &mut losses)).collect();
            (root, StoredSpheres::Coarse(codes, areas, scale), StoredPlaces::Parent(places))
        }
    };
    Stored { root, spheres, places, looks, scales }
}

fn half_codes(look: Look) -> [u16; 7] {
    match look {
        Look::Half(codes) => codes,
        Look::Lean(_) => [0; 7],
    }
}

fn lean_codes(look: Look) -> [u8; 8] {
    match look {
        Look::Lean(codes) => codes,
        Look::Half(_) => [0; 8],
    }
}

/// The sphere of the root: of a single surfel that of its disc.
fn root<T: Topology>(built: &Built<T>, surfels: &[Surfel]) -> Bound {
    match built.topology.root().map(|root| built.topology.part(root)) {
        Some(Part::Inner(i)) => built.bounds[i],
        Some(Part::Leaf(_)) => Bound { center: surfels[0].position, radius: surfels[0].radius },
        None => Bound::default(),
    }
}

/// Codes of spheres and of places that are relative to them, and the sphere of the root. A decoded place is off by a share of the radius
/// of its parent, and spheres have to hold that disc as well: they are widened by how far places below can be off, and coded again, until
/// they do. Each time the widening changes by a small share of itself, so that two or three rounds are enough.
fn relative<T: Topology>(
    built: &Built<T>,
    surfels: &[Surfel],
    root: Bound,
    grid: Grid,
) -> (Vec<[u32; 4]>, Vec<u16>, Bound) {
    let topology = &built.topology;
    let top = topology.root().map(|root| topology.part(root));
    let mut wider = vec![0.0f32; topology.inner()];
    let (mut places, mut errors) = (vec![0; topology.leaves()], vec![0.0; topology.leaves()]);
    loop {
        let extra = if let Some(Part::Inner(i)) = top { wider[i] } else { 0.0 };
        let root = widened(root, extra);
        let own = |i: usize| widened(built.bounds[i], wider[i]);
        let codes = spheres::encode(topology, root, own, grid, |k, parent| {
            let place = surfels[built.order[k] as usize].position;
            places[k] = lattice::encode(place, parent);
            let off = (lattice::decode(places[k], parent).as_dvec3() - place.as_dvec3()).length();
            // What it may be in a sphere little different, not what it happens to be in this one: so the next round is the last.
            errors[k] = above(off).max(lattice::ERROR * parent.radius);
        });
        let mut enough = true;
        let mut widest = Folded {
            leaf: |k: usize| errors[k],
            merge: f32::max,
            close: |i: usize, needed: f32| {
                if needed > wider[i] {
                    (wider[i], enough) = (needed * 1.1, false);
                }
            },
        };
        fold(topology, topology.root(), &mut widest);
        if enough {
            return (codes, places, root);
        }
    }
}

fn widened(bound: Bound, by: f32) -> Bound {
    Bound { radius: above(f64::from(bound.radius) + f64::from(by)), ..bound }
}

/// A [`Fold`] over plain values.
struct Folded<L, M, C> {
    leaf: L,
    merge: M,
    close: C,
}

impl<V: Copy, L: Fn(usize) -> V, M: Fn(V, V) -> V, C: FnMut(usize, V)> Fold<V> for Folded<L, M, C> {
    fn leaf(&mut self, leaf: usize) -> V {
        (self.leaf)(leaf)
    }

    fn merge(&mut self, value: &mut V, child: &V, _before: u32) {
        *value = (self.merge)(*value, *child);
    }

    fn close(&mut self, node: usize, value: &mut V) {
        (self.close)(node, *value);
    }
}

impl Stored {
    /// The tree over these arrays, its shape and its vectors.
    pub fn tree<'a, T: Topology>(&'a self, topology: T, vectors: Vectors<'a>) -> Tree<'a, T> {
        let spheres = match &self.spheres {
            StoredSpheres::Fine(codes, areas) => Spheres::Fine(codes, areas),
            StoredSpheres::Coarse(codes, areas, scale) => Spheres::Coarse(codes, areas, *scale),
        };
        let places = match &self.places {
            StoredPlaces::World(places) => Places::World(places),
            StoredPlaces::Parent(codes) => Places::Parent(codes),
        };
        let looks = match &self.looks {
            StoredLooks::Half(codes) => Looks::Half(codes),
            StoredLooks::Lean(codes) => Looks::Lean(codes),
        };
        let leaves = Leaves { places, looks, scales: &self.scales };
        Tree { topology, root: self.root, spheres, leaves, vectors }
    }
}
