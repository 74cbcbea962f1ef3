//! Weighted sample elimination (Yuksel 2015): of many candidates, drop again and again the most crowded one.

use super::grid::{Grid, Live};
use rayon::prelude::*;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

/// Candidates nearer than this to one that was taken before never come into question: most would be the first to be dropped.
const THIN: f32 = 0.45;
/// Where layers lie so close that too few are left at this distance, it shrinks by this factor, down to the least.
const SHRINK: f32 = 0.7;
const LEAST: f32 = 1e-3;
/// Candidates see each other within this many of that distance, so that each sees few, and at most as far as the grid tells.
const SEEN: f32 = 4.0;
/// Power of the weight of a pair (alpha of the article).
const POWER: i32 = 8;
/// Beta of the article: pairs nearer than the distance that can be reached weigh no more than at it.
const NEAR: f32 = 0.6;
/// Cells that are thinned out as one piece of work.
const CHUNK: usize = 1024;
/// Candidates of a block.
const BLOCK: usize = 4096;
/// One in so many of the wanted is what the last step drops.
const LAST: usize = 128;
/// Crowding of what is dropped.
const GONE: f32 = -1.0;

/// The `wanted` candidates that remain, or all if there are not more.
///
/// Most are dropped block by block: in each round every block drops, most crowded first, those above a bound that leaves some for
/// the next round, and then tells the other blocks. So the order differs from that of the article only at the borders of blocks.
/// The last step keeps to it everywhere.
pub fn eliminate(grid: &Grid, wanted: usize) -> Live {
    let (left, reach) = enough(grid, wanted);
    let indices: Vec<u32> = (0..left.slots.len() as u32).collect();
    let blocks: Vec<Block> =
        indices.par_chunks(BLOCK).map(|some| Block::of(grid, &left, some, reach)).collect();
    let seen = |at: u32| blocks[at as usize / BLOCK].seen(at as usize % BLOCK);
    let sum = |&at: &u32| seen(at).iter().fold(0.0, |sum, &(_, weight)| sum + weight);
    let mut crowding: Vec<f32> = indices.par_iter().map(sum).collect();
    let mut surplus = crowding.len().saturating_sub(wanted);
    while surplus > wanted / LAST {
        let Some(bound) = bound(&crowding, surplus / 4) else { break };
        let drop = |(first, crowding): (&[u32], &mut [f32])| {
            drop_greatest(crowding, first[0], bound, usize::MAX, seen)
        };
        let own = indices.par_chunks(BLOCK).zip(crowding.par_chunks_mut(BLOCK));
        let round: Vec<(usize, Vec<(u32, f32)>)> = own.map(drop).collect();
        for (dropped, told) in round {
            surplus -= dropped;
            told.iter().for_each(|&(other, weight)| relieve(&mut crowding[other as usize], weight));
        }
    }
    drop_greatest(&mut crowding, 0, GONE, surplus, seen);
    let remain = left.slots.iter().zip(crowding).filter(|slot| slot.1 != GONE).map(|slot| *slot.0);
    Live::those(grid, remain.collect())
}

/// Drops up to `most` candidates, the most crowded first, as long as one is above `bound`: of those whose `crowding` this is, the
/// first of which has the index `first`. Gives their number, and by how much what they have seen elsewhere is less crowded.
fn drop_greatest<'a>(
    crowding: &mut [f32],
    first: u32,
    bound: f32,
    most: usize,
    seen: impl Fn(u32) -> &'a [(u32, f32)],
) -> (usize, Vec<(u32, f32)>) {
    // Crowding only falls, so that a stale entry of the heap is an upper bound.
    let entry = |at: u32, crowding: f32| u64::from(crowding.to_bits()) << 32 | u64::from(!at);
    let above = (0..).zip(&*crowding).filter(|own| *own.1 > bound);
    let mut heap: BinaryHeap<u64> = above.map(|(at, &crowding)| entry(at, crowding)).collect();
    let (mut dropped, mut told) = (0, Vec::new());
    while dropped < most {
        let Some(mut top) = heap.peek_mut() else { break };
        let at = !(*top as u32);
        let now = crowding[at as usize];
        if now <= bound {
            PeekMut::pop(top);
            continue;
        }
        if entry(at, now) != *top {
            *top = entry(at, now);
            continue;
        }
        PeekMut::pop(top);
        crowding[at as usize] = GONE;
        dropped += 1;
        for &(other, weight) in seen(first + at) {
            match crowding.get_mut(other.wrapping_sub(first) as usize) {
                Some(crowding) => relieve(crowding, weight),
                None => told.push((other, weight)),
            }
        }
    }
    (dropped, told)
}

fn relieve(crowding: &mut f32, weight: f32) {
    if *crowding != GONE {
        *crowding = (*crowding - weight).max(0.0);
    }
}

/// A bound above which some of the candidates are, but at most so many.
fn bound(crowding: &[f32], most: usize) -> Option<f32> {
    // Counts by the upper half of the bits, which order numbers that are not negative.
    let count = |crowding: &[f32]| {
        let mut counts = vec![0usize; 1 << 15];
        let live = crowding.iter().filter(|&&crowding| crowding != GONE);
        live.for_each(|crowding| counts[(crowding.to_bits() >> 16) as usize] += 1);
        counts
    };
    let add = |mut sums: Vec<usize>, counts: Vec<usize>| {
        sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        sums
    };
    let counts = crowding.par_chunks(64 * BLOCK).map(count).reduce_with(add)?;
    let mut above = 0;
    let lowest = (0..counts.len()).rev().find(|&at| {
        above += counts[at];
        above > most
    })?;
    let bound = f32::from_bits(((lowest as u32 + 1) << 16) - 1);
    (above > counts[lowest]).then_some(bound)
}

/// Whom some consecutive candidates see.
struct Block {
    /// Where the pairs of each begin, and those of the last end.
    start: Vec<u32>,
    /// Index of the one seen, and weight.
    pairs: Vec<(u32, f32)>,
}

impl Block {
    fn of(grid: &Grid, left: &Live, indices: &[u32], reach: f32) -> Self {
        let mut block = Block { start: vec![0], pairs: Vec::new() };
        for &at in indices {
            left.near(grid, left.slots[at as usize], |other, distance| {
                let distance = distance / reach;
                if distance < 1.0 {
                    block.pairs.push((other, (1.0 - distance.max(NEAR)).powi(POWER)));
                }
            });
            block.start.push(block.pairs.len() as u32);
        }
        block.pairs.shrink_to_fit();
        block
    }

    fn seen(&self, at: usize) -> &[(u32, f32)] {
        &self.pairs[self.start[at] as usize..self.start[at + 1] as usize]
    }
}

/// At least `wanted` candidates that keep apart as far as so many can, or all; and the distance within which they see each other.
fn enough(grid: &Grid, wanted: usize) -> (Live, f32) {
    let mut apart = THIN;
    loop {
        let left = thin(grid, apart);
        if left.len() >= wanted {
            return (Live::those(grid, left), (SEEN * apart).min(1.0));
        }
        if apart < LEAST {
            let all = (0..grid.place.len() as u32).collect();
            return (Live::those(grid, all), SEEN * apart);
        }
        apart *= SHRINK;
    }
}

/// Candidates at least `apart`, ascending: each that is not too near to one taken before. Cells of a class do not touch, so that
/// their order does not matter.
fn thin(grid: &Grid, apart: f32) -> Vec<u32> {
    let cells = grid.start.len() - 1;
    // Those taken of each cell, from where it begins.
    let mut taken = vec![0; grid.place.len()];
    let mut end = grid.start[..cells].to_vec();
    for class in &grid.classes {
        let of_cell = |found: &mut Vec<u32>, cell: u32| {
            let before = found.len();
            for slot in grid.start[cell as usize]..grid.start[cell as usize + 1] {
                let near = |&other: &u32| grid.distance(slot, other).is_some_and(|d| d < apart);
                let near_in = |&cell: &u32| {
                    let cell = cell as usize;
                    taken[grid.start[cell] as usize..end[cell] as usize].iter().any(near)
                };
                if !found[before..].iter().any(near) && !grid.around(cell).iter().any(near_in) {
                    found.push(slot);
                }
            }
        };
        let of_some = |cells: &[u32]| {
            let mut found = Vec::new();
            cells.iter().for_each(|&cell| of_cell(&mut found, cell));
            found
        };
        let found: Vec<Vec<u32>> = class.par_chunks(CHUNK).map(of_some).collect();
        for slot in found.into_iter().flatten() {
            let end = &mut end[grid.cell[slot as usize] as usize];
            taken[*end as usize] = slot;
            *end += 1;
        }
    }
    let of_cell = |cell: usize| &taken[grid.start[cell] as usize..end[cell] as usize];
    (0..cells).flat_map(of_cell).copied().collect()
}
