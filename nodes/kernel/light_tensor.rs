//! The lighting tensor of one frame, element by element, row by row, column by column
//! (Hašan et al. 2008, section 4.2), with visibility by rays.

use super::element::{Light, Receiver, element, faces};
use super::morton;
use super::stage::Stage;
use super::tile::Tile;
use super::visibility::{Blocker, Ends};
use crate::data::{LightKind, Lights};
use glam::Vec3;

/// Access to one frame of the lighting tensor. `row(i)[j]`, `column(j)[i]` and `element(i, j)` are
/// the same number, apart from grazing shadow rays.
pub trait LightTensor {
    /// Radiance that light `j` adds to a receiver, visibility included.
    fn element(&self, receiver: &Receiver, light: usize) -> Vec3;
    /// That of every light, in the order of the list, into `row`.
    fn row(&self, receiver: &Receiver, row: &mut [Vec3]);
    /// That of light `j` on the receivers of a tile, into `column`; gives which of them it reaches. A tile that the
    /// light does not reach at all leaves `column` as it was. `blocker` is what hid the light from the tile before.
    fn column(
        &self,
        light: usize,
        tile: &Tile<'_>,
        blocker: &mut Blocker,
        column: &mut [Vec3],
    ) -> u64;
}

/// The lighting tensor by rays on the CPU. Rows and columns trace packets that share their end point.
pub struct RayTensor<'a> {
    stage: &'a Stage,
    lights: Vec<Light>,
    /// Lights that emit, in an order in which neighbours are close.
    order: Vec<u32>,
    /// Distance at which a directional light is taken to stand, metres.
    far: f32,
}

impl<'a> RayTensor<'a> {
    /// The tensor of the frame posed on `stage`, lit by `lights`.
    pub fn new(stage: &'a Stage, lights: &Lights) -> Self {
        let lights: Vec<Light> = (0..lights.kind.len()).map(|j| Light::at(lights, j)).collect();
        let geometry = stage.geometry();
        let key = |light: &Light| match light.kind {
            LightKind::Directional => (1, code(light.direction * 0.5 + 0.5)),
            _ => (0, code((light.position - geometry.centre) / geometry.diagonal + 0.5)),
        };
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        order.retain(|&j| lights[j as usize].emission != Vec3::ZERO);
        order.sort_by_cached_key(|&j| key(&lights[j as usize]));
        let far = 4.0 * geometry.diagonal;
        RayTensor { stage, lights, order, far }
    }

    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.lights.len()
    }

    /// Receivers as [`LightTensor::column`] takes them.
    pub fn tile<'r>(&self, receivers: &'r [Receiver]) -> Tile<'r> {
        Tile::new(receivers, self.stage.bias())
    }

    fn end(&self, start: Vec3, light: &Light) -> Vec3 {
        light.end(self.stage.bias()).unwrap_or(start - light.direction * self.far)
    }
}

impl LightTensor for RayTensor<'_> {
    fn element(&self, receiver: &Receiver, light: usize) -> Vec3 {
        let light = &self.lights[light];
        if !faces(receiver, light) {
            return Vec3::ZERO;
        }
        let start = receiver.lifted(self.stage.bias());
        let blocked = match light.kind {
            LightKind::Directional => self.stage.occluded_along(start, -light.direction),
            _ => self.stage.occluded(start, self.end(start, light)),
        };
        if blocked { Vec3::ZERO } else { element(receiver, light) }
    }

    fn row(&self, receiver: &Receiver, row: &mut [Vec3]) {
        row.fill(Vec3::ZERO);
        let start = receiver.lifted(self.stage.bias());
        let (mut packet, mut blocker) = (Packet::new(), Blocker::default());
        for &j in &self.order {
            let light = &self.lights[j as usize];
            if faces(receiver, light) {
                packet.push(j, self.end(start, light));
                if packet.is_full() {
                    packet.visible(
                        |ends, active| self.stage.occluded_from(start, ends, active, &mut blocker),
                        |j| {
                            row[j as usize] = element(receiver, &self.lights[j as usize]);
                        },
                    );
                }
            }
        }
        packet.visible(
            |ends, active| self.stage.occluded_from(start, ends, active, &mut blocker),
            |j| {
                row[j as usize] = element(receiver, &self.lights[j as usize]);
            },
        );
    }

    fn column(
        &self,
        light: usize,
        tile: &Tile<'_>,
        blocker: &mut Blocker,
        column: &mut [Vec3],
    ) -> u64 {
        let light = &self.lights[light];
        let facing = tile.facing(light);
        if facing == 0 {
            return 0;
        }
        let blocked = match light.end(self.stage.bias()) {
            Some(origin) => self.stage.occluded_from(origin, &tile.lifted, facing, blocker),
            None => self.stage.occluded_parallel(-light.direction, &tile.lifted, facing, blocker),
        };
        let lit = facing & !blocked;
        if lit != 0 {
            for (i, (element, receiver)) in column.iter_mut().zip(tile.receivers).enumerate() {
                let reached = lit >> i & 1 == 1;
                *element = if reached { self::element(receiver, light) } else { Vec3::ZERO };
            }
        }
        lit
    }
}

/// Up to 64 end points that wait for one visibility query, each with the index it belongs to.
struct Packet {
    ends: Ends,
    index: [u32; Ends::CAPACITY],
    len: usize,
}

impl Packet {
    fn new() -> Self {
        Packet { ends: Ends::new(), index: [0; Ends::CAPACITY], len: 0 }
    }

    fn is_full(&self) -> bool {
        self.len == Ends::CAPACITY
    }

    fn push(&mut self, index: u32, end: Vec3) {
        self.ends.set(self.len, end);
        self.index[self.len] = index;
        self.len += 1;
    }

    /// Asks which are blocked, calls `shade` with the index of each that is not, and is empty again.
    fn visible(&mut self, blocked: impl FnOnce(&Ends, u64) -> u64, mut shade: impl FnMut(u32)) {
        if self.len == 0 {
            return;
        }
        let active = u64::MAX >> (Ends::CAPACITY - self.len);
        let blocked = blocked(&self.ends, active);
        (0..self.len).filter(|k| blocked >> k & 1 == 0).for_each(|k| shade(self.index[k]));
        self.len = 0;
    }
}

/// The Morton code of a point in the unit cube, ten bits an axis.
fn code(point: Vec3) -> u64 {
    morton::code(point.to_array().map(|x| (x.clamp(0.0, 1.0) * 1023.0) as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::fixtures::{cosine_lights, room_receivers, room_stage};

    #[test]
    fn row_column_and_element_agree() {
        let stage = room_stage();
        let lights = cosine_lights(300, 5);
        let tensor = RayTensor::new(&stage, &lights);
        let receivers = room_receivers(&stage, 64, 9);
        let mut rows = vec![vec![Vec3::ZERO; tensor.lights()]; receivers.len()];
        receivers.iter().zip(&mut rows).for_each(|(receiver, row)| tensor.row(receiver, row));
        let row_element = |i: usize, j: usize| rows[i][j];
        let tile = tensor.tile(&receivers);
        let (mut lit, mut dark) = (0, 0);
        for j in 0..tensor.lights() {
            let mut column = vec![Vec3::ZERO; receivers.len()];
            tensor.column(j, &tile, &mut Blocker::default(), &mut column);
            for (i, receiver) in receivers.iter().enumerate() {
                let single = tensor.element(receiver, j);
                assert_eq!(row_element(i, j), column[i], "receiver {i}, light {j}");
                assert_eq!(column[i], single, "receiver {i}, light {j}");
                *(if single == Vec3::ZERO { &mut dark } else { &mut lit }) += 1;
            }
        }
        assert!(lit > 1000 && dark > 1000, "the scene must have light and shadow: {lit} {dark}");
    }
}
