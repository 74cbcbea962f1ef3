//! A camera that looks at a scene's geometry, and may turn around it.

use crate::data::{Camera, Geometry, Time};
use crate::kernel::animation::cos_sin;
use crate::node::{Ctx, Error, Item, Node};
use glam::{DVec3, Vec3};

crate::params! {
    /// Looks at the centre of the geometry from a distance at which all of it is in view, and turns
    /// around the vertical axis; or turns a given camera around that centre.
    pub struct OrbitCamera {
        /// Angle turned in `seconds`, degrees, counter-clockwise seen from above.
        degrees: f32 = 0.0, -36_000.0..=36_000.0;
        /// Time for `degrees`, seconds; the turning goes on after it.
        seconds: f32 = 1.0, 1e-3..=1e6;
        /// Where it starts: degrees from +Z towards +X. Not used with `base`.
        azimuth: f32 = 0.0, -360.0..=360.0;
        /// Degrees above the horizon. Not used with `base`.
        elevation: f32 = 15.0, -90.0..=90.0;
        /// Distance from the target; at 1 the bounding sphere just fits the picture's height. Not
        /// used with `base`.
        distance: f32 = 1.0, 1e-3..=1e3;
        /// Vertical field of view, degrees. Not used with `base`.
        field_of_view: f32 = 45.0, 1.0..=150.0;
        /// What it looks at and turns around, metres from the centre of the bounding box.
        target: [f32; 3] = [0.0; 3];
    }
}

crate::inputs! {
    /// Inputs of [`OrbitCamera`].
    pub struct OrbitCameraIn {
        /// What to look at.
        geometry: Item<Geometry>,
        /// When; the start of the turn if not given.
        time: Option<Item<Time>>,
        /// A camera to turn instead.
        base: Option<Item<Camera>>,
    }
}

impl Node for OrbitCamera {
    const KIND: &'static str = "OrbitCamera";
    const VERSION: u32 = 1;
    type In = OrbitCameraIn;
    type Out = Camera;

    fn run(&self, input: OrbitCameraIn, _: &Ctx) -> Result<Camera, Error> {
        let share = input.time.map_or(0.0, |time| time.seconds) / f64::from(self.seconds);
        let [cosine, sine] = cos_sin(f64::from(self.degrees) * share);
        let turned =
            |v: DVec3| DVec3::new(cosine * v.x + sine * v.z, v.y, cosine * v.z - sine * v.x);
        let target = input.geometry.centre.as_dvec3() + Vec3::from(self.target).as_dvec3();
        let base =
            input.base.map_or_else(|| self.base(&input.geometry, target), |base| (*base).clone());
        let eye = target + turned(base.eye.as_dvec3() - target);
        if !eye.as_vec3().is_finite() {
            return Err(Error::invalid(format!(
                "the camera turns around {target} m and is not finite there"
            )));
        }
        let [right, up, forward] =
            [base.right, base.up, base.forward].map(|axis| turned(axis.as_dvec3()).as_vec3());
        Ok(Camera { eye: eye.as_vec3(), right, up, forward, ..base })
    }
}

impl OrbitCamera {
    /// The camera at the start of its turn.
    fn base(&self, geometry: &Geometry, target: DVec3) -> Camera {
        let [east_z, east_x] = cos_sin(f64::from(self.azimuth));
        let [level, rise] = cos_sin(f64::from(self.elevation));
        let [cosine, sine] = cos_sin(f64::from(self.field_of_view) / 2.0);
        let distance = f64::from(self.distance) * f64::from(geometry.diagonal) / 2.0 / sine;
        let outward = DVec3::new(level * east_x, rise, level * east_z);
        let right = DVec3::new(east_z, 0.0, -east_x);
        Camera {
            eye: (target + outward * distance).as_vec3(),
            right: right.as_vec3(),
            up: outward.cross(right).as_vec3(),
            forward: (-outward).as_vec3(),
            half_height_tangent: (sine / cosine) as f32,
            half_height: 0.0,
            clip: [(distance * 1e-3) as f32, f32::MAX],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::animation::fixture::triangle;
    use crate::kernel::meshes;

    fn geometry() -> Item<Geometry> {
        meshes::geometry(&triangle(&[(-1, Vec3::new(2.0, 3.0, 4.0))]), 0.0).unwrap().0.into()
    }

    fn run(orbit: &OrbitCamera, seconds: f64, base: Option<Camera>) -> Camera {
        let time = Some(Time { seconds }.into());
        let input = OrbitCameraIn { geometry: geometry(), time, base: base.map(Item::from) };
        orbit.run(input, &Ctx::default()).unwrap()
    }

    fn near(a: Vec3, b: Vec3) -> bool {
        a.distance(b) < 1e-5
    }

    #[test]
    fn turns_around_the_centre_and_keeps_it_in_view() {
        let orbit =
            OrbitCamera { degrees: 180.0, seconds: 4.0, elevation: 0.0, ..OrbitCamera::default() };
        let centre = Vec3::new(2.5, 3.5, 4.0);
        let away = 0.5_f32.sqrt() / 22.5_f32.to_radians().sin();
        let start = run(&orbit, 0.0, None);
        assert!(near(start.eye, centre + away * Vec3::Z) && near(start.forward, Vec3::NEG_Z));
        assert!(near(start.right, Vec3::X) && near(start.up, Vec3::Y));
        let quarter = run(&orbit, 2.0, None);
        assert!(near(quarter.eye, centre + away * Vec3::X) && near(quarter.right, Vec3::NEG_Z));
        for step in 0..9 {
            let orbit = OrbitCamera { elevation: 40.0, azimuth: 20.0, ..orbit.clone() };
            let camera = run(&orbit, f64::from(step), None);
            assert!(near((centre - camera.eye).normalize(), camera.forward));
            assert!(near(camera.right.cross(camera.up), -camera.forward) && camera.up.y > 0.5);
        }
    }

    #[test]
    fn looks_straight_down_and_past_the_centre() {
        let orbit =
            OrbitCamera { elevation: 90.0, target: [1.0, 0.0, 0.0], ..OrbitCamera::default() };
        let camera = run(&orbit, 0.0, None);
        assert!(near(camera.forward, Vec3::NEG_Y) && near(camera.up, Vec3::NEG_Z));
        assert!((camera.eye.x - 3.5).abs() < 1e-5 && camera.eye.y > 4.0);
    }

    #[test]
    fn turns_a_given_camera() {
        let base = Camera {
            eye: Vec3::new(2.5, 10.0, 5.0),
            right: Vec3::X,
            up: Vec3::Y,
            forward: Vec3::NEG_Z,
            half_height_tangent: 0.0,
            half_height: 2.0,
            clip: [0.5, 7.0],
        };
        let orbit = OrbitCamera { degrees: 90.0, ..OrbitCamera::default() };
        let turned = run(&orbit, 1.0, Some(base.clone()));
        assert!(near(turned.eye, Vec3::new(3.5, 10.0, 4.0)) && near(turned.forward, Vec3::NEG_X));
        assert_eq!((turned.half_height, turned.clip, turned.up), (2.0, [0.5, 7.0], Vec3::Y));
        assert_eq!(
            crate::data::encode(&run(&orbit, 4.0, Some(base.clone()))),
            crate::data::encode(&base)
        );
    }
}
