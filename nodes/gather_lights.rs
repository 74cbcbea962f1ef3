//! Shading of the gather samples, which makes them virtual lights (Hašan et al. 2008, section 5).

use crate::data::{GatherSamples, Geometry, LightKind, Lights, Materials, Photons, Poses};
use crate::kernel::cover::{Cover, Patch};
use crate::kernel::density::Density;
use crate::kernel::element::{Light, Receiver};
use crate::kernel::light_list::LightList;
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::stage::{Stage, Surface};
use crate::kernel::surface_sampling::{self, Point};
use crate::node::{Ctx, Error, Item, Node};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Lights the gather samples, directly and by photon density estimation, and turns each into a light
    /// of cosine emission.
    pub struct GatherLights {
        /// Photons that an estimate is made of.
        nearest: u32 = 50, 1..=10_000;
        /// Distance within which they are looked for, in scene diagonals.
        radius: f32 = 0.05, 0.0001..=1.0;
        /// Distance below which the 1/r^2 of these lights is held constant, in scene diagonals: it takes
        /// the spikes where a light is close to what it lights, and some energy.
        clamp: f32 = 0.02, 0.0..=10.0;
    }
}

crate::inputs! {
    /// Inputs of [`GatherLights`].
    pub struct GatherLightsIn {
        /// The samples.
        samples: Item<GatherSamples>,
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// Lights whose direct light is computed here.
        direct: Option<Item<Lights>>,
        /// Photons that bring the rest.
        photons: Option<Item<Photons>>,
    }
}

/// Samples of surface for each photon. Photons lie closer together where it is bright.
const PATCHES: usize = 2;

/// Samples of surface at least.
const LEAST_PATCHES: usize = 1 << 16;

/// Samples of surface at most; each takes some 60 bytes.
const MOST_PATCHES: usize = 1 << 20;

/// Samples shaded as one piece of work.
const BATCH: usize = 256;

impl Node for GatherLights {
    const KIND: &'static str = "GatherLights";
    const VERSION: u32 = 5;
    type In = GatherLightsIn;
    type Out = Lights;

    fn run(&self, input: GatherLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let samples = &input.samples;
        if samples.triangle.iter().any(|t| *t >= stage.triangles()) {
            return Err(Error::invalid("the gather samples are of another geometry"));
        }
        let tensor = input.direct.as_ref().map(|lights| RayTensor::new(&stage, lights));
        let diagonal = input.geometry.diagonal;
        let density = match &input.photons {
            Some(photons) => {
                let density = Density::new(photons, self.nearest, self.radius * diagonal)?;
                let both = samples.front.contains(&0);
                let cover = Cover::new(patches(&stage, photons.position.len(), both))?;
                Some((density, cover))
            }
            None => None,
        };
        let shader = Shader { stage: &stage, tensor, density, clamp: self.clamp * diagonal };
        let direct = shader.tensor.as_ref().map_or(0, RayTensor::lights);
        ctx.evaluated(samples.triangle.len() as u64 * direct as u64);
        let indices: Vec<usize> = (0..samples.triangle.len()).collect();
        let (done, total) = (AtomicU64::new(0), indices.len().div_ceil(BATCH) as u64);
        let lights: Vec<Vec<Light>> = indices
            .par_chunks(BATCH)
            .map(|batch| {
                ctx.tick(done.fetch_add(1, Ordering::Relaxed), total)?;
                Ok(shader.shade(batch, samples))
            })
            .collect::<Result<_, Error>>()?;
        let mut list = LightList::new();
        lights.iter().flatten().for_each(|light| list.push(light));
        Ok(list.finish(true))
    }
}

struct Shader<'a> {
    stage: &'a Stage,
    tensor: Option<RayTensor<'a>>,
    density: Option<(Density<'a>, Cover)>,
    clamp: f32,
}

impl Shader<'_> {
    fn shade(&self, batch: &[usize], samples: &GatherSamples) -> Vec<Light> {
        let mut row = vec![Vec3::ZERO; self.tensor.as_ref().map_or(0, RayTensor::lights)];
        let light = |&i: &usize| {
            let surface = sample(self.stage, samples, i);
            let patch = patch(self.stage, samples, i, &surface);
            let radiance = self.radiance(&surface, &patch, &mut row);
            Light {
                kind: LightKind::Cosine,
                position: surface.position,
                direction: surface.facet,
                emission: radiance * patch.area,
                cone: Vec2::ZERO,
                clamp: self.clamp,
            }
        };
        batch.iter().map(light).collect()
    }

    /// Radiance that the sample reflects, diffusely: a glossy lobe would need a direction.
    fn radiance(&self, surface: &Surface, patch: &Patch, row: &mut [Vec3]) -> Vec3 {
        let albedo = surface.spread_albedo();
        if albedo == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let receiver = Receiver::diffuse(surface.position, surface.normal, surface.facet, albedo);
        let mut radiance = DVec3::ZERO;
        if let Some(tensor) = &self.tensor {
            tensor.row(&receiver, row);
            radiance += row.iter().map(|r| r.as_dvec3()).sum::<DVec3>();
        }
        if let Some((density, cover)) = &self.density {
            radiance += (density.irradiance(patch, cover) * albedo / PI).as_dvec3();
        }
        radiance.as_vec3()
    }
}

/// The surface at sample `i`, on the side that it lies on.
fn sample(stage: &Stage, samples: &GatherSamples, i: usize) -> Surface {
    let at = samples.barycentric[i];
    let surface = stage.surface(samples.triangle[i], at.x, at.y);
    let outward = if samples.front[i] != 0 { surface.facet } else { -surface.facet };
    surface.facing(outward)
}

/// What sample `i` stands for.
fn patch(stage: &Stage, samples: &GatherSamples, i: usize, surface: &Surface) -> Patch {
    let area = stage.area(samples.triangle[i]) * samples.share[i];
    Patch { position: surface.position, normal: surface.facet, area }
}

/// Samples of all surfaces, a few for each photon, so that a disc of some dozens of photons holds enough of them; on both sides
/// of surfaces, where light is gathered on both.
fn patches(stage: &Stage, photons: usize, both: bool) -> Vec<Patch> {
    let areas: Vec<f64> = (0..stage.triangles()).into_par_iter().map(|t| f64::from(stage.area(t))).collect();
    let count = (PATCHES * photons).clamp(LEAST_PATCHES, MOST_PATCHES) as u32;
    let points = surface_sampling::sample(&areas, count, 0);
    let patch = |point: &Point| {
        let face = stage.face(point.triangle);
        let facet = face.facet;
        let back = both && point.spare < 0.5;
        let sides = if both { 2.0 } else { 1.0 };
        Patch {
            position: face.position(point.barycentric.x, point.barycentric.y),
            normal: if back { -facet } else { facet },
            area: areas[point.triangle as usize] as f32 * point.share * sides,
        }
    };
    points.par_iter().map(patch).collect()
}
