//! One of a scene's cameras at one time.

use crate::data::{Scene, Time};
use crate::kernel::animation::{Pose, cos_sin};
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// One of the scene's own cameras.
    pub struct Camera {
        /// Which of the scene's cameras, counted from 0.
        index: u32 = 0;
    }
}

crate::inputs! {
    /// Inputs of [`Camera`].
    pub struct CameraIn {
        /// The scene.
        scene: Item<Scene>,
        /// When; the start of the animation if not given.
        time: Option<Item<Time>>,
    }
}

impl Node for Camera {
    const KIND: &'static str = "Camera";
    const VERSION: u32 = 1;
    type In = CameraIn;
    type Out = crate::data::Camera;

    fn run(&self, input: CameraIn, _: &Ctx) -> Result<Self::Out, Error> {
        let index = self.index;
        let camera = input.scene.camera.get(index as usize);
        let &[node, field_of_view, half_height, near, far] =
            camera.ok_or_else(|| Error::invalid(missing(&input.scene, index)))?;
        let pose = Pose::at(&input.scene, input.time.map_or(0.0, |time| time.seconds))?;
        let place = pose.position(node as usize).zip(pose.frame(node as usize));
        let Some((eye, [right, up, forward])) = place else {
            return Err(Error::invalid(format!(
                "camera {index} (node {node}) has no place or direction: a scale of 0, or not finite"
            )));
        };
        if field_of_view == 0.0 && !(half_height > 0.0 && half_height.is_finite()) {
            return Err(Error::invalid(format!(
                "camera {index} is orthographic and {half_height} m high"
            )));
        }
        // Also refuses what is not a number.
        if !(0.0..std::f32::consts::PI).contains(&field_of_view) {
            return Err(Error::invalid(format!(
                "camera {index} has a field of view of {field_of_view} radians"
            )));
        }
        let [cosine, sine] = cos_sin(f64::from(field_of_view).to_degrees() / 2.0);
        Ok(crate::data::Camera {
            eye: eye.as_vec3(),
            right: right.as_vec3(),
            up: up.as_vec3(),
            forward: forward.as_vec3(),
            half_height_tangent: (sine / cosine) as f32,
            half_height: if field_of_view == 0.0 { half_height } else { 0.0 },
            clip: [near, far],
        })
    }
}

fn missing(scene: &Scene, index: u32) -> String {
    let about = |(i, &[node, field_of_view, ..]): (usize, &[f32; 5])| {
        let degrees = field_of_view.to_degrees();
        if degrees > 0.0 {
            format!("{i} (perspective, {degrees:.1} degrees, node {node})")
        } else {
            format!("{i} (orthographic, node {node})")
        }
    };
    let cameras: Vec<String> = scene.camera.iter().enumerate().map(about).collect();
    if cameras.is_empty() {
        "the scene has no camera; OrbitCamera makes one that looks at its geometry".into()
    } else {
        format!("the scene has no camera {index}; it has {}", cameras.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::channel;
    use crate::kernel::animation::fixture::{animate, nodes};
    use glam::Vec3;

    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

    fn run(scene: &Scene, index: u32, seconds: f64) -> Result<crate::data::Camera, Error> {
        let time = Some(Time { seconds }.into());
        Camera { index }.run(CameraIn { scene: scene.clone().into(), time }, &Ctx::default())
    }

    #[test]
    fn looks_along_minus_z_whatever_the_scale() {
        let mut scene = nodes(&[(-1, Vec3::ZERO), (0, Vec3::new(0.0, 0.0, 2.0))]);
        scene.camera = vec![[1.0, std::f32::consts::FRAC_PI_2, 0.0, 0.1, f32::MAX]].into();
        let turn = [0.0, 0.0, 0.0, 1.0, 0.0, HALF, 0.0, HALF];
        animate(&mut scene, 0, channel::ROTATION, channel::LINEAR, &[0.0, 1.0], &turn);
        let camera = run(&scene, 0, 0.0).unwrap();
        assert_eq!((camera.eye, camera.forward), (Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z));
        assert_eq!((camera.right, camera.up), (Vec3::X, Vec3::Y));
        assert!((camera.half_height_tangent - 1.0).abs() < 1e-6 && camera.half_height == 0.0);
        assert_eq!(camera.clip, [0.1, f32::MAX]);
        scene.node_scale = vec![Vec3::new(-3.0, 2.0, 1.0), Vec3::ONE].into();
        let camera = run(&scene, 0, 1.0).unwrap();
        assert!(camera.eye.distance(Vec3::new(2.0, 0.0, 0.0)) < 1e-6);
        assert!(camera.forward.distance(Vec3::NEG_X) < 1e-6 && camera.up.distance(Vec3::Y) < 1e-6);
        assert!(camera.right.distance(Vec3::NEG_Z) < 1e-6);
    }

    #[test]
    fn orthographic_cameras_keep_their_height() {
        let mut scene = nodes(&[(-1, Vec3::ZERO)]);
        scene.camera = vec![[0.0, 0.0, 3.0, 0.0, 10.0]].into();
        let camera = run(&scene, 0, 0.0).unwrap();
        assert_eq!((camera.half_height, camera.half_height_tangent), (3.0, 0.0));
    }

    #[test]
    fn a_missing_or_broken_camera_is_told() {
        let mut scene = nodes(&[(-1, Vec3::ZERO)]);
        let text = |scene: &Scene| run(scene, 2, 0.0).unwrap_err().to_string();
        assert!(text(&scene).contains("OrbitCamera"));
        scene.camera = vec![[0.0, 1.0, 0.0, 0.1, 9.0], [0.0, 0.0, 1.0, 0.1, 9.0]].into();
        assert!(
            text(&scene).ends_with(
                "it has 0 (perspective, 57.3 degrees, node 0), 1 (orthographic, node 0)"
            )
        );
        for broken in [
            [0.0, f32::NAN, 1.0, 0.1, 9.0],
            [0.0, 4.0, 1.0, 0.1, 9.0],
            [0.0; 5],
            [7.0, 1.0, 0.0, 0.1, 9.0],
        ] {
            scene.camera = vec![broken; 3].into();
            assert!(text(&scene).contains("camera 2"), "{broken:?}");
        }
    }
}
