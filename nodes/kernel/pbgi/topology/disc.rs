//! A surfel as the builders sort it, and spheres around several.

use super::super::hierarchy::{Bound, Surfel, SurfelSet};
use glam::Vec3;
use rayon::prelude::*;

/// Place, size and number of a surfel.
#[derive(Clone, Copy)]
pub struct Disc {
    pub position: Vec3,
    pub radius: f32,
    pub surfel: u32,
}

/// The discs of surfels, numbered.
pub fn discs(surfels: &impl SurfelSet) -> Vec<Disc> {
    let disc = |i: usize| {
        let Surfel { position, radius, .. } = surfels.surfel(i);
        Disc { position, radius, surfel: i as u32 }
    };
    (0..surfels.count()).into_par_iter().map(disc).collect()
}

/// Corners of the box around their centres.
pub fn corners(discs: &[Disc]) -> [Vec3; 2] {
    let start = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    discs.iter().fold(start, |[low, high], d| [low.min(d.position), high.max(d.position)])
}

/// A sphere with the centre of the box that holds all discs whichever way they face.
pub fn sphere(discs: &[Disc], [low, high]: [Vec3; 2]) -> Bound {
    let center = low * 0.5 + high * 0.5;
    let middle = center.as_dvec3();
    let reach = |d: &Disc| (d.position.as_dvec3() - middle).length() + f64::from(d.radius);
    Bound { center, radius: above(discs.iter().map(reach).fold(0.0, f64::max)) }
}

/// The least f32 that is not less.
pub fn above(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}
