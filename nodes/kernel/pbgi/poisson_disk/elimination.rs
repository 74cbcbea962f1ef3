//! Weighted sample elimination (Yuksel 2015): of many candidates, drop again and again the most crowded one.

use super::grid::{Grid, Live};
use rayon::prelude::*;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

/// Candidates nearer than this to one that was taken before never come into question: most would be the first to be dropped.
const THIN: f32 = 0.5;
/// Power of the weight of a pair (alpha of the article).
const POWER: i32 = 8;
/// Beta of the article: pairs nearer than the distance that can be reached weigh no more than at it.
const NEAR: f32 = 0.6;

/// The `wanted` candidates that remain, or all if there are not more.
pub fn eliminate(grid: &Grid, wanted: usize) -> Live {
    let (mut live, left) = thin(grid, wanted);
    let least = NEAR;
    let pair = |distance: f32| (1.0 - distance.max(least)).max(0.0).powi(POWER);
    let crowded = |&slot: &u32| {
        let mut sum = 0.0;
        live.near(grid, slot, |_, distance| sum += pair(distance));
        sum
    };
    let sums: Vec<f32> = left.par_iter().map(crowded).collect();
    let mut crowding = vec![0.0; grid.place.len()];
    left.iter().zip(sums).for_each(|(&slot, sum)| crowding[slot as usize] = sum);

    // Crowding only falls, so that a stale entry of the heap is an upper bound.
    let entry = |slot: u32, crowding: f32| u64::from(crowding.to_bits()) << 32 | u64::from(!slot);
    let mut heap: BinaryHeap<u64> =
        left.iter().map(|&slot| entry(slot, crowding[slot as usize])).collect();
    while heap.len() > wanted {
        let Some(mut top) = heap.peek_mut() else { break };
        let slot = !(*top as u32);
        let now = entry(slot, crowding[slot as usize]);
        if now != *top {
            *top = now;
            continue;
        }
        PeekMut::pop(top);
        live.remove(grid, slot);
        live.near(grid, slot, |other, distance| {
            let crowding = &mut crowding[other as usize];
            *crowding = (*crowding - pair(distance)).max(0.0);
        });
    }
    live
}

/// Candidates that keep a little apart, ascending; all where too few do.
fn thin(grid: &Grid, wanted: usize) -> (Live, Vec<u32>) {
    let mut live = Live::none(grid);
    let mut left = Vec::new();
    for slot in 0..grid.place.len() as u32 {
        if !live.any_within(grid, slot, THIN) {
            live.add(grid, slot);
            left.push(slot);
        }
    }
    if left.len() >= wanted {
        (live, left)
    } else {
        (Live::all(grid), (0..grid.place.len() as u32).collect())
    }
}
