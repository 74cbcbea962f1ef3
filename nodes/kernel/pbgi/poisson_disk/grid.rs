//! Candidates in cells as wide as the distance within which they see each other.

use super::Place;
use crate::kernel::morton;
use glam::Vec3;
use rayon::prelude::*;

/// Facets whose normals have a smaller cosine than this face apart. A right angle is well above it.
const SAME_SIDE: f32 = -0.1;
/// Cells along an axis at most.
const CELLS: u32 = 1 << morton::BITS;

/// Places sorted by cell; a place is named by its slot in this order.
pub struct Grid {
    /// The places.
    pub place: Vec<Place>,
    /// The number each had before.
    pub item: Vec<u32>,
    /// The cell of each slot.
    pub cell: Vec<u32>,
    /// The first slot of each cell, and the end of the last.
    pub start: Vec<u32>,
    /// The first of the cells around each cell (itself included) in `around`, and the end of the last.
    around_start: Vec<u32>,
    around: Vec<u32>,
    /// Cells whose coordinates are even and odd alike: no two of a class touch.
    pub classes: [Vec<u32>; 8],
}

impl Grid {
    /// Sorts places with no negative coordinates into cells of width 1, or wider where there would be too many along an axis.
    pub fn new(places: Vec<Place>) -> Self {
        let largest =
            places.par_iter().map(|p| p.position).reduce(|| Vec3::ZERO, Vec3::max).max_element();
        let width = (largest / (CELLS - 2) as f32).max(1.0);
        let mut order: Vec<(u64, u32)> = places
            .par_iter()
            .map(|place| morton::code((place.position / width).to_array().map(|x| x as u32)))
            .zip(0..places.len() as u32)
            .collect();
        order.par_sort_unstable();
        let cells: Vec<u64> = order.chunk_by(|a, b| a.0 == b.0).map(|cell| cell[0].0).collect();
        let mut start = vec![0];
        let mut cell = Vec::with_capacity(order.len());
        for (slots, at) in order.chunk_by(|a, b| a.0 == b.0).zip(0..) {
            cell.resize(cell.len() + slots.len(), at);
            start.push(cell.len() as u32);
        }
        let table = Table::new(&cells);
        let around_some = |cells: &[u64]| {
            let (mut counts, mut around) = (Vec::with_capacity(cells.len()), Vec::new());
            for &cell in cells {
                let (found, count) = table.around(cell);
                around.extend_from_slice(&found[..count]);
                counts.push(count as u32);
            }
            (counts, around)
        };
        let chunks: Vec<(Vec<u32>, Vec<u32>)> = cells.par_chunks(4096).map(around_some).collect();
        let mut around_start = vec![0];
        let mut around = Vec::new();
        for (counts, chunk) in chunks {
            for count in counts {
                around_start.push(around_start[around_start.len() - 1] + count);
            }
            around.extend(chunk);
        }
        let mut classes: [Vec<u32>; 8] = Default::default();
        // The lowest bits of the coordinates are those of the key.
        (0..).zip(&cells).for_each(|(at, key)| classes[(key & 7) as usize].push(at));
        Grid {
            place: order.iter().map(|&(_, i)| places[i as usize]).collect(),
            item: order.iter().map(|&(_, i)| i).collect(),
            cell,
            start,
            around_start,
            around,
            classes,
        }
    }

    /// The cells around `cell`, itself included.
    pub fn around(&self, cell: u32) -> &[u32] {
        let at = cell as usize;
        &self.around[self.around_start[at] as usize..self.around_start[at + 1] as usize]
    }

    /// The distance of two places that see each other: less than 1 apart and on the same side.
    #[inline(always)]
    pub fn distance(&self, a: u32, b: u32) -> Option<f32> {
        let [a, b] = [a, b].map(|slot| &self.place[slot as usize]);
        let square = a.position.distance_squared(b.position);
        (square < 1.0 && a.normal.dot(b.normal) > SAME_SIDE).then(|| square.sqrt())
    }
}

/// Some of the places of a grid, by cell.
pub struct Live {
    /// Their slots, ascending; a place is named by its index in this list.
    pub slots: Vec<u32>,
    /// The first of each cell, and the end of the last.
    start: Vec<u32>,
}

impl Live {
    /// Those with these slots, which ascend.
    pub fn those(grid: &Grid, slots: Vec<u32>) -> Self {
        let mut at = 0;
        let first = |&start: &u32| {
            at += slots[at..].iter().take_while(|&&slot| slot < start).count();
            at as u32
        };
        let start = grid.start.iter().map(first).collect();
        Live { slots, start }
    }

    /// The indices of those in the cells around a cell, itself included.
    #[inline(always)]
    pub fn around(&self, grid: &Grid, cell: u32) -> impl Iterator<Item = u32> {
        let of_cell = |&cell: &u32| self.start[cell as usize]..self.start[cell as usize + 1];
        grid.around(cell).iter().flat_map(of_cell)
    }

    /// Calls `visit` with all that the place at `slot` sees, except itself, and the distance of each, in a fixed order.
    #[inline(always)]
    pub fn near(&self, grid: &Grid, slot: u32, mut visit: impl FnMut(u32, f32)) {
        for at in self.around(grid, grid.cell[slot as usize]) {
            let other = self.slots[at as usize];
            if let Some(distance) = grid.distance(slot, other)
                && other != slot
            {
                visit(at, distance);
            }
        }
    }
}

/// Where a key is in a list of keys: open addressing.
struct Table<'a> {
    keys: &'a [u64],
    places: Vec<u32>,
}

impl<'a> Table<'a> {
    fn new(keys: &'a [u64]) -> Self {
        let mut table =
            Table { keys, places: vec![u32::MAX; (2 * keys.len()).next_power_of_two()] };
        for (&key, at) in keys.iter().zip(0..) {
            let mut place = table.first(key);
            while table.places[place] != u32::MAX {
                place = (place + 1) & (table.places.len() - 1);
            }
            table.places[place] = at;
        }
        table
    }

    fn first(&self, key: u64) -> usize {
        (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & (self.places.len() - 1)
    }

    fn find(&self, key: u64) -> Option<u32> {
        let mut place = self.first(key);
        loop {
            let at = self.places[place];
            if at == u32::MAX {
                return None;
            }
            if self.keys[at as usize] == key {
                return Some(at);
            }
            place = (place + 1) & (self.places.len() - 1);
        }
    }

    /// The cells of the list around a cell, and how many they are.
    fn around(&self, cell: u64) -> ([u32; 27], usize) {
        // One axis' bits; steps along an axis carry through the bits of the others when those are all set.
        let axes = [0, 1, 2].map(|axis| 0x1249_2492_4924_9249u64 << axis);
        let mut steps = [[0u64; 3]; 3];
        for (axis, mask) in axes.into_iter().enumerate() {
            let own = cell & mask;
            let up = (own | !mask).wrapping_add(1 << axis) & mask;
            let down = own.wrapping_sub(1 << axis) & mask;
            steps[axis] = [down, own, up];
        }
        let (mut found, mut count) = ([0; 27], 0);
        for z in steps[2] {
            for y in steps[1] {
                for x in steps[0] {
                    if let Some(at) = self.find(x | y | z) {
                        found[count] = at;
                        count += 1;
                    }
                }
            }
        }
        (found, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_places_are_those_of_comparing_all() {
        let place = |i: u32| {
            let [x, y, z, side] = crate::kernel::surface_sampling::uniform(i, 0, 3);
            let normal = if side < 0.5 { Vec3::X } else { Vec3::NEG_X };
            Place { position: Vec3::new(5.0 * x, 3.0 * y, 2.5 * z), normal }
        };
        let places: Vec<Place> = (0..500).map(place).collect();
        let grid = Grid::new(places.clone());
        let all = Live::those(&grid, (0..500).collect());
        for slot in 0..500 {
            let mut found = Vec::new();
            all.near(&grid, slot, |at, distance| {
                found.push((grid.item[all.slots[at as usize] as usize], distance));
            });
            found.sort_by_key(|f| f.0);
            let own = grid.item[slot as usize];
            let of = &places[own as usize];
            let expected: Vec<(u32, f32)> = (0..500)
                .filter(|&i| i != own && places[i as usize].normal == of.normal)
                .map(|i| (i, places[i as usize].position.distance_squared(of.position)))
                .filter(|d| d.1 < 1.0)
                .map(|(i, square)| (i, square.sqrt()))
                .collect();
            assert_eq!(found, expected);
            assert!(expected.len() > 2);
        }
    }

    #[test]
    fn only_those_that_live_are_seen() {
        let at = |x: f32| Place { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y };
        let grid = Grid::new([0.1, 0.2, 0.3, 1.1, 5.0].map(at).into());
        let live = Live::those(&grid, vec![1, 2, 3, 4]);
        for (slot, expected) in [(0, &[1, 2][..]), (1, &[2, 3]), (3, &[1, 2]), (4, &[])] {
            let mut seen = Vec::new();
            live.near(&grid, slot, |other, _| seen.push(live.slots[other as usize]));
            seen.sort_unstable();
            assert_eq!(seen, expected);
        }
    }

    #[test]
    fn cells_of_a_class_do_not_touch() {
        let place = |i: u32| {
            let [x, y, z, _] = crate::kernel::surface_sampling::uniform(i, 1, 3);
            Place { position: Vec3::new(x, y, z) * 7.0, normal: Vec3::X }
        };
        let grid = Grid::new((0..3000).map(place).collect());
        let cells: usize = grid.classes.iter().map(Vec::len).sum();
        assert_eq!([cells, grid.start.len() - 1], [343; 2]);
        for class in &grid.classes {
            for &cell in class {
                let touching = grid.around(cell).iter().filter(|other| class.contains(other));
                assert!(touching.eq(&[cell]), "only itself");
            }
        }
    }

    #[test]
    fn steps_carry() {
        let places: Vec<Place> = [3.5, 4.5, 7.99, 8.01]
            .map(|x| Place { position: Vec3::splat(x), normal: Vec3::Y })
            .into();
        let grid = Grid::new(places);
        let around: Vec<usize> = (0..4).map(|cell| grid.around(cell).len()).collect();
        assert_eq!(around, [2, 2, 2, 2]);
    }

    #[test]
    fn long_and_thin_is_not_too_long() {
        let at = |x: f32| Place { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y };
        let grid = Grid::new([0.0, 0.5, 1e7, 1e7 + 1.0].map(at).into());
        let all = Live::those(&grid, (0..4).collect());
        let mut seen = 0;
        (0..4).for_each(|slot| all.near(&grid, slot, |_, _| seen += 1));
        assert_eq!((seen, Grid::new(Vec::new()).place.len()), (2, 0));
    }
}
