//! What rays meet in the posed scene: the hierarchy's answers, transparent texels left out.

use super::Stage;
use crate::data::alpha;
use crate::kernel::texture::{self, Texture};
use crate::kernel::visibility::{Blocker, Ends, Hit, Hits};
use glam::Vec3;

impl Stage {
    /// Whether a hit of the hierarchy counts: the filter of every query.
    fn solid(&self, number: u32, u: f32, v: f32) -> bool {
        let triangle = self.number(number);
        let (i, local) = self.locate(triangle);
        let t = (self.geometry.mesh[self.geometry.instance[i][0] as usize][0] + local) as usize;
        let m = self.geometry.triangle_material[t] as usize;
        let [mode, cutoff] = self.materials.alpha_mode[m];
        if mode != alpha::MASK {
            return true;
        }
        let corner = self.geometry.triangle[t];
        let uv = corner.map(|v| self.geometry.uv[v as usize]);
        let weights = [1.0 - u - v, u, v];
        let uv = uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2];
        let base = texture::sample(&self.materials, m, Texture::BaseColour, uv)[3];
        base * self.materials.base_colour[m][3] * self.vertex_colour(corner, weights)[3] >= cutoff
    }

    /// World-level triangle of the hierarchy's own number.
    fn number(&self, number: u32) -> u32 {
        let run = self.runs[self.runs.partition_point(|r| r.0 <= number) - 1];
        run.1 + (number - run.0)
    }

    /// The nearest surface along `direction` (unit) between distances `near` and `far`, metres; the
    /// hit's triangle is world-level.
    pub fn closest(&self, origin: Vec3, direction: Vec3, near: f32, far: f32) -> Option<Hit> {
        let hit =
            self.world.closest(origin, direction, near, far, &|t, u, v| self.solid(t, u, v))?;
        Some(Hit { triangle: self.number(hit.triangle), ..hit })
    }

    /// What [`Stage::closest`] gives along each of the active `directions`, between `limits[0]` and `limits[1]`.
    pub fn closest_from(
        &self,
        origin: Vec3,
        directions: &Ends,
        active: u64,
        limits: &[[f32; Ends::CAPACITY]; 2],
    ) -> Hits {
        let solid = |t, u, v| self.solid(t, u, v);
        let hits = self.world.closest_from(origin, directions, active, limits, &solid);
        hits.map(|hit| hit.map(|hit| Hit { triangle: self.number(hit.triangle), ..hit }))
    }

    /// Whether anything is strictly between two points: the scalar query that packets must match.
    pub fn occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.world.occluded(from, to, &|t, u, v| self.solid(t, u, v))
    }

    /// Whether anything is along `direction` from a point on.
    pub fn occluded_along(&self, from: Vec3, direction: Vec3) -> bool {
        self.world.occluded_along(from, direction, &|t, u, v| self.solid(t, u, v))
    }

    /// Which of the segments from `origin` to the active `ends` are blocked. `blocker` is what blocked rays nearby, and
    /// becomes what blocks these.
    pub fn occluded_from(
        &self,
        origin: Vec3,
        ends: &Ends,
        active: u64,
        blocker: &mut Blocker,
    ) -> u64 {
        let solid = |t, u, v| self.solid(t, u, v);
        self.world.occluded_from(origin, ends, active, blocker, &solid)
    }

    /// Which of the parallel rays from the active `starts` are blocked; `blocker` as there.
    pub fn occluded_parallel(
        &self,
        direction: Vec3,
        starts: &Ends,
        active: u64,
        blocker: &mut Blocker,
    ) -> u64 {
        let solid = |t, u, v| self.solid(t, u, v);
        self.world.occluded_parallel(direction, starts, active, blocker, &solid)
    }
}
