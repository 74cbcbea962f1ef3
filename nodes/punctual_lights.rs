//! The point, spot and directional lights of a scene (KHR_lights_punctual) at one time.

use crate::data::{LightKind, Lights, Scene, Time};
use crate::kernel::animation::Pose;
use crate::node::{Ctx, Error, Item, Node};
use glam::{Vec2, Vec3};

crate::params! {
    /// The lights of a scene that are points or directions; none is a legal answer. Ranges are
    /// ignored: light reaches as far as it does.
    pub struct PunctualLights {}
}

crate::inputs! {
    /// Inputs of [`PunctualLights`].
    pub struct PunctualLightsIn {
        /// The scene.
        scene: Item<Scene>,
        /// When; the start of the animation if not given.
        time: Option<Item<Time>>,
    }
}

impl Node for PunctualLights {
    const KIND: &'static str = "PunctualLights";
    const VERSION: u32 = 1;
    type In = PunctualLightsIn;
    type Out = Lights;

    fn run(&self, input: PunctualLightsIn, ctx: &Ctx) -> Result<Lights, Error> {
        let lights = &input.scene.light;
        let pose = Pose::at(&input.scene, input.time.map_or(0.0, |time| time.seconds))?;
        let (mut kinds, mut positions, mut directions) = (Vec::new(), Vec::new(), Vec::new());
        let (mut emissions, mut cones) = (Vec::new(), Vec::new());
        let mut undirected = 0;
        for (i, &[node, kind, r, g, b, inner, outer]) in lights.iter().enumerate() {
            let wrong = |what: &str| Error::invalid(format!("light {i} (node {node}) has {what}"));
            let kind = match kind {
                0.0 => LightKind::Omni,
                1.0 => LightKind::Spot,
                2.0 => LightKind::Directional,
                _ => return Err(wrong("an unknown kind")),
            };
            let position =
                pose.position(node as usize).ok_or_else(|| wrong("no finite position"))?;
            let mut emission = Vec3::new(r, g, b);
            if !emission.is_finite() {
                return Err(wrong("an intensity that is not finite"));
            }
            let direction = pose.forward(node as usize);
            if direction.is_none() && kind != LightKind::Omni {
                // It stays in the list, so that light j is the same light when the scale returns.
                emission = Vec3::ZERO;
                undirected += 1;
            }
            kinds.push(kind as u8);
            positions.push(position.as_vec3());
            directions.push(direction.map_or(Vec3::NEG_Z, |d| d.as_vec3()));
            emissions.push(emission);
            cones.push(if kind == LightKind::Spot { Vec2::new(inner, outer) } else { Vec2::ZERO });
        }
        if undirected > 0 {
            ctx.note(format!(
                "{undirected} lights switched off: a scale of 0 leaves them no direction"
            ));
        }
        Ok(Lights {
            kind: kinds.into(),
            position: positions.into(),
            direction: directions.into(),
            emission: emissions.into(),
            cone: cones.into(),
            clamp: vec![0.0; lights.len()].into(),
            identity: 1,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::animation::fixture::nodes;

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

    fn run(scene: Scene) -> (Result<Lights, Error>, Vec<String>) {
        let ctx = Ctx::default();
        let input = PunctualLightsIn { scene: scene.into(), time: None };
        (PunctualLights::default().run(input, &ctx), ctx.notes())
    }

    fn lit() -> Scene {
        // Node 1 is turned by -90 degrees about X: what shone along -Z shines down.
        let mut scene = nodes(&[(-1, Vec3::X), (0, Vec3::Y)]);
        scene.node_rotation = vec![[0.0, 0.0, 0.0, 1.0], [-HALF, 0.0, 0.0, HALF]].into();
        scene.node_scale = vec![Vec3::splat(2.0), Vec3::new(1.0, 5.0, 3.0)].into();
        scene.light = vec![
            [1.0, 1.0, 1.0, 2.0, 3.0, 0.9, 0.8],
            [0.0, 0.0, 4.0, 4.0, 4.0, 0.0, 0.0],
            [1.0, 2.0, 5.0, 5.0, 5.0, 0.0, 0.0],
        ]
        .into();
        scene
    }

    #[test]
    fn lights_shine_along_minus_z_of_their_node() {
        let lights = run(lit()).0.unwrap();
        assert_eq!(lights.kind[..], [1, 0, 2]);
        assert_eq!(lights.position[..2], [Vec3::new(1.0, 2.0, 0.0), Vec3::X]);
        assert!(lights.direction[0].distance(Vec3::NEG_Y) < 1e-6);
        assert_eq!((lights.direction[0], lights.direction[1]), (lights.direction[2], Vec3::NEG_Z));
        assert_eq!(
            (lights.emission[0], lights.cone[0]),
            (Vec3::new(1.0, 2.0, 3.0), Vec2::new(0.9, 0.8))
        );
        assert_eq!((lights.clamp[..].to_vec(), lights.identity), (vec![0.0; 3], 1));
    }

    #[test]
    fn no_lights_are_legal_and_a_scale_of_zero_switches_off() {
        assert!(run(nodes(&[])).0.unwrap().kind.is_empty());
        let mut scene = lit();
        scene.node_scale = vec![Vec3::ONE, Vec3::ZERO].into();
        let (lights, notes) = run(scene);
        let emission = lights.unwrap().emission;
        assert_eq!(
            (emission[0], emission[1], emission[2]),
            (Vec3::ZERO, Vec3::splat(4.0), Vec3::ZERO)
        );
        assert!(notes[0].starts_with("2 lights"));
    }

    #[test]
    fn broken_lights_are_named() {
        for (column, value) in [(0, 9.0), (1, 7.0), (3, f32::INFINITY)] {
            let mut scene = lit();
            let mut light = scene.light[0];
            light[column] = value;
            scene.light = vec![light].into();
            assert!(run(scene).0.unwrap_err().to_string().contains("light 0"));
        }
    }
}
