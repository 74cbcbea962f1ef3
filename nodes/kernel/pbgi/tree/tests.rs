//! Trees of every format against the surfels they were made of.

use super::super::bits;
use super::super::fixtures::{ball, cloud, unit_vectors};
use super::super::harmonics::{basis, cosine, dot, with_functions};
use super::super::stream::{Average, dimensions, fill};
use super::super::topology::{Built, binary, octree};
use super::encode::{Stored, StoredLooks, StoredPlaces, StoredSpheres, encode};
use super::looks::Format;
use super::vectors::Indices;
use super::*;

const ALL: [Format; 3] = [Format::A, Format::B, Format::C];

fn rounded(format: Format, surfels: &[Surfel]) -> (Vec<Surfel>, Scales) {
    let (mut surfels, scales) = (surfels.to_vec(), Scales::fit(format, surfels));
    scales.round(&mut surfels);
    (surfels, scales)
}

fn vectors<T: Topology>(built: &Built<T>, surfels: &[Surfel], bands: u32) -> Vec<f32> {
    let mut rows = vec![0.0; built.topology.inner() * dimensions(bands)];
    let leaf = |k: usize| surfels[built.order[k] as usize];
    fill(&built.topology, leaf, bands, Average::Area, &mut rows, |_: &mut (), done, row| {
        row.copy_from_slice(done.vector)
    });
    rows
}

/// Walks a tree: every leaf once and as stored, its disc in all spheres above, areas that are sums. Gives the greatest distance of a place
/// from that of the surfel, over the radius of the parent's sphere.
fn check<T: Topology>(tree: &Tree<T>, built: &Built<T>, surfels: &[Surfel]) -> f64 {
    let (mut seen, mut worst) = (0, 0.0f64);
    let mut open: Vec<(Place<T::Node>, Vec<Bound>)> =
        tree.root().map(|root| (root, Vec::new())).into_iter().collect();
    while let Some((place, above)) = open.pop() {
        match tree.entry(place) {
            Entry::Leaf(leaf) => {
                let Part::Leaf(k) = tree.topology.part(place.node) else { panic!("a leaf") };
                let surfel = surfels[built.order[k] as usize];
                let off = (leaf.position.as_dvec3() - surfel.position.as_dvec3()).length();
                assert_eq!(
                    Surfel { position: surfel.position, normal: surfel.normal, ..leaf },
                    surfel
                );
                // A normal is normalized again.
                assert!(leaf.normal.distance(surfel.normal) < 1e-3);
                for bound in &above {
                    let reach = (leaf.position.as_dvec3() - bound.center.as_dvec3()).length()
                        + f64::from(leaf.radius);
                    assert!(reach <= f64::from(bound.radius) * (1.0 + 1e-12), "{reach} {bound:?}");
                }
                worst = worst.max(off / f64::from(above.last().map_or(1.0, |b| b.radius)));
                seen += 1;
            }
            Entry::Inner(bound) => tree.children(place, |child| {
                open.push((child, above.iter().copied().chain([bound]).collect()));
            }),
        }
    }
    assert_eq!(seen, surfels.len());
    worst
}

#[test]
fn every_format_holds_its_surfels() {
    for surfels in
        [cloud(3000, 4.0, 1), ball(3000, 2), cloud(0, 1.0, 1), cloud(1, 1.0, 1), cloud(2, 1.0, 1)]
    {
        for format in ALL {
            let (surfels, scales) = rounded(format, &surfels);
            let built = binary::build(&surfels);
            let rows = vectors(&built, &surfels, 3);
            let stored = encode(&built, &surfels, scales.clone(), format);
            let tree =
                stored.tree(built.topology, Vectors { bands: 3, rows: &rows, indices: None });
            let binary_worst = check(&tree, &built, &surfels);
            let built = octree::build(&surfels);
            let rows = vectors(&built, &surfels, 3);
            let stored = encode(&built, &surfels, scales, format);
            let tree = stored
                .tree(built.topology.clone(), Vectors { bands: 3, rows: &rows, indices: None });
            let octree_worst = check(&tree, &built, &surfels);
            let bound = if format == Format::A { 0.0 } else { f64::from(lattice::ERROR) * 1.001 };
            assert!(
                binary_worst <= bound && octree_worst <= bound,
                "{format:?} {binary_worst} {octree_worst}"
            );
        }
    }
}

#[test]
fn coincident_surfels_stay_at_their_place() {
    let surfels = vec![cloud(1, 1.0, 5)[0]; 2000];
    for format in ALL {
        let (surfels, scales) = rounded(format, &surfels);
        let built = binary::build(&surfels);
        let rows = vectors(&built, &surfels, 1);
        let stored = encode(&built, &surfels, scales, format);
        check(
            &stored.tree(built.topology, Vectors { bands: 1, rows: &rows, indices: None }),
            &built,
            &surfels,
        );
    }
}

#[test]
fn far_from_the_origin_places_are_off_by_the_parent_and_by_rounding() {
    let mut surfels = cloud(2000, 40.0, 3);
    surfels.iter_mut().for_each(|s| s.position += 1e6);
    for format in ALL {
        let (surfels, scales) = rounded(format, &surfels);
        let built = binary::build(&surfels);
        let stored = encode(&built, &surfels, scales, format);
        let rows = vectors(&built, &surfels, 1);
        let tree = stored.tree(built.topology, Vectors { bands: 1, rows: &rows, indices: None });
        let mut open: Vec<_> = tree.root().into_iter().collect();
        while let Some(place) = open.pop() {
            tree.children(place, |child| open.push(child));
            if let Part::Leaf(k) = tree.topology.part(place.node) {
                let Entry::Leaf(leaf) = tree.entry(place) else { panic!("a leaf") };
                let off = leaf.position.distance(surfels[built.order[k] as usize].position);
                // Half a unit in the last place of a million is 1/32, for each coordinate.
                let bound = lattice::ERROR * place.bound.radius + 0.032 * 3f32.sqrt();
                assert!(
                    off <= if format == Format::A { 0.0 } else { bound * 1.001 },
                    "{off} {bound}"
                );
            }
        }
        check(&tree, &built, &surfels);
    }
}

/// What a tree's root sends against the sum over surfels of the same band-limited lobes.
#[test]
fn nodes_send_the_sum_of_their_surfels() {
    let surfels = ball(4000, 4);
    for bands in 1..=5 {
        let (surfels, scales) = rounded(Format::A, &surfels);
        let built = binary::build(&surfels);
        let rows = vectors(&built, &surfels, bands);
        let stored = encode(&built, &surfels, scales, Format::A);
        let tree = stored.tree(built.topology, Vectors { bands, rows: &rows, indices: None });
        for direction in unit_vectors(20, 1) {
            let Some(root) = tree.root() else { panic!("a root") };
            let sent = tree.sent(root, direction);
            let (mut flux, mut area) = (glam::DVec3::ZERO, 0.0);
            for s in &surfels {
                let lobe = with_functions!(bands, F => {
                    let lobe = cosine::<F>(s.normal);
                    dot(&lobe, &basis::<F>(direction))
                });
                flux += s.radiance.as_dvec3() * f64::from(s.area * lobe);
                area += f64::from(s.area * lobe);
            }
            assert!(
                (f64::from(sent.area) - area).abs() < 1e-5 * area,
                "{bands}: {} {area}",
                sent.area
            );
            // Ringing below zero is cut off.
            let flux = flux.max(glam::DVec3::ZERO);
            assert!(
                (sent.radiance.as_dvec3() * f64::from(sent.area) - flux).abs().max_element()
                    < 1e-5 * flux.length()
            );
            // The projected area of a sphere of radius 1.
            assert!(bands < 2 || (area - std::f64::consts::PI).abs() < 0.2, "{area}");
        }
    }
}

#[test]
fn ringing_never_gives_negative_or_unbounded_light() {
    // One side red, the other black: towards the black side little but ringing is red.
    let mut surfels = cloud(64, 1.0, 9);
    for (i, s) in surfels.iter_mut().enumerate() {
        s.normal = if i % 2 == 0 { Vec3::Y } else { -Vec3::Y };
        s.radiance = if i % 2 == 0 { Vec3::X } else { Vec3::ZERO };
    }
    let built = binary::build(&surfels);
    for bands in 1..=5 {
        let rows = vectors(&built, &surfels, bands);
        let all = Vectors { bands, rows: &rows, indices: None };
        for direction in unit_vectors(500, 2) {
            for i in 0..built.topology.inner() {
                let (radiance, share) = all.sent(i, direction);
                assert!(share >= 0.0 && radiance.min_element() >= 0.0 && radiance.is_finite());
                // The lobe itself rings up to 1.07; the mean share is a quarter.
                assert!(
                    radiance.x * share <= 1.07 && radiance.x <= 1.07 * 64.0,
                    "{bands} {radiance} {share}"
                );
            }
        }
    }
    let dark = vec![0.0; dimensions(3)];
    assert_eq!(
        Vectors { bands: 3, rows: &dark, indices: None }.sent(0, Vec3::X),
        (Vec3::ZERO, 0.0)
    );
}

#[test]
fn a_table_of_all_vectors_changes_nothing() {
    let surfels = ball(500, 4);
    let built = binary::build(&surfels);
    let rows = vectors(&built, &surfels, 3);
    let count = built.topology.inner();
    // The table in reverse.
    let table: Vec<f32> = rows.chunks(dimensions(3)).rev().flatten().copied().collect();
    for width in [bits::width(count), 17, 32] {
        let packed = bits::pack((0..count as u32).rev(), width);
        let quantized =
            Vectors { bands: 3, rows: &table, indices: Some(Indices { packed: &packed, width }) };
        let plain = Vectors { bands: 3, rows: &rows, indices: None };
        for i in 0..count {
            assert_eq!(quantized.row(i), plain.row(i));
            assert_eq!(quantized.sent(i, Vec3::Y), plain.sent(i, Vec3::Y));
        }
    }
}

#[test]
fn stored_bytes_are_those_of_the_formats() {
    let surfels = cloud(100, 1.0, 2);
    for format in ALL {
        let (surfels, scales) = rounded(format, &surfels);
        let built = binary::build(&surfels);
        let Stored { spheres, places, looks, .. } = encode(&built, &surfels, scales, format);
        let place = match places {
            StoredPlaces::World(p) => size_of_val(&p[..]),
            StoredPlaces::Parent(p) => size_of_val(&p[..]),
        };
        let look = match looks {
            StoredLooks::Half(l) => size_of_val(&l[..]),
            StoredLooks::Lean(l) => size_of_val(&l[..]),
        };
        let sphere = match spheres {
            StoredSpheres::Fine(s, a) => size_of_val(&s[..]) + size_of_val(&a[..]),
            StoredSpheres::Coarse(s, a, _) => size_of_val(&s[..]) + size_of_val(&a[..]),
        };
        assert_eq!((place + look) as u64, 100 * format.leaf_bytes());
        assert_eq!(sphere as u64, 99 * format.inner_bytes());
    }
}

#[test]
fn quantizing_with_a_table_of_all_vectors_loses_nothing_and_twice_is_once() {
    let surfels = ball(150, 4);
    let built = binary::build(&surfels);
    let rows = vectors(&built, &surfels, 2);
    let length = dimensions(2);
    let leaf = |k: usize| surfels[built.order[k] as usize];
    let nearest = |table: &[f32], vector: &[f32]| {
        let distance =
            |row: &[f32]| row.iter().zip(vector).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let all = table.chunks(length).map(distance).enumerate();
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i as u32)
    };
    for entries in [1, 5, 40, built.topology.inner()] {
        let table = &rows[..entries * length];
        let mut indices = vec![0; built.topology.inner()];
        fill(&built.topology, leaf, 2, Average::Area, &mut indices, |_: &mut (), done, index| {
            index[0] = nearest(table, done.vector);
        });
        let width = bits::width(entries);
        let packed = bits::pack(indices.iter().copied(), width);
        let quantized =
            Vectors { bands: 2, rows: table, indices: Some(Indices { packed: &packed, width }) };
        for (i, &index) in indices.iter().enumerate() {
            assert_eq!(nearest(table, quantized.row(i)), index);
            if entries == indices.len() {
                assert_eq!(quantized.row(i), &rows[i * length..(i + 1) * length]);
            }
        }
    }
}

#[test]
fn bright_surfels_do_not_overflow_their_mean() {
    let mut surfels = cloud(2, 1.0, 1);
    for (s, radiance) in surfels.iter_mut().zip([40_000.0, 65_520.0]) {
        *s = Surfel { normal: Vec3::Y, radiance: Vec3::splat(radiance), area: 1.0, ..*s };
    }
    for format in [Format::A, Format::C] {
        let (surfels, _) = rounded(format, &surfels);
        let built = binary::build(&surfels);
        let rows = vectors(&built, &surfels, 1);
        let (radiance, _) = Vectors { bands: 1, rows: &rows, indices: None }.sent(0, Vec3::Y);
        assert!((radiance.x / 52_760.0 - 1.0).abs() < 2e-3, "{format:?} {radiance}");
    }
}

#[test]
fn surfels_that_are_not_numbers_do_no_harm() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 0.0] {
        let mut surfels = cloud(60, 1.0, 8);
        surfels[3].position.x = bad;
        surfels[20].area = bad;
        surfels[30].radius = bad;
        surfels[40].normal = Vec3::splat(bad);
        surfels[50].radiance.y = bad;
        for format in ALL {
            let (surfels, scales) = rounded(format, &surfels);
            let (binary, octree) = (binary::build(&surfels), octree::build(&surfels));
            let (rows, other_rows) = (vectors(&binary, &surfels, 2), vectors(&octree, &surfels, 2));
            let stored = encode(&binary, &surfels, scales.clone(), format);
            assert_eq!(
                leaves(
                    &stored.tree(binary.topology, Vectors { bands: 2, rows: &rows, indices: None })
                ),
                60
            );
            let stored = encode(&octree, &surfels, scales, format);
            let all = Vectors { bands: 2, rows: &other_rows, indices: None };
            assert_eq!(leaves(&stored.tree(octree.topology, all)), 60);
        }
    }
}

/// Leaves that a walk meets.
fn leaves<T: Topology>(tree: &Tree<T>) -> usize {
    let (mut open, mut count): (Vec<_>, _) = (tree.root().into_iter().collect(), 0);
    while let Some(place) = open.pop() {
        match tree.entry(place) {
            Entry::Leaf(_) => count += 1,
            Entry::Inner(_) => tree.children(place, |child| open.push(child)),
        }
    }
    count
}
