//! The lighting tensor of one frame, element by element, row by row, column by column
//! (Hašan et al. 2008, section 4.2), with visibility by rays.

use super::element::{Light, LightLanes, Receiver, ReceiverLanes, element, faces};
use super::lanes::{Lanes, Portable, WIDTH};
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
    fn column(&self, light: usize, tile: &Tile, blocker: &mut Blocker, column: &mut [Vec3]) -> u64;
}

/// The lighting tensor by rays on the CPU. Rows and columns trace packets that share their end point.
pub struct RayTensor<'a> {
    stage: &'a Stage,
    lights: Vec<Light>,
    /// Lights that emit, in an order in which neighbours are close.
    groups: Vec<Group>,
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
        let group = |index: &[u32]| Group::new(&lights, index);
        let groups = order.chunks(WIDTH).map(group).collect();
        let far = 4.0 * geometry.diagonal;
        RayTensor { stage, lights, groups, far }
    }

    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.lights.len()
    }

    /// Receivers as [`LightTensor::column`] takes them.
    pub fn tile(&self, receivers: &[Receiver]) -> Tile {
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
        for group in &self.groups {
            let facing = group.facing(receiver);
            for (_, &j) in
                group.index.iter().enumerate().filter(|(lane, _)| facing >> lane & 1 == 1)
            {
                packet.push(j, self.end(start, &self.lights[j as usize]));
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

    fn column(&self, light: usize, tile: &Tile, blocker: &mut Blocker, column: &mut [Vec3]) -> u64 {
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
            tile.shade(light, lit, column);
        }
        lit
    }
}

/// Up to eight lights, side by side, and their numbers.
struct Group {
    lights: LightLanes<[f32; WIDTH]>,
    index: [u32; WIDTH],
}

impl Group {
    fn new(lights: &[Light], index: &[u32]) -> Self {
        let members: Vec<Light> = index.iter().map(|&j| lights[j as usize]).collect();
        // Lanes without a light emit nothing, so that their number is never asked for.
        let index = std::array::from_fn(|lane| index.get(lane).copied().unwrap_or(u32::MAX));
        Group { lights: LightLanes::of(&members), index }
    }

    /// Bit i is what [`faces`] says of a receiver and light i.
    fn facing(&self, receiver: &Receiver) -> u32 {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been found to have what the function is compiled for.
            return unsafe { self.facing_with_avx2(receiver) };
        }
        self.facing_lanes::<Portable>(receiver)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn facing_with_avx2(&self, receiver: &Receiver) -> u32 {
        self.facing_lanes::<super::lanes::Avx2>(receiver)
    }

    #[inline(always)]
    fn facing_lanes<L: Lanes>(&self, receiver: &Receiver) -> u32 {
        ReceiverLanes::<L>::splat(receiver).faces(&self.lights.lanes())
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
