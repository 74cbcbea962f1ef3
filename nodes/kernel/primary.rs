//! Primary rays: what the camera sees through a point of the picture.

use super::latlong;
use super::stage::{Face, Stage, Surface};
use super::visibility::{Ends, Hit};
use crate::data::{Camera, Environment};
use glam::{Vec2, Vec3};

/// What a primary ray sees, or its unit direction if it sees nothing.
pub type Seen = Result<(Hit, Surface), Vec3>;

/// A camera that takes a picture of a given size.
pub struct Lens<'a> {
    camera: &'a Camera,
    size: Vec2,
}

impl<'a> Lens<'a> {
    /// `width` x `height` pixels; the field of view spans the height.
    pub fn new(camera: &'a Camera, width: usize, height: usize) -> Self {
        Lens { camera, size: Vec2::new(width as f32, height as f32) }
    }

    /// Origin and unit direction of the ray through `at`, in pixels from the upper left corner.
    pub fn ray(&self, at: Vec2) -> (Vec3, Vec3) {
        let camera = self.camera;
        let x = (2.0 * at.x - self.size.x) / self.size.y;
        let y = 1.0 - 2.0 * at.y / self.size.y;
        if camera.half_height_tangent > 0.0 {
            let (x, y) = (x * camera.half_height_tangent, y * camera.half_height_tangent);
            (camera.eye, (camera.forward + camera.right * x + camera.up * y).normalize())
        } else {
            let offset =
                camera.right * (x * camera.half_height) + camera.up * (y * camera.half_height);
            (camera.eye + offset, camera.forward)
        }
    }

    /// The nearest surface seen through `at` between the clip planes, facing the camera.
    pub fn see(&self, stage: &Stage, at: Vec2) -> Option<(Hit, Surface)> {
        let (origin, direction) = self.ray(at);
        let [near, far] = self.limits(direction);
        let hit = stage.closest(origin, direction, near, far)?;
        Some((hit, stage.surface(hit.triangle, hit.u, hit.v).facing(-direction)))
    }

    /// Calls `seen` with the number of each point of `at` and what [`Lens::see`] gives for it, or the ray's direction
    /// where it gives nothing. Fastest for points near to each other, 64 at once.
    pub fn see_all(&self, stage: &Stage, at: &[Vec2], mut seen: impl FnMut(usize, Seen)) {
        if self.camera.half_height_tangent <= 0.0 {
            // Parallel rays share no origin.
            for (i, &at) in at.iter().enumerate() {
                seen(i, self.see(stage, at).ok_or_else(|| self.ray(at).1));
            }
            return;
        }
        for (chunk, at) in at.chunks(Ends::CAPACITY).enumerate() {
            let directions = at.iter().map(|&at| self.ray(at).1).collect::<Vec<_>>();
            let mut limits = [[0.0; Ends::CAPACITY]; 2];
            for (i, direction) in directions.iter().enumerate() {
                [limits[0][i], limits[1][i]] = self.limits(*direction);
            }
            let (ends, active) = Ends::from_points(&directions);
            let hits = stage.closest_from(self.camera.eye, &ends, active, &limits);
            // Neighbours mostly see the same triangle.
            let mut last: Option<Face> = None;
            for (i, (direction, hit)) in directions.into_iter().zip(hits).enumerate() {
                let surface = |hit: Hit| {
                    let surface = match &last {
                        Some(face) if face.triangle == hit.triangle => face.surface(hit.u, hit.v),
                        _ => last.insert(stage.face(hit.triangle)).surface(hit.u, hit.v),
                    };
                    (hit, surface.facing(-direction))
                };
                seen(chunk * Ends::CAPACITY + i, hit.map(surface).ok_or(direction));
            }
        }
    }

    /// Distances at which a ray of unit `direction` meets the clip planes.
    fn limits(&self, direction: Vec3) -> [f32; 2] {
        let cosine = direction.dot(self.camera.forward).max(1e-6);
        self.camera.clip.map(|depth| (depth / cosine).min(f32::MAX))
    }
}

/// Radiance of the environment in a direction (unit, away from the eye); bilinear, wrapping around
/// the horizon: u = 0.5 is +X, u = 0.25 is -Z, v = 0 is +Y.
pub fn background(environment: &Environment, direction: Vec3) -> Vec3 {
    let [height, width] = *environment.radiance.shape() else { return Vec3::ZERO };
    if width == 0 || height == 0 {
        return Vec3::ZERO;
    }
    let at = latlong::uv(direction.as_dvec3()).as_vec2();
    let (x, y) =
        (at.x * width as f32 - 0.5, (at.y * height as f32 - 0.5).clamp(0.0, height as f32 - 1.0));
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let column = |dx: i64| (x.floor() as i64 + dx).rem_euclid(width as i64) as usize;
    let row = |dy: usize| (y.floor() as usize + dy).min(height - 1);
    let at = |dx: i64, dy: usize| environment.radiance[row(dy) * width + column(dx)];
    at(0, 0).lerp(at(1, 0), fx).lerp(at(0, 1).lerp(at(1, 1), fx), fy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Array;

    fn camera() -> Camera {
        Camera {
            eye: Vec3::ZERO,
            right: Vec3::X,
            up: Vec3::Y,
            forward: Vec3::NEG_Z,
            half_height_tangent: 1.0,
            half_height: 0.0,
            clip: [0.0, f32::MAX],
        }
    }

    #[test]
    fn rays_through_centre_and_edges() {
        let camera = camera();
        let lens = Lens::new(&camera, 200, 100);
        assert_eq!(lens.ray(Vec2::new(100.0, 50.0)).1, Vec3::NEG_Z);
        assert!(
            (lens.ray(Vec2::new(100.0, 0.0)).1 - Vec3::new(0.0, 1.0, -1.0).normalize()).length()
                < 1e-6
        );
        assert!(
            (lens.ray(Vec2::new(200.0, 50.0)).1 - Vec3::new(2.0, 0.0, -1.0).normalize()).length()
                < 1e-6
        );
        let flat = Camera { half_height_tangent: 0.0, half_height: 3.0, ..camera.clone() };
        let (origin, direction) = Lens::new(&flat, 200, 100).ray(Vec2::new(100.0, 100.0));
        assert_eq!((origin, direction), (Vec3::new(0.0, -3.0, 0.0), Vec3::NEG_Z));
    }

    #[test]
    fn the_environment_is_oriented_as_documented() {
        let mut texels = vec![Vec3::ZERO; 8 * 4];
        let row = 2;
        texels[row * 8 + 4] = Vec3::X;
        texels[row * 8 + 2] = Vec3::Y;
        texels[row * 8 + 6] = Vec3::Z;
        texels[..8].fill(Vec3::ONE);
        let environment = Environment { radiance: Array::shaped(texels, &[4, 8]) };
        let tilt = |d: Vec3| background(&environment, (d - Vec3::Y * 0.4).normalize());
        assert!(tilt(Vec3::X).x > 0.4 && tilt(Vec3::NEG_Z).y > 0.4 && tilt(Vec3::Z).z > 0.4);
        assert_eq!(background(&environment, Vec3::Y), Vec3::ONE);
        assert_eq!(tilt(Vec3::NEG_X), Vec3::ZERO);
    }
}
