//! How much surface lies around a point, by samples that cover all surfaces evenly.

mod patch_tree;

use crate::node::Error;
use glam::Vec3;
use patch_tree::PatchTree;
use std::f32::consts::PI;

/// Cosine between normals from which on two points lie on the same side of a surface.
const SAME_SIDE: f32 = 0.5;

/// How far another point may be from the plane of a point, in radii of the disc around it: farther away lie other surfaces, the
/// next step of stairs or the inside of a board.
const FLAT: f32 = 0.2;

/// Samples that a disc holds on average below which they say too little about it: an area is off by a fifth then.
const FEW: f32 = 25.0;

/// Samples that a disc holds on average from which on a coarser choice of them is as good.
const ENOUGH: f32 = 64.0;

/// Least part of a disc that is taken for surface: a little less than what three walls leave of it in their corner. Surfaces much
/// smaller than the disc have hardly a sample or a photon on them, and the quotient of the two would be noise.
const LEAST: f32 = 0.2;

/// A surface sample: a unit normal and the area that it stands for, m^2.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// World space, metres.
    pub position: Vec3,
    /// Unit, on the side that is lit.
    pub normal: Vec3,
    /// Square metres.
    pub area: f32,
}

impl Patch {
    /// Whether a point with a normal lies on the surface around this one, on its side, as far as `radius`.
    pub fn shares(&self, position: Vec3, normal: Vec3, radius: f32) -> bool {
        let height = (position - self.position).dot(self.normal);
        normal.dot(self.normal) > SAME_SIDE && height.abs() <= FLAT * radius
    }
}

/// Samples in trees: all of them, every second, every fourth and so on, so that no disc has to look at many.
pub struct Cover {
    levels: Vec<Level>,
}

struct Level {
    tree: PatchTree,
    /// Area of a sample on average.
    mean: f32,
}

impl Level {
    fn new(patches: Vec<Patch>) -> Self {
        let sum: f64 = patches.iter().map(|patch| f64::from(patch.area)).sum();
        let mean = (sum / patches.len() as f64) as f32;
        Level { tree: PatchTree::new(patches), mean }
    }
}

impl Cover {
    /// Takes samples that are spread evenly over all surfaces, neighbours in the list being neighbours on a surface.
    ///
    /// # Errors
    /// When a position is not finite.
    pub fn new(patches: Vec<Patch>) -> Result<Self, Error> {
        if patches.iter().any(|patch| !patch.position.is_finite()) {
            return Err(Error::invalid("a sample's position is not finite"));
        }
        let mut levels = Vec::new();
        let mut stride = 1;
        while stride == 1 && !patches.is_empty() || patches.len() / stride > ENOUGH as usize {
            let larger = |patch: &Patch| Patch { area: patch.area * stride as f32, ..*patch };
            levels.push(Level::new(patches.iter().step_by(stride).map(larger).collect()));
            stride *= 2;
        }
        Ok(Cover { levels })
    }

    /// Area, m^2, of the surface within a distance of a point of it, `at`, given squared: that of the samples there. Where
    /// there are too few to tell, and where layers lie on each other, the area of a disc that is wholly surface. As a divisor
    /// it is hardly biased, because samples lie more evenly than by chance: had they Poisson's distribution, `at` would have to
    /// count as one more of them.
    pub fn area(&self, at: &Patch, squared: f32) -> f32 {
        let disc = PI * squared;
        let holds = |count: f32| move |level: &&Level| disc >= count * level.mean;
        let enough = self.levels.iter().rev().find(holds(ENOUGH));
        let Some(level) = enough.or_else(|| self.levels.first().filter(holds(FEW))) else {
            return disc;
        };
        let area = level.tree.area(at, squared);
        // More than chance makes of a whole disc: there are layers, of which others may be dark.
        let layered = area > disc * (1.0 + 2.0 * (level.mean / disc).sqrt());
        if layered { disc } else { area.max(LEAST * disc) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::surface_sampling::uniform;

    /// `count` samples of the unit square in x and z, which look up.
    fn square(count: u32) -> Vec<Patch> {
        let patch = |i| {
            let [u, v, ..] = uniform(i, 0, 1);
            Patch { position: Vec3::new(u, 0.0, v), normal: Vec3::Y, area: 1.0 / count as f32 }
        };
        (0..count).map(patch).collect()
    }

    #[test]
    fn discs_that_reach_over_an_edge_have_less_area() {
        let mut patches = square(4000);
        // A wall at x = 0, which faces the square.
        patches.extend(square(4000).into_iter().map(|patch| {
            let Vec3 { x, z, .. } = patch.position;
            Patch { position: Vec3::new(0.0, x, z), normal: Vec3::X, ..patch }
        }));
        let cover = Cover::new(patches).unwrap();
        let area = |x: f32, z: f32| {
            let at = Patch { position: Vec3::new(x, 0.0, z), normal: Vec3::Y, area: 0.0 };
            cover.area(&at, 0.04) / (PI * 0.04)
        };
        // Many places along each edge, for a single one is off by a tenth or two.
        let along = |x: f32| (0..40).map(|k| area(x, 0.3 + 0.01 * k as f32)).sum::<f32>() / 40.0;
        for (x, expected) in [(0.5, 1.0), (0.0, 0.5), (1.0, 0.5)] {
            assert!((along(x) / expected - 1.0).abs() < 0.1, "{x}: {}", along(x));
        }
        assert!((0.2..0.35).contains(&area(0.0, 0.0)), "{}", area(0.0, 0.0));
    }

    #[test]
    fn a_disc_of_few_samples_is_whole() {
        let at = Patch { position: Vec3::ZERO, normal: Vec3::Y, area: 0.0 };
        assert_eq!(Cover::new(square(100)).unwrap().area(&at, 0.01), PI * 0.01);
        assert_eq!(Cover::new(Vec::new()).unwrap().area(&at, 0.01), PI * 0.01);
        let lost = Patch { position: Vec3::NAN, ..at };
        assert!(Cover::new(vec![lost]).is_err());
    }

    #[test]
    fn as_a_divisor_it_is_unbiased() {
        let cover = Cover::new(square(3000)).unwrap();
        let inner =
            |patch: &&Patch| (patch.position - Vec3::new(0.5, 0.0, 0.5)).abs().max_element() < 0.35;
        let (mut sum, mut count) = (0.0, 0.0);
        for patch in square(500).iter().filter(inner) {
            // Beside the samples, for those are not asked.
            let at = Patch { position: patch.position + Vec3::new(0.013, 0.0, 0.007), ..*patch };
            sum += f64::from(PI * 0.01 / cover.area(&at, 0.01));
            count += 1.0;
        }
        assert!((sum / count - 1.0).abs() < 0.02, "{}", sum / count);
    }
}
