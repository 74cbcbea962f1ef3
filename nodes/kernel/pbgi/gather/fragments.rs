//! The local depth buffer of a receiver: what covers each cell, sorted by depth.

use glam::Vec3;

/// What covers a part of a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fragment {
    cell: u32,
    depth: f32,
    coverage: f32,
    radiance: Vec3,
}

/// The fragments of one receiver; kept from receiver to receiver, so that gathering allocates nothing.
#[derive(Debug, Default)]
pub(super) struct Fragments {
    list: Vec<Fragment>,
    /// Depth of the nearest fragment that fills a cell: what lies behind it is not seen.
    full: Vec<f32>,
    /// Ends of the cells' shares of `order`.
    end: Vec<u32>,
    /// Depth and index of each fragment, cell by cell.
    order: Vec<u64>,
}

impl Fragments {
    /// Empties all of `cells` cells.
    pub(super) fn clear(&mut self, cells: usize) {
        self.list.clear();
        self.full.clear();
        self.full.resize(cells, f32::INFINITY);
    }

    /// Covers a share of a cell (more than 1 is all of it) at a depth, which must not be negative, with what sends
    /// `radiance` to the receiver.
    #[inline]
    pub(super) fn cover(&mut self, cell: usize, depth: f32, coverage: f32, radiance: Vec3) {
        // A coverage that is no number is none.
        if depth <= self.full[cell] && coverage > 0.0 {
            if coverage >= 1.0 {
                self.full[cell] = depth;
            }
            self.list.push(Fragment { cell: cell as u32, depth, coverage, radiance });
        }
    }

    /// The number of fragments.
    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    /// Sorts the fragments by cell and depth; of equal depths the one that came first is in front.
    pub(super) fn sort(&mut self) {
        let Fragments { list, full, end, order } = self;
        end.clear();
        end.resize(full.len() + 1, 0);
        for fragment in list.iter() {
            end[fragment.cell as usize + 1] += 1;
        }
        for cell in 1..end.len() {
            end[cell] += end[cell - 1];
        }
        // Entering them moves the start of each cell to its end, which is where the next one started.
        order.clear();
        order.resize(list.len(), 0);
        for (i, fragment) in list.iter().enumerate() {
            let at = &mut end[fragment.cell as usize];
            // The bits of floats that are not negative are in the order of the floats.
            order[*at as usize] = u64::from(fragment.depth.to_bits()) << 32 | i as u64;
            *at += 1;
        }
        let mut start = 0;
        for &end in &end[..full.len()] {
            order[start..end as usize].sort_unstable();
            start = end as usize;
        }
    }

    /// What a cell shows, front to back until it is full, which it is from a coverage of `full` on: radiance times
    /// coverage, and the share that nothing covers. [`Fragments::sort`] must have run.
    #[inline]
    pub(super) fn composite(&self, cell: usize, full: f32) -> (Vec3, f32) {
        let start = if cell == 0 { 0 } else { self.end[cell - 1] } as usize;
        let (mut radiance, mut sum, mut covered) = (Vec3::ZERO, 0.0, 0.0);
        for &key in &self.order[start..self.end[cell] as usize] {
            let fragment = &self.list[key as u32 as usize];
            sum += fragment.coverage;
            let now = closed(sum, full);
            radiance += fragment.radiance * (now - covered);
            covered = now;
            if covered >= 1.0 {
                break;
            }
        }
        (radiance, 1.0 - covered)
    }
}

/// How much of a cell is covered where the coverage adds up to `sum`: the sum itself while it is small, all from `full`
/// on, and between them a line that is a third steeper.
#[inline]
pub(super) fn closed(sum: f32, full: f32) -> f32 {
    if sum >= full { 1.0 } else { sum.max(1.0 - (full - sum) * (4.0 / 3.0)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_first_until_a_cell_is_full() {
        let mut fragments = Fragments::default();
        for _ in 0..2 {
            fragments.clear(3);
            fragments.cover(1, 3.0, 0.9, Vec3::Z);
            fragments.cover(1, 1.0, 0.25, Vec3::X);
            fragments.cover(1, 2.0, 0.5, Vec3::Y);
            fragments.cover(2, 1.0, 0.5, Vec3::ONE);
            fragments.sort();
            assert_eq!(fragments.composite(0, 1.0), (Vec3::ZERO, 1.0));
            assert_eq!(fragments.composite(1, 1.0), (Vec3::new(0.25, 0.5, 0.25), 0.0));
            assert_eq!(fragments.composite(2, 1.0), (Vec3::splat(0.5), 0.5));
        }
    }

    #[test]
    fn nothing_is_kept_behind_what_fills_a_cell() {
        let mut fragments = Fragments::default();
        fragments.clear(1);
        fragments.cover(0, 2.0, 1.5, Vec3::X);
        fragments.cover(0, 3.0, 0.5, Vec3::Y);
        fragments.cover(0, 1.0, 0.5, Vec3::Z);
        fragments.cover(0, 0.5, f32::NAN, Vec3::ONE);
        fragments.sort();
        assert_eq!(fragments.len(), 2);
        assert_eq!(fragments.composite(0, 1.0), (Vec3::new(0.5, 0.0, 0.5), 0.0));
    }

    #[test]
    fn of_equal_depths_the_first_is_in_front() {
        let mut fragments = Fragments::default();
        fragments.clear(1);
        fragments.cover(0, 2.0, 0.75, Vec3::X);
        fragments.cover(0, 2.0, 0.75, Vec3::Y);
        fragments.sort();
        assert_eq!(fragments.composite(0, 1.0).0, Vec3::new(0.75, 0.25, 0.0));
    }

    #[test]
    fn small_gaps_close_without_a_step() {
        for full in [0.8, 0.9, 1.0] {
            assert_eq!((closed(0.0, full), closed(0.1, full), closed(full, full)), (0.0, 0.1, 1.0));
            for i in 0..1000 {
                let (a, b) = (i as f32 / 1000.0, (i + 1) as f32 / 1000.0);
                let step = closed(b, full) - closed(a, full);
                assert!(
                    (0.000_9..=0.001_4).contains(&step) || a >= full - 0.001,
                    "{full} {a}: {step}"
                );
                assert!(closed(a, full) >= a);
            }
        }
    }
}
