//! Virtual point lights deposited by photons at every bounce (Hašan et al. 2007, "photons deposit on
//! every bounce, treat photons as point lights, cosine-weighted emission").

use crate::data::{Geometry, LightKind, Lights, Materials, Poses};
use crate::kernel::element::Light;
use crate::kernel::light_list::LightList;
use crate::kernel::photon_tracing::{Landing, trace};
use crate::kernel::stage::Stage;
use crate::node::{Ctx, Error, Item, Node};
use glam::Vec2;
use std::f32::consts::PI;

crate::params! {
    /// Shoots photons and leaves a light of cosine emission wherever one is reflected. The lights are
    /// others in every frame: for single frames only.
    pub struct PhotonLights {
        /// Photons emitted; each leaves a light at every bounce.
        count: u32 = 20_000, 1..=16_777_216;
        /// Distance below which the 1/r^2 of these lights is held constant, in scene diagonals.
        clamp: f32 = 0.02, 0.0..=10.0;
        /// Seed of the paths.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`PhotonLights`].
    pub struct PhotonLightsIn {
        /// Shapes.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are.
        poses: Item<Poses>,
        /// The lights that emit.
        lights: Item<Lights>,
    }
}

impl Node for PhotonLights {
    const KIND: &'static str = "PhotonLights";
    const VERSION: u32 = 2;
    type In = PhotonLightsIn;
    type Out = Lights;

    fn run(&self, input: PhotonLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let stage = Stage::of(ctx, &input.geometry, &input.materials, &input.poses)?;
        let clamp = self.clamp * input.geometry.diagonal;
        let deposit = |landing: &Landing| {
            let surface = &landing.surface;
            Some(Light {
                kind: LightKind::Cosine,
                position: surface.position,
                direction: surface.facet,
                // Reflected flux over pi is the intensity along the normal of a cosine emitter.
                emission: landing.power * surface.reflectance.albedo / PI,
                cone: Vec2::ZERO,
                clamp,
            })
        };
        let lights = trace(&stage, &input.lights, self.count, self.seed, ctx, deposit)?;
        if lights.is_empty() {
            ctx.note("no photon met a surface");
        }
        let mut list = LightList::new();
        lights.iter().for_each(|light| list.push(light));
        Ok(list.finish(false))
    }
}
