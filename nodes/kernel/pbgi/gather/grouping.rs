//! Receivers that walk together: the closer they are, the more of what one looks at the others look at, too.

use crate::kernel::element::Receiver;
use glam::Vec3;

/// How far apart normals are that differ by a unit, in sizes of the box around all receivers.
const TURN: f32 = 0.5;

/// Reorders the numbers `order` of receivers so that runs of `size` (a power of two), counted from its start, are close
/// to each other in place and normal: halved along the longest side of the box around them.
pub(super) fn group(order: &mut [u32], receivers: &[Receiver], size: usize) {
    let [low, high] = corners(order.iter().map(|&i| receivers[i as usize].position));
    let turn = (high - low).max_element() * TURN;
    split(order, receivers, turn, size);
}

fn split(order: &mut [u32], receivers: &[Receiver], turn: f32, size: usize) {
    if order.len() <= size {
        return;
    }
    let places = corners(order.iter().map(|&i| receivers[i as usize].position));
    let normals = corners(order.iter().map(|&i| receivers[i as usize].normal));
    let (sides, turns) = (places[1] - places[0], (normals[1] - normals[0]) * turn);
    // The first half is a whole number of runs, and a power of two of them.
    let half = (order.len().div_ceil(size).next_power_of_two() / 2) * size;
    let by_place = sides.max_element() >= turns.max_element();
    let axis = if by_place { sides.max_position() } else { turns.max_position() };
    let key = |i: u32| {
        let receiver = &receivers[i as usize];
        if by_place { receiver.position[axis] } else { receiver.normal[axis] }
    };
    order.select_nth_unstable_by(half, |&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
    let (left, right) = order.split_at_mut(half);
    split(left, receivers, turn, size);
    split(right, receivers, turn, size);
}

/// Corners of the box around points.
fn corners(points: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    let none = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points.fold(none, |[low, high], p| [low.min(p), high.max(p)])
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{noise, white};
    use super::*;

    #[test]
    fn neighbours_come_together_and_all_remain() {
        // Two walls in turns, each from left to right.
        let receivers: Vec<Receiver> = (0..61)
            .map(|i| {
                let wall = if i % 2 == 0 { Vec3::X } else { Vec3::Y };
                white(Vec3::new(i as f32 * 0.01, noise(i) * 1e-3, 0.0), wall)
            })
            .collect();
        let mut order: Vec<u32> = (0..61).collect();
        group(&mut order, &receivers, 8);
        let mut mixed = 0;
        for run in order.chunks(8) {
            let of_x = run.iter().filter(|i| *i % 2 == 0).count();
            mixed += usize::from(of_x > 0 && of_x < run.len());
            let spread = run.iter().max().unwrap() - run.iter().min().unwrap();
            assert!(spread < 40, "{run:?}");
        }
        assert!(mixed <= 1, "{mixed}");
        order.sort_unstable();
        assert!(order.into_iter().eq(0..61));
    }
}
