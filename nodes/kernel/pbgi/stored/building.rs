//! Trees built from shaded surfels, and stored.

use crate::data::{Array, Lut, PbgiTree, RadiantSurfels};
use crate::kernel::pbgi::bits;
use crate::kernel::pbgi::half::Losses;
use crate::kernel::pbgi::hierarchy::{Surfel, SurfelSet};
use crate::kernel::pbgi::lut::Balanced;
use crate::kernel::pbgi::stream::{Average, Finished, dimensions, fill};
use crate::kernel::pbgi::topology::{Built, Octree, Topology, binary, octree};
use crate::kernel::pbgi::tree::encode::{StoredLooks, StoredPlaces, StoredSpheres, encode};
use crate::kernel::pbgi::tree::looks::{Format, Scales};
use crate::node::Error;

crate::choice! {
    /// Shapes of trees.
    pub enum Shape {
        /// Two children a node, each with half of the surfels.
        Binary = "binary",
        /// Up to eight children a node, one for each octant of a cube.
        Octree = "octree",
    }
}

/// How a tree is made.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// Its shape.
    pub shape: Shape,
    /// How children become their parent.
    pub average: Average,
    /// How leaves are stored.
    pub format: Format,
    /// Bands of the harmonics, 1 to 5; a table's own where there is one.
    pub bands: u32,
}

/// What building a tree told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Account {
    /// Most node vectors that can have lived at once.
    pub live: usize,
    /// What leaves could not hold.
    pub losses: Losses,
}

impl SurfelSet for RadiantSurfels {
    fn count(&self) -> usize {
        self.position.len()
    }

    fn surfel(&self, i: usize) -> Surfel {
        Surfel {
            position: self.position[i],
            normal: self.normal[i],
            radiance: self.radiance[i],
            area: self.area[i],
            radius: self.radius[i],
        }
    }
}

/// Surfels as leaves hold them. They are rounded each time they are asked for: a copy of all would be as large as the tree.
struct Rounded<'a> {
    radiant: &'a RadiantSurfels,
    scales: &'a Scales,
}

impl SurfelSet for Rounded<'_> {
    fn count(&self) -> usize {
        self.radiant.count()
    }

    fn surfel(&self, i: usize) -> Surfel {
        self.scales.rounded(&self.radiant.surfel(i), &mut Losses::default())
    }
}

/// Builds a tree over surfels; with a table, each vector is replaced by its nearest entry as soon as its
/// parent has it (Buchholz and Boubekeur 2012, algorithm 1), the root's too.
///
/// # Errors
/// When there is no surfel, or the table is of no use.
pub fn build(
    radiant: &RadiantSurfels,
    recipe: Recipe,
    lut: Option<&Lut>,
) -> Result<(PbgiTree, Account), Error> {
    if radiant.count() == 0 {
        return Err(Error::invalid("there is no surfel to build a tree of"));
    }
    let scales = Scales::fit(recipe.format, radiant);
    let mut losses = Losses::default();
    for i in 0..radiant.count() {
        scales.encode(&radiant.surfel(i), &mut losses);
    }
    let surfels = Rounded { radiant, scales: &scales };
    let made = match recipe.shape {
        Shape::Binary => {
            finish(binary::build(&surfels), &surfels, recipe, lut, |_| (Vec::new(), Vec::new()))
        }
        Shape::Octree => {
            let links =
                |octree: Octree<'_>| (octree.first.into_owned(), octree.counts.into_owned());
            finish(octree::build(&surfels), &surfels, recipe, lut, links)
        }
    };
    made.map(|(tree, live)| (tree, Account { live, losses }))
}

fn finish<T: Topology>(
    built: Built<T>,
    surfels: &Rounded<'_>,
    recipe: Recipe,
    lut: Option<&Lut>,
    links: impl Fn(T) -> (Vec<[u32; 2]>, Vec<u8>),
) -> Result<(PbgiTree, usize), Error> {
    let topology = &built.topology;
    let leaf = |k: usize| surfels.surfel(built.order[k] as usize);
    let inner = topology.inner();
    let bands = lut.map_or(recipe.bands, |lut| lut.bands);
    let (rows, indices, live) = match lut {
        None => {
            let mut rows = vec![0.0_f32; inner * dimensions(bands)];
            let copy =
                |_: &mut (), done: Finished, row: &mut [f32]| row.copy_from_slice(done.vector);
            let live = fill(topology, leaf, bands, recipe.average, &mut rows, copy);
            (rows, Vec::new(), live)
        }
        Some(lut) => {
            let table = Balanced::new(&lut.entries, dimensions(bands), lut.balance)?;
            let mut places = vec![0_u32; inner];
            // Neighbours in the walk are alike: the last answer is a good guess.
            let place = |hint: &mut u32, done: Finished, row: &mut [u32]| {
                *hint = table.nearest(done.vector, *hint);
                row[0] = *hint;
            };
            let live = fill(topology, leaf, bands, recipe.average, &mut places, place);
            let entries = lut.entries.len() / dimensions(bands);
            (lut.entries.to_vec(), bits::pack(places.into_iter(), bits::width(entries)), live)
        }
    };
    let (stored, topology) = encode(built, surfels, surfels.scales.clone(), recipe.format);
    let leaves = topology.leaves() as u32;
    let (first, counts) = links(topology);
    let count = rows.len() / dimensions(bands);
    let mut tree = PbgiTree {
        shape: recipe.shape as u8,
        format: recipe.format as u8,
        bands,
        leaves,
        root: vec![
            stored.root.center.x,
            stored.root.center.y,
            stored.root.center.z,
            stored.root.radius,
        ]
        .into(),
        first: first.into(),
        counts: counts.into(),
        fine: Array::default(),
        areas: Array::default(),
        coarse: Array::default(),
        coarse_areas: Array::default(),
        area_scale: 1.0,
        world: Array::default(),
        parent: Array::default(),
        half: Array::default(),
        lean: Array::default(),
        scales: flat(&stored.scales).into(),
        rows: Array::shaped(rows, &[count, dimensions(bands)]),
        indices: indices.into(),
    };
    match stored.spheres {
        StoredSpheres::Fine(codes, areas) => (tree.fine, tree.areas) = (codes.into(), areas.into()),
        StoredSpheres::Coarse(codes, areas, scale) => {
            (tree.coarse, tree.coarse_areas, tree.area_scale) = (codes.into(), areas.into(), scale);
        }
    }
    match stored.places {
        StoredPlaces::World(places) => tree.world = places.into(),
        StoredPlaces::Parent(codes) => tree.parent = codes.into(),
    }
    match stored.looks {
        StoredLooks::Half(codes) => tree.half = codes.into(),
        StoredLooks::Lean(codes) => tree.lean = codes.into(),
    }
    Ok((tree, live))
}

fn flat(scales: &Scales) -> Vec<f32> {
    match scales {
        Scales::Half { radiance, area, spread } => vec![*radiance, *area, *spread],
        Scales::Lean { radiance, areas, radii } => std::iter::once(*radiance)
            .chain(areas.iter().copied())
            .chain(radii.iter().copied())
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn one_surfel_and_two_at_one_place_are_trees_and_none_is_told() {
        let recipe =
            Recipe { shape: Shape::Octree, average: Average::Uniform, format: Format::C, bands: 5 };
        let some = |count: usize| RadiantSurfels {
            position: vec![Vec3::ONE; count].into(),
            normal: vec![Vec3::Y; count].into(),
            radiance: vec![Vec3::ONE; count].into(),
            area: vec![1.0; count].into(),
            radius: vec![0.6; count].into(),
        };
        for (count, inner) in [(1, 0), (2, 1)] {
            let (tree, _) = build(&some(count), recipe, None).unwrap();
            assert_eq!((tree.leaves as usize, tree.coarse.len()), (count, inner));
        }
        assert!(build(&some(0), recipe, None).is_err());
    }
}
