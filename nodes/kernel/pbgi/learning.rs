//! Vectors that a table is learned from.

use super::hierarchy::SurfelSet;
use super::stored::Shape;
use super::stream::{Average, Finished, dimensions, stream};
use super::topology::{Built, Topology, binary, octree};
use super::tree::encode::areas;
use crate::data::RadiantSurfels;

/// How the chance of an inner node to be learned from grows with its area: as the area to this power. A cut uses large and small nodes at
/// about the same solid angle, so that an error in a node that stands for much surface is seen by many more receivers. Of the pavilion with 10,000 entries
/// a picture had 52.3, 53.1 and 51.3 dB with 0.5, 0.75 and 1, and 47.7 dB from a tree of a tenth of the surfels.
const POWER: f32 = 0.75;

/// The vectors of about `count` inner nodes of the tree over `surfels`, one after the other: all of the largest nodes, and of smaller ones the
/// fewer the smaller they are. They are copied while the tree is walked; it never exists as a whole.
pub fn of_nodes(
    surfels: &RadiantSurfels,
    shape: Shape,
    average: Average,
    bands: u32,
    count: usize,
) -> Vec<f32> {
    match shape {
        Shape::Binary => walked(&binary::build(surfels), surfels, average, bands, count),
        Shape::Octree => walked(&octree::build(surfels), surfels, average, bands, count),
    }
}

fn walked<T: Topology>(
    built: &Built<T>,
    surfels: &RadiantSurfels,
    average: Average,
    bands: u32,
    count: usize,
) -> Vec<f32> {
    let leaf = |k: usize| surfels.surfel(built.order[k] as usize);
    let chosen = chosen(&areas(&built.topology, leaf), count);
    let mut vectors = Vec::with_capacity(count.min(chosen.len()) * dimensions(bands));
    stream(&built.topology, leaf, bands, average, |done: Finished| {
        if chosen[done.node] {
            vectors.extend_from_slice(done.vector);
        }
    });
    vectors
}

/// Which of the nodes with these areas are learned from: each with the chance min(1, c area^[`POWER`]), drawn evenly along their numbers.
fn chosen(areas: &[f32], count: usize) -> Vec<bool> {
    let largest = areas.iter().copied().fold(0.0, f32::max);
    let weight = |area: &f32| {
        let share = if largest > 0.0 { area / largest } else { 1.0 };
        f64::from(libm::powf(share, POWER))
    };
    let weights: Vec<f64> = areas.iter().map(weight).collect();
    let expected = |c: f64| weights.iter().map(|w| (c * w).min(1.0)).sum::<f64>();
    // The expected number grows with c until all are certain: the exponent of c is found by halving.
    let (mut low, mut high) = (-64.0_f64, 64.0_f64);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        match expected(libm::exp2(middle)) > count as f64 {
            true => high = middle,
            false => low = middle,
        }
    }
    let factor = libm::exp2(high);
    let mut sum = 0.5;
    let draw = |w: &f64| {
        sum += (factor * w).min(1.0);
        let is = sum >= 1.0;
        sum -= f64::from(u8::from(is));
        is
    };
    weights.iter().map(draw).collect()
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::cloud;
    use super::super::hierarchy::Surfel;
    use super::*;

    fn radiant(surfels: &[Surfel]) -> RadiantSurfels {
        RadiantSurfels {
            position: surfels.iter().map(|s| s.position).collect(),
            normal: surfels.iter().map(|s| s.normal).collect(),
            radiance: surfels.iter().map(|s| s.radiance).collect(),
            area: surfels.iter().map(|s| s.area).collect(),
            radius: surfels.iter().map(|s| s.radius).collect(),
        }
    }

    #[test]
    fn large_nodes_are_all_learned_from_and_as_many_as_wanted() {
        let surfels = cloud(4096, 3.0, 1);
        let built = binary::build(&surfels);
        let areas = areas(&built.topology, |k| surfels[built.order[k] as usize]);
        let mut sorted = areas.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        for count in [1, 50, 800, 4095] {
            let chosen = chosen(&areas, count);
            let found = chosen.iter().filter(|is| **is).count();
            assert!(found.abs_diff(count) <= 1, "{found} of {count}");
            let large = sorted[sorted.len() - count.div_ceil(20)];
            assert!(areas.iter().zip(&chosen).all(|(area, is)| *is || *area <= large), "{count}");
        }
        let vectors = of_nodes(&radiant(&surfels), Shape::Octree, Average::Area, 2, 300);
        assert!((vectors.len() / 16).abs_diff(300) <= 1);
    }

    #[test]
    fn all_nodes_of_a_small_tree_and_of_one_without_area() {
        for count in [0, 1, 2, 9] {
            let flat: Vec<Surfel> =
                cloud(count, 1.0, 2).into_iter().map(|s| Surfel { area: 0.0, ..s }).collect();
            for surfels in [cloud(count, 1.0, 2), flat] {
                let vectors = of_nodes(&radiant(&surfels), Shape::Binary, Average::Area, 1, 1000);
                assert_eq!(vectors.len(), 4 * count.saturating_sub(1));
            }
        }
    }
}
