//! Shading of surfels: the light that each reflects (Buchholz and Boubekeur 2012, section 1.1).

use crate::data::{Geometry, Lights, Materials, PbgiTree, Poses, RadiantSurfels, Surfels};
use crate::kernel::element::Receiver;
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::pbgi::gather::{Gather, MicroBuffer, Settings, Shape};
use crate::kernel::pbgi::stored;
use crate::kernel::stage::{Stage, Surface};
use crate::node::{Ctx, Error, Item, Node};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

crate::params! {
    /// Lights surfels with every light there is, through the same matrix element as pixels. With a tree,
    /// they also gather from it what it reflects: one more bounce.
    pub struct ShadeSurfels {
        /// Whether surfels send what their surfaces emit, for emitters that are no lights.
        emission: bool = false;
        /// Cells a side of the buffers with which surfels gather.
        resolution: u32 = 4, 1..=64;
    }
}

crate::inputs! {
    /// Inputs of [`ShadeSurfels`].
    pub struct ShadeSurfelsIn {
        /// The surfels.
        surfels: Item<Surfels>,
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// Lights that shine on them.
        lights: Option<Item<Lights>>,
        /// The bounce before.
        tree: Option<Item<PbgiTree>>,
    }
}

/// Surfels shaded as one piece of work.
const BATCH: usize = 256;

impl Node for ShadeSurfels {
    const KIND: &'static str = "ShadeSurfels";
    const VERSION: u32 = 3;
    type In = ShadeSurfelsIn;
    type Out = RadiantSurfels;

    fn run(&self, input: ShadeSurfelsIn, ctx: &Ctx) -> Result<RadiantSurfels, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let surfels = &*input.surfels;
        let count = surfels.triangle.len();
        if surfels.triangle.iter().any(|t| *t >= stage.triangles()) {
            return Err(Error::invalid("the surfels are of another geometry"));
        }
        let tensor = input.lights.as_ref().map(|lights| RayTensor::new(&stage, lights));
        let lights = tensor.as_ref().map_or(0, RayTensor::lights);
        ctx.evaluated(count as u64 * lights as u64);
        let indices: Vec<usize> = (0..count).collect();
        let (done, total) = (AtomicU64::new(0), count.div_ceil(BATCH) as u64);
        let lit: Vec<Vec<(Receiver, Vec3)>> = indices
            .par_chunks(BATCH)
            .map(|batch| {
                ctx.tick(done.fetch_add(1, Ordering::Relaxed), total)?;
                let mut row = vec![Vec3::ZERO; lights];
                let shade = |&i: &usize| {
                    let surface = surface(&stage, surfels, i);
                    let Surface { position, normal, facet, .. } = surface;
                    let albedo = surface.spread_albedo();
                    let receiver = Receiver::diffuse(position, normal, facet, albedo);
                    let mut radiance = if self.emission { surface.emitted.as_dvec3() } else { DVec3::ZERO };
                    if let Some(tensor) = &tensor
                        && albedo != Vec3::ZERO
                    {
                        tensor.row(&receiver, &mut row);
                        radiance += row.iter().map(|r| r.as_dvec3()).sum::<DVec3>();
                    }
                    (receiver, radiance.min(DVec3::splat(f64::from(f32::MAX))).as_vec3())
                };
                Ok(batch.iter().map(shade).collect())
            })
            .collect::<Result<_, Error>>()?;
        let lit: Vec<(Receiver, Vec3)> = lit.into_iter().flatten().collect();
        let mut radiance: Vec<Vec3> = lit.iter().map(|(_, radiance)| *radiance).collect();
        if let Some(tree) = &input.tree {
            let receivers: Vec<Receiver> = lit.iter().map(|(receiver, _)| *receiver).collect();
            let buffer = MicroBuffer::new(Shape::Cube, self.resolution);
            let background = |_: Vec3| Vec3::ZERO;
            let settings = Settings::default();
            let gathered = stored::with_tree!(tree, hierarchy => {
                let gather = Gather { hierarchy: &hierarchy, buffer: &buffer, settings, background };
                gather.all(&receivers, |done, total| ctx.tick(done, total))?
            });
            radiance.iter_mut().zip(&gathered.0).for_each(|(sum, more)| *sum += more.radiance);
        }
        let area = |i: usize| stage.area(surfels.triangle[i]) * surfels.share[i];
        Ok(RadiantSurfels {
            position: lit.iter().map(|(receiver, _)| receiver.position).collect(),
            normal: lit.iter().map(|(receiver, _)| receiver.facet).collect(),
            radiance: radiance.into(),
            area: (0..count).map(area).collect(),
            radius: (0..count).map(|i| surfels.spread[i] * area(i).sqrt()).collect(),
        })
    }
}

fn surface(stage: &Stage, surfels: &Surfels, i: usize) -> Surface {
    let at = surfels.barycentric[i];
    let surface = stage.surface(surfels.triangle[i], at.x, at.y);
    let outward = if surfels.front[i] != 0 { surface.facet } else { -surface.facet };
    surface.facing(outward)
}
