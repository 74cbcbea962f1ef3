//! Trees as artifacts: built from shaded surfels, and seen again as a [`Hierarchy`](super::hierarchy::Hierarchy).

use super::bits;
use super::half::Losses;
use super::hierarchy::{Bound, Surfel, SurfelSet};
use super::lut::Balanced;
use super::stream::{Average, Finished, dimensions, fill};
use super::topology::{Binary, Built, Octree, Topology, binary, octree};
use super::tree::Tree;
use super::tree::encode::{StoredLooks, StoredPlaces, StoredSpheres, encode};
use super::tree::looks::{Format, Scales};
use super::tree::spheres::Spheres;
use super::tree::vectors::{Indices, Vectors};
use super::tree::{Leaves, Looks, Places};
use crate::data::{Array, Lut, PbgiTree, RadiantSurfels};
use crate::node::Error;
use glam::Vec3;
use std::borrow::Cow;

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

/// What the leaves of a tree share.
///
/// # Errors
/// When the artifact has another number of scales than its format.
pub fn scales(tree: &PbgiTree) -> Result<Scales, Error> {
    let table = |from: usize| -> Option<Box<[f32; 256]>> {
        tree.scales.get(from..from + 256)?.try_into().ok().map(Box::new)
    };
    let found = match (&tree.scales[..], table(1), table(257)) {
        (&[radiance, area, spread], ..) => Some(Scales::Half { radiance, area, spread }),
        (&[radiance, ..], Some(areas), Some(radii)) => {
            Some(Scales::Lean { radiance, areas, radii })
        }
        _ => None,
    };
    found.ok_or_else(|| Error::invalid("the tree's scales are of no known format"))
}

/// A binary tree as it is gathered from.
pub fn as_binary<'a>(tree: &'a PbgiTree, scales: &'a Scales) -> Tree<'a, Binary> {
    view(tree, scales, Binary { leaves: tree.leaves })
}

/// An octree as it is gathered from.
pub fn as_octree<'a>(tree: &'a PbgiTree, scales: &'a Scales) -> Tree<'a, Octree<'a>> {
    let (first, counts) = (Cow::Borrowed(&tree.first[..]), Cow::Borrowed(&tree.counts[..]));
    view(tree, scales, Octree { first, counts, leaves: tree.leaves })
}

fn view<'a, T: Topology>(tree: &'a PbgiTree, scales: &'a Scales, topology: T) -> Tree<'a, T> {
    let (center, radius) = (Vec3::new(tree.root[0], tree.root[1], tree.root[2]), tree.root[3]);
    let entries = tree.rows.len() / dimensions(tree.bands);
    let packed = &tree.indices[..];
    let indices = (!packed.is_empty()).then(|| Indices { packed, width: bits::width(entries) });
    Tree {
        topology,
        root: Bound { center, radius },
        spheres: match tree.coarse.is_empty() {
            true => Spheres::Fine(&tree.fine, &tree.areas),
            false => Spheres::Coarse(&tree.coarse, &tree.coarse_areas, tree.area_scale),
        },
        leaves: Leaves {
            places: match tree.world.is_empty() {
                true => Places::Parent(&tree.parent),
                false => Places::World(&tree.world),
            },
            looks: match tree.half.is_empty() {
                true => Looks::Lean(&tree.lean),
                false => Looks::Half(&tree.half),
            },
            scales,
        },
        vectors: Vectors { bands: tree.bands, rows: &tree.rows, indices },
    }
}

/// Evaluates an expression with a tree artifact as a hierarchy of its own type.
macro_rules! with_tree {
    ($tree:expr, $hierarchy:ident => $body:expr) => {{
        let tree: &$crate::data::PbgiTree = &$tree;
        let scales = $crate::kernel::pbgi::stored::scales(tree)?;
        if tree.shape == 0 {
            let $hierarchy = $crate::kernel::pbgi::stored::as_binary(tree, &scales);
            $body
        } else {
            let $hierarchy = $crate::kernel::pbgi::stored::as_octree(tree, &scales);
            $body
        }
    }};
}
pub(crate) use with_tree;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::element::Receiver;
    use crate::kernel::pbgi::gather::{Gather, MicroBuffer, Settings, Shape as Cells};
    use crate::kernel::pbgi::poisson_disk::sample;

    /// A closed cube of this side whose walls send radiance 1 inwards.
    fn furnace(side: f32, center: Vec3, count: u32) -> RadiantSurfels {
        let corner = |i: usize| {
            let bit = |k: usize| if i >> k & 1 == 1 { 0.5 } else { -0.5 };
            center + side * Vec3::new(bit(0), bit(1), bit(2))
        };
        let walls =
            [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        let triangle = |t: u32| {
            let [a, b, c, d] = walls[t as usize / 2];
            if t.is_multiple_of(2) { [a, b, c].map(corner) } else { [a, c, d].map(corner) }
        };
        let samples = sample(triangle, 12, count, 7);
        let place = |i: usize| {
            let [a, b, c] = triangle(samples.triangle[i]);
            let at = samples.barycentric[i];
            a + (b - a) * at.x + (c - a) * at.y
        };
        let normal = |i: usize| {
            let [a, b, c] = triangle(samples.triangle[i]);
            let normal = (b - a).cross(c - a).normalize();
            if normal.dot(center - a) < 0.0 { -normal } else { normal }
        };
        let all = 0..samples.triangle.len();
        RadiantSurfels {
            position: all.clone().map(place).collect(),
            normal: all.clone().map(normal).collect(),
            radiance: all.clone().map(|_| Vec3::ONE).collect(),
            area: all.map(|_| samples.area).collect(),
            radius: samples.splat.clone().into(),
        }
    }

    /// Mean radiance, relative to what a closed furnace gives, that receivers on the floor reflect.
    fn fullness(side: f32, center: Vec3, recipe: Recipe) -> Result<f32, Error> {
        let (tree, account) = build(&furnace(side, center, 4000), recipe, None)?;
        assert!(account.live < 2000);
        let floor = center - Vec3::Y * side * 0.5;
        let receivers: Vec<Receiver> = (0..64)
            .map(|i| {
                let at = Vec3::new((i % 8) as f32 - 3.5, 0.0, (i / 8) as f32 - 3.5) * (side * 0.11);
                Receiver::diffuse(floor + at, Vec3::Y, Vec3::Y, Vec3::splat(0.8))
            })
            .collect();
        let buffer = MicroBuffer::new(Cells::Cube, 8);
        let (gathered, _) = with_tree!(tree, hierarchy => {
            let settings = Settings::default();
            let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background: |_| Vec3::ZERO };
            gather.all(&receivers, |_, _| Ok::<(), Error>(()))?
        });
        Ok(gathered.iter().map(|g| g.radiance.x).sum::<f32>() / (0.8 * receivers.len() as f32))
    }

    #[test]
    fn a_closed_furnace_is_full_within_two_percent_in_every_shape_and_format() {
        for shape in [Shape::Binary, Shape::Octree] {
            for format in [Format::A, Format::B, Format::C] {
                let recipe = Recipe { shape, average: Average::Area, format, bands: 3 };
                let found = fullness(1.0, Vec3::ZERO, recipe).unwrap();
                assert!((found - 1.0).abs() < 0.02, "{shape:?} {format:?} {found}");
            }
        }
    }

    #[test]
    fn energy_does_not_grow_with_bounces_between_nearly_white_walls() {
        // Light on every other surfel, so that vectors are uneven.
        let mut lit = furnace(1.0, Vec3::ZERO, 1500);
        let count = lit.position.len();
        lit.radiance = (0..count).map(|i| Vec3::splat((i % 2 * 2) as f32)).collect();
        let albedo = 0.99;
        let receiver = |i: usize| {
            let (place, normal) = (lit.position[i], lit.normal[i]);
            Receiver::diffuse(place, normal, normal, Vec3::splat(albedo))
        };
        let receivers: Vec<Receiver> = (0..count).map(receiver).collect();
        let energy = |lit: &RadiantSurfels| {
            let sent = |i: usize| f64::from(lit.radiance[i].x) * f64::from(lit.area[i]);
            (0..count).map(sent).sum::<f64>()
        };
        let recipe =
            Recipe { shape: Shape::Binary, average: Average::Area, format: Format::A, bands: 3 };
        let buffer = MicroBuffer::new(Cells::Cube, 8);
        let first = energy(&lit);
        let mut before = first;
        for bounce in 1..=20 {
            let (tree, _) = build(&lit, recipe, None).unwrap();
            let scales = scales(&tree).unwrap();
            let hierarchy = as_binary(&tree, &scales);
            let (settings, background) = (Settings::default(), |_| Vec3::ZERO);
            let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background };
            let (gathered, _) = gather.all(&receivers, |_, _| Ok::<(), Error>(())).unwrap();
            lit.radiance = gathered.iter().map(|g| g.radiance).collect();
            let now = energy(&lit);
            assert!(now <= before, "bounce {bounce}: {before} grows to {now}");
            before = now;
        }
        // Each bounce may lose the two percent that a furnace may.
        let (left, most) = (before / first, f64::from(albedo).powi(20));
        assert!(left > most * 0.98_f64.powi(20), "{left} of {most}");
    }

    #[test]
    fn a_convex_sheet_with_two_faces_does_not_shadow_itself() {
        let count = 1500;
        let normal = |i: usize| {
            let (z, turn) = (1.0 - (i as f32 + 0.5) * 2.0 / count as f32, i as f32 * 2.399_963);
            Vec3::new(z, libm::cosf(turn), libm::sinf(turn)) * {
                let flat = (1.0 - z * z).sqrt();
                Vec3::new(1.0, flat, flat)
            }
        };
        let area = 4.0 * std::f32::consts::PI / count as f32;
        let faces = || (0..count).flat_map(|i| [normal(i), -normal(i)]);
        let ball = RadiantSurfels {
            position: (0..count).flat_map(|i| [normal(i); 2]).collect(),
            normal: faces().collect(),
            radiance: faces().map(|_| Vec3::ZERO).collect(),
            area: faces().map(|_| area).collect(),
            radius: faces().map(|_| 0.8 * area.sqrt()).collect(),
        };
        let recipe =
            Recipe { shape: Shape::Binary, average: Average::Area, format: Format::A, bands: 3 };
        let (tree, _) = build(&ball, recipe, None).unwrap();
        let scales = scales(&tree).unwrap();
        let hierarchy = as_binary(&tree, &scales);
        let receivers: Vec<Receiver> = (0..64)
            .map(|i| normal(i * 23 + 11))
            .map(|n| Receiver::diffuse(n * 1.0005, n, n, Vec3::ONE))
            .collect();
        let buffer = MicroBuffer::new(Cells::Cube, 8);
        let (settings, background) = (Settings::default(), |_| Vec3::ONE);
        let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background };
        let (gathered, _) = gather.all(&receivers, |_, _| Ok::<(), Error>(())).unwrap();
        let least = gathered.iter().map(|g| g.radiance.x).fold(f32::INFINITY, f32::min);
        assert!(least > 0.9, "{least}");
    }

    #[test]
    fn size_and_place_of_the_scene_do_not_matter() {
        let recipe =
            Recipe { shape: Shape::Binary, average: Average::Area, format: Format::A, bands: 3 };
        let far = [(1.0, Vec3::splat(1000.0)), (1000.0, Vec3::splat(1e6))];
        for (side, center) in [(1e-6, Vec3::ZERO), (1e6, Vec3::ZERO)].into_iter().chain(far) {
            let found = fullness(side, center, recipe).unwrap();
            assert!((found - 1.0).abs() < 0.02, "{side} {center} {found}");
        }
    }

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
