//! The photon pass: indirect light for the gather samples (Hašan et al. 2008, section 5).

use crate::data::{self, Geometry, Lights, Materials, Poses};
use crate::kernel::photon_tracing::{Landing, trace};
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// Shoots photons into the scene and keeps where they land. What the gather samples compute themselves
    /// is not stored: the first hit of photons from `direct` lights.
    pub struct Photons {
        /// Photons emitted from each set of lights; 10,000 in the paper.
        count: u32 = 10_000, 1..=16_777_216;
        /// Seed of their paths; the same in every frame, so that paths change only with the scene.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`Photons`].
    pub struct PhotonsIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// Lights whose direct light the gather samples compute: the first hit is not stored.
        direct: Option<Item<Lights>>,
        /// Lights too many for that, as skies and emitting meshes: the first hit is stored too.
        area: Option<Item<Lights>>,
    }
}

impl Node for Photons {
    const KIND: &'static str = "Photons";
    const VERSION: u32 = 2;
    type In = PhotonsIn;
    type Out = data::Photons;

    fn run(&self, input: PhotonsIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let mut landed: Vec<Landing> = Vec::new();
        for (lights, first) in [(&input.direct, 1), (&input.area, 0)] {
            if let Some(lights) = lights {
                let keep = |l: &Landing| (l.bounce >= first).then_some(*l);
                landed.extend(trace(&stage, lights, self.count, self.seed, ctx, keep)?);
            }
        }
        if landed.is_empty() {
            ctx.note("no photon was stored");
        }
        Ok(data::Photons {
            position: landed.iter().map(|l| l.surface.position).collect(),
            direction: landed.iter().map(|l| l.direction).collect(),
            power: landed.iter().map(|l| l.power).collect(),
            normal: landed.iter().map(|l| l.surface.facet).collect(),
        })
    }
}
