//! The nearest other centres of each centre, so that a search from a near centre looks at few (triangle inequality).

use super::lanes::{Eight, GROUP, Lanes, WIDTH, squared, squared_of_eight, wide};
use rayon::prelude::*;

/// Entries of all lists together at most, unless the lists would become shorter than `SHORTEST`.
const ALL: usize = 4 << 20;
/// Shortest list.
const SHORTEST: usize = 64;
/// Centres that move farthest and are compared with every list when centres move.
const JUMPERS: usize = 32;
/// One in so many squares tells where to cut.
const SAMPLE: usize = 16;
/// Room for the rounding of two distances: relative, and absolute where squares underflow.
pub const MARGIN: f32 = 1e-5;
/// See [`MARGIN`].
pub const LEAST: f32 = 1e-18;

/// Centres, in both layouts of `lanes`.
pub struct Centres {
    /// Numbers of a centre.
    pub dims: usize,
    /// Number of centres.
    pub count: usize,
    /// Centre by centre.
    pub padded: Vec<Eight>,
    /// By eights.
    pub blocked: Vec<Eight>,
}

impl Centres {
    /// One of them.
    #[inline(always)]
    pub fn get(&self, centre: u32, lanes: usize) -> &[Eight] {
        &self.padded[centre as usize * lanes..(centre as usize + 1) * lanes]
    }
}

/// Lists of the same length for all centres.
pub struct Neighbours {
    /// Entries of a list that are not padding.
    full: usize,
    /// Entries of one list, a multiple of [`GROUP`].
    length: usize,
    /// The centres, nearest first; padded with the owner.
    centre: Vec<u32>,
    /// Lower bounds of their distances from the owner, ascending; padded with infinity.
    distance: Vec<f32>,
    /// Lower bound, by owner, of the distance of all centres that are not in the list.
    beyond: Vec<f32>,
    /// What `beyond` was when all centres were last compared.
    beyond_then: Vec<f32>,
}

/// What one thread works with.
#[derive(Default)]
struct Room {
    squares: Vec<f32>,
    sample: Vec<u32>,
    /// Squared distance in the upper half, centre in the lower.
    order: Vec<u64>,
}

impl Neighbours {
    /// The lists of all `centres`, each compared with all.
    pub fn new(centres: &Centres) -> Self {
        let count = centres.count;
        let full = (count - 1).min((ALL / count).max(SHORTEST));
        let length = full.next_multiple_of(GROUP);
        let mut lists = Neighbours {
            full,
            length,
            centre: vec![0; count * length],
            distance: vec![f32::INFINITY; count * length],
            beyond: vec![f32::NEG_INFINITY; count],
            beyond_then: vec![f32::INFINITY; count],
        };
        lists.each(|room, owner, list| list.compare_with_all(room, owner, centres));
        lists
    }

    /// Follows the centres, each of which has moved by `steps`. A list is made anew if it has become shorter than `needed`.
    pub fn follow(&mut self, centres: &Centres, steps: &[f32], needed: &[f32]) {
        let mut order: Vec<u32> = (0..centres.count as u32).collect();
        order.sort_unstable_by(|&a, &b| steps[b as usize].total_cmp(&steps[a as usize]));
        let (jumpers, others) = order.split_at(JUMPERS.min(order.len()));
        let farthest = others.first().map_or(0.0, |&c| steps[c as usize]);
        let mut jumps = vec![false; centres.count];
        jumpers.iter().for_each(|&c| jumps[c as usize] = true);
        self.each(|room, owner, list| {
            let beyond = *list.beyond - (steps[owner] + farthest) * (1.0 + MARGIN) - LEAST;
            if beyond < needed[owner].min(0.9 * *list.beyond_then) {
                return list.compare_with_all(room, owner, centres);
            }
            let stay = list.centre[..list.full].iter().filter(|&&c| !jumps[c as usize]);
            let known = stay.chain(jumpers).copied().filter(|&c| c as usize != owner);
            room.order.clear();
            room.order.extend(known.map(u64::from));
            add_squares(owner as u32, centres, &mut room.order);
            room.order.sort_unstable();
            let dropped = room.order.get(list.full).map_or(f32::INFINITY, |&near| lower(near));
            list.set(owner, &room.order);
            *list.beyond = beyond.min(dropped);
        });
    }

    fn each(&mut self, work: impl Fn(&mut Room, usize, &mut List) + Sync) {
        let length = self.length.max(1);
        let full = self.full;
        self.centre
            .par_chunks_mut(length)
            .zip(self.distance.par_chunks_mut(length))
            .zip(&mut self.beyond)
            .zip(&mut self.beyond_then)
            .enumerate()
            .for_each_init(Room::default, |room, (owner, lists)| {
                let (((centre, distance), beyond), beyond_then) = lists;
                work(room, owner, &mut List { full, centre, distance, beyond, beyond_then });
            });
    }

    /// The list of `owner`: centres, lower bounds of their distances, and one for all other centres.
    #[inline(always)]
    pub fn of(&self, owner: usize) -> (&[[u32; GROUP]], &[[f32; GROUP]], f32) {
        let list = owner * self.length..(owner + 1) * self.length;
        (
            self.centre[list.clone()].as_chunks().0,
            self.distance[list].as_chunks().0,
            self.beyond[owner],
        )
    }
}

/// The list of one centre.
struct List<'a> {
    full: usize,
    centre: &'a mut [u32],
    distance: &'a mut [f32],
    beyond: &'a mut f32,
    beyond_then: &'a mut f32,
}

impl List<'_> {
    fn compare_with_all(&mut self, room: &mut Room, owner: usize, centres: &Centres) {
        let x = centres.get(owner as u32, centres.dims.div_ceil(WIDTH));
        room.squares.resize(centres.count.next_multiple_of(WIDTH), 0.0);
        squared_from_all(x, centres.dims, &centres.blocked, &mut room.squares);
        nearest_first(owner, self.full, centres.count, room);
        let all = self.full == centres.count - 1;
        let last = room.order.last().map_or(f32::NEG_INFINITY, |&last| lower(last));
        *self.beyond = if all { f32::INFINITY } else { last };
        *self.beyond_then = *self.beyond;
        self.set(owner, &room.order);
    }

    fn set(&mut self, owner: usize, order: &[u64]) {
        let length = self.full.min(order.len());
        for (at, &near) in order[..length].iter().enumerate() {
            (self.centre[at], self.distance[at]) = (near as u32, lower(near));
        }
        self.centre[length..].fill(owner as u32);
        self.distance[length..].fill(f32::INFINITY);
    }
}

/// Lower bound of the distance from the square in the upper half.
fn lower(near: u64) -> f32 {
    let distance = f32::from_bits((near >> 32) as u32).sqrt();
    (distance * (1.0 - MARGIN) - LEAST).max(0.0)
}

/// The `full` centres nearest to `owner`, ordered by squared distance and then by number, from the squares of all.
fn nearest_first(owner: usize, full: usize, count: usize, room: &mut Room) {
    let Room { squares, sample, order } = room;
    let squares = &squares[..count];
    let mut cut = cut(squares, full, sample);
    loop {
        order.clear();
        for (chunk, at) in squares.chunks(WIDTH).zip((0u64..).step_by(WIDTH)) {
            if chunk.iter().any(|&square| square <= cut) {
                let near = chunk
                    .iter()
                    .zip(at..)
                    .filter(|&(&square, c)| square <= cut && c != owner as u64);
                order.extend(near.map(|(square, c)| u64::from(square.to_bits()) << 32 | c));
            }
        }
        if order.len() >= full || cut == f32::INFINITY {
            break;
        }
        cut = f32::INFINITY;
    }
    if full < order.len() && full > 0 {
        order.select_nth_unstable(full - 1);
    }
    order.truncate(full);
    order.sort_unstable();
}

/// A square below which a little more than `full` of the `squares` probably are.
fn cut(squares: &[f32], full: usize, sample: &mut Vec<u32>) -> f32 {
    sample.clear();
    sample.extend(squares.iter().step_by(SAMPLE).map(|square| square.to_bits()));
    let rank = full * 5 / 4 / SAMPLE + 8;
    if rank >= sample.len() {
        return f32::INFINITY;
    }
    f32::from_bits(*sample.select_nth_unstable(rank).1)
}

wide! {
    /// The squared distances of `x` from all of `blocked`, `dims` lanes an eight.
    pub fn squared_from_all(x: &[Eight], dims: usize, blocked: &[Eight], squares: &mut [f32]) = from_all
}

#[inline(always)]
fn from_all<L: Lanes>(x: &[Eight], dims: usize, blocked: &[Eight], squares: &mut [f32]) {
    let (squares, _) = squares.as_chunks_mut::<WIDTH>();
    for (block, squares) in blocked.chunks_exact(dims).zip(squares) {
        *squares = squared_of_eight::<L>(x, block).store();
    }
}

wide! {
    /// Adds to each centre, in the upper half, its squared distance from `owner`.
    fn add_squares(owner: u32, centres: &Centres, order: &mut [u64]) = add
}

#[inline(always)]
fn add<L: Lanes>(owner: u32, centres: &Centres, order: &mut [u64]) {
    let lanes = centres.dims.div_ceil(WIDTH);
    let x = centres.get(owner, lanes);
    for four in order.chunks_mut(GROUP) {
        let mut others = [x; GROUP];
        for (other, &centre) in others.iter_mut().zip(&*four) {
            *other = centres.get(centre as u32, lanes);
        }
        for (near, square) in four.iter_mut().zip(squared::<L>(x, others)) {
            *near |= u64::from(square.to_bits()) << 32;
        }
    }
}
