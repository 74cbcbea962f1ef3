//! Surfels: Poisson-disk samples of all surfaces (Buchholz and Boubekeur 2012, section 1.1).

use crate::data::{self, Geometry, Materials, Poses};
use crate::kernel::closed::{self, Seen};
use crate::kernel::pbgi::poisson_disk::{Samples, sample};
use crate::kernel::stage::Stage;
use crate::kernel::surface_sampling::uniform;
use crate::node::{Ctx, Error, Item, Node};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;

crate::choice! {
    /// Which faces of surfaces have surfels.
    pub enum Faces {
        /// What can be seen: the outside of closed solids, of open surfaces both faces where their
        /// material is double-sided, front faces elsewhere. A closed room that is seen from inside, and
        /// has nothing separate in it, is taken for a solid if its material is double-sided.
        Seen = "seen",
        /// Front faces only, for scenes of closed solids: their backs are never seen, and hide nothing.
        Front = "front",
        /// Both: each place has a surfel on either side. The dark insides of solids then take light
        /// from what a cell of a buffer sees past their edges.
        Both = "both",
    }
}

crate::params! {
    /// Covers all surfaces with surfels that keep apart from each other. They move and deform with their
    /// triangles.
    pub struct Surfels {
        /// Number of surfels; more where open, double-sided surfaces have them on their backs, too.
        count: u32 = 200_000, 1..=67_108_864;
        /// Which faces have them.
        faces: Faces = Faces::Seen;
        /// Surfels over which nearly all directions are closed within this many of their radii are left
        /// out: nothing but the gap sees them, and nodes would mix them with the surface that hides them.
        /// 0 keeps all.
        buried: f32 = 2.0, 0.0..=100.0;
        /// Seed of their places.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`Surfels`].
    pub struct SurfelsIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Materials: what is absent has no surfels.
        materials: Item<Materials>,
        /// The pose whose areas decide: `Poses` without a time, or surfels are others in every frame.
        rest: Item<Poses>,
    }
}

impl Node for Surfels {
    const KIND: &'static str = "Surfels";
    const VERSION: u32 = 3;
    type In = SurfelsIn;
    type Out = data::Surfels;

    fn memory(&self, inputs: &crate::node::Sizes) -> u64 {
        // Eight candidates a surfel, at about 64 bytes each while they are sorted out.
        576 * u64::from(self.count) + 8 * inputs.bytes("geometry")
    }

    fn run(&self, input: SurfelsIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        ctx.tick(0, 1)?;
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.rest)?;
        let corners = |t: u32| match stage.area(t) > 0.0 {
            true => stage.triangle(t),
            false => [Vec3::ZERO; 3],
        };
        let sides: &[u8] = match self.faces {
            Faces::Front => &[1],
            Faces::Both | Faces::Seen => &[1, 0],
        };
        let places = if self.faces == Faces::Both { self.count.div_ceil(2) } else { self.count };
        let samples = sample(corners, stage.triangles(), places, self.seed);
        if samples.triangle.is_empty() {
            return Err(Error::invalid("there is no surface to put surfels on"));
        }
        let all = samples.triangle.len() * sides.len();
        let surfel = |k: usize| (k / sides.len(), sides[k % sides.len()]);
        let shown = self.shown(&stage);
        let wanted: Vec<(usize, u8)> = (0..all)
            .map(surfel)
            .filter(|&(i, side)| match shown.get(samples.triangle[i] as usize) {
                None | Some(Seen::Both) => true,
                Some(Seen::Front) => side == 1,
                Some(Seen::Back) => side == 0,
            })
            .collect();
        let kept: Vec<(usize, u8)> = wanted
            .par_iter()
            .copied()
            .filter(|&(i, side)| !self.is_buried(&stage, &samples, i, side))
            .collect();
        let (all, left) = (wanted.len(), wanted.len() - kept.len());
        ctx.note(format!("{left} of {all} surfels are buried and left out"));
        let each = || kept.iter().copied();
        let root = samples.area.sqrt();
        let area = areas(&stage, &samples);
        Ok(data::Surfels {
            triangle: each().map(|(i, _)| samples.triangle[i]).collect(),
            barycentric: each().map(|(i, _)| samples.barycentric[i]).collect(),
            front: each().map(|(_, side)| side).collect(),
            share: each().map(|(i, _)| area[i] / stage.area(samples.triangle[i])).collect(),
            spread: each().map(|(i, _)| samples.splat[i] / root).collect(),
        })
    }
}

/// Samples that share out the area of their triangles between them, at least.
const SHARING: usize = 8;

/// The area that each sample stands for. Samples keep apart from those of other surfaces close by, too,
/// so that layers have fewer for their area than what lies alone: neighbouring triangles are taken
/// together until they have a few samples, which share out their area. The sum is that of all triangles.
fn areas(stage: &Stage, samples: &Samples) -> Vec<f32> {
    let mut areas = vec![0.0; samples.triangle.len()];
    let (mut start, mut end, mut sum) = (0, 0, 0.0_f64);
    let least = SHARING as f64 * f64::from(samples.area);
    for triangle in 0..stage.triangles() {
        sum += f64::from(stage.area(triangle));
        while samples.triangle.get(end) == Some(&triangle) {
            end += 1;
        }
        if end - start >= SHARING && sum >= least {
            let each = sum / (end - start) as f64;
            areas[start..end].fill(each as f32);
            (start, sum) = (end, 0.0);
        }
    }
    // What is left at the end goes to all, in proportion.
    let shared: f64 = areas.iter().map(|a| f64::from(*a)).sum();
    match end - start {
        0 if shared > 0.0 => areas.iter_mut().for_each(|a| *a *= ((shared + sum) / shared) as f32),
        0 => {}
        left => areas[start..end].fill((sum / left as f64) as f32),
    }
    areas
}

/// Directions that are looked at above a surfel, and how many of them must be closed to bury it.
const LOOKS: u32 = 16;
const CLOSED: u32 = 14;

impl Surfels {
    /// The faces of each triangle that have surfels; empty where all faces that are tried have them.
    fn shown(&self, stage: &Stage) -> Vec<Seen> {
        let two_sided = |t: u32| stage.surface(t, 0.0, 0.0).double_sided;
        if self.faces != Faces::Seen {
            return Vec::new();
        }
        let triangles = stage.triangles();
        if !(0..triangles).any(two_sided) {
            return vec![Seen::Front; triangles as usize];
        }
        let mut shown = closed::seen(|t| stage.triangle(t), triangles);
        for (t, seen) in (0..triangles).zip(&mut shown) {
            if !two_sided(t) {
                *seen = Seen::Front;
            }
        }
        shown
    }

    /// Whether nearly all directions, cosine-weighted, are closed near a side of sample `i`.
    fn is_buried(&self, stage: &Stage, samples: &Samples, i: usize, side: u8) -> bool {
        let at = samples.barycentric[i];
        let surface = stage.surface(samples.triangle[i], at.x, at.y);
        let normal = if side == 1 { surface.facet } else { -surface.facet };
        let origin = surface.position + normal * stage.bias();
        let reach = self.buried * samples.splat[i];
        let (across, along) = normal.any_orthonormal_pair();
        let mut open = 0;
        for k in 0..LOOKS {
            let [u, v, ..] = uniform((i as u32).wrapping_mul(LOOKS) + k, 1 + u32::from(side), self.seed);
            let (sin, cos) = (libm::sinf(TAU * v), libm::cosf(TAU * v));
            let direction = (across * cos + along * sin) * u.sqrt() + normal * (1.0 - u).sqrt();
            open += u32::from(!stage.occluded(origin, origin + direction * reach));
            if open > LOOKS - CLOSED {
                return false;
            }
        }
        self.buried > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::{plain_materials, quad, soup, still};

    fn run(count: u32, faces: Faces) -> data::Surfels {
        let mut triangles = quad(Vec3::ZERO, Vec3::X * 2.0, Vec3::Z * 3.0, 0).to_vec();
        triangles[1].1 = 1;
        triangles.push(([Vec3::ZERO, Vec3::X, Vec3::X * 2.0], 0));
        let mut materials = plain_materials(&[Vec3::ONE; 2]);
        materials.double_sided = vec![0, 1].into();
        let input = SurfelsIn {
            geometry: Geometry { diagonal: 4.0, bias: 1e-3, ..soup(&triangles) }.into(),
            materials: materials.into(),
            rest: still().into(),
        };
        Surfels { count, faces, seed: 3, ..Surfels::default() }.run(input, &Ctx::default()).unwrap()
    }

    #[test]
    fn areas_add_up_on_each_side_and_degenerate_triangles_have_none() {
        // The second of two triangles of three square metres is double-sided.
        for (faces, expected, count) in
            [(Faces::Front, 6.0, 1000), (Faces::Both, 12.0, 1000), (Faces::Seen, 9.0, 1500)]
        {
            let surfels = run(1000, faces);
            assert!(surfels.triangle.len().abs_diff(count) < 40);
            assert!(surfels.triangle.iter().all(|t| *t < 2));
            if faces == Faces::Seen {
                let backs = surfels.front.iter().zip(surfels.triangle.iter());
                assert!(backs.filter(|(front, _)| **front == 0).all(|(_, t)| *t == 1));
            }
            let area: f32 = surfels.share.iter().map(|s| s * 3.0).sum();
            assert!((area - expected).abs() < 1e-2, "{area}");
        }
    }

    #[test]
    fn what_lies_close_under_a_sheet_is_buried() {
        // A floor, and a sheet over its left half that looks the other way from just above it.
        let mut triangles = quad(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0, 0).to_vec();
        let over = Vec3::new(0.0, 0.001, 0.0);
        triangles.extend(quad(over, Vec3::Z * 4.0, Vec3::X * 2.0, 0));
        let input = || SurfelsIn {
            geometry: Geometry { diagonal: 6.0, bias: 1e-5, ..soup(&triangles) }.into(),
            materials: plain_materials(&[Vec3::ONE]).into(),
            rest: still().into(),
        };
        let node = Surfels { count: 2400, ..Surfels::default() };
        let kept = node.run(input(), &Ctx::default()).unwrap();
        // Triangles of the floor have 8 square metres, those of the sheet 4.
        let area = |surfels: &data::Surfels, floor: bool| -> f32 {
            let of = surfels.triangle.iter().zip(surfels.share.iter());
            of.filter(|(t, _)| (**t < 2) == floor).map(|(_, share)| share * if floor { 8.0 } else { 4.0 }).sum()
        };
        let all = Surfels { buried: 0.0, ..node }.run(input(), &Ctx::default()).unwrap();
        assert_eq!(all.triangle.len(), 2400);
        assert!((area(&all, true) - 16.0).abs() < 1e-2 && (area(&all, false) - 8.0).abs() < 1e-2);
        // The half of the floor under the sheet is gone.
        let (floor, sheet) = (area(&kept, true), area(&kept, false));
        assert!((7.0..10.0).contains(&floor) && (sheet - 8.0).abs() < 1e-2, "{floor} {sheet}");
    }

    #[test]
    fn discs_cover_their_areas() {
        let least = run(500, Faces::Front).spread.iter().copied().fold(f32::INFINITY, f32::min);
        assert!(least >= 0.56, "{least}: a disc of its own area has 1 / sqrt pi");
    }
}
