//! What a scene has, as far as it decides the graph.

use lightloom_nodes as nodes;
use nodes::data::{Scene, alpha, instance};
use nodes::kernel::animation::moving;
use nodes::kernel::stage::Stage;
use nodes::node::{Ctx, Error, Item, Node};
use std::collections::BTreeSet;
use std::f64::consts::PI;

/// What a scene has, as far as it decides the graph.
pub struct Needs {
    /// Cameras, and whether the first moves.
    pub cameras: (usize, bool),
    /// Point, spot and directional lights that are not black, and whether one moves.
    pub lights: ([usize; 3], bool),
    /// Emitting triangles at the start, their area in square metres and power in watts.
    pub emissive: (usize, f64, f64),
    /// Exposure that brings what the strongest lights shine on to about 1; never above 0.
    pub stops: i32,
    /// End of the animation, seconds.
    pub seconds: f64,
    /// Instances that move as they are, and those that deform.
    pub instances: [usize; 2],
    /// Materials in use that are double-sided, and those that have an alpha mask.
    pub materials: [usize; 2],
    pub triangles: usize,
    /// Diagonal of the bounding box at the start, metres.
    pub diagonal: f64,
}

impl Needs {
    /// Looks through a scene.
    ///
    /// # Errors
    /// When there is nothing to light, or the scene is inconsistent.
    pub fn of(scene: Scene, ctx: &Ctx) -> Result<Needs, Error> {
        let scene: Item<Scene> = scene.into();
        let geometry: Item<_> =
            nodes::Geometry::default().run(nodes::GeometryIn { scene: scene.clone() }, ctx)?.into();
        if geometry.triangle.is_empty() || geometry.instance.is_empty() {
            return Err(Error::invalid("the scene has no triangles, so there is nothing to light"));
        }
        let moving = moving(&scene)?;
        let moves = |node: f32| moving.get(node as usize).copied().unwrap_or(false);
        let lit: Vec<_> = scene.light.iter().filter(|l| l[2..5].iter().any(|c| *c > 0.0)).collect();
        let lights = [0.0, 1.0, 2.0].map(|kind| lit.iter().filter(|l| l[1] == kind).count());
        let motion = |kind| geometry.instance.iter().filter(|i| i[2] == kind).count();
        let used: BTreeSet<u32> = geometry.triangle_material.iter().copied().collect();
        let used_and =
            |has: &dyn Fn(usize) -> bool| used.iter().filter(|m| has(**m as usize)).count();
        let emissive = emission(&scene, &geometry, ctx)?;
        let diagonal = f64::from(geometry.diagonal);
        // Where lights shine on grey from half the diagonal, and emitters on the sphere around all.
        let reach = |l: &[f32; 7]| if l[1] == 2.0 { 1.0 } else { (diagonal / 2.0).powi(2) };
        let near = lit.iter().map(|l| f64::from(l[2] + l[3] + l[4]) / 3.0 / reach(l)).sum::<f64>();
        let radiance = (near + emissive.2 / (PI * diagonal * diagonal)) * 0.5 / PI;
        Ok(Needs {
            cameras: (scene.camera.len(), scene.camera.first().is_some_and(|c| moves(c[0]))),
            lights: (lights, lit.iter().any(|l| moves(l[0]))),
            emissive,
            // Below two stops the guess is worse than none; the limit is that of the pictures.
            stops: if radiance > 4.0 { -(radiance.log2().round().min(64.0) as i32) } else { 0 },
            seconds: scene.key_time.iter().copied().fold(0.0, f32::max).into(),
            instances: [instance::RIGID, instance::DEFORMING].map(motion),
            materials: [
                used_and(&|m| scene.double_sided[m] == 1),
                used_and(&|m| scene.alpha_mode[m][0] == alpha::MASK),
            ],
            triangles: geometry
                .instance
                .iter()
                .map(|i| geometry.mesh[i[0] as usize][1] as usize)
                .sum(),
            diagonal,
        })
    }

    pub fn shapes_move(&self) -> bool {
        self.instances != [0, 0]
    }

    pub fn moves(&self) -> bool {
        self.shapes_move() || self.cameras.1 || self.lights.1
    }

    pub fn punctual(&self) -> usize {
        self.lights.0.iter().sum()
    }
}

/// Emitting triangles, their area and power: as `EmissiveLights` sees them, at their centroids.
fn emission(
    scene: &Item<Scene>,
    geometry: &Item<nodes::data::Geometry>,
    ctx: &Ctx,
) -> Result<(usize, f64, f64), Error> {
    if scene.emissive.iter().all(|e| e.max_element() <= 0.0) {
        return Ok((0, 0.0, 0.0));
    }
    let materials =
        nodes::Materials {}.run(nodes::MaterialsIn { scene: scene.clone() }, ctx)?.into();
    let poses =
        nodes::Poses {}.run(nodes::PosesIn { scene: scene.clone(), time: None }, ctx)?.into();
    let stage = Stage::of(ctx, geometry, &materials, &poses)?;
    let mut sum = (0, 0.0, 0.0);
    for triangle in 0..stage.triangles() {
        let surface = stage.surface(triangle, 1.0 / 3.0, 1.0 / 3.0);
        let area = f64::from(stage.area(triangle)) * if surface.double_sided { 2.0 } else { 1.0 };
        let radiance = f64::from(surface.emitted.element_sum() / 3.0);
        if area * radiance > 0.0 {
            sum = (sum.0 + 1, sum.1 + area, sum.2 + PI * area * radiance);
        }
    }
    Ok(sum)
}
