//! Candidates in cells as wide as the distance within which they see each other.

use super::Place;
use glam::Vec3;
use rayon::prelude::*;

/// Facets whose normals have a smaller cosine than this face apart. A right angle is well above it.
const SAME_SIDE: f32 = -0.1;
/// Cells along an axis at most: three numbers below it fill a key.
const CELLS: u32 = 1 << 21;

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
}

impl Grid {
    /// Sorts places with no negative coordinates into cells of width 1, or wider where there would be too many along an axis.
    pub fn new(places: Vec<Place>) -> Self {
        let largest =
            places.par_iter().map(|p| p.position).reduce(|| Vec3::ZERO, Vec3::max).max_element();
        let width = (largest / (CELLS - 2) as f32).max(1.0);
        let mut order: Vec<(u64, u32)> = places
            .par_iter()
            .map(|place| key((place.position / width).to_array().map(|x| x as u32)))
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
        let neighbours: Vec<([u32; 27], usize)> =
            cells.par_iter().map(|&cell| table.around(cell)).collect();
        let mut around_start = vec![0];
        let mut around = Vec::new();
        for (cells, count) in &neighbours {
            around.extend_from_slice(&cells[..*count]);
            around_start.push(around.len() as u32);
        }
        Grid {
            place: order.iter().map(|&(_, i)| places[i as usize]).collect(),
            item: order.iter().map(|&(_, i)| i).collect(),
            cell,
            start,
            around_start,
            around,
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
    /// The slots of each cell, from its start in the grid; those that live are first.
    slots: Vec<u32>,
    /// Where those that live end.
    end: Vec<u32>,
}

impl Live {
    /// None of the places.
    pub fn none(grid: &Grid) -> Self {
        Live { slots: vec![0; grid.place.len()], end: grid.start[..grid.start.len() - 1].to_vec() }
    }

    /// All of them.
    pub fn all(grid: &Grid) -> Self {
        Live { slots: (0..grid.place.len() as u32).collect(), end: grid.start[1..].to_vec() }
    }

    /// Adds a place that is not among them.
    pub fn add(&mut self, grid: &Grid, slot: u32) {
        let end = &mut self.end[grid.cell[slot as usize] as usize];
        self.slots[*end as usize] = slot;
        *end += 1;
    }

    /// Takes away a place if it is among them.
    pub fn remove(&mut self, grid: &Grid, slot: u32) {
        let cell = grid.cell[slot as usize] as usize;
        let (start, end) = (grid.start[cell] as usize, &mut self.end[cell]);
        let live = &mut self.slots[start..*end as usize];
        if let Some(at) = live.iter().position(|&other| other == slot) {
            let last = live.len() - 1;
            live.swap(at, last);
            *end -= 1;
        }
    }

    /// Those of a cell.
    #[inline]
    pub fn of(&self, grid: &Grid, cell: u32) -> &[u32] {
        &self.slots[grid.start[cell as usize] as usize..self.end[cell as usize] as usize]
    }

    /// Calls `visit` with all that `slot` sees, except itself, and the distance of each, in a fixed order.
    #[inline(always)]
    pub fn near(&self, grid: &Grid, slot: u32, mut visit: impl FnMut(u32, f32)) {
        for &cell in grid.around(grid.cell[slot as usize]) {
            for &other in self.of(grid, cell) {
                if let Some(distance) = grid.distance(slot, other)
                    && other != slot
                {
                    visit(other, distance);
                }
            }
        }
    }

    /// Whether `slot`, which is not among them, sees one nearer than `distance`.
    #[inline(always)]
    pub fn any_within(&self, grid: &Grid, slot: u32, distance: f32) -> bool {
        let near = |&other: &u32| grid.distance(slot, other).is_some_and(|d| d < distance);
        grid.around(grid.cell[slot as usize]).iter().any(|&c| self.of(grid, c).iter().any(near))
    }
}

/// The bits of three coordinates interleaved, so that near cells are mostly near in memory.
fn key(cell: [u32; 3]) -> u64 {
    let spread = |x: u32| {
        let x = u64::from(x.min(CELLS - 1));
        let x = (x | x << 32) & 0x001f_0000_0000_ffff;
        let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    let [x, y, z] = cell.map(spread);
    x | y << 1 | z << 2
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
        let all = Live::all(&grid);
        for slot in 0..500 {
            let mut found = Vec::new();
            all.near(&grid, slot, |i, distance| found.push((grid.item[i as usize], distance)));
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
    fn what_is_added_lives_until_it_is_removed() {
        let at = |x: f32| Place { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y };
        let grid = Grid::new([0.1, 0.2, 0.3, 1.1].map(at).into());
        let mut live = Live::none(&grid);
        (0..4).for_each(|slot| live.add(&grid, slot));
        live.remove(&grid, 0);
        live.remove(&grid, 0);
        let mut seen = Vec::new();
        live.near(&grid, 1, |other, _| seen.push(other));
        seen.sort_unstable();
        assert_eq!(seen, [2, 3]);
        assert!(live.any_within(&grid, 0, 0.15) && !live.any_within(&grid, 0, 0.05));
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
        let all = Live::all(&grid);
        let mut seen = 0;
        (0..4).for_each(|slot| all.near(&grid, slot, |_, _| seen += 1));
        assert_eq!((seen, Grid::new(Vec::new()).place.len()), (2, 0));
    }
}
