//! Trees as artifacts: built from shaded surfels (`building`), and seen again as a [`Hierarchy`](super::hierarchy::Hierarchy).

mod building;

pub use building::{Account, Recipe, Shape, build};

use super::bits;
use super::hierarchy::Bound;
use super::stream::dimensions;
use super::topology::{Binary, Octree, Topology};
use super::tree::Tree;
use super::tree::looks::Scales;
use super::tree::spheres::Spheres;
use super::tree::vectors::{Indices, Vectors};
use super::tree::{Leaves, Looks, Places};
use crate::data::PbgiTree;
use crate::node::Error;
use glam::Vec3;
use std::borrow::Cow;

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
    use crate::data::RadiantSurfels;
    use crate::kernel::element::Receiver;
    use crate::kernel::pbgi::gather::{Gather, MicroBuffer, Settings, Shape as Cells};
    use crate::kernel::pbgi::poisson_disk::sample;
    use crate::kernel::pbgi::stream::Average;
    use crate::kernel::pbgi::tree::looks::Format;

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
}
